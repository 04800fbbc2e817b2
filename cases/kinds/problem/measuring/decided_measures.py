"""Measures of numbers decided besides controls: end time, parameters, starts.

This module also gives the meanings of all measures that a user's scenario decides or
defines itself.
"""

from collections.abc import Mapping

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Measure
from swarmstart.cases.kinds.problem.stated.names import (
    END_TIME_MEASURE,
    MEMBERS_MEASURE,
)
from swarmstart.cases.kinds.problem.stated.phases import (
    durations,
    phase_names,
    phase_scenarios,
)
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario, UserScenario
from swarmstart.cases.kinds.problem.stated.symbols import (
    is_decided as is_decided_number,
)
from swarmstart.cases.kinds.problem.stated.values import Decided
from swarmstart.ocp import Free, OptimalControlProblem
from swarmstart.ocp.statement import END_TIME, lowered


def is_decided(problem: OptimalControlProblem) -> bool:
    """Return whether a problem decides more than controls."""
    is_free = isinstance(problem.horizon, Free)
    return is_free or bool(problem.decided or problem.start)


def decided_values(problem: OptimalControlProblem, x0: Array) -> dict[str, float]:
    """Return the numbers that a plan decides besides controls, by names of measures.

    Args:
        problem: The problem.
        x0: Initial state of the plan, in the form that the problem has after all
            rewrites (`lowered`).
    """
    whole, names = lowered(problem), problem.model.state_names
    found = {
        END_TIME_MEASURE if name == END_TIME else f"decided_{name}": value
        for name, value in whole.decided(x0).items()
    }
    if problem.risk is None:
        states = {i: names[i] for one in problem.free_starts for i in one.states}
    else:  # All members have one start: names are those of the first, without 0.
        first = len(names) // problem.risk.members
        states = {
            i: names[i].removesuffix("_0")
            for one in problem.free_starts
            for i in one.states
            if i < first
        }
    start = whole.as_stated(x0)
    return found | {f"decided_{name}": float(start[i]) for i, name in states.items()}


def decided_measures(scenario: ProblemScenario) -> dict[str, str]:
    """Return the measures of decided and uncertain numbers: name -> empty text.

    Other measures have a reason why they can be null in place of the empty text.
    """
    is_free = isinstance(scenario.prediction.horizon_s, Decided)
    found = [END_TIME_MEASURE] if is_free or scenario.phases else []
    for name, one in zip(phase_names(scenario), scenario.phases, strict=True):
        found += [f"duration_{name}"] if isinstance(one.horizon_s, Decided) else []
    found += [MEMBERS_MEASURE] if scenario.uncertain else []
    names = [n for n, one in scenario.parameters.items() if isinstance(one, Decided)]
    names += _decided_starts(scenario)
    return dict.fromkeys([*found, *(f"decided_{name}" for name in names)], "")


def _decided_starts(scenario: ProblemScenario) -> list[str]:
    """Return the states with a decided start, with the names of their vehicles."""
    # Only the first phase has a start; the others continue.
    first = phase_scenarios(scenario)[0] if scenario.phases else scenario
    members = scenario.vehicles.members if scenario.vehicles else []
    names = []
    for name, state in first.states.items():
        starts = {f"_{one.name}": one.start.get(name, state.start) for one in members}
        names += [
            f"{name}{end}"
            for end, one in (starts or {"": state.start}).items()
            if is_decided_number(one)
        ]
    return names


def with_durations(
    scenario: ProblemScenario,
    problem: OptimalControlProblem,
    found: Mapping[str, Measure],
) -> dict[str, Measure]:
    """Return measures, with the end time and decided lengths of phases [s] by name.

    Args:
        scenario: A scenario with phases.
        problem: The problem of all phases.
        found: The measures of this problem, in which a decided length of a phase is
            one of the decided parameters.
    """
    measures, lengths, named = dict(found), [], {}
    for number, (name, one) in enumerate(durations(scenario, problem).items(), 1):
        length: Measure = one if isinstance(one, float) else None
        if isinstance(one, Free):
            # The joined problem calls it a parameter; here it has the name of the
            # phase.
            length = measures.pop(f"decided_duration of phase {number}")
            named[f"duration_{name}"] = length
        lengths.append(length)
    total = sum(one for one in lengths if isinstance(one, float))
    return {END_TIME_MEASURE: total, **named, **measures}


def own_meanings(scenario: UserScenario) -> dict[str, str]:
    """Return the meaning of each measure that `own_measures` names."""
    decided: dict[str, str] = {}
    if isinstance(scenario, ProblemScenario):
        decided = {
            name: _of_decided(name, scenario) for name in decided_measures(scenario)
        }
    own = {
        name: f"Measure of this scenario: {' '.join(text.split())}"
        for name, text in scenario.measures.items()
    }
    return decided | own


def _of_decided(name: str, scenario: ProblemScenario) -> str:
    """Return the meaning of a measure of a decided or an uncertain number."""
    if name == MEMBERS_MEASURE:
        return (
            "List of the costs of the first plan, one for each member of the uncertain "
            "parameters [cost]"
        )
    if name == END_TIME_MEASURE and scenario.phases:
        return "Length of all phases of the first plan together [s]"
    if name == END_TIME_MEASURE:
        return "Length of the horizon that the first plan decides [s]"
    sort, _, of = name.partition("_")
    if sort == "duration":
        return f"Length of phase {of} that the first plan decides [s]"
    if of in scenario.parameters:
        return f"Value of the parameter {of} that the first plan decides"
    state = scenario.states.get(of)
    unit = f" [{state.unit}]" if state and state.unit else ""
    return f"Initial value of the state {of} that the first plan decides{unit}"
