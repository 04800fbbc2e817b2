"""Figures of a problem: those of any problem, with its own names and units."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.drawing.panels import Labels
from swarmstart.cases.drawing.problem_figures import draw_problem
from swarmstart.cases.format.kind import Flight, PosedAgent
from swarmstart.cases.kinds.problem.pose import ProblemPosed
from swarmstart.cases.kinds.problem.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.symbols import TIMING_S
from swarmstart.cases.record.trajectory_arrays import held_controls
from swarmstart.ocp import Known, Trajectory
from swarmstart.ocp.controller import known_at
from swarmstart.ocp.fitness import replay

Array = NDArray[np.float64]


def draw(
    scenario: ProblemScenario,
    flight: Flight[ProblemPosed],
    trajectory: Trajectory,
    folder: Path,
) -> list[Path]:
    """Write all figures that apply to a run; return the files."""
    agents = flight.posed.agents
    vehicles = scenario.vehicles.members if scenario.vehicles else []

    def known(step: int, number: int) -> Known:
        agent, time = agents[number], float(trajectory.times[step])
        seen = tuple(_shown(step, other) for other in agent.watches)
        found = known_at(agent.problem, time, agent.reference, agent.parameters, seen)
        return found._replace(previous=_held_before(step, agent))

    def _held_before(step: int, agent: PosedAgent) -> Array | None:
        """Return the controls of the interval before a step, where they count."""
        if not (step and agent.problem.previous.numel()):
            return agent.previous
        times, held = held_controls(trajectory)
        before = np.searchsorted(times, trajectory.times[step] - TIMING_S) - 1
        return held[:, before]

    def _shown(step: int, number: int) -> Array:
        """Return where an agent's plan leads; a record keeps none of its states."""
        agent, plan = agents[number], trajectory.decisions[step].plans[number]
        states = plan.states
        if not states.size:
            before = sum(other.problem.model.nx for other in agents[:number])
            x0 = trajectory.states[before : before + agent.problem.model.nx, step]
            states, _, _ = replay(agent.problem, plan.controls, x0, known(step, number))
        return states[list(agent.shows)]

    return draw_problem(
        [agent.problem for agent in agents],
        trajectory,
        folder,
        labels=Labels(
            states=tuple(scenario.states),
            controls=tuple(scenario.controls),
            units={
                **{name: state.unit for name, state in scenario.states.items()},
                **{name: control.unit for name, control in scenario.controls.items()},
            },
            vehicles=[vehicle.name for vehicle in vehicles] or ("",),
            maximize=scenario.maximize,
        ),
        known=known,
    )
