"""A reconfiguration scenario -> planning problems and plant.

All controls are decided at once, also the leader's unless it flies straight; or, with
`planning: priority`, UAV after UAV plans, the leader first, in the order of their
slots' distances from the leader.

UAV i then minimises only its own term e_i'Q e_i of the cost (`problem.py`). It uses the
leader's plan and keeps the safe distance to all UAVs within range: to the new plans of
those that have planned before it, and to the last plans of the others. It keeps the
communication distance to its links only: the nearest UAVs in the new formation among
those that have planned before it. With one link each, the links are a tree with the
leader as its root, so that all UAVs are connected. The leader holds its course.
"""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Flight, Nearby, Posed, PosedAgent, PosedPlant
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.planar import METRE, POSITION, speed_bounds
from swarmstart.cases.kinds.reconfiguration.problem import (
    NU,
    NX,
    assigned_slots,
    connection,
    control_limits,
    error,
    joint_problem,
    separation,
    team_model,
    trim,
    uav_model,
)
from swarmstart.cases.kinds.reconfiguration.scenario import (
    ReconfigurationScenario,
    start_flaws,
)
from swarmstart.ocp import Bounds, OptimalControlProblem

FEWEST_OTHERS = 4
"""Smallest number of others for which a problem is compiled; it is then doubled."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedReconfiguration(Posed):
    """A reconfiguration as planning problems and plant, with nothing compiled.

    Attributes:
        slots: Slot of each UAV relative to the leader, shape (uavs, 2) [m].
        steered: Numbers of the UAVs whose controls are decided, counted from 0.
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

    The scenario must have been checked before.
    """
    slots, steered = assigned_slots(scenario), _steered(scenario)
    model = team_model(scenario, steered)
    agents: tuple[PosedAgent, ...]
    if scenario.planning.name == "joint":
        problem = joint_problem(scenario, model, slots)
        # No thrust is not straight flight: the last controls are appended, not zeros.
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
    # Slots are assigned below, which needs as many slots as UAVs.
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


def planning_order(scenario: ReconfigurationScenario, slots: Array) -> list[int]:
    """Return the UAVs' numbers from 0, the leader first, the outermost slot last."""
    distance = np.hypot(*slots.T)
    distance[scenario.leader_index] = -1.0  # Before a slot at the same place, too.
    return [int(i) for i in np.argsort(distance, kind="stable")]  # Ties: by number.


def links_of(
    scenario: ReconfigurationScenario, slots: Array, order: Sequence[int]
) -> dict[int, tuple[int, ...]]:
    """Return for each UAV the numbers of the UAVs that are its links.

    Args:
        scenario: The scenario.
        slots: Slot of each UAV relative to the leader, shape (uavs, 2) [m].
        order: Numbers of the UAVs in the order of planning, from `planning_order`.
    """
    links: dict[int, tuple[int, ...]] = {}
    for place, number in enumerate(order):
        # The type is for the leader, before which there is no other: an empty list.
        before = np.array(order[:place], dtype=np.int64)
        apart = np.hypot(*(slots[before] - slots[number]).T)
        nearest = before[np.argsort(apart, kind="stable")]
        links[number] = tuple(int(j) for j in nearest[: scenario.planning.links])
    return links


def priority_team(
    scenario: ReconfigurationScenario, slots: Array, order: Sequence[int]
) -> tuple[tuple[PosedAgent, ...], Nearby]:
    """Return the UAVs as agents, and a problem each for 4, 8, ... other UAVs in range.

    Args:
        scenario: The scenario, with `planning: priority`.
        slots: Slot of each UAV relative to the leader, shape (uavs, 2) [m].
        order: Numbers of the UAVs in the order of planning, from `planning_order`.
    """
    kept, leader = scenario.planning.links, scenario.leader_index
    links = links_of(scenario, slots, order)
    intervals = scenario.prediction.intervals
    straight = np.repeat(trim(scenario.vehicle)[:, None], intervals, axis=1)
    problems = {
        others: uav_problem(scenario, others=others) for others in rooms(len(slots))
    }
    agents = tuple(
        PosedAgent(
            # The one with most signals; `Nearby` has those for fewer others.
            problem=problems[len(slots) - 1],
            parameters=_constant(
                [*slot, *(float(k < len(links[number])) for k in range(kept))]
            ),
            watches=links[number],
            reference=_straight_flight(scenario) if number == leader else None,
            candidates=_constant(straight[:, :, None]),
            given=straight if number == leader else None,
            append="last",
        )
        for number, slot in enumerate(slots)
    )
    return agents, Nearby(
        problems=problems,
        range=scenario.planning.range_m or np.inf,
        position=POSITION,
        links=kept,
    )


def _constant(values: ArrayLike) -> Callable[[float], Array]:
    array = np.asarray(values)
    return lambda time: array


def rooms(uavs: int) -> list[int]:
    """Return for how many other UAVs problems are compiled: 4, 8, ..., uavs - 1."""
    # Not one problem for each number: each has to be compiled.
    doubled = (FEWEST_OTHERS * 2**k for k in itertools.count())
    return [*itertools.takewhile(lambda others: others < uavs - 1, doubled), uavs - 1]


def uav_problem(
    scenario: ReconfigurationScenario, *, others: int
) -> OptimalControlProblem:
    """Return one UAV's planning problem, the same for every UAV.

    Its signals are the leader's state, the positions of the links and of the other
    UAVs; its parameters are the slot, and for each link 1 if it is used, else 0.

    Args:
        scenario: The scenario.
        others: Number of other UAVs for which the problem has signals.
    """
    prediction, kept = scenario.prediction, scenario.planning.links
    model = replace(
        uav_model(scenario.vehicle), parameters=ca.SX.sym("parameters", 2 + kept)
    )
    leader = ca.SX.sym("leader", NX)
    linked = [ca.SX.sym(f"link{k}", len(POSITION)) for k in range(kept)]
    near = [ca.SX.sym(f"other{k}", len(POSITION)) for k in range(others)]
    slot, is_link = model.parameters[:2], model.parameters[2:]
    position, distances = model.states[list(POSITION)], scenario.distances
    e = error(model.states, leader, slot, turned=scenario.frame == "leader")
    return OptimalControlProblem(
        model,
        # The quadrature multiplies by dt; (5.38) is a plain sum.
        stage_cost=ca.bilin(ca.diag(ca.DM(scenario.weights)), e, e) / prediction.dt,
        bounds=Bounds(
            controls=control_limits(scenario.vehicle),
            states=speed_bounds(scenario.vehicle.speed_m_s),
            state_scale=METRE,
        ),
        constraints=[
            *[
                # A link that is not used has the factor 0: the distance 0, always
                # allowed.
                connection(distances, is_link[k] * (position - place))
                for k, place in enumerate(linked)
            ],
            *[separation(distances, position - place) for place in near],
        ],
        signals=ca.vertcat(leader, *linked, *near),
        quadrature="right",
        **prediction.grid(),
    )


def _straight_flight(scenario: ReconfigurationScenario) -> Callable[[Array], Array]:
    """Return times (n,) [s] -> states of the leader in straight flight, (4, n)."""
    start = scenario.uavs[scenario.leader_index]
    psi = start.heading_rad
    # Speed and heading stay.
    rate = start.speed_m_s * np.array([0.0, 0.0, np.cos(psi), np.sin(psi)])
    return lambda times: np.array(start.vector())[:, None] + rate[:, None] * times
