"""Figures of a problem in YAML or Python: those of any problem, with its own names.

With uncertain parameters the plant is one system. The figures are then those of one
member, that is, of one set of values of these parameters, and show the states of this
member in each plan; one more figure shows the states of all members.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import Figures, into_folder
from swarmstart.cases.drawing.panels import (
    Labels,
    panels_figure,
    panels_of,
    stacked_limits,
)
from swarmstart.cases.drawing.plan_figures import PlanPath, with_plans
from swarmstart.cases.drawing.problem_figures import Place, figures_of
from swarmstart.cases.drawing.vehicles import (
    discs_of_problem,
    position_of,
)
from swarmstart.cases.format.kind import Flight, Posed, PosedAgent
from swarmstart.cases.kinds.problem.stated.members import ProblemPosed
from swarmstart.cases.kinds.problem.stated.model import planning_problem
from swarmstart.cases.kinds.problem.stated.phases import (
    in_phase,
    interval_ends,
    phase_names,
    whole_scenario,
)
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario, UserScenario
from swarmstart.cases.kinds.problem.stated.symbols import (
    TIMING_S,
    constants_of,
    known_parameters,
    rows_over_time,
)
from swarmstart.cases.record.trajectory_arrays import held_controls
from swarmstart.ocp import Known, OptimalControlProblem, Plan, Trajectory
from swarmstart.ocp.loop import known_at
from swarmstart.ocp.rollout import replayed
from swarmstart.ocp.statement import lowered

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def _to_replay(agent: PosedAgent, time: float, known: Callable[[], Known]) -> Known:
    """Return what an agent knows; of what it hears, zeros, as no rate depends on it.

    Agents hear each other, so none of them could be replayed first.
    """
    if not agent.hears:
        return known()
    seen = agent.unseen()
    return known_at(agent.problem, time, agent.reference, agent.parameters, seen)


@into_folder
def draw(
    scenario: ProblemScenario,
    flight: Flight[ProblemPosed],
    trajectory: Trajectory,
) -> Figures:
    """Return all figures that apply to a run by name, in order."""
    posed, labels = flight.posed, _labels(scenario, trajectory)
    shown = trajectory
    if scenario.uncertain is not None:  # The plant is one system.
        agent = _single(scenario, flight.posed)
        (stated,) = flight.posed.agents
        shown = of_one_member(trajectory, agent.problem, stated.problem)
        posed = replace(posed, agents=(agent,))
    figures = figures_of(
        posed.planned,
        shown,
        labels=labels,
        known=Planned(posed, shown).known,
        true=[agent.reference for agent in posed.agents],
        title=scenario.title,
        place=_place(scenario, labels),
    )
    if scenario.uncertain is None:
        return figures
    return [*figures, *member_figures(flight, trajectory, labels, posed.planned[0])]


def _single(scenario: ProblemScenario, posed: ProblemPosed) -> PosedAgent:
    """Return the agent of an uncertain problem with the problem of one member."""
    (agent,) = posed.agents
    parameters = rows_over_time(known_parameters(scenario), constants_of(scenario))
    return replace(
        agent,
        problem=planning_problem(scenario, posed.members),
        parameters=None
        if parameters is None
        else lambda time: parameters(np.array([time]))[:, 0],
    )


def _labels(scenario: ProblemScenario, trajectory: Trajectory) -> Labels:
    """Return names, units, and times of phases for the figures."""
    vehicles = scenario.vehicles.members if scenario.vehicles else []
    whole = whole_scenario(scenario) if scenario.phases else scenario
    ends = [0, *interval_ends(scenario)]
    # A short run ends sooner.
    flown = [k for k in ends[1:-1] if k < trajectory.times.size]
    return Labels(
        states=tuple(whole.states),
        controls=tuple(whole.controls),
        units={
            **{name: state.unit for name, state in whole.states.items()},
            **{name: control.unit for name, control in whole.controls.items()},
        },
        ends=[float(trajectory.times[k]) for k in flown],
        spans={
            in_phase(name): (begin, end)
            for name, begin, end in zip(
                phase_names(scenario), ends, ends[1:], strict=False
            )
        },
        vehicles=[vehicle.name for vehicle in vehicles] or ("",),
        maximize=scenario.maximize,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """The known data of the plans of a run.

    Attributes:
        posed: The agents that plan.
        trajectory: The run; a record of it keeps no states of plans.
    """

    posed: ProblemPosed
    trajectory: Trajectory

    def known(self, step: int, number: int) -> Known:
        """Return what an agent knew when it planned at a step."""
        agent, time = self.posed.agents[number], float(self.trajectory.times[step])
        seen = agent.seen(partial(self._shown, step))
        found = self.posed.known_by(number, time, seen)
        return found._replace(previous=self._held_before(step, agent))

    def _held_before(self, step: int, agent: PosedAgent) -> Array | None:
        """Return the controls of the interval before a step, if they count."""
        if not (step and agent.problem.previous.numel()):
            return agent.previous
        times, held = held_controls(self.trajectory)
        # TIMING_S: the step itself must not count as before it.
        before = np.searchsorted(times, self.trajectory.times[step] - TIMING_S) - 1
        return held[:, before]

    def _shown(self, step: int, number: int) -> Array:
        """Return the positions of an agent along its plan, shape (shows, nodes)."""
        agents, run = self.posed.agents, self.trajectory
        agent, plan = agents[number], run.decisions[step].plans[number]
        states = plan.states
        if not states.size:
            # Its rows in the stacked states of all agents.
            before = sum(other.problem.model.nx for other in agents[:number])
            x0 = run.states[before : before + agent.problem.model.nx, step]
            given = _to_replay(
                agent, float(run.times[step]), partial(self.known, step, number)
            )
            states = replayed(agent.problem, plan.controls, x0, given)
        return states[list(agent.shows)]


def _place(scenario: ProblemScenario, labels: Labels) -> Place | None:
    """Return the states that are a position in the plane, and discs to keep out of."""
    recorded = scenario.model_dump(mode="json", by_alias=True)
    axes = position_of(recorded, labels.states, labels.units)
    if axes is None:
        return None
    x, y = (list(labels.states).index(name) for name in axes)
    discs = discs_of_problem(recorded, axes)
    return Place(
        rows=(x, y),
        discs=[(disc.x, disc.y, disc.radius) for disc in discs if not disc.is_limit],
    )


def of_one_member(
    trajectory: Trajectory, problem: OptimalControlProblem, every: OptimalControlProblem
) -> Trajectory:
    """Return a run whose plans are reduced to their part for the first member.

    The plans have no states, only the member's initial state.

    Args:
        trajectory: The run.
        problem: Problem of one member.
        every: Problem of all members, for which the plans were made.
    """
    nu, own_places, places = (
        problem.model.nu,
        lowered(problem).places,
        lowered(every).places,
    )
    # The states that every rewrite appends begin with those of the first member.
    start = [i for role, own in own_places.items() for i in places[role][: len(own)]]

    def own(plan: Plan) -> Plan:
        return replace(
            plan,
            controls=plan.controls[:nu],
            states=np.empty((0, 0)),
            # The core has more states than the member: of others, decided numbers,
            # copies.
            start=plan.x0[start],
        )

    made: dict[int, Plan] = {}  # A plan that is used again stays the same object.
    return replace(
        trajectory,
        decisions=tuple(
            replace(
                decision,
                plans=tuple(
                    made.setdefault(id(plan), own(plan)) for plan in decision.plans
                ),
            )
            for decision in trajectory.decisions
        ),
    )


def member_figures(
    flight: Flight[ProblemPosed],
    trajectory: Trajectory,
    labels: Labels,
    problem: OptimalControlProblem,
) -> "Iterator[tuple[str, Figure]]":
    """Yield a figure of the simulated states with those that the first plan predicts.

    It predicts them for each member, that is, each set of the uncertain parameters.

    `problem` is that of one member.
    """
    answer, nx = flight.answer(trajectory), problem.model.nx
    limits, _ = stacked_limits([problem])
    panels = panels_of(
        labels.states,
        labels,
        trajectory.dense_times,
        trajectory.dense_states,
        limits,
    )
    # Without the states that the core adds below those of the members.
    rows = answer.path.states[: answer.problem.model.nx]
    paths = [
        PlanPath(times=answer.path.times, states=member)
        for member in np.split(rows, len(rows) // nx)
    ]
    drawn = with_plans(panels, paths, name="members of the plan")
    yield "g_members", panels_figure({"states": drawn}, labels)


@into_folder
def draw_from_python(
    scenario: UserScenario,
    flight: Flight[Posed],
    trajectory: Trajectory,
) -> Figures:
    """Return all figures that apply to a run by name, in order."""
    posed = flight.posed

    def known(step: int, number: int) -> Known:
        return posed.known_by(number, float(trajectory.times[step]))

    return figures_of(
        posed.planned,
        trajectory,
        known=known,
        true=[agent.reference for agent in posed.agents],
        title=scenario.title,
    )
