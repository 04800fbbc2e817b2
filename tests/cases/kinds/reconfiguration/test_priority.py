"""Priority planning: order, links, problems with unused signals, a flight."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.cases.kinds.planar import by_uav, pair_distances
from swarmstart.cases.kinds.reconfiguration.measures import measure
from swarmstart.cases.kinds.reconfiguration.pose import (
    links_of,
    planning_order,
    rooms,
    uav_problem,
)
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.ocp import Fitness, Known, LocalTeam, Trajectory, simulate
from swarmstart.ocp.loop.local_team import FAR
from swarmstart.tests.cases.kinds.flights import build
from swarmstart.tests.cases.kinds.reconfiguration.scenarios import (
    horizon,
    reconfiguration,
    slots_at,
    uavs_at,
)

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.reconfiguration.conftest import Make


V = np.array([[-20.0, 20], [-10, 10], [0, 0], [-10, -10], [-20, -20]])
ALONE = ("planning={name: priority, range_m: 60}", "leader=straight")
LEADER, UAVS = 2, 5


def priority(*assignments: str) -> ReconfigurationScenario:
    return reconfiguration(*ALONE, *assignments, variant="corrected")


@pytest.fixture(scope="module")
def alone() -> ReconfigurationScenario:
    return priority()


def test_they_plan_from_the_leader_outwards(alone: ReconfigurationScenario) -> None:
    assert planning_order(alone, V) == [2, 1, 3, 0, 4]


def test_everybody_is_linked_to_the_nearest_that_has_planned(
    alone: ReconfigurationScenario,
) -> None:
    links = links_of(alone, V, [2, 1, 3, 0, 4])
    assert links == {2: (), 1: (2,), 3: (2,), 0: (1,), 4: (3,)}
    twice = priority("planning.links=2")
    assert links_of(twice, V, [2, 1, 3, 0, 4])[0] == (1, 2)
    assert links_of(twice, V, [2, 1, 3, 0, 4])[1] == (2,)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(-9, 9), st.integers(-9, 9)).filter(any),
        min_size=1, max_size=20, unique=True,
    ),
    st.integers(1, 3),
    st.data(),
)  # fmt: skip
def test_links_hang_at_the_leader(
    others: list[tuple[int, int]], kept: int, data: st.DataObject
) -> None:
    leader = data.draw(st.integers(0, len(others)))
    slots = np.array([*others[:leader], (0, 0), *others[leader:]], dtype=np.float64)
    scenario = priority(f"planning.links={kept}").model_copy(
        update={"leader_uav": leader + 1}
    )
    order = planning_order(scenario, slots)
    links = links_of(scenario, slots, order)
    away = np.hypot(*slots.T)
    assert order[0] == leader and (np.diff(away[order]) >= 0).all()
    assert links[leader] == ()
    reached = {leader}
    for place, number in enumerate(order[1:], start=1):
        before = order[:place]
        assert set(links[number]) <= set(before)
        assert len(links[number]) == min(kept, place)
        apart = np.hypot(*(slots[before] - slots[number]).T)
        linked = np.hypot(*(slots[list(links[number])] - slots[number]).T)
        assert sorted(linked) == sorted(apart)[: len(linked)]
        assert reached & set(links[number])
        reached.add(number)
    assert len(reached) == len(slots)


@given(st.integers(2, 200))
def test_rooms_double_up_to_one_for_all_the_others(uavs: int) -> None:
    found = rooms(uavs)
    assert found[-1] == uavs - 1 and found == sorted(set(found))
    assert found[0] <= 4
    assert all(more <= 2 * room for room, more in itertools.pairwise(found))
    assert {room & (room - 1) for room in found[:-1]} <= {0}


def drawn(rng: np.random.Generator, nodes: int, count: int) -> Array:
    """Return tracks of positions about the origin, (2 * count, nodes)."""
    return rng.uniform(-12, 12, (2 * count, nodes))


@pytest.mark.parametrize("along", ["points", "segments"])
def test_room_to_spare_changes_nothing(along: str) -> None:
    scenario = priority(horizon(2), f"distances.along={along}")
    tight, spare = (
        Fitness(uav_problem(scenario, others=others), backend="casadi")
        for others in (3, 8)
    )
    nodes, rng = tight.problem.nodes, np.random.default_rng(0)
    slot, x0 = [-10.0, 10.0, 1.0], np.array([2.0, 0.1, 0.0, 10.0])
    broken = 0
    for _ in range(20):
        controls = rng.uniform([[0], [-1]], [[6000], [1]], (2, 2))
        seen = np.vstack([rng.normal(size=(4, nodes)), drawn(rng, nodes, 1 + 3)])
        nobody = np.full((2 * 5, nodes), FAR)
        found = tight.value(controls, x0, Known(slot, seen))
        assert (
            spare.value(controls, x0, Known(slot, np.vstack([seen, nobody]))) == found
        )
        broken += found[1] > 0
    assert broken > 5


def test_only_links_that_are_links_keep_the_communication_distance() -> None:
    scenario = priority("planning.links=2")
    problem = uav_problem(scenario, others=1)
    assert problem.model.np == 2 + 2 and problem.ns == 4 + 2 * (2 + 1)
    fitness, checks = Fitness(problem, backend="casadi"), problem.checks
    leader, x0 = np.array([2.0, 0, 0, 0]), np.array([2.0, 0, 0, 0])
    at = np.array([*leader, 0, 53, 0, FAR, 0, FAR])  # a link 3 m too far, no others
    still = np.array([[2000.0], [0.0]])

    def violation(first: float, second: float) -> float:
        moving = np.repeat(at[:, None], problem.nodes, axis=1)
        moving[[2, 4]] += 2.0 * problem.times
        known = Known([0, 0, first, second], moving)
        return fitness.value(still, x0, known)[1]

    assert violation(1, 0) == pytest.approx(3 * checks)
    assert violation(0, 0) == 0.0


def test_the_parts_of_all_are_the_cost_and_the_penalty_of_the_whole() -> None:
    """With all UAVs in range, and a communication distance that none reaches."""
    posed = ("leader=straight", "distances.communication_m=1e4", "weights=[1, 2, 3, 4]")
    whole = build(reconfiguration(*posed, variant="corrected"))
    scenario = priority(*posed)
    rng, order = np.random.default_rng(0), planning_order(scenario, V)
    fitness = {
        others: Fitness(uav_problem(scenario, others=others), backend="casadi")
        for others in range(UAVS)
    }
    x0 = whole.x0.reshape(UAVS, 4) * [1, 1, 1, 0.3] + rng.normal(size=(UAVS, 4)) * 0.1
    controls = rng.uniform([0, -1], [6000, 1], (UAVS, 2))
    controls[LEADER] = 2000.0, 0.0
    nodes = fitness[0].problem.nodes
    nobody = np.full((2, nodes), FAR)  # no link: another test
    blind = Known([0, 0, 0], np.zeros((6, nodes)))
    tracks = {
        i: fitness[0].states(controls[i][:, None], x0[i], blind) for i in range(UAVS)
    }
    cost = violation = 0.0
    for place, i in enumerate(order):
        others = [tracks[j][2:] for j in order[:place]]
        known = Known([*V[i], 0], np.vstack([tracks[LEADER], nobody, *others]))
        spent, broken = fitness[place].value(controls[i][:, None], x0[i], known)
        cost, violation = cost + spent, violation + broken
    expected = whole.loop.planner.fitness.value(
        np.delete(controls, LEADER, axis=0).reshape(-1, 1), x0.ravel()
    )
    assert (cost, violation) == pytest.approx(expected, rel=1e-9)
    assert violation > 1


# --- a flight in which all change sides behind their leader

SIDES = [(-12 * row, side * 12) for row in range(1, 5) for side in (1, -1)]
STARTS = [(0, 0), *SIDES]
TARGETS = [(0, 0), *((x, -y) for x, y in SIDES)]


def crossing(*assignments: str) -> ReconfigurationScenario:
    return reconfiguration(
        uavs_at([(20, 0, *place) for place in STARTS]), slots_at(TARGETS),
        "leader_uav=1", "assignment=given", "steps=30", "plant.substeps=50",
        *assignments, name="formation_100", variant=None,
    )  # fmt: skip


def flown(scenario: ReconfigurationScenario) -> Trajectory:
    flight = build(scenario)
    return simulate(
        flight.plant, flight.controller, flight.x0, steps=scenario.steps,
        rng=np.random.default_rng(0),
    )  # fmt: skip


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    return flown(crossing())


def test_those_who_change_sides_keep_the_safe_distance_at_all_times(
    trajectory: Trajectory,
) -> None:
    # Every 10 ms, in which two UAVs close 0.5 m at most.
    distances = pair_distances(trajectory.dense_states, len(STARTS))
    assert distances.min() >= 5.0
    plans = [plan for step in trajectory.decisions for plan in step.plans]
    assert all(plan.feasible for plan in plans)


def test_without_a_safe_distance_they_would_meet() -> None:
    careless = crossing(
        "distances.safe_m=0.1", "distances.margin_m=0", "steps=10",
        "budget.evaluations=400",
    )  # fmt: skip
    found = pair_distances(flown(careless).dense_states, len(STARTS))
    assert found.min() < 2.0


def test_they_end_in_their_slots_behind_a_leader_that_flew_straight(
    trajectory: Trajectory,
) -> None:
    scenario = crossing()
    end = by_uav(trajectory.states, len(STARTS))[:, :, -1]
    assert end[0] == pytest.approx([20, 0, 20 * 15, 0], abs=1e-9)
    off = np.hypot(*(end[:, 2:] - end[0, 2:] - TARGETS).T)
    assert off.max() < 0.05
    found = measure(scenario, build(scenario), trajectory)
    assert found["position_error_m"] == pytest.approx(off.max())
    assert found["infeasible_steps"] == 0 and found["candidate_losses"] is None


def test_links_keep_the_communication_distance_where_others_do_not_have_to(
    make: Make,
) -> None:
    """Two fly apart, both linked to the leader between them: 30 m, not 60 m."""
    starts = [(20, 0, 0, 0), (20, 0, 0, 20), (20, 0, 0, -20)]
    slots = [(0, 0), (0, 29), (0, -29)]
    wide = make(
        uavs_at(starts), slots_at(slots), "leader_uav=1", "assignment=given",
        "distances.communication_m=30", "steps=12", name="formation_100", variant=None,
    )  # fmt: skip
    found = measure(wide, build(wide), flown(wide))
    farthest, linked = found["max_distance_m"], found["max_link_distance_m"]
    assert isinstance(farthest, float) and isinstance(linked, float)
    assert farthest > 50 and 28.5 < linked <= 30.0


def test_the_team_sees_as_far_and_links_as_the_scenario_says(make: Make) -> None:
    scenario = priority("planning.links=2", "planning.range_m=45.5")
    team = build(scenario).controller
    assert isinstance(team, LocalTeam)
    assert (team.range, team.order) == (45.5, (2, 1, 3, 0, 4))
    assert [agent.links for agent in team.agents] == [(1, 2), (2,), (), (2, 1), (3, 2)]
    assert [np.asarray(agent.parameters).tolist() for agent in team.agents] == [
        [-20, 20, 1, 1], [-10, 10, 1, 0], [0, 0, 0, 0], [-10, -10, 1, 1],
        [-20, -20, 1, 1],
    ]  # fmt: skip


def test_two_who_meet_head_on_see_each_other_before_they_are_near() -> None:
    """At 25 m/s each, 90 m apart, with a range of 35 m: their plans come nearer.

    By distances now they would see each other 35 m apart, 0.7 s before they meet, and
    pass at half a metre.
    """
    scenario = reconfiguration(
        "uavs=[{speed_m_s: 20, heading_rad: 0, x_m: 0, y_m: -1000}, "
        "{speed_m_s: 25, heading_rad: 0, x_m: -45, y_m: 0}, "
        "{speed_m_s: 25, heading_rad: pi, x_m: 45, y_m: 0}]",
        "slots=[{x_m: 0, y_m: 0}, {x_m: 40, y_m: 1000}, {x_m: -40, y_m: 1000}]",
        "leader_uav=1",
        "assignment=given",
        "distances.communication_m=2000",
        "steps=8",
        name="formation_100",
        variant=None,
    )
    flight = build(scenario)
    flown = simulate(
        flight.plant, flight.controller, flight.x0, steps=8,
        rng=np.random.default_rng(0),
    )  # fmt: skip
    pair = pair_distances(flown.dense_states, 3)[2]
    assert pair[0] == pytest.approx(90.0)
    assert pair.min() >= scenario.distances.safe_m
