"""Figures of a problem from Python."""

from pathlib import Path

from swarmstart.cases.drawing.problem_figures import draw_problem
from swarmstart.cases.format.kind import Flight, Posed
from swarmstart.cases.kinds.python.scenario import PythonScenario
from swarmstart.ocp import Known, Trajectory
from swarmstart.ocp.controller import known_at


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
