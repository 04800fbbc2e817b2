"""Figures of a problem from Python."""

from swarmstart.cases.drawing.drawing import Figures, into_folder
from swarmstart.cases.drawing.problem_figures import figures_of
from swarmstart.cases.format.kind import Flight, Posed
from swarmstart.cases.kinds.python.scenario import PythonScenario
from swarmstart.ocp import Known, Trajectory
from swarmstart.ocp.loop import known_at


@into_folder
def draw(
    scenario: PythonScenario,
    flight: Flight[Posed],
    trajectory: Trajectory,
) -> Figures:
    """Return all figures that apply to a run by name, in order."""
    (agent,) = flight.posed.agents

    def known(step: int, number: int) -> Known:
        del number
        time = float(trajectory.times[step])
        found = known_at(agent.problem, time, agent.reference, agent.parameters)
        return found._replace(previous=agent.previous)

    return figures_of(agent.problem, trajectory, known=known, title=scenario.title)
