"""A problem brought to its core: what is decided or remembered becomes a state.

    end time T       a state that stays as it began; rates and stage cost times T, and
                     the horizon is 1
    parameter        a state that stays as it began
    periodic state   and a copy of its start, which stays; at the end both are equal
    previous control a state that the end of an interval sets to the control
    time             t0 + T tau, with the parameter t0 and the signal tau in [0, 1]
    risk             a state that sums up the cost of each member, and what an NLP
                     decides to have their worst or the mean of these without kinks
    maximised costs  times -1

What is decided is then a free start of one of these states, which the search, the NLP
and the verification know. The states of the stated problem come first, and keep their
names, bounds and units.

    stated: x, u, p, s   ->   core: (x, T, decided p, copies, previous u, members'
                                     costs, t, e, r of risk.py), u,
                                    (known p, t0), (the model's s, tau, other s)
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.ocp.constraints import Bounds, Constraint, TerminalConstraint
from swarmstart.ocp.errors import InvalidProblemError
from swarmstart.ocp.expressions import symbol_names, symbol_of
from swarmstart.ocp.free import Free
from swarmstart.ocp.model import Model
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.risk import Epigraph, Risk, epigraph_symbols

Array = NDArray[np.float64]
_Timed = Callable[[ca.SX], ca.SX]
"""An expression -> the same with the time as the core has it."""
END_TIME = "end time"
"""Name of the state that a free end time is."""


@dataclass(frozen=True, eq=False)
class Lowered:
    """A stated problem with its core.

    Attributes:
        stated: The problem as the user states it.
        core: The same, minimised, without free end time, decided parameters, periodic
            states, previous controls and time.
    """

    stated: OptimalControlProblem
    core: OptimalControlProblem

    @property
    def known_parameters(self) -> list[int]:
        """Numbers of the model's parameters that are not decided."""
        names = symbol_names(self.stated.model.parameters)
        return [i for i, name in enumerate(names) if name not in self.stated.decided]

    @cached_property
    def places(self) -> dict[str, list[int]]:
        """Numbers of the core's states, by what they are."""
        sizes = {
            "states": self.stated.model.nx,
            END_TIME: int(isinstance(self.stated.horizon, Free)),
            "decided": len(self.stated.decided),
            "copies": len(self.stated.periodic),
            "previous": int(self.stated.previous.numel()),
            "risk": _risk_states(self.stated),
        }
        ends = np.cumsum([0, *sizes.values()]).tolist()
        return {
            role: list(range(first, last))
            for role, first, last in zip(sizes, ends, ends[1:], strict=False)
        }

    def end_time(self, x0: Array) -> float:
        """Return the length of the horizon [s] of an answer.

        Args:
            x0: The core's state at its start.
        """
        place = self.places[END_TIME]
        return float(x0[place[0]]) if place else self.stated.length

    def decided(self, x0: Array) -> dict[str, float]:
        """Return what an answer decides about parameters and end time, by name."""
        names = [*([END_TIME] if self.places[END_TIME] else []), *self.stated.decided]
        places = [*self.places[END_TIME], *self.places["decided"]]
        return {name: float(x0[i]) for name, i in zip(names, places, strict=True)}

    def decided_parameters(self, x0: Array) -> dict[str, float]:
        """Return what an answer decides about parameters, by name."""
        return {name: self.decided(x0)[name] for name in self.stated.decided}

    def start(self, x0: ArrayLike, previous: ArrayLike | None = None) -> Array:
        """Return the core's initial state, with the guesses of what is decided.

        Args:
            x0: Initial state, shape (nx,); NaN where it is decided and no guess known.
                Of an ensemble, that of a member is one for all.
            previous: Control of the interval before, shape (nu,); None: the nearest to
                zero that is allowed.

        Raises:
            InvalidProblemError: If a shape is not the problem's, or a number missing.
        """
        given = _numbers("x0", x0)
        if self.stated.risk is not None:
            given = self.stated.risk.start(given, self.stated.model.nx)
        if given.size != self.stated.model.nx:
            raise InvalidProblemError(
                f"x0 must have shape ({self.stated.model.nx},), got {np.shape(x0)}"
            )
        place = self.places
        state = np.full(self.core.model.nx, np.nan)
        state[place["states"]], state[place["risk"]] = given, 0.0
        if place["previous"]:
            lower, upper = self.stated.control_limits
            nearest = np.clip(np.zeros(lower.size), lower, upper)
            state[place["previous"]] = (
                nearest
                if previous is None
                else _sized("previous", previous, lower.size)
            )
        for copy, name in zip(place["copies"], self.stated.periodic, strict=True):
            state[copy] = given[self.stated.model.state_names.index(name)]
        for one in self.core.free_starts:
            guess = state[one.states[0]]
            value = one.value.first if np.isnan(guess) else guess
            state[list(one.states)] = np.clip(value, one.value.lower, one.value.upper)
        return state

    def states(self, states: Array, x0: Array) -> Array:
        """Return the core's states at the nodes.

        Args:
            states: Of the stated problem, shape (nx, nodes); those of the core are
                returned as they are.
            x0: The core's initial state.
        """
        rows = np.asarray(states, dtype=np.float64)
        if rows.shape[0] == self.core.model.nx:
            return rows
        more = np.repeat(x0[rows.shape[0] :, None], rows.shape[1], axis=1)
        return np.vstack([rows, more])

    def parameters(self, values: ArrayLike, time: float) -> Array:
        """Return the core's parameters.

        Args:
            values: Of the parameters that are not decided, in the model's order.
            time: At the start of the horizon [s].
        """
        given = np.asarray(values)
        if self.stated.model.time.numel() and given.size == len(self.known_parameters):
            return np.append(given, time)
        return given

    def signals(self, values: ArrayLike) -> Array:
        """Return the core's signals at the nodes, of those of the stated problem.

        Raises:
            InvalidProblemError: If the shape is not the problem's.
        """
        given = np.asarray(values)
        nodes = self.core.nodes
        if not self.stated.model.time.numel():
            return given
        tau, own = np.linspace(0.0, 1.0, nodes)[None, :], self.stated.model.ns
        rows = given if given.size else np.empty((0, nodes))
        if rows.shape != (self.stated.ns, nodes):
            raise InvalidProblemError(
                f"signals must have shape ({self.stated.ns}, {nodes}), got {rows.shape}"
            )
        return np.vstack([rows[:own], tau, rows[own:]])


def lowered(stated: OptimalControlProblem) -> Lowered:
    """Return a problem with its core, which is the same where nothing is lowered.

    Raises:
        InvalidProblemError: If a discrete-time model has a free end time.
    """
    given, stated = stated, _minimised(stated)
    free_end = isinstance(stated.horizon, Free)
    remembers = bool(stated.previous.numel())
    if not (
        free_end
        or stated.decided
        or stated.periodic
        or remembers
        or stated.model.time.numel()
        or _risk_states(stated)
    ):
        return Lowered(given, stated)
    if free_end and stated.model.is_discrete:
        raise InvalidProblemError(
            "a discrete-time model has no end time to decide: its horizon must be a "
            "number"
        )
    return Lowered(given, _core(stated))


def _minimised(stated: OptimalControlProblem) -> OptimalControlProblem:
    """Return a problem whose costs are minimised."""
    if not stated.maximize:
        return stated
    return replace(
        stated,
        stage_cost=-stated.stage_cost,
        step_cost=-stated.step_cost,
        initial_cost=-stated.initial_cost,
        terminal_cost=-stated.terminal_cost,
        risk=None if stated.risk is None else stated.risk.negated(),
        maximize=False,
    )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Added:
    """The symbols that the core has besides those of the stated problem.

    Attributes:
        end_time: The state that is the end time, where it is free; else empty.
        decided: The parameters that are decided, in the order of their names.
        copies: The start of each periodic state.
        accrued: The members' costs so far, of an ensemble; else empty.
        epigraph: What the NLP decides for their risk; else empty.
        length: Length of the horizon [s].
        scale: Seconds to a unit of the core's time: the end time where it is free.
        clock: The time.
    """

    end_time: ca.SX
    decided: ca.SX
    copies: ca.SX
    accrued: ca.SX
    epigraph: ca.SX
    length: ca.SX
    scale: ca.SX
    clock: "_Clock"

    @property
    def constant(self) -> ca.SX:
        """The states that stay as they began."""
        return ca.vertcat(self.end_time, self.decided, self.copies)


def _added(stated: OptimalControlProblem) -> _Added:
    """Return the symbols that the core of a problem needs."""
    model, free_end = stated.model, isinstance(stated.horizon, Free)
    T = ca.SX.sym(END_TIME, int(free_end))
    names = symbol_names(model.parameters)
    decided = [model.parameters[names.index(name)] for name in stated.decided]
    copies = [symbol_of(_copy_of(name)) for name in stated.periodic]
    accrued, epigraph = _risk_symbols(stated)
    length = T if free_end else ca.SX(stated.length)
    return _Added(
        end_time=T,
        decided=ca.vertcat(ca.SX(0, 1), *decided),
        copies=ca.vertcat(ca.SX(0, 1), *copies),
        accrued=accrued,
        epigraph=epigraph,
        length=length,
        scale=T if free_end else ca.SX(1),
        clock=_clock(model, length),
    )


def _core(stated: OptimalControlProblem) -> OptimalControlProblem:
    added, free_end = _added(stated), isinstance(stated.horizon, Free)
    model = stated.model

    def timed(expression: ca.SX) -> ca.SX:
        if not model.time.numel():
            return expression
        return ca.substitute(expression, model.time, added.clock.time)

    core_model = _core_model(stated, added, timed)
    stage, risk = timed(stated.stage_cost), _timed_risk(stated.risk, timed, added.scale)
    end = None if risk is None else _epigraph(risk, added, core_model.nx)
    terminal_cost = timed(stated.terminal_cost)
    return replace(
        stated,
        model=core_model,
        horizon=1.0 if free_end else stated.length,
        stage_cost=added.scale * stage if free_end else stage,
        step_cost=timed(stated.step_cost),
        initial_cost=timed(stated.initial_cost),
        terminal_cost=terminal_cost if end is None else end.risk.of(end.costs),
        risk=risk,
        epigraph=end,
        constraints=_core_constraints(stated, added, timed),
        terminal=_core_terminal(stated, added, timed),
        start=dict(_starts(stated)),
        periodic=(),
        decided={},
        previous=ca.SX(0, 1),
        signals=ca.vertcat(core_model.signals, stated.signals[model.ns :, 0]),
        bounds=_bounds(stated, core_model.nx),
    )


def _core_model(stated: OptimalControlProblem, added: _Added, timed: _Timed) -> Model:
    """Return the model with the states that the core adds."""
    model, previous = stated.model, int(stated.previous.numel())
    free_end = isinstance(stated.horizon, Free)
    after = timed(model.next_state) if model.jumps else model.states
    accrual = _accrual(stated, added.length, added.scale, after)
    rates, steps = (timed(costs) for costs in accrual)
    held = model.controls[:previous, 0]
    next_state = ca.vertcat(
        after, added.constant, held, added.accrued + steps, added.epigraph
    )
    jumps = model.jumps or bool(previous) or not steps.is_zero()
    known = [
        model.parameters[i]
        for i, name in enumerate(symbol_names(model.parameters))
        if name not in stated.decided
    ]
    return Model(
        states=ca.vertcat(
            model.states, added.constant, stated.previous, added.accrued, added.epigraph
        ),
        controls=model.controls,
        ode=ca.vertcat(
            added.scale * timed(model.ode) if free_end else timed(model.ode),
            ca.SX.zeros(added.constant.numel() + previous),
            rates,
            ca.SX.zeros(added.epigraph.numel()),
        ),
        next_state=next_state if jumps else ca.SX(0, 1),
        parameters=ca.vertcat(ca.SX(0, 1), *known, added.clock.begin),
        signals=ca.vertcat(model.signals, added.clock.tau),
        state_names=(
            *model.state_names,
            *([END_TIME] if free_end else []),
            *stated.decided,
            *symbol_names(added.copies),
            *[f"previous {name}" for name in model.control_names[:previous]],
            *symbol_names(ca.vertcat(added.accrued, added.epigraph)),
        ),
        control_names=model.control_names,
    )


def _epigraph(risk: Risk, added: _Added, states: int) -> Epigraph | None:
    """Return the epigraph of a risk; None if the NLP decides nothing for it."""
    if not added.epigraph.numel():
        return None
    first = states - int(added.epigraph.numel())
    return Epigraph(
        risk=risk,
        costs=added.accrued + risk.terminal,
        decided=added.epigraph,
        first=first,
        accrued=tuple(range(first - risk.members, first)),
    )


def _core_constraints(
    stated: OptimalControlProblem, added: _Added, timed: _Timed
) -> list[Constraint | ca.SX]:
    """Return the path constraints, hard and soft, with the time as the core has it."""
    hard = [
        _with_expression(c, timed(c.expression)) if stated.model.time.numel() else c
        for c in stated.stated
    ]
    soft = [
        replace(
            c,
            expression=timed(c.expression),
            weight=added.scale * timed(c.weights[0]),
            quadratic_weight=added.scale * timed(c.weights[1]),
        )
        for c in stated.soft
    ]
    return [*hard, *soft]


def _core_terminal(
    stated: OptimalControlProblem, added: _Added, timed: _Timed
) -> list[TerminalConstraint]:
    """Return the terminal constraints, those of the periodic states among them."""
    model = stated.model
    copied = [model.state_names.index(name) for name in stated.periodic]
    return [
        *[_timed_end(c, timed(c.expression)) for c in stated.terminal_constraints],
        *[
            TerminalConstraint(
                expression=model.states[i] - added.copies[k],
                name=f"{model.state_names[i]} as at the start",
            )
            for k, i in enumerate(copied)
        ],
    ]


def _risk_states(stated: OptimalControlProblem) -> int:
    """Return the number of states that the members' costs need."""
    return sum(symbols.numel() for symbols in _risk_symbols(stated))


def _risk_symbols(stated: OptimalControlProblem) -> tuple[ca.SX, ca.SX]:
    """Return symbols of the members' costs so far, and of t, e, r; see risk.py."""
    risk, none = stated.risk, ca.SX(0, 1)
    if risk is None or stated.epigraph is not None:  # That of a core is made.
        return none, none
    epigraph = epigraph_symbols(risk)
    if not epigraph.numel():
        return none, none
    costs = [ca.SX.sym(f"cost of member {m}") for m in range(risk.members)]
    return ca.vertcat(*costs), epigraph


def _accrual(
    stated: OptimalControlProblem, length: ca.SX, scale: ca.SX, after: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return the rates of the members' costs, and what an interval's end adds to them.

    Args:
        stated: The problem.
        length: Of the horizon [s].
        scale: What rates are multiplied with.
        after: The states that an interval's end leaves.
    """
    risk, model = stated.risk, stated.model
    if risk is None or not epigraph_symbols(risk).numel():
        return ca.SX(0, 1), ca.SX(0, 1)
    dt = length / stated.intervals
    if stated.quadrature == "right":
        ends = ca.substitute(risk.stage, model.states, after)
        return ca.SX.zeros(risk.members), risk.step + dt * ends
    if stated.quadrature == "left" or model.is_discrete:
        # Held over the interval, and so the same at its end; see ensemble.py.
        return ca.SX.zeros(risk.members), risk.step + dt * risk.stage
    return scale * risk.stage, risk.step


def _timed_risk(
    risk: Risk | None, timed: Callable[[ca.SX], ca.SX], scale: ca.SX
) -> Risk | None:
    """Return the members' costs as the core has them."""
    if risk is None:
        return None
    return replace(
        risk,
        stage=scale * timed(risk.stage),
        step=timed(risk.step),
        initial=timed(risk.initial),
        terminal=timed(risk.terminal),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Clock:
    """The time as the core has it."""

    time: ca.SX
    begin: ca.SX
    tau: ca.SX


def _clock(model: Model, length: ca.SX) -> _Clock:
    count = int(model.time.numel())
    begin, tau = ca.SX.sym("t0", count), ca.SX.sym("tau", count)
    return _Clock(begin + length * tau if count else ca.SX(0, 1), begin, tau)


def _with_expression(constraint: Constraint, expression: ca.SX) -> Constraint:
    """Return a path constraint, a distance or another, on another expression."""
    field = "relative" if hasattr(constraint, "relative") else "expression"
    changed: Constraint = replace(constraint, **{field: expression})  # type: ignore[type-var]
    return changed


def _timed_end(constraint: TerminalConstraint, expression: ca.SX) -> TerminalConstraint:
    return TerminalConstraint(
        expression=expression,
        lower=constraint.lower,
        upper=constraint.upper,
        scale=constraint.scale,
        name=constraint.name,
    )


def _starts(
    stated: OptimalControlProblem,
) -> Iterator[tuple[str | tuple[str, ...], Free]]:
    """Yield the free starts of the core: (names of states, bounds)."""
    for key, value in stated.start.items():
        names = (key,) if isinstance(key, str) else tuple(key)
        copies = [_copy_of(name) for name in names if name in stated.periodic]
        together = (*names, *copies)
        yield (together[0] if len(together) == 1 else together), value
    if isinstance(stated.horizon, Free):
        yield END_TIME, stated.horizon
    yield from stated.decided.items()


def _copy_of(name: str) -> str:
    return f"{name} at the start"


def _bounds(stated: OptimalControlProblem, states: int) -> Bounds:
    """Return the bounds of the core, whose other states have none along the way."""
    more = states - stated.model.nx
    lower, upper = stated.state_limits
    scale = stated.bounds.state_scale
    return replace(
        stated.bounds,
        states=(
            np.append(lower, np.full(more, -np.inf)),
            np.append(upper, np.full(more, np.inf)),
        ),
        state_scale=None if scale is None else np.append(scale, np.ones(more)),
    )


def _sized(role: str, values: ArrayLike, size: int) -> Array:
    """Return finite numbers, as many as there must be."""
    found = _numbers(role, values)
    if found.size != size or not np.isfinite(found).all():
        raise InvalidProblemError(
            f"{role} must be {size} finite numbers, got {values!r}"
        )
    return found


def _numbers(role: str, values: ArrayLike) -> Array:
    try:
        return np.array(values, dtype=np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise InvalidProblemError(f"{role} must be numbers, got {values!r}") from error
