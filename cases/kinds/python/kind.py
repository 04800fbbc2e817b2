"""A problem from Python, as the commands run it."""

from collections.abc import Iterator, Mapping
from pathlib import Path

from swarmstart.cases.drawing.problem_figures import draw_problem
from swarmstart.cases.format.expressions import CONSTANTS, parse
from swarmstart.cases.format.kind import Flight, Kind, Measure, Posed
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.problem.flown_path import rows_of
from swarmstart.cases.kinds.problem.measures import (
    PATH,
    measured,
    own_measures,
    own_values,
    wrong_measures,
)
from swarmstart.cases.kinds.problem.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.python.pose import names_of, pose
from swarmstart.cases.kinds.python.scenario import PythonScenario
from swarmstart.ocp import Known, Trajectory
from swarmstart.ocp.controller import known_at


def flaws(scenario: PythonScenario) -> Iterator[LocatedFlaw]:
    """Yield all that can be said without running the file: it alone has the names."""
    yield from scenario.flaws()
    for name, text in scenario.measures.items():
        used = parse(text, of_paths=True, functions=None).names - CONSTANTS.keys()
        yield from wrong_measures({name: text}, dict.fromkeys(used, PATH))


def measure(
    scenario: PythonScenario, flight: Flight[Posed], trajectory: Trajectory
) -> Mapping[str, Measure]:
    """Return all measures by name, null where one is not defined."""
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


def draw(
    scenario: PythonScenario,
    flight: Flight[Posed],
    trajectory: Trajectory,
    folder: Path,
) -> list[Path]:
    """Write all figures that apply to a run; return the files."""
    del scenario
    (agent,) = flight.posed.agents

    def known(step: int, number: int) -> Known:
        del number
        time = float(trajectory.times[step])
        found = known_at(agent.problem, time, agent.reference, agent.parameters)
        return found._replace(previous=agent.previous)

    return draw_problem(agent.problem, trajectory, folder, known=known)


KIND = Kind(
    scenario=PythonScenario,
    poses=pose,
    measure=measure,
    measures=MEASURES,
    own_measures=own_measures,
    undefined=UNDEFINED,
    flaws=flaws,
    figures=draw,
    code=lambda scenario: scenario.problem.file,
)
