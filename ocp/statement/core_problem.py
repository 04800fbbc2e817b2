"""Core of a problem: all decisions besides the controls are turned into states.

    end time T       a constant state; rates and stage cost are multiplied by T, and the
                     horizon is 1
    parameter        a constant state, if it is decided
    periodic state   a constant copy of its start; both must be equal at the end
    previous control a state that the end of an interval sets to the control
    time             t0 + T tau, with the parameter t0 and the signal tau in [0, 1]
    linear controls  two states each; see control_shape.py
    risk             the members' accrued costs as states, and the NLP's own decisions

The correspondence between a stated problem and its core is in lowering.py.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from swarmstart.ocp.common.expressions import symbol_names, symbol_of
from swarmstart.ocp.statement.control_shape import Knots, knot_names, knots_of
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.risk import Epigraph, Risk, epigraph_symbols
from swarmstart.ocp.system.constraints import Bounds, Constraint, TerminalConstraint
from swarmstart.ocp.system.model import Model

_Timed = Callable[[ca.SX], ca.SX]
"""An expression -> the same with the time as the core expresses it."""
END_TIME = "end time"
"""Name of the state that represents a free end time."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Added:
    """Symbols that the core has besides those of the stated problem.

    Attributes:
        end_time: State for the end time, if it is free; else empty.
        decided: Parameters that are decided, in the order of their names.
        copies: Copy of the start of each periodic state.
        previous: Previous controls, if they are used; else empty.
        knots: States of linear controls; empty if the controls are held.
        accrued: Accrued costs of the members of an ensemble; else empty.
        epigraph: Decisions that an NLP needs for their risk; else empty.
        length: Length of the horizon [s].
        scale: Seconds in a unit of the core's time: the end time if it is free.
        clock: Expression of the time.
    """

    end_time: ca.SX
    decided: ca.SX
    copies: ca.SX
    previous: ca.SX
    knots: Knots
    accrued: ca.SX
    epigraph: ca.SX
    length: ca.SX
    scale: ca.SX
    clock: "_Clock"

    @property
    def constant(self) -> ca.SX:
        """States that keep their initial value."""
        return ca.vertcat(self.end_time, self.decided, self.copies)


def _added(stated: OptimalControlProblem) -> _Added:
    """Return the symbols that the core of a problem needs in addition."""
    model, free_end = stated.model, isinstance(stated.horizon, Free)
    T = ca.SX.sym(END_TIME, int(free_end))  # Empty if the end is given.
    names = symbol_names(model.parameters)
    # The symbol itself becomes a state, so expressions need no change.
    decided = [model.parameters[names.index(name)] for name in stated.decided]
    copies = [symbol_of(_copy_of(name)) for name in stated.periodic]
    accrued, epigraph = _risk_symbols(stated)
    length = T if free_end else ca.SX(stated.length)
    return _Added(
        end_time=T,
        decided=ca.vertcat(ca.SX(0, 1), *decided),
        copies=ca.vertcat(ca.SX(0, 1), *copies),
        # The knot at the start of an interval is the previous control.
        previous=ca.SX(0, 1) if stated.has_knots else stated.previous,
        knots=knots_of(model.control_names, stated.control_shape),
        accrued=accrued,
        epigraph=epigraph,
        length=length,
        scale=T if free_end else ca.SX(1),
        clock=_clock(model, length),
    )


def core_of(stated: OptimalControlProblem) -> OptimalControlProblem:
    """Return the core of a problem whose costs are minimised."""
    added, free_end = _added(stated), isinstance(stated.horizon, Free)
    model = stated.model

    def begun(expression: ca.SX) -> ca.SX:
        """Return an expression that is evaluated once, at the start of an interval."""
        if stated.has_knots and stated.previous.numel():
            expression = ca.substitute(expression, stated.previous, added.knots.first)
        if not model.time.numel():
            return expression
        return ca.substitute(expression, model.time, added.clock.time)

    def timed(expression: ca.SX) -> ca.SX:
        """Return an expression that is evaluated at any time."""
        if stated.has_knots:
            expression = ca.substitute(expression, model.controls, added.knots.now)
        return begun(expression)

    core_model = _core_model(stated, added, timed)
    stage = timed(stated.stage_cost)
    risk = _timed_risk(stated.risk, timed, begun, added.scale)
    end = None if risk is None else _epigraph(risk, added, core_model.nx)
    terminal_cost = timed(stated.terminal_cost)
    return replace(
        stated,
        model=core_model,
        horizon=1.0 if free_end else stated.length,
        stage_cost=added.scale * stage if free_end else stage,
        step_cost=begun(stated.step_cost),
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
        scales=_scales(stated),
        control_shape="constant",
    )


def _core_model(stated: OptimalControlProblem, added: _Added, timed: _Timed) -> Model:
    """Return the model with the states that the core adds."""
    model, previous = stated.model, int(added.previous.numel())
    free_end, knots = isinstance(stated.horizon, Free), added.knots
    after = timed(model.next_state) if model.jumps else model.states
    accrual = _accrual(stated, added, after)
    rates, steps = (timed(costs) for costs in accrual)
    held = model.controls[:previous, 0]
    next_state = ca.vertcat(
        after,
        added.constant,
        held,
        knots.after(model.controls[: knots.first.numel(), 0]),
        added.accrued + steps,
        added.epigraph,
    )
    remembers = bool(previous) or stated.has_knots
    jumps = model.jumps or remembers or not steps.is_zero()
    known = [
        model.parameters[i]
        for i, name in enumerate(symbol_names(model.parameters))
        if name not in stated.decided
    ]
    return Model(
        states=ca.vertcat(
            model.states,
            added.constant,
            added.previous,
            knots.states,
            added.accrued,
            added.epigraph,
        ),
        controls=model.controls,
        ode=ca.vertcat(
            added.scale * timed(model.ode) if free_end else timed(model.ode),
            ca.SX.zeros(added.constant.numel() + previous),
            _knot_rates(stated, knots),
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
            *symbol_names(ca.vertcat(knots.states, added.accrued, added.epigraph)),
        ),
        control_names=model.control_names,
        outputs={name: timed(output) for name, output in model.outputs.items()},
        elimination=model.elimination.rewritten(timed),
    )


def _knot_rates(stated: OptimalControlProblem, knots: Knots) -> ca.SX:
    """Return the rates of the states of linear controls."""
    if not stated.has_knots:
        return knots.states  # Empty.
    whole = 1.0 if isinstance(stated.horizon, Free) else stated.length
    return knots.rates(stated.model.controls, whole / stated.intervals)


def _epigraph(risk: Risk, added: _Added, states: int) -> Epigraph | None:
    """Return the epigraph of a risk; None if the NLP needs no decisions for it."""
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
    """Return the path constraints, hard and soft, with the core's time."""
    moves = stated.model.time.numel() or stated.has_knots
    hard = [
        _with_expression(c, timed(c.expression)) if moves else c for c in stated.stated
    ]
    soft = [
        replace(
            c,
            expression=timed(c.expression),
            # A weight is per second, and the core integrates over its own time.
            weight=added.scale * timed(c.weights[0]),
            quadratic_weight=added.scale * timed(c.weights[1]),
        )
        for c in stated.soft
    ]
    return [*hard, *soft]


def _core_terminal(
    stated: OptimalControlProblem, added: _Added, timed: _Timed
) -> list[TerminalConstraint]:
    """Return the terminal constraints, including those of the periodic states."""
    model = stated.model
    copied = [model.state_names.index(name) for name in stated.periodic]
    return [
        *[replace(c, expression=timed(c.expression))
          for c in stated.terminal_constraints],
        *[
            TerminalConstraint(
                expression=model.states[i] - added.copies[k],
                name=f"{model.state_names[i]} as at the start",
            )
            for k, i in enumerate(copied)
        ],
    ]  # fmt: skip


def risk_states(stated: OptimalControlProblem) -> int:
    """Return the number of states that the members' costs need."""
    return sum(symbols.numel() for symbols in _risk_symbols(stated))


def _risk_symbols(stated: OptimalControlProblem) -> tuple[ca.SX, ca.SX]:
    """Return symbols of the members' accrued costs, and of t, e, r; see risk.py."""
    risk, none = stated.risk, ca.SX(0, 1)
    if risk is None or stated.epigraph is not None:  # A core has its epigraph already.
        return none, none
    epigraph = epigraph_symbols(risk)
    if not epigraph.numel():
        return none, none
    costs = [ca.SX.sym(f"cost of member {m}") for m in range(risk.members)]
    return ca.vertcat(*costs), epigraph


def _accrual(
    stated: OptimalControlProblem, added: _Added, after: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return the rates of the members' costs, and their steps at an interval's end."""
    risk, model = stated.risk, stated.model
    if risk is None or not epigraph_symbols(risk).numel():
        return ca.SX(0, 1), ca.SX(0, 1)
    dt = added.length / stated.intervals
    if stated.quadrature == "right":
        ends = ca.substitute(risk.stage, model.states, after)
        return ca.SX.zeros(risk.members), risk.step + dt * ends
    if stated.quadrature == "left" or model.is_discrete:
        # Held over the interval, and so the same at its end; see ensemble.py.
        stage = risk.stage
        if stated.has_knots:
            stage = ca.substitute(stage, model.controls, added.knots.first)
        return ca.SX.zeros(risk.members), risk.step + dt * stage
    return added.scale * risk.stage, risk.step


def _timed_risk(
    risk: Risk | None, timed: _Timed, begun: _Timed, scale: ca.SX
) -> Risk | None:
    """Return the members' costs in the core's time; step costs at interval starts."""
    if risk is None:
        return None
    return replace(
        risk,
        stage=scale * timed(risk.stage),
        step=begun(risk.step),
        initial=timed(risk.initial),
        terminal=timed(risk.terminal),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Clock:
    """Time in the core."""

    time: ca.SX
    begin: ca.SX
    tau: ca.SX


def _clock(model: Model, length: ca.SX) -> _Clock:
    count = int(model.time.numel())
    begin, tau = ca.SX.sym("t0", count), ca.SX.sym("tau", count)
    return _Clock(begin + length * tau if count else ca.SX(0, 1), begin, tau)


def _with_expression(constraint: Constraint, expression: ca.SX) -> Constraint:
    """Return a copy of a path constraint with another expression."""
    field = "relative" if hasattr(constraint, "relative") else "expression"
    changed: Constraint = replace(constraint, **{field: expression})  # type: ignore[type-var]
    return changed


def _starts(
    stated: OptimalControlProblem,
) -> Iterator[tuple[str | tuple[str, ...], Free]]:
    """Yield the free starts of the core: (names of states, bounds)."""
    for key, value in stated.start.items():
        names = (key,) if isinstance(key, str) else tuple(key)
        copies = [_copy_of(name) for name in names if name in stated.periodic]
        together = (*names, *copies)  # A copy starts at the same value.
        yield (together[0] if len(together) == 1 else together), value
    if isinstance(stated.horizon, Free):
        yield END_TIME, stated.horizon
    yield from stated.decided.items()
    yield from _first_knots(stated)


def _first_knots(
    stated: OptimalControlProblem,
) -> Iterator[tuple[tuple[str, ...], Free]]:
    """Yield the first knots of linear controls, if they are decided."""
    if stated.control_shape != "linear":
        return
    # Members of an ensemble that share the first control share its first knot.
    labels = stated.control_labels[:, 0]
    lower, upper = stated.control_limits
    for label in np.unique(labels):
        together = np.flatnonzero(labels == label)
        names = [knot_names(stated.model.control_names[j]) for j in together]
        j = int(together[0])
        limits = Free(float(lower[j]), float(upper[j]))
        yield tuple(name for pair in names for name in reversed(pair)), limits


def _scales(stated: OptimalControlProblem) -> dict[str, float]:
    """Return the given sizes; states of linear controls get those of the controls."""
    scales = dict(stated.scales)
    if not stated.has_knots:
        return scales
    lower, upper = stated.control_limits
    for j, name in enumerate(stated.model.control_names):
        size = scales.get(name, float(upper[j] - lower[j]))
        if 0 < size < np.inf:  # Else it is found, as for any other state.
            scales.update(dict.fromkeys(knot_names(name), size))
    return scales


def _copy_of(name: str) -> str:
    return f"{name} at the start"


def _bounds(stated: OptimalControlProblem, states: int) -> Bounds:
    """Return the bounds of the core; the states that it adds are unbounded."""
    more = states - stated.model.nx
    lower, upper = stated.state_limits
    scale = stated.bounds.state_scale
    return replace(
        stated.bounds,
        states=(
            np.append(lower, np.full(more, -np.inf)),
            np.append(upper, np.full(more, np.inf)),
        ),
        # Unbounded states have no excess, so any number will do.
        state_scale=None if scale is None else np.append(scale, np.ones(more)),
    )
