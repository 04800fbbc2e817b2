"""A swarm behind a plant moves as it plans, and keeps away under any disturbance."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.ocp.swarm.controller import SwarmDecision

PAIR: dict[str, Any] = {
    "starts": [[0, 0, 1], [2, 0, 1], [1, 1, 1]],
    "goals": [[2, 0, 1], [0, 0, 1], [1, -1, 1]],
    "distance": 0.35,
}
LOSSY = ss.Links(most_delay=3, loss=0.3)


def flown(
    loop: ss.SwarmController, gusts: Any = None, *, substeps: int = 4, seed: int = 0
) -> ss.Trajectory:
    n = loop.swarm.size
    plant = ss.Plant(
        ss.swarm_model(n), dt=loop.dt, substeps=substeps,
        parameters=gusts or (lambda t: np.zeros((3 * n, t.size))),
    )  # fmt: skip
    return ss.simulate(plant, loop, loop.x0, steps=300, seed=seed)


def last(run: ss.Trajectory) -> SwarmDecision:
    decision = run.decisions[-1]
    assert isinstance(decision, SwarmDecision)
    return decision


def least(path: Array) -> float:
    pairs = itertools.combinations(path, 2)
    return min(float(np.linalg.norm(a - b, axis=0).min()) for a, b in pairs)


def places(run: ss.Trajectory) -> Array:
    """Return positions on the fine path, shape (n, 3, times)."""
    return run.dense_states.reshape(-1, 6, run.dense_times.size)[:, :3]


def test_a_plant_without_a_disturbance_flies_as_the_simulation_of_plans() -> None:
    swarm = ss.Swarm(**PAIR)
    run = flown(ss.SwarmController(swarm, links=LOSSY))
    flight = ss.simulate_swarm(swarm, links=LOSSY, seed=0)
    assert run.decisions[-1].is_last
    np.testing.assert_allclose(
        run.states.reshape(-1, 6, run.times.size)[:, :3], flight.positions, atol=1e-9
    )
    np.testing.assert_array_equal(last(run).flight.positions, flight.positions)
    assert last(run).flight.rule == flight.rule == "acknowledged"


@pytest.mark.parametrize("kind", ["towards each other", "constant", "random"])
def test_disturbed_vehicles_keep_distance_bounds_and_their_plans(kind: str) -> None:
    size, rng = 0.2, np.random.default_rng(1)
    signs: dict[str, Callable[[Array], Array]] = {
        "towards each other": lambda t: np.sign(np.sin(2 * t + np.arange(9)[:, None])),
        "constant": lambda t: np.ones((9, t.size)),
        "random": lambda t: rng.choice([-1.0, 1.0], size=(9, t.size)),
    }
    swarm = ss.Swarm(**PAIR)
    loop = ss.SwarmController(swarm, links=LOSSY, disturbance=size)
    run = flown(loop, lambda t: size * signs[kind](t))
    assert last(run).flight.arrived_share == 1.0
    assert last(run).flight.min_distance_m >= loop.swarm.plan_distance > 0.35
    assert least(places(run)) >= 0.35
    assert np.abs(run.controls).max() <= 1.0
    velocities = run.dense_states.reshape(3, 6, -1)[:, 3:]
    assert np.abs(velocities).max() <= 2.0
    off = places(run)[:, :, ::4] - last(run).flight.positions
    assert 0 < np.abs(off).max() <= loop.tracking.position
    assert np.abs(off).max() > 0.2 * loop.tracking.position


def test_without_room_for_the_error_the_same_disturbance_leads_too_near() -> None:
    # So the test above can fail: two hover as near as they may, and are pushed, while
    # a third moves.
    near = ss.Swarm(
        starts=[[0.0, 0.0, 0.0], [0.36, 0.0, 0.0], [0.0, 2.0, 0.0]],
        goals=[[0.0, 0.0, 0.0], [0.36, 0.0, 0.0], [0.0, 4.0, 0.0]], distance=0.35,
    )  # fmt: skip
    loop = ss.SwarmController(near)
    push = np.array([1.0, 0, 0, -1.0, 0, 0, 0, 0, 0])[:, None]
    run = flown(loop, lambda t: 0.2 * push * np.ones(t.size))
    assert least(places(run)) < 0.35
    with pytest.raises(ss.InvalidProblemError, match="starts of vehicles 0 and 1"):
        ss.SwarmController(near, disturbance=0.2)


def test_two_that_hover_as_near_as_plans_may_be_stay_apart_when_pushed() -> None:
    far = ss.Swarm(starts=np.eye(2, 3), goals=np.eye(2, 3), distance=0.35)
    apart = ss.SwarmController(far, disturbance=0.2).swarm.plan_distance
    beside = [[0.0, 0.0, 0.0], [apart, 0.0, 0.0], [0.0, 2.0, 0.0]]
    near = ss.Swarm(starts=beside, goals=[*beside[:2], [0.0, 4.0, 0.0]], distance=0.35)
    loop = ss.SwarmController(near, disturbance=0.2)
    push = np.array([1.0, 0, 0, -1.0, 0, 0, 0, 0, 0])[:, None]
    run = flown(loop, lambda t: 0.2 * push * np.ones(t.size))
    # With the error only once in between they would meet.
    assert 0.35 <= least(places(run)) < (apart + 0.35) / 2


def test_frames_that_drift_keep_the_turn_rate_over_the_ground() -> None:
    swarm = ss.Swarm(
        starts=[[-25, 5, 0], [-25, -5, 0]], goals=[[0, 0, 0], [-30, -30, 0]],
        distance=3.0, acceleration=[5, 5, 5], speed=[10, 10, 10],
        turn_rate=np.pi / 18, drift=[15, 0, 0],
    )  # fmt: skip
    flight = ss.simulate_swarm(swarm, step_s=0.2, seed=0)
    assert flight.arrived_share == 1.0
    path = flight.positions[:, :2] + np.array([[15.0], [0.0]]) * flight.times
    velocity = np.gradient(path, 0.2, axis=2)
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    turns = np.abs(np.diff(heading, axis=1)) / 0.2
    assert 0.5 * np.pi / 18 < turns.max() <= np.pi / 18 * (1 + 1e-3)


@pytest.mark.parametrize("drift", [0.5, 1.0, 2.0])
def test_no_plan_turns_back_on_the_spot_over_the_ground(drift: float) -> None:
    swarm = ss.Swarm(
        starts=[[0, 0, 0]], goals=[[-10, 0, 0]], distance=0.35, turn_rate=0.3,
        drift=[drift, 0, 0],
    )  # fmt: skip
    flight = ss.simulate_swarm(swarm, seconds=120, longest_s=60, seed=0)
    path = flight.positions[0, :2] + np.array([[drift], [0.0]]) * flight.times
    steps = np.diff(path, axis=1)
    moving = steps[:, np.hypot(*steps) > 1e-9]
    cosines = (moving[:, 1:] * moving[:, :-1]).sum(axis=0)
    assert (cosines > 0).all()


def test_vehicles_without_a_speed_along_an_axis_keep_their_coordinate() -> None:
    swarm = ss.Swarm(**PAIR, speed=[2, 2, 0])
    flight = ss.simulate_swarm(swarm, links=LOSSY, seed=0)
    assert flight.arrived_share == 1.0
    assert (flight.positions[:, 2] == 1.0).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": [0, 0, 0]}, "speed must be at least 0, and one above it"),
        ({"speed": [2, 0, 2]}, "goals must have the y of the starts"),
        ({"drift": [1, 0, 1]}, "drift must be level"),
        ({"drift": [1e-12, 0, 0]}, r"or at least 0.001 m/s"),
        ({"acceleration": [1, 0, 1]}, "acceleration must be above 0"),
    ],
)
def test_bounds_that_do_not_fit_are_refused(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ss.InvalidProblemError, match=message):
        ss.Swarm(**PAIR, **changes)


def test_disturbances_that_leave_no_acceleration_are_refused() -> None:
    swarm = ss.Swarm(**PAIR)
    with pytest.raises(ss.InvalidProblemError, match=r"acceleration must be above the"):
        ss.SwarmController(swarm, disturbance=1.0)
    flat = ss.Swarm(**PAIR, turn_rate=1.0)
    with pytest.raises(ss.InvalidProblemError, match="must be 0 with a turn rate"):
        ss.SwarmController(flat, disturbance=0.1)


def test_decisions_that_are_not_the_last_are_refused() -> None:
    loop, rng = ss.SwarmController(ss.Swarm(**PAIR)), np.random.default_rng(0)
    first = loop.decide(0.0, loop.x0, None, rng=rng)
    assert first.flight is first.flight
    assert len(first.flight.apart) == 1
    second = loop.decide(0.1, loop.x0, first, rng=rng)
    assert len(second.flight.apart) == 2
    assert (first.step, second.step) == (1, 2)
    with pytest.raises(ss.InvalidProblemError, match="must be the last decision"):
        loop.decide(0.1, loop.x0, first, rng=rng)
    foreign = ss.Decision(control=np.zeros(9), plans=())
    with pytest.raises(ss.InvalidProblemError, match="must be a SwarmDecision"):
        loop.decide(0.1, loop.x0, foreign, rng=rng)
