"""Derivatives of an answer by the initial state and the parameters, to first order.

At a strict minimum of the NLP whose active limits do not change, the first-order
conditions are equations in the variables w and the multipliers, and the data q of the
NLP (transcription.py) are their parameters:

    [W  A'] [dw  ]     [d(grad f + A' lam)/dq]
    [A  0 ] [dlam]  = -[d(active rows)/dq    ] dq

W is the Hessian of the Lagrangian, A the Jacobian of the active rows. Variables at a
bound stay there. The derivative of the cost is that of the Lagrangian. Derivatives by q
are central differences of exact ones, so their relative error is some 1e-9; the rest is
the accuracy of the answer.

Source: Fiacco (1976), Sensitivity analysis for nonlinear programming using penalty
methods, Mathematical Programming 10; Nocedal and Wright (2006), section 16.2.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.nlp.optimality import (
    Curvature,
    NlpPoint,
    curvature,
    is_stationary,
    rooms,
)
from swarmstart.ocp.statement.rewrites.chain import Lowered

Data = Literal["x0", "parameters"]
DATA: tuple[Data, ...] = get_args(Data)
_STEP = np.finfo(np.float64).eps ** (1 / 3)
"""Relative step of central differences."""
_CLEAR = 1e3
"""Ratio of multiplier and distance, or of distance and multiplier, from which a limit
is clearly active or free. Multipliers are relative to the slope of the cost."""
_NEAR = 1e-2
"""Distance, or multiplier, from which it is clear, too."""
_RESIDUAL = 1e-6
"""Largest residual of the linear equations, relative to their right side."""


class NoSensitivityError(SwarmstartError):
    """An answer without derivatives; the message says why."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Sensitivity:
    """Derivatives of an answer by n data, each in the units of the problem.

    Attributes:
        data: Names of the data: states at the start, then parameters, as asked.
        cost: Derivatives of the cost, shape (n,).
        controls: Derivatives of the controls (or their knots), shape (nu, N, n).
        states: Derivatives of the states at the ends of the intervals, shape (nx, N +
            1, n).
        decided: Derivatives of the decided parameters and a free end time ("end time"),
            by name, each of shape (n,).
        unclear: Number of limits that are neither clearly active nor clearly free. If
            there are any, the derivatives hold on one side only.
    """

    data: tuple[str, ...]
    cost: Array
    controls: Array
    states: Array
    decided: Mapping[str, Array]
    unclear: int

    def __repr__(self) -> str:
        """Return the derivatives of the cost, and the number of unclear limits."""
        slopes = ", ".join(
            f"{name} {value:.4g}"
            for name, value in zip(self.data, self.cost, strict=True)
        )
        doubt = f"; {self.unclear} limit(s) may change at once" if self.unclear else ""
        return f"Sensitivity: derivatives of the cost: {slopes}{doubt}"


def sensitivity_of(
    point: NlpPoint | None, core: Lowered, controls: Array, by: Sequence[Data]
) -> Sensitivity:
    """Return the derivatives of an answer.

    Args:
        point: The answer as a point of the NLP; None if no NLP solver converged to it.
        core: The problem with its core.
        controls: Controls of the core, shape (nu, N).
        by: Data to differentiate by.

    Raises:
        NoSensitivityError: If there is no point, or it is no strict minimum whose
            active limits are independent.
    """
    if point is None or not is_stationary(point):
        raise NoSensitivityError(
            "expected an answer to which an NLP solver has converged, found none"
        )
    found = curvature(point)
    if found is not Curvature.POSITIVE:
        raise NoSensitivityError(f"expected a strict minimum, found {found.value}")
    if core.stated.risk is not None:
        raise NoSensitivityError("expected a problem without members, found a risk")
    known, count = len(core.known_parameters), point.program.problem.model.np
    if known != count:
        raise NoSensitivityError(
            f"expected {known} parameters in the problem that is solved, found {count}"
        )
    names, along = _data(point, core, by)
    rates = [_rate(point, dq) for dq in along]
    variables, unclear = _solved(point, rates)
    moved = [_Moved.of(point, dw, dq) for dw, dq in zip(variables, along, strict=True)]
    here, nx = _Moved.of(point, point.w, point.q), core.stated.model.nx
    u, x = controls, here.ends[:, 0]
    slope = core.stated.sense * point.cost_size
    return Sensitivity(
        data=names,
        cost=slope * np.array([rate.cost for rate in rates]),
        controls=_stacked(
            core.knots(u, x),
            [core.knots(u + m.controls, x + m.ends[:, 0]) for m in moved],
        ),
        states=_stacked(0.0 * here.ends[:nx], [m.ends[:nx] for m in moved]),
        decided={
            name: np.array([core.decided(one.ends[:, 0])[name] for one in moved])
            for name in core.decided(x)
        },
        unclear=unclear,
    )


def _stacked(here: Array, moved: Sequence[Array]) -> Array:
    """Return the changes side by side, in one more axis, which may be empty."""
    found = np.empty((*here.shape, len(moved)))
    for number, there in enumerate(moved):
        found[..., number] = there - here
    return found


class _Moved(NamedTuple):
    """Controls and states of the core, in its units; linear in the NLP's numbers.

    Attributes:
        controls: Shape (nu, N).
        ends: States between the intervals, shape (nx, N + 1).
    """

    controls: Array
    ends: Array

    @classmethod
    def of(cls, point: NlpPoint, w: Array, q: Array) -> "_Moved":
        moved, nu = replace(point, w=w, q=q), point.program.problem.model.nu
        return cls(
            moved.intervals[:nu] * point.control_sizes[:, None],
            moved.ends * point.state_sizes[:, None],
        )


def _data(
    point: NlpPoint, core: Lowered, by: Sequence[Data]
) -> tuple[tuple[str, ...], list[Array]]:
    """Return the names of the data, and the change of q with each."""
    problem, stated = point.program.problem, core.stated
    nx = problem.model.nx
    names, along = list[str](), list[Array]()
    if "x0" in by:
        zero = np.zeros(stated.model.nx)
        decided = {i for one in problem.free_starts for i in one.states}
        before = core.start(zero)
        for i, name in enumerate(stated.model.state_names):
            if i in decided:  # Not a datum.
                continue
            zero[i] = 1.0
            dq = np.zeros(point.q.size)
            dq[:nx] = (core.start(zero) - before) / point.state_sizes
            dq[[*decided]] = 0.0
            zero[i] = 0.0
            names.append(name)
            along.append(dq)
    if "parameters" in by:
        every = symbol_names(stated.model.parameters)
        for i, number in enumerate(core.known_parameters):
            dq = np.zeros(point.q.size)
            dq[nx + i] = 1.0
            names.append(every[number])
            along.append(dq)
    return tuple(names), along


class _Rate(NamedTuple):
    """Derivatives along a change of q, the variables and multipliers fixed.

    Attributes:
        cost: Of the Lagrangian.
        slope: Of its gradient by w, shape (nw,).
        rows: Of the rows, shape (ng,).
    """

    cost: float
    slope: Array
    rows: Array


def _rate(point: NlpPoint, dq: Array) -> _Rate:
    nx, moved = point.program.problem.model.nx, np.flatnonzero(dq)
    # States are divided by their sizes; a parameter's size is only known from itself.
    size = np.abs(point.q[moved])
    size[(moved < nx) & (size < 1.0) | (size == 0.0)] = 1.0
    step = _STEP * (size / np.abs(dq[moved])).min(initial=np.inf)
    if not np.isfinite(step):  # Nothing depends on it.
        return _Rate(0.0, np.zeros(point.w.size), np.zeros(point.lam_g.size))
    ahead, behind = (_values(point, point.q + sign * step * dq) for sign in (1, -1))
    cost, slope, rows = (
        (a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True)
    )
    return _Rate(float(cost), np.asarray(slope), np.asarray(rows))


def _values(point: NlpPoint, q: Array) -> tuple[Array, Array, Array]:
    """Return the Lagrangian, its gradient by w, and the rows."""
    f, gradient = point.program.derivatives["grad_f"](point.w, q)
    g, jacobian = point.program.derivatives["jac_g"](point.w, q)
    rows = np.array(g).ravel()
    pull = np.array(jacobian.T @ point.lam_g).ravel()
    return (
        np.array(float(f) + point.lam_g @ rows), np.array(gradient).ravel() + pull, rows
    )  # fmt: skip


def _solved(point: NlpPoint, rates: Sequence[_Rate]) -> tuple[list[Array], int]:
    """Return the change of w for each rate, and the number of unclear limits.

    Raises:
        NoSensitivityError: If the linear equations have no unique solution.
    """
    from scipy import sparse  # Takes as long to import as CasADi and NumPy.
    from scipy.sparse.linalg import splu

    derivatives = point.program.derivatives
    upper = derivatives["hess_lag"](point.w, point.q, 1.0, point.lam_g).sparse()
    jacobian = derivatives["jac_g"](point.w, point.q)[1].sparse()
    of_rows, of_bounds = rooms(point)
    active, held = (
        np.abs(lam) > room
        for lam, room in ((point.lam_g, of_rows), (point.lam_x, of_bounds))
    )
    free = np.flatnonzero(~held)
    W = (upper + upper.T - sparse.diags(upper.diagonal())).tocsr()[free][:, free]
    A = jacobian.tocsr()[np.flatnonzero(active)][:, free]
    matrix = sparse.bmat([[W, A.T], [A, None]], format="csc")
    right = np.column_stack(
        [-np.concatenate([rate.slope[free], rate.rows[active]]) for rate in rates]
        or [np.empty((matrix.shape[0], 0))]
    )
    try:
        found = splu(matrix).solve(right)
    except RuntimeError:  # Exactly singular.
        found = np.full_like(right, np.nan)
    off = np.abs(matrix @ found - right).max(initial=0.0)
    if not off <= _RESIDUAL * max(1.0, np.abs(right).max(initial=0.0)):
        raise NoSensitivityError(
            "expected active limits that are independent of each other; they are not, "
            "so that the multipliers are not unique"
        )
    changes = np.zeros((point.w.size, len(rates)))
    changes[free] = found[: free.size]
    return list(changes.T), _unclear(point, (of_rows, of_bounds))


def _unclear(point: NlpPoint, room: tuple[Array, Array]) -> int:
    """Return the number of limits that are neither clearly active nor clearly free."""
    limits = point.limits
    slope = np.array(point.program.derivatives["grad_f"](point.w, point.q)[1])
    largest = np.abs(slope).max(initial=1.0)
    count = 0
    for lower, upper, lam, far in (
        (limits.lbg, limits.ubg, point.lam_g, room[0]),
        (limits.lbx, limits.ubx, point.lam_x, room[1]),
    ):
        pull = np.abs(lam) / largest
        less, more = np.minimum(pull, far), np.maximum(pull, far)
        unclear = (more < _NEAR) & (more <= _CLEAR * less) & (lower < upper)
        count += int(unclear.sum())
    return count
