"""The kind of scenario "python": a problem from a user's Python file."""

from collections.abc import Iterator, Mapping

from swarmstart.cases.format.expressions import CONSTANTS, parse
from swarmstart.cases.format.kind import Flight, Kind, Measure, Posed
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.checks.attempts import tried
from swarmstart.cases.kinds.problem.checks.instance_flaws import (
    instance_numbers,
    instance_ranges,
    instances_of,
)
from swarmstart.cases.kinds.problem.measuring.decided_measures import own_meanings
from swarmstart.cases.kinds.problem.measuring.flown_path import rows_of
from swarmstart.cases.kinds.problem.measuring.measures import (
    PATH,
    measured,
    own_measures,
    own_values,
    whole_run,
    wrong_measures,
)
from swarmstart.cases.kinds.problem.stated.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.python.pose import names_of, pose
from swarmstart.cases.kinds.python.scenario import PythonScenario
from swarmstart.ocp import Trajectory


def flaws(scenario: PythonScenario) -> Iterator[LocatedFlaw]:
    """Yield errors that can be found without running the user's file."""
    yield from scenario.flaws()
    wrong = [*tried(instance_numbers(scenario))]
    yield from wrong or instance_ranges(scenario)
    for name, text in scenario.measures.items():
        # Every name stands for a path: which ones exist is known after the file has
        # run.
        used = parse(text, of_paths=True, functions=None).names - CONSTANTS.keys()
        yield from wrong_measures({name: text}, dict.fromkeys(used, PATH))


def measure(
    scenario: PythonScenario, flight: Flight[Posed], trajectory: Trajectory
) -> Mapping[str, Measure]:
    """Return all measures by name, with None for undefined ones."""
    problem = flight.posed.agents[0].problem
    times, states, controls = rows_of(flight, trajectory)
    rows = (times, *states, *controls)
    return measured(
        flight,
        trajectory,
        problem=problem,
        own=own_values(
            scenario.measures, dict(zip(names_of(problem.model), rows, strict=True))
        ),
    )


KIND = Kind(
    scenario=PythonScenario,
    poses=pose,
    measure=measure,
    whole_run=whole_run,
    measures=MEASURES,
    own_measures=own_measures,
    own_meanings=own_meanings,
    undefined=UNDEFINED,
    instances=instances_of,
    flaws=flaws,
    drawn_by="swarmstart.cases.kinds.problem.figures:draw_from_python",
    code=lambda scenario: str(scenario.problem.file),
    posed_by_code=True,
)
