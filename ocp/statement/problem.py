"""The optimal-control problem, complete and frozen when constructed.

    minimise    sum of stage costs over the horizon + terminal cost at its end
    subject to  x' = f(x, u, p),  x(0) = x0,  u constant on each of N intervals,
                bounds on u; bounds on x and path constraints at the start and at
                every check; terminal constraints at the end

    |---- interval 0 ----|---- interval 1 ----| ...     N intervals, dt = horizon / N
    |-check-|-check-|....|                              `checks` to an interval
    |.|.|.|.|                                           `substeps` of the integrator
                                                        to a check

The initial state, the parameters p and the signals are arguments of the functions made
from the problem, not part of it. Signals are known functions of time (a reference, the
plans of others), given by their values at the N * checks + 1 nodes and linear in
between.

The stage cost is integrated with the model (`quadrature="integral"`), or summed as in
the chapter: at the start of each interval, dt * L(x_k, u_k) (`quadrature="left"`, 5.2),
or at its end, dt * L(x_k+1, u_k) (`quadrature="right"`, 5.3).

No decision depends on the units of the problem. Each row of a constraint has a scale
(row_scales): the one given, the width of a range, or one found for an initial state
from the problem's own numbers (scaling.py).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple, get_args

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arguments import (
    INDICES,
    NAMES,
    checked,
    either,
    mapping,
    of_kind,
    optional,
    reals,
    text,
)
from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError, refused
from swarmstart.ocp.common.expressions import (
    as_column,
    in_sx,
    require_known,
    require_symbols,
    shortened,
    symbol_names,
    without_power_of_two,
)
from swarmstart.ocp.common.limits import (
    Limit,
    limits_of,
    require_choice,
    require_count,
    require_number,
    scales_given,
    sizes_given,
)
from swarmstart.ocp.common.pickling import Expressed
from swarmstart.ocp.integration.integrators import require_integrator
from swarmstart.ocp.integration.radau import Radau, Transcription, as_transcription
from swarmstart.ocp.integration.rodas import COARSEST, FINEST
from swarmstart.ocp.statement.control_shape import (
    ControlShape,
    averaged,
    block_lengths,
    control_labels,
    require_shape,
    same_in_labels,
)
from swarmstart.ocp.statement.decisions import (
    Free,
    FreeStart,
    free_starts,
    integer_numbers,
)
from swarmstart.ocp.statement.feature import Feature, effective, features_given
from swarmstart.ocp.statement.risk import Epigraph, Risk
from swarmstart.ocp.system.constraints import (
    Bounds,
    Constraint,
    MovingLimit,
    PathConstraint,
    TerminalConstraint,
    fixed_and_moving,
)
from swarmstart.ocp.system.model import Model
from swarmstart.ocp.system.separation import (
    as_path,
    as_terminal,
    known_scales,
    label,
)

STATE_BOUNDS = "bounds of the states"
"""Name of the path constraint that represents bounds of the states."""
Quadrature = Literal["integral", "left", "right"]
_WITHOUT_CONTROLS = (
    "initial_cost", "terminal_cost", "a terminal constraint", "a weight",
)  # fmt: skip
_LARGEST_POWER = 1000
"""Power of two: the factor taken out of costs must itself be finite."""


class Costs(NamedTuple):
    """The costs of a problem, each a scalar; see OptimalControlProblem."""

    stage: ca.SX
    step: ca.SX
    initial: ca.SX
    terminal: ca.SX


@checked(
    refused,
    periodic=NAMES,
    transcription=either(text(), of_kind(Radau, "Radau()")),
    start=mapping(words="a mapping of states to Free"),
    decided=mapping(words="a mapping of names to Free"),
    clock=text(),
    control_shape=text(),
    quadrature=text(),
    integrator=text(),
    blocks=INDICES,
    risk=optional(of_kind(Risk, "a Risk")),
    epigraph=optional(of_kind(Epigraph, "an Epigraph")),
)
@dataclass(frozen=True, eq=False)  # No slots: cached properties need a dict.
class OptimalControlProblem(Expressed):
    """An optimal-control problem over a horizon; the initial state is an argument.

    Attributes:
        model: The model; all expressions are written in its symbols.
        horizon: Length of the prediction [s]; a `Free` if it is decided.
        intervals: Number N of control intervals in the horizon.
        stage_cost: Scalar in states, controls, parameters and signals [cost / s].
        step_cost: Scalar in the same symbols and the previous controls [cost], added at
            the start of each interval.
        initial_cost: Scalar in states, parameters and signals, at the start of the
            horizon.
        terminal_cost: Scalar in states, parameters and signals, at the end of the
            horizon.
        maximize: Whether the costs are maximised. They are then negated internally; a
            `Solution` reports them as stated, whereas plans hold the minimised costs.
        bounds: Bounds on controls and states.
        constraints: Path constraints: `PathConstraint`, `Separation` or `disc`,
            relations such as `x[0] <= 1`, or expressions alone, which mean expression =
            0.
        terminal: Terminal constraints: objects, relations, expressions alone (= 0), or
            pairs (expression, value).
        start: Names of the states whose initial value is decided, each with its bounds;
            several names in a tuple share one value. Their entries in the initial state
            are the guess.
        periodic: Names of states whose final value equals their initial value.
        decided: Names of the model's parameters that are decided, each with its bounds.
        previous: Symbols of the controls of the interval before, shape (nu, 1), for the
            step cost and the path constraints.
        clock: Name of the state that is the time of an answer [s]; empty: the time is
            uniform over the horizon.
        blocks: Lengths of blocks of intervals that share one control, in order
            (docs/any_problem.md, "Blocks"); empty: each interval has its own.
        control_shape: "constant" (controls held over an interval), "linear" (linear
            between knots, the first of which is decided) or "continuous" (linear, with
            the first knot given by Known(previous=...)). With knots, the step cost uses
            the controls at the end of an interval, and the previous controls are those
            at its start (docs/any_problem.md, "Linear controls").
        scales: Natural sizes of states and controls by name, in their units; sizes that
            are not given are found (docs/any_problem.md, "Sizes").
        signals: Symbols of the known signals, shape (ns, 1); those of the model come
            first, and are added if they are missing.
        quadrature: Sum of the stage cost: "integral" (integrated with the model),
            "left" or "right" (its value at the start or the end of each interval, times
            dt).
        integrator: "rk4" (Runge-Kutta of order 4), "euler" (explicit Euler) or "stiff"
            (implicit; docs/stiff_models.md).
        substeps: Number of integrator steps from one check to the next; with step size
            control, the expected number.
        integrator_tolerance: Allowed relative error of each step of "stiff"; None:
            `substeps` equal steps. The other integrators always take equal steps.
        transcription: Treatment of the states within an interval by the polish:
            "shooting" (integrator steps) or "radau" (collocation, with the states as
            unknowns); a `Radau` sets its number of points.
        checks: Number of checks in an interval: the points at which path constraints
            are required.
        tolerance: Largest summed violation that counts as feasible, relative to the
            constraints' scales.
        path_tolerance: Largest excess of a constraint on the finely integrated path,
            relative to its scale, at which an answer is confirmed.
        risk: Costs of the members of an ensemble, made by `ensemble`; None: not an
            ensemble.
        features: Further parts of the problem, such as a `TransportDelay`, in the order
            in which they apply.
        epigraph: Smooth form of a terminal cost with kinks, for an NLP; made
            internally.

    Raises:
        InvalidProblemError: If an entry is invalid; the message has the entry's name,
            the value given and what is allowed.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        ...     horizon=2.0, intervals=10, stage_cost=u**2,
        ...     bounds=ss.Bounds(controls=(-3, 3)), terminal=[(x[0], 1), (x[1], 0)],
        ... )
        >>> problem.dt, problem.decisions
        (0.2, 10)
    """

    model: Model
    _: KW_ONLY
    horizon: float | Free
    intervals: int
    stage_cost: ca.SX = field(default_factory=lambda: ca.SX(0))
    step_cost: ca.SX = field(default_factory=lambda: ca.SX(0))
    initial_cost: ca.SX = field(default_factory=lambda: ca.SX(0))
    terminal_cost: ca.SX = field(default_factory=lambda: ca.SX(0))
    maximize: bool = False
    bounds: Bounds = field(default_factory=Bounds)
    constraints: Sequence[Constraint | ca.SX] = ()
    terminal: Sequence[ca.SX | TerminalConstraint | tuple[ca.SX, Limit]] = ()
    start: Mapping[str | tuple[str, ...], Free] = field(default_factory=dict)
    periodic: Sequence[str] = ()
    decided: Mapping[str, Free] = field(default_factory=dict)
    previous: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    clock: str = ""
    signals: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    blocks: Sequence[int] = ()
    control_shape: ControlShape = "constant"
    scales: Mapping[str, float] = field(default_factory=dict)
    quadrature: Quadrature = "integral"
    integrator: str = "rk4"
    substeps: int = 4
    transcription: Transcription | Radau = "shooting"
    integrator_tolerance: float | None = 1e-6
    checks: int = 1
    tolerance: float = 1e-6
    path_tolerance: float = 1e-4
    risk: Risk | None = None
    features: Sequence[Feature] = ()
    epigraph: Epigraph | None = None

    def __post_init__(self) -> None:
        """Validate all fields; convert sequences to tuples and bounds to arrays."""
        if not isinstance(self.model, Model):
            raise InvalidProblemError(
                f"model must be a swarmstart.Model, got {shortened(self.model)}"
            )
        if not isinstance(self.maximize, bool):
            raise InvalidProblemError(
                f"maximize must be True or False, got {shortened(self.maximize)}"
            )
        self._check_grid()
        self._check_step()  # After the grid, which gives dt.
        self._bring_symbols_to_sx()
        require_symbols("signals", self.signals)
        require_symbols("previous", self.previous)
        if self.previous.numel() not in (0, self.model.nu):
            raise InvalidProblemError(
                f"previous must be a symbol for each of the {self.model.nu} controls, "
                f"got {self.previous.numel()}"
            )
        self._set("signals", _with_those_of(self.model, self.signals))
        for role in ("stage_cost", "step_cost", "initial_cost", "terminal_cost"):
            self._set(role, self._scalar(role))
        for role, stated in (("constraints", as_path), ("terminal", as_terminal)):
            listed = tuple(map(stated, self._listed(role)))
            self._set(role, in_sx(role, listed, self.model.sx))
        self._set("constraints", self._with_solved())
        # Moving bounds become constraints here, so before the constraints are checked.
        self._set("bounds", self._array_bounds())
        require_shape(
            self.control_shape,
            is_discrete=self.model.is_discrete,
            integer=len(self.bounds.integer),
        )
        self._set("start", dict(self.start))
        self._set("features", features_given(self.features))
        self._check_constraints()
        self._check_decisions()
        for feature in self.features:
            feature.require(self)

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _bring_symbols_to_sx(self) -> None:
        """Replace MX symbols of the problem, and add them to the model's map."""
        columns = {role: getattr(self, role) for role in ("signals", "previous")}
        if any(isinstance(column, ca.MX) for column in columns.values()):
            symbol_map, columns = self.model.symbol_map.extended(columns)
            # Only for MX: a model that is built again is validated again.
            self._set("model", replace(self.model, symbol_map=symbol_map))
            for role, column in columns.items():
                self._set(role, column)

    def _with_solved(self) -> tuple[Constraint, ...]:
        """Return the constraints, including that the algebraic equations are solved."""
        stated = tuple(as_path(c) for c in self.constraints)
        names = {constraint.name for constraint in stated}
        solved = self.model.elimination.constraints()
        # A problem made by `replace` has them already.
        return (*stated, *[c for c in solved if c.name not in names])

    def _listed(self, role: str) -> list[object]:
        """Return the entries of a list; a lone expression or relation is one entry."""
        given = in_sx(role, getattr(self, role), self.model.symbol_map.sx)
        if isinstance(given, ca.SX):
            return [given]
        if isinstance(given, str | bytes) or not isinstance(given, Sequence):
            raise InvalidProblemError(f"{role} must be a list, got {shortened(given)}")
        return list(given)

    def _check_grid(self) -> None:
        if not isinstance(self.horizon, Free):
            self._set("horizon", require_number("horizon", self.horizon))
            if not (np.isfinite(self.length) and self.length > 0):
                raise InvalidProblemError(
                    f"horizon must be positive, got {self.horizon}"
                )
        elif not self.horizon.lower > 0:
            raise InvalidProblemError(
                f"a free horizon must have a lower bound above 0, got {self.horizon}"
            )
        for role in ("intervals", "checks"):
            require_count(role, getattr(self, role))
        self._set(
            "scales",
            sizes_given(
                self.scales, (*self.model.state_names, *self.model.control_names)
            ),
        )
        self._set("blocks", block_lengths(self.blocks, self.intervals))
        require_integrator(self.integrator, self.substeps)
        self._check_integrator_tolerance()
        if self.collocation is not None and self.model.is_discrete:
            raise InvalidProblemError(
                "a discrete-time model has nothing to collocate: transcription must be "
                "'shooting'"
            )
        require_choice("quadrature", self.quadrature, get_args(Quadrature))
        for role in ("tolerance", "path_tolerance"):
            self._set(role, require_number(role, getattr(self, role)))
            if not getattr(self, role) >= 0:
                raise InvalidProblemError(
                    f"{role} must be at least 0, got {getattr(self, role)}"
                )

    def _check_step(self) -> None:
        """Raise if the intervals are not the steps of a sampled model."""
        if not isinstance(self.horizon, Free):
            self.model.require_step(self.dt)
        elif self.model.dt is not None:
            raise InvalidProblemError(
                f"the model is sampled with dt = {self.model.dt:g} s, so its horizon "
                "must be a number"
            )

    def _check_integrator_tolerance(self) -> None:
        if self.integrator_tolerance is None:
            return
        role = "integrator_tolerance"
        self._set(role, require_number(role, self.integrator_tolerance))
        if not FINEST <= self.integrator_tolerance <= COARSEST:
            raise InvalidProblemError(
                f"{role} must be a number from {FINEST:g} to {COARSEST:g}, "
                f"got {self.integrator_tolerance}"
            )

    def _check_constraints(self) -> None:
        """Raise if a constraint depends on symbols that have no value at its place."""
        for constraint in (*self.stated, *self.soft):
            self._require_known("a path constraint", constraint.expression)
        for soft in self.soft:
            for weight in soft.weights:
                self._require_known("a weight", weight)
        for end in self.terminal_constraints:
            self._require_known("a terminal constraint", end.expression)

    def _check_decisions(self) -> None:
        """Raise if names of states and parameters are unknown or repeated."""
        # For its errors; the property of this name returns the result.
        free_starts(self.start, self.model.state_names, self.state_limits)
        parameters = symbol_names(self.model.parameters)
        for role, named, names in (
            ("periodic", self.periodic, self.model.state_names),
            ("decided", self.decided, parameters),
            ("clock", [self.clock] if self.clock else [], self.model.state_names),
        ):
            wrong = [name for name in named if name not in names]
            if wrong or isinstance(named, str) or len(set(named)) != len(named):
                raise InvalidProblemError(
                    f"{role} must name, each once, some of "
                    f"{', '.join(names) or 'nothing'}, got {list(named)}"
                )
        for name, value in dict(self.decided).items():
            if not isinstance(value, Free):
                raise InvalidProblemError(
                    f"decided parameter {name!r} must be a swarmstart.Free, "
                    f"got {value!r}"
                )

    def _scalar(self, role: str) -> ca.SX:
        given = in_sx(role, getattr(self, role), self.model.sx)
        expression = as_column(role, given)
        if expression.numel() != 1:
            raise InvalidProblemError(
                f"{role} must be a scalar, got shape {expression.shape}"
            )
        self._require_known(role, expression)
        return expression

    def _require_known(self, role: str, expression: ca.SX) -> None:
        """Raise if an expression depends on symbols that have no value at its place."""
        known = self.symbols()
        if role in _WITHOUT_CONTROLS:
            del known["controls"]
        elif role != "stage_cost" and self.previous.numel():
            known["previous"] = self.previous
        if self.model.time.numel():
            known["time"] = self.model.time
        require_known(role, expression, known)

    def _array_bounds(self) -> Bounds:
        if not isinstance(self.bounds, Bounds):
            raise InvalidProblemError(
                "bounds must be swarmstart.Bounds, such as Bounds(controls=(-1, 1)), "
                f"got {shortened(self.bounds)}"
            )
        controls, states = (
            self._fixed(role, in_sx(role, getattr(self.bounds, role), self.model.sx))
            for role in ("controls", "states")
        )
        controls = limits_of("controls", controls, self.model.nu)
        search = self.bounds.search
        if search is not None:
            within = limits_of("controls in the search", search, self.model.nu)
            # Raises if both ranges leave no value in common.
            search = limits_of(
                "controls in the search, within those of the controls",
                (np.maximum(within[0], controls[0]),
                 np.minimum(within[1], controls[1])),
                self.model.nu,
            )  # fmt: skip
        return Bounds(
            controls=controls,
            search=search,
            states=limits_of("states", states, self.model.nx),
            state_scale=scales_given("states", self.bounds.state_scale, self.model.nx),
            integer=integer_numbers(
                self.bounds.integer,
                self.model.control_names,
                {"bounds": controls, "bounds in the search": search},
            ),
        )

    def _fixed(
        self, role: str, limits: tuple[MovingLimit, MovingLimit] | None
    ) -> tuple[Limit, Limit]:
        """Return the bounds that are numbers; the others become path constraints."""
        symbols = self.symbols()
        known = {name: symbols[name] for name in ("parameters", "signals")}
        if self.model.time.numel():
            known["time"] = self.model.time
        fixed, moving = fixed_and_moving(role, limits, symbols[role], known)
        self._set("constraints", (*self.constraints, *moving))
        return fixed

    def symbols(self) -> dict[str, ca.SX]:
        """Return the columns of symbols that expressions may use, by role."""
        return {
            "states": self.model.states,
            "controls": self.model.controls,
            "parameters": self.model.parameters,
            "signals": self.signals,
        }

    @property
    def sense(self) -> float:
        """1 for costs that are minimised, -1 for costs that are maximised."""
        return -1.0 if self.maximize else 1.0

    @property
    def collocation(self) -> Radau | None:
        """Collocation of the polish; None: multiple shooting."""
        return as_transcription(self.transcription)

    @property
    def length(self) -> float:
        """Length of the horizon [s].

        Raises:
            InvalidProblemError: If it is decided, and so not known in advance.
        """
        if isinstance(self.horizon, Free):
            raise InvalidProblemError(
                "the horizon is free: its length is known from an answer only"
            )
        return self.horizon

    @property
    def dt(self) -> float:
        """Length of a control interval [s]."""
        return self.length / self.intervals

    @property
    def ns(self) -> int:
        """Number of signals."""
        return int(self.signals.numel())

    def costs(self) -> tuple[float, Costs]:
        """Return (unit, costs / unit), where the unit is a power of two.

        Costs that differ by a factor that is a power of two differ in the unit only.
        """
        given = Costs(
            self.stage_cost, self.step_cost, self.initial_cost, self.terminal_cost
        )
        split = [without_power_of_two(cost) for cost in given]
        powers = [p for (p, _), cost in zip(split, given, strict=True)
                  if not cost.is_zero()]  # fmt: skip
        # Any of them: costs in a unit 2^k times as large shift all powers by k.
        unit = powers[0] if powers else 0
        if any(
            abs(p) > _LARGEST_POWER or abs(p - unit) > _LARGEST_POWER for p in powers
        ):
            return 1.0, given
        return 2.0**unit, Costs(
            *[2.0 ** (power - unit) * cost if power != unit and not cost.is_zero()
              else cost for power, cost in split]
        )  # fmt: skip

    @property
    def nodes(self) -> int:
        """Number of nodes, N * checks + 1: the ends of all checks."""
        return self.intervals * self.checks + 1

    @property
    def times(self) -> Array:
        """Times of the nodes after the start of the horizon, shape (nodes,) [s]."""
        return np.linspace(0.0, self.length, self.nodes)

    @property
    def expected_times(self) -> Array:
        """Times of the nodes; for a free horizon, by its guess, shape (nodes,) [s]."""
        if isinstance(self.horizon, Free):
            return np.linspace(0.0, self.horizon.first, self.nodes)
        return self.times

    @property
    def control_limits(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the controls, each (nu,)."""
        lower, upper = self.bounds.controls or ((), ())
        return np.asarray(lower), np.asarray(upper)

    @property
    def integer(self) -> tuple[int, ...]:
        """Indices of the controls that take whole numbers only."""
        # All are numbers since the validation; the test is for the type checker.
        return tuple(j for j in self.bounds.integer if isinstance(j, int))

    @property
    def has_knots(self) -> bool:
        """True if the controls are linear between knots."""
        return self.control_shape != "constant"

    @property
    def flown_controls(self) -> int:
        """Number of controls that a plant receives.

        It is nu or, for an ensemble with a robust horizon, that of one member.
        """
        several = self.risk is not None and self.risk.robust_horizon is not None
        return self.model.nu // (self.risk.members if several and self.risk else 1)

    @cached_property
    def kept(self) -> dict[str, Any]:
        """Functions and planners kept for later calls with this problem.

        A copy of the problem begins without any.
        """
        return {}

    @cached_property
    def control_labels(self) -> NDArray[np.intp]:
        """Label of each control of each interval, shape (nu, N).

        Controls that must be equal have the same label: those of a block, and those of
        all members of an ensemble in the intervals in which the members share their
        controls.
        """
        shared = 0
        if self.risk is not None and self.risk.robust_horizon is not None:
            shared = self.risk.robust_horizon
        return control_labels(
            self.blocks,
            self.intervals,
            controls=self.model.nu,
            own=self.flown_controls,
            shared=shared,
        )

    @property
    def ties_controls(self) -> bool:
        """True if some controls must be equal."""
        # A robust horizon of 0 intervals ties nothing.
        tied = self.risk is not None and bool(self.risk.robust_horizon)
        return bool(self.blocks) or tied

    @checked(refused, controls=reals(array=True, axes=2))
    def averaged(self, controls: Array) -> Array:
        """Return controls in which those that must be equal have their mean; a copy.

        Args:
            controls: Controls, shape (nu, N).

        Returns:
            Controls, shape (nu, N).
        """
        if self.flown_controls == self.model.nu:
            return averaged(controls, self.blocks)  # Only blocks tie controls.
        return same_in_labels(controls, self.control_labels)

    @property
    def search_limits(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the controls in a population search, each (nu,).

        They are `bounds.search` or, if this is None, the bounds of the controls.
        """
        if self.bounds.search is None:
            return self.control_limits
        lower, upper = self.bounds.search
        return np.asarray(lower), np.asarray(upper)

    @property
    def state_limits(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the states, each (nx,)."""
        lower, upper = self.bounds.states or ((), ())
        return np.asarray(lower), np.asarray(upper)

    @cached_property
    def terminal_constraints(self) -> tuple[TerminalConstraint, ...]:
        """All terminal constraints, converted to TerminalConstraint."""
        return tuple(as_terminal(c) for c in self.terminal)

    @cached_property
    def stated(self) -> tuple[Constraint, ...]:
        """All stated path constraints except soft ones, as constraint objects."""
        every = map(as_path, self.constraints)
        return tuple(
            c for c in every if not (isinstance(c, PathConstraint) and c.is_soft)
        )

    @cached_property
    def soft(self) -> tuple[PathConstraint, ...]:
        """Soft constraints, whose excess is a cost."""
        every = map(as_path, self.constraints)
        return tuple(c for c in every if isinstance(c, PathConstraint) and c.is_soft)

    @cached_property
    def slacks(self) -> int:
        """Number of rows of all soft constraints together."""
        return sum(int(c.expression.numel()) for c in self.soft)

    @cached_property
    def path_constraints(self) -> tuple[Constraint, ...]:
        """Path constraints, with the state bounds as the last one."""
        lower, upper = self.state_limits
        bounded = self.bounded_states
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

    @property
    def bounded_states(self) -> NDArray[np.int64]:
        """Indices of the states that have bounds."""
        lower, upper = self.state_limits
        return np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))

    def row_scales(self) -> list[Array]:
        """Return an array for each constraint, with the scale of each of its rows.

        The path constraints come first, then the terminal constraints. NaN stands for a
        scale that depends on the initial state.
        """
        return [
            known_scales(c)
            for c in (*self.path_constraints, *self.terminal_constraints)
        ]

    @cached_property
    def free_starts(self) -> tuple[FreeStart, ...]:
        """Decisions about the state at the start."""
        return free_starts(self.start, self.model.state_names, self.state_limits)

    @property
    def start_decisions(self) -> dict[int, int]:
        """Index of each state whose start is decided -> index in `free_starts`."""
        return {
            i: number for number, one in enumerate(self.free_starts) for i in one.states
        }

    @property
    def nlp_starts(self) -> tuple[FreeStart, ...]:
        """Free starts, and then the decisions that make the cost of an NLP smooth."""
        more = () if self.epigraph is None else self.epigraph.starts
        return (*self.free_starts, *more)

    @property
    def smooth_terminal_cost(self) -> ca.SX:
        """Terminal cost in the smooth form for an NLP."""
        return self.terminal_cost if self.epigraph is None else self.epigraph.cost

    @property
    def decisions(self) -> int:
        """Number of decisions: the controls, and the free starts."""
        return self.model.nu * self.intervals + len(self.free_starts)

    @cached_property
    def automatic(self) -> int:
        """Number of a rollout's parameters that depend on the initial state.

        These are 1 / scale of each constraint row whose scale depends on the initial
        state and, with step size control, the sizes of the states and of the integrated
        cost.
        """
        rows = sum(int(np.isnan(scales).sum()) for scales in self.row_scales())
        return rows + (self.model.nx + self.integrals if self.is_adaptive else 0)

    @property
    def integrals(self) -> int:
        """Number of costs that are integrated with the states."""
        return int(self.quadrature == "integral")

    @property
    def is_adaptive(self) -> bool:
        """True if rollouts use step size control."""
        return (
            self.integrator == "stiff"
            and self.integrator_tolerance is not None
            and not self.model.is_discrete
        )

    def __repr__(self) -> str:
        """Return the problem's sizes, names and grid in a few lines."""
        model, kinds = self.model, self.path_constraints
        horizon = "a free time"
        if not isinstance(self.horizon, Free):
            horizon = f"{self.horizon:g} s"
        lines = [
            f"OptimalControlProblem over {horizon}: {self.intervals} intervals"
            f", {self.checks} check(s) in each, "
            f"{self._steps_as_text()} a check"
            + ("; polished by collocation" if self.collocation else "")
            + ("; its costs are maximised" if self.maximize else ""),
            *(["  controls are linear between knots"] if self.has_knots else []),
            f"  states: {', '.join(model.state_names)}",
            f"  controls: {', '.join(map(self._with_limits, range(model.nu)))}",
            f"  path constraints: {', '.join(map(label, kinds)) or 'none'}",
            "  terminal constraints: "
            f"{', '.join(map(label, self.terminal_constraints)) or 'none'}",
        ]
        if self.soft:
            lines.append(f"  soft constraints: {', '.join(map(label, self.soft))}")
        return "\n".join(lines)

    def _steps_as_text(self) -> str:
        if self.is_adaptive:
            return f"{self.integrator} to {self.integrator_tolerance:g}"
        return f"{self.integrator} in {self.substeps} step(s)"

    def _with_limits(self, j: int) -> str:
        lower, upper = (limits[j] for limits in self.control_limits)
        return f"{self.model.control_names[j]} in [{lower:g}, {upper:g}]"


def _with_those_of(model: Model, signals: ca.SX) -> ca.SX:
    """Return the signals of a problem, with the model's first."""
    own = [signals[i] for i in range(signals.numel())]
    first = [model.signals[i] for i in range(model.ns)]
    if len(own) >= len(first) and all(
        # A problem made by `replace` has the model's signals already.
        ca.is_equal(a, b)
        for a, b in zip(first, own, strict=False)
    ):
        return signals
    return ca.vertcat(model.signals, signals)


def require_held(problems: Iterable[OptimalControlProblem]) -> None:
    """Raise if a team or a dual mode cannot use the controls of some problems.

    Raises:
        InvalidProblemError: If controls are linear, or delayed.
    """
    for problem in problems:
        if problem.has_knots:
            raise InvalidProblemError(
                "a team and a dual mode use controls that are held: control_shape must "
                f"be constant, got {problem.control_shape!r}"
            )
        if found := [one for one in effective(problem) if not one.goes_with_teams]:
            raise InvalidProblemError(
                "a team and a dual mode take no delays and no feature other than "
                f"HeldSignals, got {shortened(found)}"
            )
