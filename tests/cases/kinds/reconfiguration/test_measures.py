"""Measures of flights that are written by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from swarmstart.cases.format.kind import Nearby
from swarmstart.cases.kinds.planar import by_uav, pair_distances
from swarmstart.cases.kinds.reconfiguration.measures import measure
from swarmstart.cases.kinds.reconfiguration.names import MEASURES
from swarmstart.cases.kinds.reconfiguration.pose import ReconfigurationFlight
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.ocp import Source
from swarmstart.tests.cases.kinds.flights import build
from swarmstart.tests.cases.kinds.reconfiguration.scenarios import horizon

if TYPE_CHECKING:
    from swarmstart.arrays import Array
    from swarmstart.tests.cases.kinds.reconfiguration.conftest import Fly, Make

V, PSI, X, Y = range(4)
STEPS, UAVS, LEADER = 4, 5, 2
SLOTS = np.array([[-20.0, 20], [-10, 10], [0, 0], [-10, -10], [-20, -20]])


def in_slots(substeps: int = 1) -> Array:
    """Return five UAVs in the V that fly east at 2 m/s, (20, steps * substeps + 1)."""
    times = np.linspace(0.0, STEPS, STEPS * substeps + 1)
    states = np.zeros((UAVS, 4, times.size))
    states[:, V] = 2.0
    states[:, X] = SLOTS[:, :1] + 2.0 * times
    states[:, Y] = SLOTS[:, 1:]
    return states.reshape(-1, times.size)


@pytest.fixture
def measured(
    scenario: ReconfigurationScenario, flight: ReconfigurationFlight, by_hand: Fly
) -> Any:
    return lambda states, **how: measure(scenario, flight, by_hand(states, **how))


def test_a_formation_that_never_leaves_its_slots(measured: Any) -> None:
    found = measured(in_slots())
    assert found.keys() == MEASURES.keys()
    assert found["position_error_m"] == found["heading_error_rad"] == 0.0
    assert found["position_error_per_horizon_m"] == [0.0] * STEPS
    assert found["min_distance_m"] == pytest.approx(math.hypot(10, 10))
    assert found["max_distance_m"] == found["max_link_distance_m"] == 40.0
    assert found["speed_min_m_s"] == found["speed_max_m_s"] == 2.0
    assert found["evaluations"] == 7 * STEPS
    assert (found["step_seconds_median"], found["step_seconds_max"]) == (2.5, STEPS)
    assert found["penalty_max"] == found["infeasible_steps"] == 0
    assert found["gap_per_horizon"] is found["gap_max"] is None


def test_the_error_of_a_horizon_is_the_largest_at_its_end(measured: Any) -> None:
    states = in_slots()
    uavs = by_uav(states, UAVS)
    uavs[0, X, 0] += 30.0  # the start is not the end of a horizon
    uavs[0, X, 2], uavs[0, Y, 2] = uavs[0, X, 2] + 3, uavs[0, Y, 2] - 4
    uavs[4, Y, 2] += 1.0
    uavs[3, X, 4] -= 0.25
    found = measured(states)
    assert found["position_error_per_horizon_m"] == pytest.approx([0, 5, 0, 0.25])
    assert found["position_error_m"] == pytest.approx(0.25)


def test_errors_are_relative_to_where_the_leader_is(measured: Any) -> None:
    states = in_slots()
    by_uav(states, UAVS)[LEADER, Y, -1] += 2.0
    assert measured(states)["position_error_m"] == pytest.approx(2.0)
    by_uav(states, UAVS)[:, Y] += 17.0  # all alike: the formation may be anywhere
    assert measured(states)["position_error_m"] == pytest.approx(2.0)


def test_a_heading_a_full_turn_away_is_not_the_leaders(measured: Any) -> None:
    states = in_slots()
    by_uav(states, UAVS)[1, PSI, -1] = -2 * math.pi
    by_uav(states, UAVS)[3, PSI, -1] = 1.0
    assert measured(states)["heading_error_rad"] == pytest.approx(2 * math.pi)


def test_distances_and_speeds_are_those_between_the_control_instants_too(
    scenario: ReconfigurationScenario, flight: ReconfigurationFlight, by_hand: Fly
) -> None:
    dense = in_slots(substeps=2)
    uavs = by_uav(dense, UAVS)
    uavs[0, [X, Y], 5] = uavs[1, [X, Y], 5] + [0, 4]
    uavs[4, [X, Y], 7] = uavs[0, [X, Y], 7] - [0, 55]
    uavs[2, V, 1], uavs[3, V, 1] = 0.5, 9.0
    times = np.linspace(0.0, STEPS, 2 * STEPS + 1)
    trajectory = replace(by_hand(in_slots()), dense_states=dense, dense_times=times)
    found = measure(scenario, flight, trajectory)
    assert found["min_distance_m"] == pytest.approx(4)
    assert found["max_distance_m"] == pytest.approx(55)
    assert (found["speed_min_m_s"], found["speed_max_m_s"]) == (0.5, 9.0)


def test_distances_do_not_depend_on_how_many_steps_are_kept(
    make: Make, by_hand: Fly
) -> None:
    scenario = make("plant.substeps=80")
    flight = build(scenario)
    rng = np.random.default_rng(0)
    controls = np.tile(flight.posed.trim, UAVS)[:, None] + np.tile(
        [[300], [0.3]], (UAVS, 1)
    )
    controls = controls * rng.uniform(0.8, 1.2, (2 * UAVS, STEPS))
    dense = in_slots()[:, :1]
    for step, control in enumerate(controls.T):
        dense = np.hstack([dense, flight.plant(dense[:, -1], control, float(step))])
    found: list[Any] = []
    for every in (1, 8):
        kept = dense[:, ::every]
        times = np.linspace(0.0, STEPS, kept.shape[1])
        trajectory = by_hand(dense[:, ::80], controls=controls)
        trajectory = replace(trajectory, dense_states=kept, dense_times=times)
        found.append(measure(scenario, flight, trajectory))
    for name in ("min_distance_m", "max_distance_m", "max_link_distance_m"):
        assert found[0][name] == pytest.approx(found[1][name], abs=1e-6)
    distances = pair_distances(dense[:, ::8], UAVS)
    assert distances.min() > found[0]["min_distance_m"] + 1e-5


def test_the_distance_of_a_link_is_that_of_links_only(
    scenario: ReconfigurationScenario, flight: ReconfigurationFlight, by_hand: Fly
) -> None:
    linked = replace(
        flight, posed=replace(flight.posed, links=((1, 2), (3, 2), (0, 1)))
    )
    states = in_slots()
    by_uav(states, UAVS)[0, Y, 3] += 6.0
    found = measure(scenario, linked, by_hand(states))
    assert found["max_distance_m"] == pytest.approx(46)
    assert found["max_link_distance_m"] == pytest.approx(math.hypot(10, 16))


def test_costs_and_their_rises(measured: Any) -> None:
    found = measured(in_slots(), costs=[5.0, 4.0, 4.5, 4.5])
    assert found["cost_per_horizon"] == [5.0, 4.0, 4.5, 4.5]
    assert found["cost_rises"] == 1


def test_costs_of_those_who_plan_alone_are_summed(
    scenario: ReconfigurationScenario, flight: ReconfigurationFlight, by_hand: Fly
) -> None:
    nearby = Nearby(problems={}, range=45.0, position=(2, 3), links=1)
    alone = replace(flight, posed=replace(flight.posed, nearby=nearby))
    trajectory = by_hand(
        in_slots(), agents=UAVS, plan=lambda step, agent: {"cost": step + 10.0 * agent}
    )
    found = measure(scenario, alone, trajectory)
    assert found["cost_per_horizon"] == [100.0 + UAVS * k for k in range(STEPS)]
    assert found["cost_rises"] == STEPS - 1
    assert found["candidate_losses"] is None
    assert found["evaluations"] == 7 * UAVS * STEPS


def test_a_plan_worse_than_the_last_one_shifted_is_a_loss(
    make: Make, by_hand: Fly
) -> None:
    scenario = make(horizon(2))
    flight = build(scenario)
    rng = np.random.default_rng(0)
    banked = np.tile([[2500.0], [0.1]], (UAVS, 2)) + rng.uniform(-0.1, 0.1, (10, 2))
    held = banked[:, [1, 1]]  # its first interval is over, its last goes on
    states = in_slots()
    value, broken = flight.loop.planner.fitness.value(held, states[:, 1])
    assert value > 0.01 and broken == 0.0

    def losses(second: float, states: Array = states) -> object:
        def plan(step: int, agent: int) -> dict[str, Any]:
            cost = {0: 1e9, 1: second}.get(step, -1.0)  # the first has no last one
            return {"cost": cost, "controls": banked}

        return measure(scenario, flight, by_hand(states, plan=plan))["candidate_losses"]

    assert losses(value * (1 + 1e-10)) == 0  # rounding
    assert losses(value * (1 + 1e-8)) == 1
    too_near = states.copy()
    by_uav(too_near, UAVS)[0, [X, Y], 1] = by_uav(too_near, UAVS)[1, [X, Y], 1]
    assert losses(1e9, too_near) == 0  # the last one, shifted, is not allowed


def test_broken_limits_are_told(measured: Any) -> None:
    def plan(step: int, agent: int) -> dict[str, Any]:
        told: dict[int, dict[str, Any]] = {
            1: {"violation": 0.3, "feasible": False},
            3: {"source": Source.SHIFTED},
        }
        return told.get(step, {})

    found = measured(in_slots(), plan=plan)
    assert found["penalty_max"] == 0.3
    assert found["infeasible_steps"] == 2


def test_the_largest_bank_is_to_either_side(measured: Any) -> None:
    controls = np.zeros((2 * UAVS, STEPS))
    controls[0::2] = 2000.0
    controls[3, 1], controls[9, 2] = 0.5, -0.75
    assert measured(in_slots(), controls=controls)["bank_max_rad"] == 0.75


def test_errors_of_slots_that_turn(make: Make, by_hand: Fly) -> None:
    """The V behind a leader that heads north, as one that is turned left by 90 deg."""
    scenario = make("frame=leader")
    flight = build(scenario)
    states = in_slots()
    uavs = by_uav(states, UAVS)
    uavs[:, PSI] = np.pi / 2
    uavs[:, X], uavs[:, Y] = -SLOTS[:, 1:], SLOTS[:, :1]
    assert measure(scenario, flight, by_hand(states))[
        "position_error_m"
    ] == pytest.approx(0.0, abs=1e-12)
