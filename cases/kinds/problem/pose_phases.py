"""A problem of several phases -> its agent and its plant.

The states are those of all phases, then the time and values that phases keep. A control
that a phase does not have is constant there.
"""

from collections.abc import Callable, Mapping

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import PosedAgent, PosedPlant
from swarmstart.cases.kinds.problem.stated.members import (
    candidate_scopes,
    members_of,
    shared_of,
)
from swarmstart.cases.kinds.problem.stated.phases import (
    expected_ends,
    interval_ends,
    joined,
    whole_scenario,
)
from swarmstart.cases.kinds.problem.stated.posed import ProblemPosed
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.symbols import (
    constants_of,
    known_parameters,
    over_time,
    rows_over_time,
)
from swarmstart.cases.kinds.problem.stated.values import OverTime
from swarmstart.ocp import OptimalControlProblem, Start, zero_controls
from swarmstart.ocp.statement import CLOCK, COUNTER


def pose_phases(scenario: ProblemScenario) -> ProblemPosed:
    """Return the agent that plans all phases, and its plant."""
    together, members = joined(scenario)
    problem, fixed = together.problem, constants_of(scenario)
    given, feedback = known_parameters(scenario), scenario.feedback
    over = {**given, **scenario.plant.parameters}
    truly = {name: over[name] for name in scenario.parameters if name in over}
    planned = rows_over_time(given, fixed)
    return ProblemPosed(
        agents=(
            PosedAgent(
                problem=problem,
                parameters=None
                if planned is None
                else lambda time: planned(np.array([time]))[:, 0],
                candidates=_candidates(scenario, problem),
                append=feedback.append,
                shift=feedback.last_plan == "shifted",
                first=_guessed(scenario, problem),
            ),
        ),
        x0=together.start(members[0].start),
        plant=PosedPlant(
            model=problem.model,
            substeps=scenario.plant.substeps,
            parameters=rows_over_time(truly, fixed),
            decided={
                name: one.first
                for name, one in problem.decided.items()
                if name not in truly
            },
            differs=bool(scenario.plant.parameters),
        ),
        open_loop=True,
        repair=feedback.repair,
        known={name: over_time(one, fixed) for name, one in truly.items()},
        members=tuple(members),
    )


def _candidates(
    scenario: ProblemScenario, problem: OptimalControlProblem
) -> Callable[[float], Array] | None:
    """Return additional controls of all phases for a search, held over the horizon."""
    if not scenario.candidates:
        return None
    whole, fixed = whole_scenario(scenario), constants_of(scenario)
    members = members_of(whole, shared_of(whole))

    def candidates(time: float) -> Array:
        (scope,) = candidate_scopes(whole, members, fixed, time)
        columns = [
            [scope.number(one[name]) for name in whole.controls]
            for one in scenario.candidates
        ]
        return np.repeat(np.array(columns).T[:, None, :], problem.intervals, axis=1)

    return candidates


def _guessed(
    scenario: ProblemScenario, problem: OptimalControlProblem
) -> Array | Start | None:
    """Return the start of the plan: controls (nu, N), states (nx, nodes)."""
    guess, checks = scenario.guess, problem.checks
    if not (guess.controls or guess.states):
        return None
    whole, fixed = whole_scenario(scenario), constants_of(scenario)
    times = _node_times(scenario, problem)

    def rows(
        given: Mapping[str, OverTime], names: Mapping[str, object], at: Array
    ) -> Array:
        found = [
            over_time(given[name], fixed)(at) if name in given else np.zeros_like(at)
            for name in names
        ]
        return np.stack(found)

    controls = zero_controls(problem)
    if guess.controls:
        controls = rows(guess.controls, whole.controls, times[:-1:checks])
    if not guess.states:
        return controls
    states = np.zeros((problem.model.nx, problem.nodes))
    states[: len(whole.states)] = rows(guess.states, whole.states, times)
    names = problem.model.state_names
    states[names.index(CLOCK)] = times
    states[names.index(COUNTER)] = np.arange(problem.nodes) // checks
    return Start(controls, states)


def _node_times(scenario: ProblemScenario, problem: OptimalControlProblem) -> Array:
    """Return the guessed times of the nodes of all phases [s]."""
    ends, counts = expected_ends(scenario, problem), [0, *interval_ends(scenario)]
    at = np.arange(problem.nodes) / problem.checks
    return np.asarray(np.interp(at, counts, ends))
