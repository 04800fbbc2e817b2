"""Linear controls: two states each, the control as it is and its last knot.

    u(t) = q_k + (v_k - q_k) (t - t_k) / dt,   q_k+1 = v_k      (control_shape.py)

v_k are the controls of the core. u(t) is a state with the rate (v_k - q_k) / dt; all
expressions use it in place of the control. The knot q_k at the start of an interval is
a state too, which the end of the interval sets to v_k; it is the previous control. The
step cost uses v_k, the control at the end of the interval.
"""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.statement.control_shape import knot_names, split_knots
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.changed import (
    Appended,
    changed_fields,
    changed_model,
    controls_before,
    replaced,
    with_states,
)
from swarmstart.ocp.statement.rewrites.rewrite import Rewrite

_ROUNDING = 1e-9
"""Relative rounding of a control at its bound."""


@dataclass(frozen=True, slots=True)
class LinearControls(Rewrite):
    """Controls that are linear between knots -> states and controls that are held."""

    role = "knots"
    is_remembered = True

    def accepts(self, problem: OptimalControlProblem) -> bool:
        """Return whether the controls are linear between knots."""
        return problem.has_knots

    def apply(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """Return the problem with held controls: the knots at the intervals' ends."""
        model, u = problem.model, problem.model.controls
        now, first = (
            ca.vertcat(*[ca.SX.sym(knot_names(n)[i]) for n in model.control_names])
            for i in (0, 1)
        )
        to_now, to_first = replaced(u, now), replaced(u, first)
        begun = replaced(problem.previous, first)

        def timed(expression: ca.SX) -> ca.SX:
            return begun(to_now(expression))

        fields = changed_fields(problem, timed, begun)
        risk = problem.risk
        if risk is not None and problem.quadrature == "left":
            # The same at the start of an interval, and later it is still known.
            fields["risk"] = replace(fields["risk"], stage=begun(to_first(risk.stage)))
        return with_states(
            problem,
            Appended(
                states=ca.vertcat(now, first),
                rates=ca.vertcat((u - first) / problem.dt, ca.SX.zeros(model.nu)),
                after=ca.vertcat(now, u),
            ),
            changed_model(model, timed),
            start={**problem.start, **_first_knots(problem)},
            previous=ca.SX(0, 1),
            scales=_scales(problem),
            control_shape="constant",
            **fields,
        )

    def start(
        self, problem: OptimalControlProblem, x0: Array, previous: ArrayLike | None
    ) -> Array:
        """Return the initial values of the appended states: the first knots, twice.

        The states are the controls themselves and the knots last passed. If the first
        knots are decided, the values returned are a guess within the bounds.

        Raises:
            InvalidProblemError: If given knots are not within the bounds.
        """
        del x0
        found = controls_before(problem, previous)[:, -1]
        lower, upper = problem.control_limits
        within = np.clip(found, lower, upper)
        room = _ROUNDING * np.maximum(np.abs(found), np.abs(within))
        is_given = problem.control_shape == "continuous"
        if is_given and (np.abs(found - within) > room).any():
            raise InvalidProblemError(
                "continuous controls begin at the previous ones, which must be within "
                f"the bounds {lower} and {upper}, got {found}"
            )
        # The control itself begins at its first knot.
        return np.tile(within, 2)

    def along(
        self, problem: OptimalControlProblem, start: Array, controls: Array, at: Array
    ) -> Array:
        """Return the controls at each time, and below them the knots last passed."""
        del problem
        knots, N = self.controls(start, controls), controls.shape[1]
        now = [np.interp(at, np.arange(N + 1), row) for row in knots]
        return np.vstack([np.empty((0, at.size)), *now, knots[:, at.astype(int)]])

    def guess(
        self, problem: OptimalControlProblem, start: Array, controls: Array
    ) -> tuple[Array, Array]:
        """Return start and controls from knots, or from held controls.

        Raises:
            InvalidProblemError: If the shape is not that of knots or of held controls,
                or a value is not finite.
        """
        nu, N = problem.model.nu, problem.intervals
        if controls.shape not in ((nu, N + 1), (nu, N)):
            raise InvalidProblemError(
                f"a guess of linear controls must have shape {(nu, N + 1)}, or "
                f"{(nu, N)} of held ones, got {controls.shape}"
            )
        if not np.isfinite(controls).all():
            raise InvalidProblemError(f"a guess must be finite, got {controls}")
        first, rest = split_knots(controls, N)
        if problem.control_shape == "linear":
            lower, upper = problem.control_limits
            start = np.tile(np.clip(first, lower, upper), 2)
        return start, rest

    def controls(self, start: Array, controls: Array) -> Array:
        """Return the knots, shape (nu, N + 1)."""
        return np.hstack([start[: controls.shape[0], None], controls])


def _first_knots(problem: OptimalControlProblem) -> dict[tuple[str, ...], Free]:
    """Return the free starts of the first knots, if they are decided."""
    if problem.control_shape != "linear":
        return {}
    found = {}
    # Members of an ensemble that share the first control share its first knot.
    labels = problem.control_labels[:, 0]
    lower, upper = problem.control_limits
    for label in np.unique(labels):
        together = np.flatnonzero(labels == label)
        names = [knot_names(problem.model.control_names[j]) for j in together]
        j = int(together[0])
        limits = Free(float(lower[j]), float(upper[j]))
        found[tuple(name for pair in names for name in reversed(pair))] = limits
    return found


def _scales(problem: OptimalControlProblem) -> dict[str, float]:
    """Return the given sizes; the further states get those of the controls."""
    scales = dict(problem.scales)
    lower, upper = problem.control_limits
    for j, name in enumerate(problem.model.control_names):
        size = scales.get(name, float(upper[j] - lower[j]))
        if 0 < size < np.inf:  # Else it is found, as for any other state.
            scales.update(dict.fromkeys(knot_names(name), size))
    return scales
