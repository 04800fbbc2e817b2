"""The model of a problem and its planning problem, of one vehicle or of several.

    x' = rate(x, u, p),  J = integral of stage_cost + terminal_cost, per vehicle

Several vehicles share parameters and signals; planned jointly they are stacked, one
after another each has a problem of its own with the positions of those before it as
its last signals.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.kinds.problem.constraints import (
    path_constraint,
    separations,
    terminal_constraint,
)
from swarmstart.cases.kinds.problem.members import Member, column_of
from swarmstart.cases.kinds.problem.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.symbols import limits
from swarmstart.ocp import Bounds, Model, OptimalControlProblem

Array = NDArray[np.float64]


def model_of(
    scenario: ProblemScenario, members: Sequence[Member], *, disturbed: bool = False
) -> Model:
    """Return the members side by side as one model.

    Args:
        scenario: The scenario.
        members: The members.
        disturbed: Whether disturbances are parameters after the file's own, those of
            one member after those of another: for a plant.
    """
    shared = members[0].shared
    parameters, rates = [*shared.parameters.values()], []
    for member in members:
        for name, state in scenario.states.items():
            rate = member.scopes["rate"].symbol(state.rate)
            if disturbed and name in scenario.plant.disturbance:
                parameters.append(ca.SX.sym(f"disturbance_{name}{member.suffix}"))
                rate += parameters[-1]
            rates.append(rate)
    return Model(
        states=column_of(s for member in members for s in member.states.values()),
        controls=column_of(u for member in members for u in member.controls.values()),
        ode=column_of(rates),
        parameters=column_of(parameters),
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
    return OptimalControlProblem(
        model_of(scenario, members),
        stage_cost=_cost(scenario, members, "stage_cost"),
        terminal_cost=_cost(scenario, members, "terminal_cost"),
        maximize=scenario.maximize,
        bounds=_bounds(scenario, members),
        constraints=[
            *(path_constraint(c, member) for member in members for c in scenario.path),
            *separations(separation, members, dict(zip(seen, others, strict=True))),
        ],
        terminal=[
            terminal_constraint(c, member)
            for member in members
            for c in scenario.terminal
        ],
        signals=column_of([*first.shared.signals.values(), *others]),
        quadrature=grid.quadrature,
        **grid.grid(),
        tolerance=grid.tolerance,
        path_tolerance=grid.path_tolerance,
    )


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
    return Bounds(controls=_pair(of_controls), states=_pair(of_states))


def _pair(ranges: Sequence[tuple[float, float]]) -> tuple[Array, Array]:
    lower, upper = np.array(ranges).T
    return lower, upper
