"""The optimal-control problem, complete and frozen when constructed.

    minimise    sum of stage costs over the horizon + terminal cost at its end
    subject to  x' = f(x, u, p),  x(0) = x0,  u constant on each of N intervals,
                bounds on u; bounds on x and path constraints at the start and at
                every check; terminal constraints at the end

    |---- interval 0 ----|---- interval 1 ----| ...     N intervals, dt = horizon / N
    |-check-|-check-|....|                              `checks` to an interval
    |.|.|.|.|                                           `substeps` of the integrator
                                                        to a check

The initial state, the parameters p and the signals are arguments of whatever is made
from the problem, not part of it. Signals are what is known to change over the horizon
(a reference, the plans of others): a value at each of the N * checks + 1 nodes, linear
in between.

The stage cost is integrated with the model (`quadrature="integral"`), or summed, as the
chapter does, at the beginning of each interval, dt * L(x_k, u_k) (`quadrature="left"`,
5.2), or at its end, dt * L(x_k+1, u_k) (`quadrature="right"`, 5.3).

Nothing is judged by a number that a change of units would change. Each row of a
constraint has a scale (row_scales): the one given, the width of a range, or one found
for an initial state from the problem's own numbers (scaling.py).
"""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from typing import Literal, cast, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.constraints import (
    Bounds,
    Constraint,
    PathConstraint,
    TerminalConstraint,
    limited,
)
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.integrators import require_count, require_integrator
from swarmstart.ocp.limits import (
    Limit,
    limits_of,
    require_choice,
    require_number,
    scales_given,
)
from swarmstart.ocp.model import (
    Model,
    as_column,
    require_known,
    require_symbols,
    shortened,
)
from swarmstart.ocp.separation import Connection, Separation
from swarmstart.ocp.units import without_power_of_two

Array = NDArray[np.float64]
STATE_BOUNDS = "bounds of the states"
"""Name of the path constraint that bounds of the states are."""
Quadrature = Literal["integral", "left", "right"]
_LARGEST_POWER = 1000
"""Of two: what is taken out of costs must itself be a number."""


@dataclass(frozen=True, eq=False)
class OptimalControlProblem:
    """An optimal-control problem over a horizon; the initial state is an argument.

    Attributes:
        model: The model whose symbols all expressions are written in.
        horizon: Length of the prediction [s].
        intervals: Number N of control intervals in it.
        stage_cost: Scalar in states, controls, parameters, signals [cost / s].
        terminal_cost: Scalar in states, parameters, signals.
        bounds: Bounds on controls and states.
        constraints: Path constraints: those of constraints.py, relations such as
            `x[0] <= 1`, or bare expressions, which mean expression = 0.
        terminal: Terminal constraints, relations, bare expressions (= 0), or pairs
            (expression, value).
        signals: Symbols of the known signals, shape (ns, 1).
        quadrature: "integral", "left" or "right".
        integrator: A key of INTEGRATORS.
        substeps: Steps of the integrator from one check to the next.
        checks: Number of checks in an interval.
        tolerance: Largest summed violation that counts as feasible, in parts of the
            constraints' scales.
        path_tolerance: Largest excess of a constraint on the finely integrated path, in
            parts of its scale, for an answer to be confirmed.

    Raises:
        InvalidProblemError: With the name, the value given and what is allowed.
    """

    model: Model
    _: KW_ONLY
    horizon: float
    intervals: int
    stage_cost: ca.SX = field(default_factory=lambda: ca.SX(0))
    terminal_cost: ca.SX = field(default_factory=lambda: ca.SX(0))
    bounds: Bounds = field(default_factory=Bounds)
    constraints: Sequence[Constraint | ca.SX] = ()
    terminal: Sequence[ca.SX | TerminalConstraint | tuple[ca.SX, Limit]] = ()
    signals: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    quadrature: Quadrature = "integral"
    integrator: str = "rk4"
    substeps: int = 4
    checks: int = 1
    tolerance: float = 1e-6
    path_tolerance: float = 1e-4

    def __post_init__(self) -> None:
        """Check everything; bring sequences to tuples and bounds to arrays."""
        if not isinstance(self.model, Model):
            raise InvalidProblemError(
                f"model must be a swarmstart.Model, got {shortened(self.model)}"
            )
        self._check_grid()
        require_symbols("signals", self.signals)
        for role in ("stage_cost", "terminal_cost"):
            self._set(role, self._scalar(role))
        self._set("constraints", tuple(map(as_path, self._listed("constraints"))))
        self._set("terminal", tuple(map(as_terminal, self._listed("terminal"))))
        self._set("bounds", self._array_bounds())
        symbols = self.symbols()
        for constraint in self.stated:
            require_known("a path constraint", constraint.expression, symbols)
        at_end = {name: s for name, s in symbols.items() if name != "controls"}
        for end in self.terminal_constraints:
            require_known("a terminal constraint", end.expression, at_end)

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _listed(self, role: str) -> list[object]:
        """Return the entries of a list; a bare expression or relation is one."""
        given = getattr(self, role)
        if isinstance(given, ca.SX):
            return [given]
        if isinstance(given, str | bytes) or not isinstance(given, Sequence):
            raise InvalidProblemError(f"{role} must be a list, got {shortened(given)}")
        return list(given)

    def _check_grid(self) -> None:
        for role in ("horizon", "tolerance", "path_tolerance"):
            self._set(role, require_number(role, getattr(self, role)))
        if not (np.isfinite(self.horizon) and self.horizon > 0):
            raise InvalidProblemError(f"horizon must be positive, got {self.horizon}")
        for role in ("intervals", "checks"):
            require_count(role, getattr(self, role))
        require_integrator(self.integrator, self.substeps)
        require_choice("quadrature", self.quadrature, get_args(Quadrature))
        for role in ("tolerance", "path_tolerance"):
            if not getattr(self, role) >= 0:
                raise InvalidProblemError(
                    f"{role} must be at least 0, got {getattr(self, role)}"
                )

    def _scalar(self, role: str) -> ca.SX:
        expression = as_column(role, getattr(self, role))
        if expression.numel() != 1:
            raise InvalidProblemError(
                f"{role} must be a scalar, got shape {expression.shape}"
            )
        known = self.symbols()
        if role == "terminal_cost":
            del known["controls"]
        require_known(role, expression, known)
        return expression

    def _array_bounds(self) -> Bounds:
        if not isinstance(self.bounds, Bounds):
            raise InvalidProblemError(
                "bounds must be swarmstart.Bounds, such as Bounds(controls=(-1, 1)), "
                f"got {shortened(self.bounds)}"
            )
        controls, states = (
            (-np.inf, np.inf) if limits is None else limits
            for limits in (self.bounds.controls, self.bounds.states)
        )
        return Bounds(
            controls=limits_of("controls", controls, self.model.nu),
            states=limits_of("states", states, self.model.nx),
            state_scale=scales_given("states", self.bounds.state_scale, self.model.nx),
        )

    def symbols(self) -> dict[str, ca.SX]:
        """Return the columns of symbols that expressions may use, by role."""
        return {
            "states": self.model.states,
            "controls": self.model.controls,
            "parameters": self.model.parameters,
            "signals": self.signals,
        }

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.horizon / self.intervals

    @property
    def ns(self) -> int:
        """Number of signals."""
        return int(self.signals.numel())

    def costs(self) -> tuple[float, ca.SX, ca.SX]:
        """Return (unit, stage cost / unit, terminal cost / unit), unit a power of two.

        A cost times a power of two differs in the unit only; see units.py.
        """
        power, stage = without_power_of_two(self.stage_cost)
        other, end = without_power_of_two(self.terminal_cost)
        if self.stage_cost.is_zero():
            power = other
        if self.terminal_cost.is_zero():
            other = power
        if max(abs(power), abs(other), abs(other - power)) > _LARGEST_POWER:
            return 1.0, self.stage_cost, self.terminal_cost
        return 2.0**power, stage, 2.0 ** (other - power) * end

    @property
    def nodes(self) -> int:
        """Number of nodes, N * checks + 1: the ends of all checks."""
        return self.intervals * self.checks + 1

    @property
    def times(self) -> Array:
        """Times of the nodes after the start of the horizon, shape (nodes,) [s]."""
        return np.linspace(0.0, self.horizon, self.nodes)

    @property
    def control_limits(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the controls, each (nu,)."""
        lower, upper = self.bounds.controls or ((), ())
        return np.asarray(lower), np.asarray(upper)

    @property
    def state_limits(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the states, each (nx,)."""
        lower, upper = self.bounds.states or ((), ())
        return np.asarray(lower), np.asarray(upper)

    @cached_property
    def terminal_constraints(self) -> tuple[TerminalConstraint, ...]:
        """The terminal constraints, all as such."""
        return tuple(as_terminal(c) for c in self.terminal)

    @cached_property
    def stated(self) -> tuple[Constraint, ...]:
        """The path constraints as stated, all as such."""
        return tuple(as_path(c) for c in self.constraints)

    @cached_property
    def path_constraints(self) -> tuple[Constraint, ...]:
        """The path constraints, with the state bounds as the last one."""
        lower, upper = self.state_limits
        bounded = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
        if not bounded.size:
            return self.stated
        scale = self.bounds.state_scale
        on_states = PathConstraint(
            expression=self.model.states[bounded.tolist()],
            lower=lower[bounded],
            upper=upper[bounded],
            scale=None if scale is None else np.asarray(scale)[bounded],
            name=STATE_BOUNDS,
        )
        return (*self.stated, on_states)

    def row_scales(self) -> list[Array]:
        """Return the scale of each row of the path, then the terminal constraints.

        NaN stands for a scale that depends on the initial state, see scaling.py.
        """
        return [
            known_scales(c)
            for c in (*self.path_constraints, *self.terminal_constraints)
        ]

    @cached_property
    def automatic(self) -> int:
        """Number of rows whose scale depends on the initial state."""
        return sum(int(np.isnan(scales).sum()) for scales in self.row_scales())

    def __repr__(self) -> str:
        """Return the problem's sizes, names and grid in a few lines."""
        model, kinds = self.model, self.path_constraints
        lines = [
            f"OptimalControlProblem over {self.horizon:g} s: {self.intervals} intervals"
            f" of {self.dt:g} s, {self.checks} check(s) in each, "
            f"{self.integrator} in {self.substeps} step(s) a check",
            f"  states: {', '.join(model.state_names)}",
            f"  controls: {', '.join(map(self._with_limits, range(model.nu)))}",
            f"  path constraints: {', '.join(map(label, kinds)) or 'none'}",
            "  terminal constraints: "
            f"{', '.join(map(label, self.terminal_constraints)) or 'none'}",
        ]
        return "\n".join(lines)

    def _with_limits(self, j: int) -> str:
        lower, upper = (limits[j] for limits in self.control_limits)
        return f"{self.model.control_names[j]} in [{lower:g}, {upper:g}]"


def known_scales(constraint: Constraint) -> Array:
    """Return the scale of each row, as given or the width of a range; else NaN."""
    if constraint.scale is not None:
        return np.asarray(constraint.scale, dtype=np.float64)
    rows = constraint.rows(constraint.expression)
    with np.errstate(invalid="ignore"):
        width = rows.upper - rows.lower
    return np.where(np.isfinite(width) & (width > 0), width, np.nan)


def label(constraint: Constraint) -> str:
    """Return the name of a constraint, or its expression in short."""
    return constraint.name or shortened(constraint.expression)


def as_path(constraint: object) -> Constraint:
    """Return a path constraint; a relation or a bare expression becomes one.

    Raises:
        InvalidProblemError: If it is none of these.
    """
    if isinstance(constraint, TerminalConstraint):
        raise InvalidProblemError(
            "constraints must hold path constraints; a TerminalConstraint belongs into "
            "the list `terminal`"
        )
    stated = limited("a path constraint", constraint)
    if stated is not None:
        expression, lower, upper = stated
        name = shortened(constraint)
        return PathConstraint(
            expression=expression, lower=lower, upper=upper, name=name
        )
    if not all(hasattr(constraint, n) for n in ("expression", "excess", "smooth")):
        raise InvalidProblemError(
            "constraints must hold PathConstraint, Separation, Connection, relations "
            f"such as x[0] <= 1 or expressions, got {shortened(constraint)}"
        )
    return cast(Constraint, constraint)


def as_terminal(constraint: object) -> TerminalConstraint:
    """Return a terminal constraint; relations, expressions and pairs become one.

    Raises:
        InvalidProblemError: If it is none of these.
    """
    if isinstance(constraint, TerminalConstraint):
        return constraint
    if isinstance(constraint, PathConstraint | Separation | Connection):
        raise InvalidProblemError(
            "terminal must hold terminal constraints, got a "
            f"{type(constraint).__name__}: use TerminalConstraint(expression=..., "
            "lower=..., upper=...)"
        )
    stated = limited("a terminal constraint", constraint)
    if stated is not None:
        expression, lower, upper = stated
        return TerminalConstraint(expression=expression, lower=lower, upper=upper)
    if isinstance(constraint, tuple) and len(constraint) == 2:  # noqa: PLR2004
        expression, value = constraint
        return TerminalConstraint(expression=expression, lower=value, upper=value)
    raise InvalidProblemError(
        "terminal must hold TerminalConstraint, relations, expressions or pairs "
        f"(expression, value), got {shortened(constraint)}"
    )
