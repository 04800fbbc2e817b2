"""Meetings of two plans: none is missed, and few alarms are false."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmstart.ocp.swarm.plans import GONE, Plans, may_meet, no_plans

Path = NDArray[np.float64]
PIECES, STEP_S, RADIUS = 6, 0.5, 0.35
FINE = 200


def held(plans: Plans, row: int, first: int, start: Path, pushes: Path) -> Path:
    """Write a plan of held accelerations, and return its path on a fine grid.

    Args:
        plans: The plans.
        row: Its row.
        first: Step of its first sample.
        start: Position and velocity at it, shape (2, 3) [m, m/s].
        pushes: Accelerations, shape (PIECES, 3) [m/s^2].
    """
    shares = np.linspace(0.0, STEP_S, FINE, endpoint=False)[:, None]
    position, velocity = start
    samples, pieces = [position], []
    for push in pushes:
        pieces.append(position + velocity * shares + push * shares**2 / 2)
        position = position + velocity * STEP_S + push * STEP_S**2 / 2
        velocity = velocity + push * STEP_S
        samples.append(position)
    plans.first[row] = first
    plans.samples[row] = samples
    plans.bulges[row, :-1] = np.linalg.norm(pushes, axis=1) * STEP_S**2 / 8
    plans.bulges[row, -1] = 0.0
    return np.concatenate([*pieces, position[None]])


def numbers(most: float, *shape: int) -> st.SearchStrategy[Path]:
    """Return arrays of numbers of at most a size."""
    count = int(np.prod(shape))
    return st.lists(
        st.floats(-most, most, width=32), min_size=count, max_size=count
    ).map(lambda given: np.array(given).reshape(shape))


@settings(deadline=None)
@given(
    numbers(1.0, 2, 3), numbers(1.0, 2, 3), numbers(2.0, PIECES, 3),
    numbers(2.0, PIECES, 3), st.integers(0, 8),
)  # fmt: skip
def test_no_meeting_is_missed_and_an_alarm_is_near_one(
    start: Path, its: Path, pushes: Path, its_pushes: Path, from_step: int
) -> None:
    plans = no_plans(2, PIECES)
    # The second starts two steps earlier, and so comes to rest two steps earlier.
    one = held(plans, 0, 2, start, pushes)
    other = held(plans, 1, 0, its, its_pushes)
    one = np.concatenate([one, np.repeat(one[-1:], FINE, axis=0)])
    other = np.concatenate(
        [other[2 * FINE :], np.repeat(other[-1:], 3 * FINE, axis=0)]
    )[: len(one)]
    step = 2 + from_step
    apart = np.linalg.norm(one - other, axis=1)[min(step - 2, PIECES) * FINE :].min()
    alarm = may_meet(0, 1, step, RADIUS, plans)
    assert alarm == may_meet(1, 0, step, RADIUS, plans)
    if apart < RADIUS:
        assert alarm
    # Both bulges, and what the grid of this test may miss.
    if apart >= RADIUS + 2 * 2 * np.sqrt(3) * 2 * STEP_S**2 / 8 + 0.1:
        assert not alarm


def standing(places: list[list[float]], rests: list[float]) -> Plans:
    """Return plans that stand at places and stay in balls."""
    plans = no_plans(len(places), PIECES)
    plans.samples[:] = np.array(places)[:, None]
    plans.bulges[:] = 0.0
    plans.bulges[:, -1] = rests
    return plans


def test_they_pass_between_samples() -> None:
    # They change places within one piece: both samples are a metre apart.
    plans = standing([[0.0, 0, 0], [1.0, 0, 0]], [0.0, 0.0])
    plans.samples[0, 3:, 0], plans.samples[1, 3:, 0] = 1.0, 0.0
    assert may_meet(0, 1, 0, 0.1, plans)
    assert may_meet(0, 1, 2, 0.1, plans)
    assert not may_meet(0, 1, 3, 0.1, plans)


@pytest.mark.parametrize("rests", [[0.3, 0.0], [0.0, 0.3], [0.15, 0.15]])
def test_their_rests_must_be_apart_for_ever(rests: list[float]) -> None:
    plans = standing([[0.0, 0, 0], [0.64, 0, 0]], rests)
    for step in (0, PIECES, 1000):
        assert may_meet(0, 1, step, 0.35, plans)
        assert not may_meet(0, 1, step, 0.33, plans)


@pytest.mark.parametrize("index", [0, 3, PIECES])
def test_plans_that_are_not_numbers_may_meet(index: int) -> None:
    for bad in (np.nan, np.inf):
        plans = standing([[0.0, 0, 0], [9.0, 0, 0]], [0.0, 0.0])
        assert not may_meet(0, 1, 0, RADIUS, plans)
        assert may_meet(0, 1, 0, bad, plans)
        plans.bulges[1, index] = bad
        assert may_meet(0, 1, 0, RADIUS, plans)
    plans = standing([[0.0, 0, 0], [9.0, 0, 0]], [0.0, 0.0])
    plans.samples[1, index, 2] = np.nan
    assert may_meet(0, 1, 0, RADIUS, plans)


def test_a_row_that_is_not_written_may_meet_all_and_who_has_left_none() -> None:
    plans = no_plans(2, PIECES)
    assert may_meet(0, 1, 0, RADIUS, plans)
    assert not may_meet(0, GONE, 0, RADIUS, plans)
    assert not may_meet(GONE, GONE, 0, RADIUS, plans)


def test_nothing_is_known_before_a_plan_begins() -> None:
    plans = standing([[0.0, 0, 0], [9.0, 0, 0]], [0.0, 0.0])
    plans.first[1] = 5
    assert may_meet(0, 1, 4, RADIUS, plans)
    assert not may_meet(0, 1, 5, RADIUS, plans)
