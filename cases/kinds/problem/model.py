"""The model of a problem and its planning problem, of one vehicle or of several.

    x' = rate(t, x, u, p, s),  x+ = next(t, x, u, p, s) at the end of an interval,
    J = integral of stage_cost + step_cost of each interval + initial and terminal cost

Several vehicles share parameters and signals; planned jointly they are stacked, one
after another each has a problem of its own with the positions of those before it as
its last signals.
"""

from collections.abc import Mapping, Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.kinds.problem.constraints import (
    path_constraint,
    separations,
    terminal_constraint,
)
from swarmstart.cases.kinds.problem.members import Member, column_of
from swarmstart.cases.kinds.problem.scenario import (
    Control,
    Decided,
    ProblemScenario,
    State,
)
from swarmstart.cases.kinds.problem.symbols import (
    decided_parameters,
    free,
    limits,
    number,
)
from swarmstart.ocp import Bounds, Free, Model, OptimalControlProblem

Array = NDArray[np.float64]
COSTS = ("stage_cost", "step_cost", "initial_cost", "terminal_cost")


def model_of(
    scenario: ProblemScenario,
    members: Sequence[Member],
    *,
    disturbed: bool = False,
    timed: bool = False,
) -> Model:
    """Return the members side by side as one model.

    Args:
        scenario: The scenario.
        members: The members.
        disturbed: Whether disturbances are parameters after the file's own, those of
            one member after those of another: for a plant.
        timed: Whether it has the time even if no rate depends on it.
    """
    shared = members[0].shared
    parameters, rates, after = [*shared.parameters.values()], [], []
    jumps = any(state.next is not None for state in scenario.states.values())
    for member in members:
        for name, state in scenario.states.items():
            rate = member.scopes["rate"].symbol(state.rate or "0")
            if disturbed and name in scenario.plant.disturbance:
                parameters.append(ca.SX.sym(f"disturbance_{name}{member.suffix}"))
                rate += parameters[-1]
            rates.append(rate)
            if state.next is not None:
                after.append(member.scopes["next"].symbol(state.next))
            elif jumps:
                after.append(member.states[name])
    ode, next_state = column_of(rates), column_of(after)
    changes = ca.vertcat(ode, next_state)
    signals = column_of(shared.signals.values())
    return Model(
        states=column_of(s for member in members for s in member.states.values()),
        controls=column_of(u for member in members for u in member.controls.values()),
        ode=ode,
        next_state=next_state,
        parameters=column_of(parameters),
        signals=signals if _uses(changes, signals) else ca.SX(0, 1),
        time=shared.time if timed or _uses(changes, shared.time) else ca.SX(0, 1),
        state_names=tuple(n for m in members for n in m.titled(m.states)),
        control_names=tuple(n for m in members for n in m.titled(m.controls)),
    )


def planning_problem(
    scenario: ProblemScenario, members: Sequence[Member], *, seen: Sequence[Member] = ()
) -> OptimalControlProblem:
    """Return the planning problem of some members.

    Args:
        scenario: The scenario.
        members: Those that are planned together.
        seen: Others whose positions are the last signals.
    """
    first, grid = members[0], scenario.prediction
    separation = None if scenario.vehicles is None else scenario.vehicles.separation
    dimensions = 0 if separation is None else len(separation.of)
    others = [ca.SX.sym(f"position{m.suffix}", dimensions) for m in seen]
    costs = {place: _cost(scenario, members, place) for place in COSTS}
    constraints = [
        *(path_constraint(c, member) for member in members for c in scenario.path),
        *separations(separation, members, dict(zip(seen, others, strict=True))),
    ]
    terminal = [
        terminal_constraint(c, member) for member in members for c in scenario.terminal
    ]
    used = column_of(
        [*costs.values(), *(c.expression for c in (*constraints, *terminal))]
    )
    previous = column_of(u for m in members for u in m.previous.values())
    return OptimalControlProblem(
        model_of(scenario, members, timed=_uses(used, first.shared.time)),
        horizon=horizon_of(scenario, first.constants),
        intervals=grid.intervals,
        stage_cost=costs["stage_cost"],
        step_cost=costs["step_cost"],
        initial_cost=costs["initial_cost"],
        terminal_cost=costs["terminal_cost"],
        maximize=scenario.maximize,
        bounds=_bounds(scenario, members),
        constraints=constraints,
        terminal=terminal,
        start={f"{n}{m.suffix}": f for m in members for n, f in m.decided.items()},
        periodic=[
            f"{name}{member.suffix}"
            for member in members
            for name, state in scenario.states.items()
            if state.periodic
        ],
        decided=decided_parameters(scenario, first.constants),
        previous=previous if _uses(used, previous) else ca.SX(0, 1),
        signals=column_of([*first.shared.signals.values(), *others]),
        control_shape=grid.control_shape,
        scales=_scales(scenario, members),
        quadrature=grid.quadrature,
        integrator=grid.integrator,
        substeps=grid.substeps,
        checks=grid.checks,
        tolerance=grid.tolerance,
        path_tolerance=grid.path_tolerance,
    )


def horizon_of(
    scenario: ProblemScenario, constants: Mapping[str, float]
) -> float | Free:
    """Return the length of the horizon [s], or within what it is decided.

    In discrete time it may be left out: an interval lasts 1.
    """
    given = scenario.prediction.horizon_s
    if given is None:
        return float(scenario.prediction.intervals)
    return free(given, constants) if isinstance(given, Decided) else given


def previous_controls(
    scenario: ProblemScenario, members: Sequence[Member]
) -> Array | None:
    """Return the controls before the first interval; None: no one says what they are.

    Those of which nothing is said are the nearest to zero within their bounds.
    """
    if all(control.previous is None for control in scenario.controls.values()):
        return None
    values = [
        np.clip(0.0, *limits(control.bounds, member.constants))
        if control.previous is None
        else number(control.previous, member.constants)
        for member in members
        for control in scenario.controls.values()
    ]
    return np.array(values)


def _uses(expression: ca.SX, symbols: ca.SX) -> bool:
    """Return whether an expression depends on any of some symbols."""
    return bool(symbols.numel()) and bool(ca.depends_on(expression, symbols))


def positions_of(scenario: ProblemScenario) -> tuple[int, ...]:
    """Return the rows of the states that a separation is of; they must be states."""
    if scenario.vehicles is None or scenario.vehicles.separation is None:
        return ()
    names = list(scenario.states)
    return tuple(names.index(name.strip()) for name in scenario.vehicles.separation.of)


def _cost(scenario: ProblemScenario, members: Sequence[Member], place: str) -> ca.SX:
    """Return the sum of all members' costs."""
    text = getattr(scenario, place)
    first, *others = (member.scopes[place].symbol(text) for member in members)
    return sum(others, first)


def _bounds(scenario: ProblemScenario, members: Sequence[Member]) -> Bounds:
    states, controls = scenario.states.values(), scenario.controls.values()
    of_controls = [limits(c.bounds, m.constants) for m in members for c in controls]
    of_states = [limits(s.bounds, m.constants) for m in members for s in states]
    of_search = [
        limits(c.search_bounds or c.bounds, m.constants)
        for m in members
        for c in controls
    ]
    is_narrower = any(c.search_bounds is not None for c in controls)
    return Bounds(
        controls=_pair(of_controls),
        search=_pair(of_search) if is_narrower else None,
        states=_pair(of_states),
    )


def _scales(scenario: ProblemScenario, members: Sequence[Member]) -> dict[str, float]:
    """Return the sizes of states and controls that are given, by name."""
    given: dict[str, State | Control] = {**scenario.states, **scenario.controls}
    return {
        f"{name}{member.suffix}": number(part.scale, member.constants)
        for member in members
        for name, part in given.items()
        if part.scale is not None
    }


def _pair(ranges: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
    lower, upper = np.array(ranges).T
    return lower, upper
