"""Meanings of the measures that a user's scenario defines or decides itself."""

from swarmstart.cases.kinds.problem.measuring.decided_measures import decided_measures
from swarmstart.cases.kinds.problem.stated.names import (
    END_TIME_MEASURE,
    MEMBERS_MEASURE,
)
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario, UserScenario


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
