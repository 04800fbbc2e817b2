"""A small problem as data, which swarmstart and a peer are both made from.

Expressions are of CasADi's SX and share their symbols. A table is a symbol of its own
with an argument, so that each side has its own table.
"""

from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp import (
    AlgebraicEquations,
    Bounds,
    Free,
    HeldSignals,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    TerminalConstraint,
    TransportDelay,
    table,
)


def nothing() -> ca.SX:
    """An empty column."""
    return ca.SX(0, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Limited:
    """lower <= expression <= upper, one row.

    Attributes:
        expression: In the problem's symbols.
        lower: Lower limit.
        upper: Upper limit.
        prices: Of an excess and of its square, if it is soft.
        moves: Whether it is a moving bound, whose scale the library finds.
    """

    expression: ca.SX
    lower: float
    upper: float
    prices: tuple[float, float] | None = None
    moves: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Tabulated:
    """A symbol that stands for a table's value at an argument.

    Attributes:
        symbol: The symbol.
        arguments: One or two.
        grid: Breakpoints of each.
        values: At them.
        method: "linear" or "bspline".
    """

    symbol: ca.SX
    arguments: tuple[ca.SX, ...]
    grid: tuple[Array, ...]
    values: Array
    method: str


@dataclass(kw_only=True, slots=True, eq=False)
class Stated:
    """A problem; features change it before either side is made.

    Attributes:
        names: Of the features.
        limits: Lower and upper bounds of each control.
        bounds: Of states, by their numbers.
        guess: Controls to start from, shape (nu, N).
        parameters: Values of the parameters that are known, by name.
        rows: Values of the signals at the nodes.
        solved: An algebraic variable, its equation, and what solves it.
        ceiling: An upper bound of the first control, as an expression.
        delay: Intervals by which the last control is late.
        held: Whether the signals are held over intervals.
        maximize: Whether the costs are stated with the other sign.
    """

    names: tuple[str, ...] = ()
    states: ca.SX
    controls: ca.SX
    ode: ca.SX
    x0: Array
    limits: tuple[Array, Array]
    horizon: float
    intervals: int
    stage: ca.SX
    terminal: ca.SX
    step: ca.SX = field(default_factory=lambda: ca.SX(0))
    initial: ca.SX = field(default_factory=lambda: ca.SX(0))
    next_state: ca.SX = field(default_factory=nothing)
    end_time: tuple[float, float] | None = None
    decided: dict[str, tuple[ca.SX, float, float]] = field(default_factory=dict)
    parameters: dict[str, tuple[ca.SX, float]] = field(default_factory=dict)
    wind: ca.SX = field(default_factory=nothing)
    reference: ca.SX = field(default_factory=nothing)
    rows: dict[str, Array] = field(default_factory=dict)
    time: ca.SX = field(default_factory=nothing)
    clock: float = 0.0
    before: ca.SX = field(default_factory=nothing)
    previous: Array = field(default_factory=lambda: np.empty(0))
    start: dict[tuple[int, ...], tuple[float, float]] = field(default_factory=dict)
    periodic: list[int] = field(default_factory=list)
    path: list[Limited] = field(default_factory=list)
    ends: list[Limited] = field(default_factory=list)
    bounds: dict[int, tuple[float, float]] = field(default_factory=dict)
    tables: list[Tabulated] = field(default_factory=list)
    solved: tuple[ca.SX, ca.SX, ca.SX] | None = None
    ceiling: ca.SX | None = None
    delay: int = 0
    held: bool = False
    maximize: bool = False
    quadrature: str = "integral"
    integrator: str = "rk4"
    substeps: int = 2
    integrator_tolerance: float | None = None  # As the peer steps.
    checks: int = 1
    as_function: bool = False
    guess: Array = field(default_factory=lambda: np.empty((0, 0)))

    @property
    def is_discrete(self) -> bool:
        """True if the state changes at the ends of intervals only."""
        return bool(self.next_state.numel()) and not self.ode.numel()

    @property
    def nodes(self) -> int:
        """Ends of checks, and the start."""
        return self.intervals * self.checks + 1

    @property
    def signals(self) -> ca.SX:
        """Signals, those of the model first."""
        return ca.vertcat(self.wind, self.reference)

    @property
    def signal_values(self) -> Array:
        """At the nodes, shape (ns, nodes)."""
        return np.array([self.rows[s.name()] for s in ca.vertsplit(self.signals)]
                        if self.rows else np.empty((0, self.nodes)))  # fmt: skip

    @property
    def all_parameters(self) -> ca.SX:
        """Known ones, then those that are decided."""
        both = (*self.parameters.values(), *self.decided.values())
        return ca.vertcat(nothing(), *[entry[0] for entry in both])

    @property
    def known(self) -> Known:
        """Known values besides the initial state."""
        return Known(
            [value for _, value in self.parameters.values()],
            self.signal_values,
            self.clock,
            self.previous if self.before.numel() else None,
        )

    def problem(self) -> OptimalControlProblem:
        """Return the problem as swarmstart takes it, every scale 1."""
        names = [s.name() for s in ca.vertsplit(self.states)]
        path = [
            PathConstraint(
                expression=self._put(c.expression), lower=c.lower, upper=c.upper,
                scale=1.0, weight=c.prices[0] if c.prices else None,
                quadratic_weight=c.prices[1] if c.prices else None,
            )
            for c in self.path
        ]  # fmt: skip
        ends = [
            TerminalConstraint(
                expression=self._put(c.expression), lower=c.lower, upper=c.upper,
                scale=1.0,
            )
            for c in self.ends
        ]  # fmt: skip
        lower, upper = (
            [self.bounds.get(i, (-np.inf, np.inf))[side] for i in range(len(names))]
            for side in (0, 1)
        )
        start = {
            tuple(names[i] for i in together): Free(*limits)
            for together, limits in self.start.items()
        }
        horizon: float | Free = self.horizon
        if self.end_time is not None:
            horizon = Free(*self.end_time, guess=self.horizon)
        sense = -1 if self.maximize else 1
        return OptimalControlProblem(
            self._model(),
            horizon=horizon,
            intervals=self.intervals,
            stage_cost=sense * self._put(self.stage),
            step_cost=sense * self._put(self.step),
            initial_cost=sense * self._put(self.initial),
            terminal_cost=sense * self._put(self.terminal),
            maximize=self.maximize,
            bounds=Bounds(
                controls=(self.limits[0], self._upper),
                states=(lower, upper) if self.bounds else None,
                state_scale=1.0 if self.bounds else None,
            ),
            constraints=path,
            terminal=ends,
            start={key[0] if len(key) == 1 else key: v for key, v in start.items()},
            periodic=[names[i] for i in self.periodic],
            decided={
                name: Free(low, high) for name, (_, low, high) in self.decided.items()
            },
            previous=self.before,
            signals=self.signals,
            quadrature=self.quadrature,  # type: ignore[arg-type]
            integrator=self.integrator,
            substeps=self.substeps,
            integrator_tolerance=self.integrator_tolerance,
            checks=self.checks,
            features=self._features(),
        )

    def _features(self) -> list[TransportDelay | HeldSignals]:
        found: list[TransportDelay | HeldSignals] = []
        if self.delay:
            name = self.controls[-1].name()
            late = self.delay * self.horizon / self.intervals
            found.append(TransportDelay({name: late}))
        if self.held:
            found.append(HeldSignals([s.name() for s in ca.vertsplit(self.signals)]))
        return found

    @property
    def _upper(self) -> Any:
        if self.ceiling is None:
            return self.limits[1]
        return [self.ceiling, *self.limits[1][1:]]

    def _model(self) -> Model:
        ode: Any = self._put(self.ode)
        if self.as_function:
            arguments = [self.states, self.controls, self.all_parameters]
            names = ["x", "u", "p"]
            if self.time.numel():
                arguments, names = [*arguments, self.time], [*names, "t"]
            ode = ca.Function("ode", arguments, [ode], names, ["rate"])
        equations = {}
        if self.solved is not None:
            z, residual, _ = self.solved
            equations = {
                "algebraic": AlgebraicEquations(symbols=z, residual=self._put(residual))
            }
        return Model(
            states=self.states,
            controls=self.controls,
            ode=ode,
            next_state=self._put(self.next_state),
            parameters=self.all_parameters,
            signals=self.wind,
            time=self.time,
            **equations,  # type: ignore[arg-type]
        )

    def _put(self, expression: ca.SX) -> ca.SX:
        """Return an expression with the tables of swarmstart in the symbols' places."""
        for one in self.tables:
            grid = one.grid[0] if len(one.grid) == 1 else one.grid
            value = table(grid, one.values, one.method)(*one.arguments)  # type: ignore[arg-type]
            expression = ca.substitute(expression, one.symbol, value)
        return expression
