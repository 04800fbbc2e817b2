"""The optimal-control problem, complete and frozen when constructed.

    minimise    sum of stage costs over the horizon + terminal cost at its end
    subject to  x' = f(x, u, p),  x(0) = x0,  u constant on each of N intervals,
                bounds on u; bounds on x and path constraints at every check;
                terminal constraints at the end

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
"""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, field
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.constraints import (
    Bounds,
    Constraint,
    PathConstraint,
    TerminalConstraint,
    limits_of,
)
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.integrators import require_count, require_integrator
from swarmstart.ocp.model import Model, as_column, require_known, require_symbols

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class OptimalControlProblem:
    """An optimal-control problem over a horizon; the initial state is an argument.

    Attributes:
        model: The model whose symbols all expressions are written in.
        horizon: Length of the prediction [s].
        intervals: Number N of control intervals in it.
        stage_cost: Scalar in states, controls, parameters, signals [cost / s].
        terminal_cost: Scalar in states, parameters, signals.
        bounds: Bounds on controls and states.
        constraints: Path constraints, as in constraints.py.
        terminal: Terminal constraints; a bare expression means expression = 0.
        signals: Symbols of the known signals, shape (ns, 1).
        quadrature: "integral", "left" or "right".
        integrator: A key of INTEGRATORS.
        substeps: Steps of the integrator from one check to the next.
        checks: Number of checks in an interval.
        tolerance: Largest summed violation that counts as feasible.

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
    constraints: Sequence[Constraint] = ()
    terminal: Sequence[ca.SX | TerminalConstraint] = ()
    signals: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    quadrature: Literal["integral", "left", "right"] = "integral"
    integrator: str = "rk4"
    substeps: int = 4
    checks: int = 1
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        """Check everything; bring sequences to tuples and bounds to arrays."""
        self._check_grid()
        for role in ("constraints", "terminal"):
            if not isinstance(getattr(self, role), Sequence):
                raise InvalidProblemError(
                    f"{role} must be a list, got {type(getattr(self, role)).__name__}"
                )
        require_symbols("signals", self.signals)
        for role in ("stage_cost", "terminal_cost"):
            self._set(role, self._scalar(role))
        self._set("terminal", tuple(as_terminal(c) for c in self.terminal))
        self._set("bounds", self._array_bounds())
        self._set("constraints", tuple(self.constraints))
        symbols = self.symbols()
        for constraint in self.constraints:
            require_known("a path constraint", constraint.expression, symbols)
        at_end = {name: s for name, s in symbols.items() if name != "controls"}
        for end in self.terminal_constraints:
            require_known("a terminal constraint", end.expression, at_end)

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _check_grid(self) -> None:
        if not (np.isfinite(self.horizon) and self.horizon > 0):
            raise InvalidProblemError(f"horizon must be positive, got {self.horizon}")
        for role in ("intervals", "checks"):
            require_count(role, getattr(self, role))
        require_integrator(self.integrator, self.substeps)
        if self.quadrature not in ("integral", "left", "right"):
            raise InvalidProblemError(
                f"quadrature must be integral, left or right, got {self.quadrature!r}"
            )
        if not self.tolerance >= 0:
            raise InvalidProblemError(
                f"tolerance must be at least 0, got {self.tolerance}"
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
        controls, states = (
            (-np.inf, np.inf) if limits is None else limits
            for limits in (self.bounds.controls, self.bounds.states)
        )
        return Bounds(
            controls=limits_of("controls", controls, self.model.nu),
            states=limits_of("states", states, self.model.nx),
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

    @property
    def terminal_constraints(self) -> tuple[TerminalConstraint, ...]:
        """The terminal constraints, bare expressions turned into equalities."""
        return tuple(as_terminal(c) for c in self.terminal)

    @property
    def path_constraints(self) -> tuple[Constraint, ...]:
        """The path constraints, with the state bounds as the last one."""
        lower, upper = self.state_limits
        if not np.isfinite([lower, upper]).any():
            return tuple(self.constraints)
        on_states = PathConstraint(
            expression=self.model.states, lower=lower, upper=upper
        )
        return (*self.constraints, on_states)


def as_terminal(constraint: ca.SX | TerminalConstraint) -> TerminalConstraint:
    """Return a terminal constraint; a bare expression means expression = 0."""
    if isinstance(constraint, TerminalConstraint):
        return constraint
    return TerminalConstraint(expression=constraint)
