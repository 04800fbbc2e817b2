"""Planners, controller and plant for any kind of scenario, from what it poses."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeVar

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import (
    Flight,
    Nearby,
    PlanningProblem,
    Posed,
    PosedAgent,
    SeveralPlansError,
)
from swarmstart.cases.format.settings import Scenario
from swarmstart.ocp import (
    Agent,
    Controller,
    DualMode,
    Free,
    LocalAgent,
    LocalTeam,
    OpenLoop,
    Planner,
    Plant,
    RecedingHorizon,
    Team,
)
from swarmstart.ocp.integration import verifying_integrator
from swarmstart.ocp.loop import SimulatedPlant
from swarmstart.ocp.rollout import replayed

P = TypeVar("P", bound=Posed)
_Planning = Callable[[PosedAgent], Planner]
"""Makes the planner of an agent."""


def flight_of(posed: P, scenario: Scenario, *, threads: int | None = 1) -> Flight[P]:
    """Return the closed loop of posed agents; code is compiled at the first step.

    Args:
        posed: Agents and plant, posed by the scenario's kind.
        scenario: The scenario, with its search, polish and backend.
        threads: Largest number of threads and processes of planning, as in `Planner`.
    """
    if posed.controller is not None:
        return _steered(posed, posed.controller)
    plant, problem = posed.plant, posed.agents[0].problem
    has_period = isinstance(problem.horizon, Free) or posed.period is not None
    controller = _controller(posed, partial(_planner, scenario, threads))
    made: Callable[..., Plant] = Plant
    if plant.simulator is not None:
        made = partial(SimulatedPlant, load=plant.simulator.loading())
    return Flight(
        posed=posed,
        plant=made(
            plant.model,
            # A decided end time has no dt of its own; the loop has the period, or a
            # guess.
            dt=controller.dt if has_period else problem.dt,
            substeps=plant.substeps,
            parameters=plant.parameters,
            signals=plant.signals,
            decided=plant.decided,
            # Of order 4, also if plans are made with Euler steps.
            integrator=verifying_integrator(problem.integrator),
            clock=problem.clock,
        ),
        controller=controller,
    )


def _steered(posed: P, controller: Controller) -> Flight[P]:
    """Return the closed loop of a controller of the kind's own."""
    plant = posed.plant
    return Flight(
        posed=posed,
        plant=Plant(
            plant.model, dt=controller.dt, substeps=plant.substeps,
            parameters=plant.parameters, signals=plant.signals,
        ),
        controller=controller,
    )  # fmt: skip


def first_problem(posed: Posed) -> PlanningProblem:
    """Return the planning problem of the first step, not compiled.

    Agents before the one that plans follow their given plans.

    Args:
        posed: Agents and plant, posed by the scenario's kind.

    Raises:
        SeveralPlansError: If not exactly one agent plans.
    """
    planning = [n for n, agent in enumerate(posed.agents) if agent.given is None]
    if len(planning) != 1 or posed.nearby is not None:
        raise SeveralPlansError(
            "expected one planning problem a step: all planned at once, or a given "
            f"plan for all but one agent; found {len(planning)} that plan"
        )
    # Every agent before the one that plans has a given plan, which others see.
    shown: dict[int, Array] = {}
    sizes = [agent.problem.model.nx for agent in posed.agents]
    starts = np.split(posed.x0, np.cumsum(sizes)[:-1])
    for number in posed.order or (0,):
        agent, x0 = posed.agents[number], starts[number]
        known = agent.known(0.0, tuple(shown[j] for j in agent.watches))
        if agent.given is None:
            break
        states = replayed(agent.problem, agent.given, x0, known)
        shown[number] = states[list(agent.shows)]
    return PlanningProblem(
        problem=agent.problem,
        x0=x0,
        known=known,
        family=agent.family,
        guess=agent.first,
        candidates=None if agent.candidates is None else agent.candidates(0.0),
    )


def _controller(posed: Posed, planner: _Planning) -> Controller:
    if posed.nearby is not None:
        return _local_team(posed, posed.nearby, planner)
    agents = posed.agents
    if posed.order is None:
        # Without an order there is one agent.
        (agent,) = agents
        loop = replace(
            _receding_horizon(agent, planner), period=posed.period, until=posed.until
        )
        return OpenLoop(loop=loop, repair=posed.repair) if posed.open_loop else loop
    team = Team(
        [
            Agent(
                controller=_receding_horizon(agent, planner),
                watches=agent.watches,
                shows=agent.shows,
            )
            for agent in agents
        ],
        order=posed.order,
    )
    laws = posed.dual_mode
    if laws is None:
        return team
    if posed.committed is not None:
        from swarmstart.ocp import CommittedTeam  # Few runs need its kernels.

        return CommittedTeam(
            team,
            sets=laws.sets,
            distance=posed.committed.distance,
            links=posed.committed.links,
            tracking_error=posed.committed.tracking_error,
        )
    return DualMode(
        team, sets=laws.sets, targets=laws.targets, uncertified=laws.uncertified
    )


def _local_team(posed: Posed, nearby: Nearby, planner: _Planning) -> LocalTeam:
    return LocalTeam(
        [
            LocalAgent(
                # Parameters and candidates of such agents are constant: time 0 stands
                # for all.
                parameters=() if agent.parameters is None else agent.parameters(0.0),
                links=agent.watches,
                reference=agent.reference,
                candidates=None if agent.candidates is None else agent.candidates(0.0),
                held=agent.given,
            )
            for agent in posed.agents
        ],
        # One planner for each number of others, shared by all agents: few compilations.
        planners={
            others: planner(PosedAgent(problem=problem))
            for others, problem in nearby.problems.items()
        },
        order=posed.order or (),
        range=nearby.range,
        position=nearby.position,
        links=nearby.links,
    )


def _receding_horizon(agent: PosedAgent, planner: _Planning) -> RecedingHorizon:
    return RecedingHorizon(
        planner=planner(agent),
        reference=agent.reference,
        parameters=agent.parameters,
        candidates=agent.candidates,
        append=agent.append,
        shift=agent.shift,
        # A given plan is the first plan, which no search or polish changes.
        first=agent.first if agent.given is None else agent.given,
        previous=agent.previous,
        within=agent.within,
    )


def _planner(scenario: Scenario, threads: int | None, agent: PosedAgent) -> Planner:
    """Return the planner of an agent, which only evaluates a given plan."""
    return Planner(
        agent.problem,
        search=scenario.search_settings() if agent.given is None else None,
        polish=scenario.polish_options() if agent.given is None else None,
        family=agent.family,
        backend=scenario.evaluator,
        lanes=scenario.random_starts() if agent.given is None else 0,
        threads=threads,
    )
