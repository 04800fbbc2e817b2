"""A reconfiguration scenario -> planning problems and plant.

All controls are decided at once, also the leader's unless it flies straight; or UAV
after UAV plans (`planning: priority`).
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Flight, Posed, PosedAgent, PosedPlant
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.reconfiguration.priority import (
    links_of,
    planning_order,
    priority_team,
)
from swarmstart.cases.kinds.reconfiguration.problem import (
    NU,
    joint_problem,
    team_model,
    trim,
)
from swarmstart.cases.kinds.reconfiguration.scenario import (
    ReconfigurationScenario,
    start_flaws,
)
from swarmstart.cases.kinds.reconfiguration.target import assigned_slots


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedReconfiguration(Posed):
    """A reconfiguration.

    Attributes:
        slots: Slot of each UAV relative to the leader, shape (uavs, 2) [m].
        steered: Numbers from 0 of the UAVs whose controls are decided.
        trim: Controls of straight flight, shape (2,).
        links: Pairs of UAVs that keep the communication distance.
    """

    slots: Array
    steered: tuple[int, ...]
    trim: Array
    links: tuple[tuple[int, int], ...]

    def controls_by_uav(self, controls: Array) -> Array:
        """Return flown controls of all UAVs, shape (uavs, 2, T).

        Args:
            controls: Controls of the steered UAVs, shape (steered * 2, T).
        """
        steps = controls.shape[1]
        full = np.repeat(self.trim[:, None], steps, axis=1)
        stacked = np.repeat(full[None], len(self.slots), axis=0)
        stacked[list(self.steered)] = controls.reshape(-1, NU, steps)
        return stacked


ReconfigurationFlight = Flight[PosedReconfiguration]


def pose(scenario: ReconfigurationScenario) -> PosedReconfiguration:
    """Return the planning problem of all UAVs, or one for each, and the plant.

    Args:
        scenario: The scenario, checked.
    """
    slots, steered = assigned_slots(scenario), _steered(scenario)
    model = team_model(scenario, steered)
    agents: tuple[PosedAgent, ...]
    if scenario.planning.name == "joint":
        problem = joint_problem(scenario, model, slots)
        agents = (PosedAgent(problem=problem, append="last"),)
        order, nearby = None, None
    else:
        order = tuple(planning_order(scenario, slots))
        agents, nearby = priority_team(scenario, slots, order)
    return PosedReconfiguration(
        agents=agents,
        x0=np.concatenate([uav.vector() for uav in scenario.uavs]),
        plant=PosedPlant(model=model, substeps=scenario.plant.substeps),
        order=order,
        nearby=nearby,
        slots=slots,
        steered=steered,
        trim=trim(scenario.vehicle),
        links=_links(scenario, slots),
    )


def flaws(scenario: ReconfigurationScenario) -> Iterator[LocatedFlaw]:
    """Yield errors between parts of the scenario, also those of starts."""
    found = list(scenario.flaws())
    yield from found
    if found:
        return
    slots, (_, far) = assigned_slots(scenario), scenario.distances.kept_m
    linked = {(min(pair), max(pair)) for pair in _links(scenario, slots)}
    for pair in itertools.combinations(range(len(slots)), 2):
        yield from start_flaws(scenario, pair, linked=pair in linked)
    for i, j in sorted(linked):
        apart = float(np.hypot(*(slots[i] - slots[j])))
        if apart > far:
            yield (
                ("slots",),
                f"expected slots of the linked UAVs {i + 1} and {j + 1} at most "
                f"{far:g} m (distances.communication_m) apart, found {apart:g} m",
            )


def _links(
    scenario: ReconfigurationScenario, slots: Array
) -> tuple[tuple[int, int], ...]:
    """Return the pairs that keep the communication distance: all, or the links."""
    if scenario.planning.name == "joint":
        return tuple(itertools.combinations(range(len(slots)), 2))
    links = links_of(scenario, slots, planning_order(scenario, slots))
    return tuple((number, j) for number, others in links.items() for j in others)


def _steered(scenario: ReconfigurationScenario) -> tuple[int, ...]:
    """Return the UAVs whose controls are decided."""
    return tuple(
        i
        for i in range(len(scenario.uavs))
        if scenario.planning.name == "priority"
        or scenario.leader == "free"
        or i != scenario.leader_index
    )
