"""Questions to a tube: never a wrong "outside"."""

from collections.abc import Callable

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.stated.answer import Tube
from swarmstart.ocp.lower_bound.stated.statement import Statement
from swarmstart.ocp.lower_bound.tubes.tube import tube_of
from swarmstart.ocp.lower_bound.tubes.tube_set import (
    inside,
    outside,
    starting_boxes,
)
from swarmstart.tests.ocp.lower_bound.statements import (
    double_integrator,
    pushed,
    unicycle,
)

PROBLEMS = (double_integrator, unicycle, pushed)


def some_tube(problem: Callable[[], Statement]) -> Tube:
    return tube_of(problem(), slabs=12)


def intervals(tube: Tube, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Intervals of time of all lengths, some at knots."""
    ends = tube.times[-1] * rng.random((2, count))
    ends[1] = ends[0] + (ends[1] - ends[0]) * rng.random(count) ** 4
    ends[0, ::5] = rng.choice(tube.times, ends[0, ::5].shape)
    return ends.min(axis=0), ends.max(axis=0)


def greatest_levels(tube: Tube, low: Array, high: Array) -> Array:
    """The greatest level of each face within each interval, by the definition."""
    found = []
    for begin, end in zip(low, high, strict=True):
        within = tube.times[(tube.times > begin) & (tube.times < end)]
        times = np.concatenate([[begin, end], within])
        found.append([np.interp(times, tube.times, row).max() for row in tube.levels.T])
    return np.array(found).T


def points_in(tube: Tube, rng: np.random.Generator, count: int) -> Array:
    """Random points of the tube, as many in each slab's box."""
    lower, upper = starting_boxes(tube)
    slab = rng.integers(lower.shape[1], size=40 * count)
    part = rng.random((len(lower), slab.size))
    points = lower[:, slab] + part * (upper - lower)[:, slab]
    return points[:, inside(tube, points)][:, :count]


@pytest.mark.parametrize("problem", PROBLEMS)
def test_no_box_with_a_point_of_the_tube_is_outside(
    problem: Callable[[], Statement],
) -> None:
    tube, rng = some_tube(problem), np.random.default_rng(1)
    points = points_in(tube, rng, 3000)
    assert points.shape == (1 + tube.directions.shape[1], 3000)
    assert not outside(tube, points, points).any()
    size = rng.random(points.shape) ** 3
    assert not outside(tube, points - size, points + size).any()
    lower, upper = starting_boxes(tube)
    assert not outside(tube, lower, upper).any()
    slab = np.clip(np.searchsorted(tube.times, points[0]) - 1, 0, None)
    assert (points >= lower[:, slab] - 1e-12).all()
    assert (points <= upper[:, slab] + 1e-12).all()


@pytest.mark.parametrize("problem", PROBLEMS)
def test_small_boxes_beyond_a_face_are_outside(
    problem: Callable[[], Statement],
) -> None:
    tube, rng = some_tube(problem), np.random.default_rng(2)
    points = points_in(tube, rng, 2000)
    moved = points.copy()
    face = rng.integers(len(tube.directions), size=2000)
    moved[1:] += 2 * np.abs(tube.levels).max() * tube.directions[face].T
    is_in = inside(tube, moved)
    assert not is_in.any()
    assert outside(tube, moved - 1e-9, moved + 1e-9).mean() > 0.99
    late = points + np.eye(len(points))[:, :1] * (tube.times[-1] + 0.1)
    assert outside(tube, late, late).all()


@pytest.mark.parametrize("problem", PROBLEMS)
def test_a_box_is_outside_just_if_a_face_is_between(
    problem: Callable[[], Statement],
) -> None:
    # The definition in NumPy, against the kernel.
    tube, rng = some_tube(problem), np.random.default_rng(7)
    low, high = intervals(tube, rng, 2000)
    reach = np.abs(tube.levels).max()
    x = reach * rng.uniform(-1.5, 1.5, (tube.directions.shape[1], 2000))
    size = 0.2 * reach * rng.random(x.shape)
    d = tube.directions[:, :, None]
    least = np.minimum(d * (x - size), d * (x + size)).sum(axis=1)
    expected = (least > greatest_levels(tube, low, high)).any(axis=0)
    found = outside(tube, np.vstack([low, x - size]), np.vstack([high, x + size]))
    assert 100 < found.sum() < 1990
    assert np.array_equal(found, expected)


def test_a_box_that_touches_the_tube_is_not_outside() -> None:
    tube = some_tube(double_integrator)
    levels = tube.levels[-1]
    for sign, level in ((1.0, levels[0]), (-1.0, levels[1])):
        # From the greatest x1 on outwards, at the end.
        ends = sorted([sign * level, sign * (level + 1.0)])
        lower = np.array([[tube.times[-1]], [ends[0]], [-9.0]])
        upper = np.array([[tube.times[-1]], [ends[1]], [9.0]])
        assert not outside(tube, lower, upper)[0]
        lower[1] += sign * 1e-9
        upper[1] += sign * 1e-9
        assert outside(tube, lower, upper)[0]


def test_boxes_without_numbers_are_never_outside() -> None:
    tube = some_tube(double_integrator)
    nan, inf = np.nan, np.inf
    lower = np.array(
        [[0.5, 0.5, nan, 0.5, 0.5], [nan, -inf, 0, 99, nan], [0, -inf, 0, 99, 9]]
    )
    upper = np.array(
        [[0.6, 0.6, 0.6, 0.6, 0.6], [nan, inf, 1, nan, 1], [1, inf, 1, 99, 9]]
    )
    assert not outside(tube, lower, upper).any()
