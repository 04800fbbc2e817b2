"""The checker's tube: levels between times, cuts, membership."""

from __future__ import annotations

import numpy as np

from swarmstart.terminal_set.checker.lower_bound.regions import Tube
from swarmstart.terminal_set.checker.search import Boxes
from swarmstart.tests.terminal_set.checker.test_boxes import held, points


def random_tube(rng: np.random.Generator, slabs: int = 13, faces: int = 7) -> Tube:
    axes = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]
    return Tube(
        directions=np.vstack([axes, rng.normal(size=(faces, 2))]),
        times=np.concatenate([[0.0], np.cumsum(rng.uniform(0.1, 1.0, slabs))]),
        levels=rng.uniform(0.2, 2.0, size=(slabs + 1, 4 + faces)),
    )


def interpolated(tube: Tube, t: np.ndarray) -> np.ndarray:
    return np.array([np.interp(t, tube.times, level) for level in tube.levels.T])


def random_boxes(rng: np.random.Generator, tube: Tube, count: int) -> Boxes:
    ends = np.sort(rng.uniform(0, tube.times[-1], size=(2, count)), axis=0)
    ends[:, ::5] = rng.choice(tube.times, size=ends[:, ::5].shape)
    ends = np.sort(ends, axis=0)
    corner = rng.uniform(-3, 3, size=(2, 2, count))
    lower = np.vstack([ends[0], corner.min(axis=0)])
    upper = np.vstack([ends[1], corner.max(axis=0)])
    return Boxes(lower, upper, np.zeros(count, dtype=np.int64))


def test_the_highest_level_is_that_of_all_times_between() -> None:
    rng = np.random.default_rng(0)
    tube = random_tube(rng)
    boxes = random_boxes(rng, tube, 500)
    most = tube.highest(boxes.lower[0], boxes.upper[0])
    t = boxes.lower[0] + np.linspace(0, 1, 2001)[:, None] * (
        boxes.upper[0] - boxes.lower[0]
    )
    for k in range(len(tube.directions)):
        sampled = np.interp(t, tube.times, tube.levels[:, k]).max(axis=0)
        assert (most[k] >= sampled).all()
        assert (most[k] <= sampled + 1e-2).all()


def test_no_point_of_the_tube_is_cut_off() -> None:
    rng = np.random.default_rng(1)
    tube = random_tube(rng)
    boxes = random_boxes(rng, tube, 2000)
    cut, outside = tube.cut(boxes)
    seen = 0
    for _ in range(100):
        y = points(rng, boxes)
        inside = (tube.directions @ y[1:] <= interpolated(tube, y[0])).all(axis=0)
        seen += int(inside.sum())
        assert held(cut, y)[inside].all()
        assert not outside[inside].any()
    assert seen > 1000
    assert outside.any()


def test_points_said_to_be_held_are_inside() -> None:
    rng = np.random.default_rng(2)
    tube = random_tube(rng)
    boxes = random_boxes(rng, tube, 5000).points()
    inside = tube.holds(boxes)
    values = tube.directions @ boxes.lower[1:] - interpolated(tube, boxes.lower[0])
    assert (values[:, inside] <= 0.0).all()
    assert inside.any()
    assert (values[:, ~inside].max(axis=0) > -1e-9).all()


def test_a_start_outside_is_found_exactly() -> None:
    tube = random_tube(np.random.default_rng(4))
    top = float(tube.levels[0, 0])
    assert tube.holds_exactly((np.nextafter(top, 9.0), 0.0)) == 0
    assert tube.holds_exactly((0.0, 0.0)) is None
