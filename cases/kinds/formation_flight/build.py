"""A formation scenario -> planners, team, dual mode and plant.

UAV after UAV plans, or flies the plan that it is given.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.format.kind import Flight, Posed, SeveralPlansError
from swarmstart.cases.format.settings import Problem
from swarmstart.cases.kinds.formation_flight.linear_law import terminal_set_of
from swarmstart.cases.kinds.formation_flight.problem import (
    dynamics_of,
    planning_problem,
    reference_of,
    slot_states,
    terminal_cost_of,
)
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.models.unicycle import unicycle
from swarmstart.cases.kinds.planar import POSITION
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import (
    Agent,
    Controller,
    DualMode,
    Known,
    Model,
    Planner,
    Plant,
    RecedingHorizon,
    Team,
    stack_models,
)
from swarmstart.ocp.fitness import replay
from swarmstart.terminal_set import Reference, TerminalSet, certificate_text

Array = NDArray[np.float64]


class NoTerminalSetError(SwarmstartError):
    """A formation has no terminal set."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FormationFlight(Flight):
    """A formation flight ready to be flown.

    Attributes:
        names: What the UAVs are called.
        slots: (times (n,)) -> slot states of all UAVs, shape (uavs, 4, n).
        designed_set: The terminal set, the same for every UAV; None: the dual mode is
            off and no set can be designed.
        reference: What it is built around, with the bounds.
        dynamics: f(x, u) of one UAV.
    """

    names: tuple[str, ...]
    slots: Callable[[Array], Array]
    designed_set: TerminalSet | None
    reference: Reference
    dynamics: ca.Function

    @property
    def terminal_set(self) -> TerminalSet:
        """The terminal set.

        Raises:
            NoTerminalSetError: If there is none.
        """
        if self.designed_set is None:
            raise NoTerminalSetError("the dual mode is off, and no set can be designed")
        return self.designed_set


def build(scenario: FormationScenario) -> FormationFlight:
    """Compile everything a flight needs.

    Args:
        scenario: The scenario, checked.
    """
    model = unicycle()
    dynamics, reference = dynamics_of(model), reference_of(scenario)
    terminal_cost = terminal_cost_of(scenario, dynamics, reference)
    designed_set = _designed_set(scenario, reference)
    order = scenario.order_of_planning()
    agents = [
        _agent(scenario, model, terminal_cost, number, order)
        for number in range(len(scenario.uavs))
    ]
    team = Team(agents, order=order)
    controller: Controller = team
    if scenario.dual_mode.enabled and designed_set is not None:
        targets = [_target(scenario, number) for number in range(len(agents))]
        controller = DualMode(
            team,
            sets=[designed_set] * len(agents),
            targets=targets,
            uncertified=not scenario.dual_mode.is_certified,
        )
    plant = Plant(
        stack_models([model] * len(agents)),
        dt=scenario.prediction.dt_s,
        substeps=scenario.plant.substeps,
    )
    certificate = None if designed_set is None else designed_set.certificate
    return FormationFlight(
        documents={}
        if certificate is None
        else {"certificate.json": certificate_text(certificate)},
        plant=plant,
        controller=controller,
        x0=np.concatenate([uav.start.vector() for uav in scenario.uavs]),
        agents=len(agents),
        names=tuple(f"UAV {number}" for number in scenario.numbers),
        slots=lambda times: np.stack(
            [slot_states(scenario, number, times) for number in range(len(agents))]
        ),
        designed_set=designed_set,
        reference=reference,
        dynamics=dynamics,
    )


def pose(scenario: FormationScenario) -> Posed:
    """Return the planning problem of the first step, of the one UAV that plans.

    Args:
        scenario: The scenario, checked.

    Raises:
        SeveralPlansError: If several UAVs plan.
    """
    planning = scenario.planning
    if len(planning) > 1:
        raise SeveralPlansError(
            f"expected one UAV that plans, one planning problem a step; found "
            f"{len(planning)} without the key 'plan'"
        )
    (number,) = planning
    model, order = unicycle(), scenario.order_of_planning()
    dynamics, reference = dynamics_of(model), reference_of(scenario)
    terminal_cost = terminal_cost_of(scenario, dynamics, reference)
    before = order[: order.index(number)]
    problem = planning_problem(scenario, model, terminal_cost, others=len(before))
    alone = planning_problem(scenario, model, terminal_cost, others=0)

    def positions(other: int) -> Array:
        """Where a given plan leads, shape (2, nodes)."""
        uav = scenario.uavs[other]
        known = Known(signals=slot_states(scenario, other, alone.times))
        states, _, _ = replay(alone, np.array(uav.plan).T, uav.start.vector(), known)
        return states[list(POSITION)]

    own = slot_states(scenario, number, problem.times)
    return Posed(
        problem=problem,
        x0=np.array(scenario.uavs[number].start.vector()),
        known=Known(signals=np.vstack([own, *map(positions, before)])),
    )


def problems(scenario: FormationScenario) -> Iterator[Problem]:
    """Yield what is wrong across the scenario's parts, impossible designs included."""
    found = list(scenario.problems())
    yield from found
    if found:
        return
    try:
        part = "leader"
        dynamics, reference = dynamics_of(unicycle()), reference_of(scenario)
        part = "weights"
        terminal_cost_of(scenario, dynamics, reference)
        part = "dual_mode"
        _designed_set(scenario, reference)
    except SwarmstartError as error:
        yield (part,), f"expected a linear law that can be designed: {error}"


def _designed_set(
    scenario: FormationScenario, reference: Reference
) -> TerminalSet | None:
    """Return the terminal set; None: it cannot be designed, and nothing rests on it."""
    try:
        return terminal_set_of(scenario, reference)
    except SwarmstartError:
        if scenario.dual_mode.enabled:
            raise
        return None


def leader_positions(scenario: FormationScenario, times: Array) -> Array:
    """Return the virtual leader's positions, shape (2, n) [m], at times (n,) [s]."""
    leader = scenario.leader
    direction = np.array([np.cos(leader.heading_rad), np.sin(leader.heading_rad)])
    start = np.array([leader.x_m, leader.y_m])
    return start[:, None] + leader.speed_m_s * direction[:, None] * times


def _target(scenario: FormationScenario, number: int) -> Callable[[float], Array]:
    return lambda time: slot_states(scenario, number, np.array([time]))[:, 0]


def _agent(
    scenario: FormationScenario,
    model: Model,
    terminal_cost: Array,
    number: int,
    order: list[int],
) -> Agent:
    """Return one UAV with its planner; it watches all that plan before it.

    One with a given plan neither searches nor polishes: the plan is only evaluated.
    """
    watches = tuple(order[: order.index(number)])
    given = scenario.uavs[number].plan
    planner = Planner(
        planning_problem(scenario, model, terminal_cost, others=len(watches)),
        search=scenario.search_settings() if given is None else None,
        polish=scenario.polish_options() if given is None else None,
        backend=scenario.backend,
    )
    return Agent(
        controller=RecedingHorizon(
            planner=planner,
            reference=lambda times: slot_states(scenario, number, times),
            shift=scenario.last_plan == "shifted",
            first=None if given is None else np.array(given).T,
        ),
        watches=watches,
        shows=POSITION,
    )
