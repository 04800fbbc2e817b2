"""The planning problem against (5.30)-(5.38), written in NumPy beside it."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.cases.kinds.planar import by_uav
from swarmstart.cases.kinds.reconfiguration.pose import ReconfigurationFlight
from swarmstart.cases.kinds.reconfiguration.problem import team_model, trim
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.ocp import Plant, Separation
from swarmstart.tests.cases.kinds.flights import build
from swarmstart.tests.cases.kinds.reconfiguration.scenarios import (
    horizon,
    slots_at,
    uavs_at,
)

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.reconfiguration.conftest import Make


G, DRAG, WEIGHT = 9.8, 2000.0, 10_000.0
LEADER, UAVS, CHECKS = 2, 5, 10
V = np.array([[-20.0, 20], [-10, 10], [0, 0], [-10, -10], [-20, -20]])
WEIGHTS = np.array([0.5, 2.0, 1.0, 3.0])
UNEQUAL = "weights=[0.5, 2, 1, 3]"
OMEGA, SAFE, FAR = 1e10, 5.0, 50.0
COLUMN = np.array([[2.0, 0, 0, y] for y in (20, 10, 0, -10, -20)])
Evaluate = Callable[[Array, Array], tuple[float, float]]

nodes, gauss = np.polynomial.legendre.leggauss(12)
POINTS, SHARES = (nodes + 1) / 2, gauss / 2


def after(state: Array, controls: Array, t: float) -> Array:
    """Return the state of one UAV after t: closed form, the way by Gauss' rule.

    v = v0 + a t, psi = psi0 + g sin(phi) / a ln(v / v0).
    """
    v, psi, *place = state
    a, rate = (controls[0] - DRAG) / WEIGHT, G * np.sin(controls[1])

    def heading(at: Array) -> Array:
        return np.asarray(psi + rate / a * np.log1p(a * at / v))

    pieces = [(t * (k + POINTS) / 8, t * SHARES / 8) for k in range(8)]
    way = np.sum(
        [
            [np.cos(heading(at)), np.sin(heading(at))] @ (share * (v + a * at))
            for at, share in pieces
        ],
        axis=0,
    )
    return np.array([v + a * t, heading(np.array(t)), *(np.array(place) + way)])


def flown(x0: Array, controls: Array) -> Array:
    """Return states (uavs, 4) at the end of each check, (N * checks, uavs, 4).

    Args:
        x0: Shape (uavs, 4).
        controls: Shape (N, uavs, 2).
    """
    states, found = x0, []
    for interval in controls:
        for t in np.arange(1, CHECKS + 1) / CHECKS:
            pairs = zip(states, interval, strict=True)
            found.append([after(state, held, t) for state, held in pairs])
        states = np.array(found[-1])
    return np.array(found)


def printed_cost(states: Array, *, turned: bool = False) -> float:
    """Return (5.38) of the states (uavs, 4) at the ends of the intervals."""
    cost = 0.0
    for uavs in states:
        leader = uavs[LEADER]
        cos, sin = np.cos(leader[1]), np.sin(leader[1])
        for uav, (x, y) in zip(uavs, V, strict=True):
            slot = (x * cos - y * sin, x * sin + y * cos) if turned else (x, y)
            error = np.array([0.0, 0.0, *slot]) - (uav - leader)
            cost += float(np.sum(WEIGHTS * error**2))
    return cost


def printed_penalty(states: Array, dt: float = 1.0) -> float:
    """Return (5.35): over ordered pairs, integrated by the rectangle rule."""
    integral = 0.0
    for uavs in states:
        for i, j in itertools.permutations(range(UAVS), 2):
            apart = np.hypot(*(uavs[i, 2:] - uavs[j, 2:]))
            integral += max(0.0, SAFE - apart) + max(0.0, apart - FAR)
    return OMEGA * integral * dt / CHECKS


def drawn(rng: np.random.Generator, intervals: int) -> Array:
    """Return controls (N, uavs, 2), nowhere exactly the drag: there a = 0."""
    thrust = rng.uniform(0, 6000, (intervals, UAVS))
    banks = rng.uniform(-np.pi / 3, np.pi / 3, (intervals, UAVS))
    return np.stack([thrust, banks], axis=2)


def evaluated(scenario: ReconfigurationScenario) -> Evaluate:
    """Return (x0 (uavs, 4), controls of the steered (N, m, 2)) -> cost, violation."""
    flight = build(scenario)
    fitness = flight.loop.planner.fitness
    return lambda x0, controls: fitness.value(
        controls.reshape(len(controls), -1).T, x0.ravel()
    )


@pytest.mark.parametrize("intervals", [1, 3])
@pytest.mark.parametrize("frame", ["global", "leader"])
def test_cost_is_that_of_5_38(make: Make, intervals: int, frame: str) -> None:
    value = evaluated(make(UNEQUAL, f"frame={frame}", horizon(intervals)))
    rng = np.random.default_rng(intervals)
    for _ in range(4):
        x0 = COLUMN + rng.uniform(-1, 1, (UAVS, 4)) * [0, 1, 3, 3]
        controls = drawn(rng, intervals)
        states = flown(x0, controls)[CHECKS - 1 :: CHECKS]
        expected = printed_cost(states, turned=frame == "leader")
        # Ten Runge-Kutta steps a second place a UAV to 2e-5 m at 1.4 m/s and more,
        # times twice the weighted distances to the slots, some 100 m in all.
        assert value(x0, controls)[0] == pytest.approx(expected, abs=1e-2)
        assert expected > 500


def test_a_leader_that_flies_straight_is_not_decided_but_counts(make: Make) -> None:
    value = evaluated(make(UNEQUAL, "leader=straight", horizon(2)))
    rng = np.random.default_rng(0)
    controls = drawn(rng, 2)
    controls[:, LEADER] = DRAG + 1e-6, 0.0  # as good as no acceleration
    states = flown(COLUMN, controls)
    assert states[-1, LEADER] == pytest.approx([2, 0, 4, 0], abs=1e-8)
    cost, _ = value(COLUMN, np.delete(controls, LEADER, axis=1))
    assert cost == pytest.approx(printed_cost(states[CHECKS - 1 :: CHECKS]), abs=1e-2)


@pytest.mark.parametrize("intervals", [1, 3])
def test_weight_of_the_order_makes_violations_the_penalty_5_35(
    make: Make, intervals: int
) -> None:
    scenario = make(horizon(intervals))
    value, rng = evaluated(scenario), np.random.default_rng(intervals)
    # Two lots, too near each other within and too far from each other: both limits.
    x0 = COLUMN + rng.uniform(-2, 2, (UAVS, 4)) * [0, 1, 1, 1]
    x0[:, 3] = x0[:, 3] / 8 + [0, 0, 0, 51, 51]
    controls = drawn(rng, intervals)
    states = flown(x0, controls)
    apart = np.linalg.norm(states[:, :, None, 2:] - states[:, None, :, 2:], axis=3)
    assert apart[apart > 0].min() < SAFE and apart.max() > FAR
    _, violation = value(x0, controls)
    assert scenario.order and scenario.order.name == "static_penalty"
    assert scenario.order.weight * violation == pytest.approx(
        printed_penalty(states), rel=1e-5
    )


def test_within_the_distances_the_penalty_is_exactly_zero(
    flight: ReconfigurationFlight,
) -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        controls = drawn(rng, 1)
        states = flown(COLUMN, controls)
        assert printed_penalty(states) == 0.0
        value = flight.loop.planner.fitness.value(controls.reshape(-1, 1), flight.x0)
        assert value[1] == 0.0


def test_a_formation_that_flies_as_one_costs_nothing(
    flight: ReconfigurationFlight,
) -> None:
    """J = 0 with any control that is the same for all UAVs: the V drifts freely."""
    in_slots = np.hstack([np.tile([7.0, 0.4], (UAVS, 1)), V + np.array([30.0, -40.0])])
    for thrust, bank in ((DRAG, 0.0), (6000.0, 1.0), (0.0, -np.pi / 3)):
        together = np.tile([thrust, bank], (UAVS, 1)).reshape(-1, 1)
        cost, _ = flight.loop.planner.fitness.value(together, in_slots.ravel())
        assert cost == pytest.approx(0.0, abs=1e-20)


@settings(max_examples=20, deadline=None)
@given(
    shift=st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    seed=st.integers(0, 1000),
)
def test_where_all_are_does_not_matter(
    flight: ReconfigurationFlight, shift: tuple[float, float], seed: int
) -> None:
    rng, fitness = np.random.default_rng(seed), flight.loop.planner.fitness
    controls = drawn(rng, 1).reshape(-1, 1)
    x0 = COLUMN + rng.uniform(-1, 1, (UAVS, 4)) * [1, 3, 20, 20]
    moved = x0 + np.array([0.0, 0.0, *shift])
    here, there = (fitness.value(controls, each.ravel()) for each in (x0, moved))
    assert there == pytest.approx(here, rel=1e-9, abs=1e-9)


def test_in_the_leaders_frame_neither_does_where_it_heads(make: Make) -> None:
    value, angle = evaluated(make("frame=leader")), 0.7
    rng = np.random.default_rng(0)
    controls, x0 = drawn(rng, 1), COLUMN.copy()
    x0[:, 1] = rng.uniform(-0.5, 0.5, UAVS)
    turned = x0.copy()
    turned[:, 1] += angle
    turned[:, 2:] = x0[:, 2:] @ np.array(
        [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    )
    assert value(turned, controls) == pytest.approx(value(x0, controls), rel=1e-9)
    fixed = evaluated(make())
    assert abs(fixed(turned, controls)[0] - fixed(x0, controls)[0]) > 100


PAIR = (
    uavs_at([(2, 0, 0, 0), (2, 0, 0, 20)]), slots_at([(0, 0), (0, 20)]), "leader_uav=1"
)  # fmt: skip
STILL = np.tile([DRAG, 0.0], (1, 2, 1))


def two(apart: float, *, speed: float = 2.0) -> Array:
    """Return two UAVs side by side, or one flying to the other, each at a speed."""
    return np.array([[speed, 0, 0, 0], [speed, 0, 0, apart]])


def test_a_margin_is_kept_to_both_limits(make: Make) -> None:
    value = evaluated(make("distances.margin_m=0.5", *PAIR))
    assert value(two(5.25), STILL)[1] == pytest.approx(CHECKS * 0.25)
    assert value(two(49.75), STILL)[1] == pytest.approx(CHECKS * 0.25)
    assert value(two(5.75), STILL)[1] == value(two(49.25), STILL)[1] == 0.0


def test_the_polish_keeps_the_margin_that_the_search_keeps(make: Make) -> None:
    """Both check points; without the margin the polish would keep the given plan."""
    flight = build(make("distances.margin_m=0.5", *PAIR))
    problem = flight.loop.planner.problem
    apart = [c for c in problem.constraints if isinstance(c, Separation)]
    assert [(c.margin, c.smooth_margin) for c in apart] == [(0.5, 0.5)]


@pytest.mark.parametrize(("along", "violation"), [("points", 0.0), ("segments", 5.0)])
def test_who_passes_through_the_other_between_two_checks(
    make: Make, along: str, violation: float
) -> None:
    value = evaluated(make("prediction.checks=1", f"distances.along={along}", *PAIR))
    meeting = np.array([[20.0, 0, 0, 0], [20.0, np.pi, 20, 0]])
    assert value(meeting, STILL)[1] == pytest.approx(violation)


def test_speeds_out_of_their_limits_are_violations(make: Make) -> None:
    value = evaluated(make(*PAIR, variant="corrected"))  # 0.2 to 20 m/s
    assert value(two(20.0), STILL)[1] == 0.0
    assert value(two(20.0, speed=20.5), STILL)[1] == pytest.approx(CHECKS * 2 * 0.5)
    assert value(two(20.0, speed=0.15), STILL)[1] == pytest.approx(CHECKS * 2 * 0.05)


def test_bounds_are_the_scenarios_for_everybody(make: Make) -> None:
    flight = build(make("leader=straight", variant="corrected"))
    problem = flight.loop.planner.problem
    lower, upper = problem.control_limits
    assert lower.reshape(4, 2) == pytest.approx(np.tile([0, -np.pi / 3], (4, 1)))
    assert upper.reshape(4, 2) == pytest.approx(np.tile([6000, np.pi / 3], (4, 1)))
    slowest, fastest = (limit.reshape(UAVS, 4) for limit in problem.state_limits)
    assert (slowest[:, 0] == 0.2).all() and (fastest[:, 0] == 20).all()
    assert np.isinf(slowest[:, 1:]).all() and np.isinf(fastest[:, 1:]).all()


def test_the_plant_of_a_straight_leader_flies_it_straight(make: Make) -> None:
    scenario = make("leader=straight")
    model = team_model(scenario, [0, 1, 3, 4])
    assert model.control_names[::2] == tuple(f"thrust_n_{i}" for i in (0, 1, 3, 4))
    x0, rng = COLUMN + np.array([0, 0.4, 0, 0]), np.random.default_rng(0)
    controls = drawn(rng, 1)[0]
    dense = Plant(model, dt=1.0, substeps=CHECKS)(
        x0.ravel(), np.delete(controls, LEADER, axis=0).ravel()
    )
    found = by_uav(dense, UAVS)
    times = np.arange(1, CHECKS + 1) / CHECKS
    straight = [2 * times * np.cos(0.4), 2 * times * np.sin(0.4)]
    assert found[LEADER, 2:] == pytest.approx(np.array(straight))
    for i in (0, 1, 3, 4):
        expected = after(x0[i], controls[i], 1.0)
        assert found[i, :, -1] == pytest.approx(expected, abs=2e-5)


def test_trim_keeps_speed_and_heading(make: Make) -> None:
    vehicle = make("vehicle.drag_n=1234").vehicle
    assert trim(vehicle).tolist() == [1234.0, 0.0]
