"""Search of clear plans: the direct way if it is free, another if not, none if none."""

import math

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.swarm.legs import PointMass, State
from swarmstart.ocp.swarm.plans import Plans, may_meet, no_plans
from swarmstart.ocp.swarm.seeking import PARTS, Task, seek

PIECES, DISTANCE = 200, 0.35
BODY = PointMass(np.ones(3), 2 * np.ones(3), 0.1)
GOAL = np.array([3.0, 0.0, 0.0])


def standing(places: list[list[float]]) -> Plans:
    """Return plans that stand, and room for one more in the last row."""
    plans = no_plans(len(places) + 1, PIECES)
    for row, place in enumerate(places):
        plans.samples[row], plans.bulges[row] = place, 0.0
    plans.samples[-1, 0] = 0.0
    return plans


def found(plans: Plans, *, seed: int = 0, tries: int = 200) -> tuple[float, Array]:
    """Return cost and samples of what is found from the origin to the goal."""
    row = len(plans.first) - 1
    state = State(np.zeros(3), np.zeros(3))
    task = Task(0, 0, state, GOAL, np.arange(row), DISTANCE)
    draws = np.random.default_rng(seed).standard_normal((tries, PARTS))
    return seek(row, task, draws, BODY, plans), plans.samples[row]


def test_a_free_way_is_flown_directly() -> None:
    cost, samples = found(standing([[0.0, 2.0, 0.0]]))
    # Half the way at the largest acceleration, in steps; and the way is straight.
    time = 2 * math.ceil(math.sqrt(3.0) / 0.1) * 0.1
    assert cost == pytest.approx(time + 3.0)
    assert (samples[:, 1:] == 0).all()
    assert samples[-1] == pytest.approx(GOAL)


def test_a_way_round_is_clear_and_its_cost_is_its_time_and_length() -> None:
    plans = standing([[1.5, 0.0, 0.0], [1.5, 0.4, 0.0]])
    cost, samples = found(plans)
    assert math.isfinite(cost)
    assert not any(may_meet(2, other, 0, DISTANCE, plans) for other in (0, 1))
    length = np.linalg.norm(np.diff(samples, axis=0), axis=1).sum()
    moving = (samples != samples[-1]).any(axis=1)
    assert cost == pytest.approx(0.1 * moving.sum() + length)
    assert 3.0 < length < 4.0


def test_one_waits_for_who_passes() -> None:
    # A column crosses in front of the goal for some seconds.
    plans = standing([[9.0, 9.0, 9.0]])
    plans.samples[0] = [1.0, 0.0, 0.0]
    late = np.linspace(0.0, 6.0, 61)
    plans.samples[0, 20:81, 1] = late
    plans.samples[0, 81:, 1] = 6.0
    cost, _ = found(plans)
    assert math.isfinite(cost)
    assert not may_meet(1, 0, 0, DISTANCE, plans)


def test_nothing_is_found_if_another_stands_on_the_goal_for_ever() -> None:
    cost, _ = found(standing([[3.1, 0.0, 0.0]]))
    assert cost == math.inf


def test_more_tries_are_not_worse() -> None:
    costs = []
    for tries in (50, 200, 800):
        cost, _ = found(standing([[1.5, 0, 0], [1.5, 0.3, 0], [1.5, 0, 0.4]]),
                        tries=tries)  # fmt: skip
        costs.append(cost)
    # The refinement begins at half of the tries, so that costs need not fall strictly.
    assert costs[2] <= costs[0] * 1.01


def test_a_body_in_motion_does_not_wait() -> None:
    plans = standing([[1.5, 0.0, 0.0]])
    state = State(np.zeros(3), np.array([0.5, 0.0, 0.0]))
    task = Task(0, 0, state, GOAL, np.arange(1), DISTANCE)
    draws = np.random.default_rng(0).standard_normal((200, PARTS))
    assert math.isfinite(seek(1, task, draws, BODY, plans))
    assert (plans.samples[1, 1] != plans.samples[1, 0]).any()
