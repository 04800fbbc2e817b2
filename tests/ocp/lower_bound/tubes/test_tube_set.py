"""Questions to a tube: never a wrong "outside", and samples all over it."""

from collections.abc import Callable

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.stated.evidence import Tube
from swarmstart.ocp.lower_bound.stated.statement import Statement
from swarmstart.ocp.lower_bound.tubes.tube import tube_of
from swarmstart.ocp.lower_bound.tubes.tube_set import (
    box_over,
    inside,
    levels_over,
    outside,
    sampled,
    starting_boxes,
)
from swarmstart.tests.ocp.lower_bound.statements import (
    double_integrator,
    pushed,
    stated,
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


@pytest.mark.parametrize("problem", PROBLEMS)
def test_levels_over_an_interval_are_the_greatest_within(
    problem: Callable[[], Statement],
) -> None:
    tube, rng = some_tube(problem), np.random.default_rng(0)
    low, high = intervals(tube, rng, 300)
    found = levels_over(tube, low, high)
    lower, upper = box_over(tube, low, high)
    for k in range(300):
        within = tube.times[(tube.times > low[k]) & (tube.times < high[k])]
        times = np.concatenate([[low[k], high[k]], within])
        exact = [np.interp(times, tube.times, row).max() for row in tube.levels.T]
        assert found[:, k] == pytest.approx(exact, abs=1e-11)
        assert (found[:, k] >= exact).all()
        assert np.array_equal(upper[:, k], found[0 : 2 * len(upper) : 2, k])
        assert np.array_equal(lower[:, k], -found[1 : 2 * len(upper) : 2, k])


@pytest.mark.parametrize("problem", PROBLEMS)
def test_samples_are_inside_and_no_box_with_one_is_outside(
    problem: Callable[[], Statement],
) -> None:
    tube, rng = some_tube(problem), np.random.default_rng(1)
    points = sampled(tube, rng, 3000)
    assert points.shape == (1 + tube.directions.shape[1], 3000)
    assert inside(tube, points).all()
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
    points = sampled(tube, rng, 2000)
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
    expected = (least > levels_over(tube, low, high)).any(axis=0)
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


def test_samples_are_spread_over_the_tube_s_volume() -> None:
    tube, rng = some_tube(double_integrator), np.random.default_rng(3)
    points = sampled(tube, rng, 20_000)
    between = points[:, (points[0] > 0) & (points[0] < 2.1)]
    # The share in parts of the tube, against that of uniform points in its box.
    lower, upper = starting_boxes(tube)
    low, high = lower.min(axis=1, keepdims=True), upper.max(axis=1, keepdims=True)
    uniform = low + (high - low) * rng.random((3, 400_000))
    uniform = uniform[:, inside(tube, uniform)]
    for axis, cut in ((0, 1.5), (0, 1.9), (1, 1.0), (2, 0.7)):
        exact = (uniform[axis] > cut).mean()
        assert (between[axis] > cut).mean() == pytest.approx(exact, abs=0.03)
    assert (points[0] == tube.times[-1]).mean() == pytest.approx(0.04, abs=0.001)


def test_samples_can_be_had_of_one_time() -> None:
    tube, rng = some_tube(unicycle), np.random.default_rng(4)
    points = sampled(tube, rng, 500, between=(1.3, 1.3))
    assert (points[0] == 1.3).all()
    assert inside(tube, points).all()
    some = sampled(tube, rng, 500, between=(0.7, 0.8))
    assert ((some[0] >= 0.7) & (some[0] <= 0.8)).all()


def test_a_tube_thinner_than_its_box_is_sampled_too() -> None:
    # Along the diagonal, and no control moves it off: 1e-5 wide.
    line = stated(
        lambda _, x, u: [u[0] + 1e-5 * u[1], u[0] - 1e-5 * u[1]],
        [0, 0],
        [(-1, 1), (-1, 1)],
        1.0,
    )
    tube, rng = tube_of(line, slabs=8), np.random.default_rng(5)
    points = sampled(tube, rng, 400)
    assert np.isfinite(points).all()
    levels = np.array([np.interp(points[0], tube.times, row) for row in tube.levels.T])
    assert (tube.directions @ points[1:] <= levels + 1e-9).all()
    assert np.ptp(points[1]) > 0.5


def test_the_same_seed_gives_the_same_samples() -> None:
    tube = some_tube(double_integrator)
    one, other = (sampled(tube, np.random.default_rng(6), 100) for _ in range(2))
    assert np.array_equal(one, other)
    assert sampled(tube, np.random.default_rng(6), 1).shape == (3, 1)
