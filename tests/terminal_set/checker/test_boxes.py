"""Cutting boxes drops no point of the set."""

from __future__ import annotations

import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set.checker.models import Model
from swarmstart.terminal_set.checker.search import (
    Boxes,
    Flags,
    cut_by,
    is_empty,
    joined,
)


def random_boxes(rng: np.random.Generator, d: int, count: int) -> Boxes:
    lower = rng.normal(size=(d, count))
    width = rng.choice([0.0, 1e-3, 0.3, 2.0], size=(d, count))
    return Boxes(lower, lower + width, np.zeros(count, dtype=np.int64))


def points(rng: np.random.Generator, boxes: Boxes) -> Array:
    share = rng.uniform(size=boxes.lower.shape)
    share = np.where(rng.random(share.shape) < 0.3, np.round(share), share)
    inside = boxes.lower + share * (boxes.upper - boxes.lower)
    return np.clip(inside, boxes.lower, boxes.upper)


def held(boxes: Boxes, y: Array) -> Flags:
    inside = (boxes.lower <= y) & (y <= boxes.upper)
    return np.asarray(inside.all(axis=0), dtype=np.bool_)


def constraint(x: list[Model] | list[Array]) -> Model | Array:
    """A curved set: x0 - 2 x1 + x0 x1 + .5."""
    if isinstance(x[0], Model):
        a, b = x[0], x[1]
        assert isinstance(b, Model)
        return (a - b.scaled(2.0) + a * b).shifted(0.5)
    return np.asarray(x[0] - 2.0 * x[1] + x[0] * x[1] + 0.5)


def test_no_point_of_a_curved_set_is_dropped() -> None:
    rng = np.random.default_rng(0)
    boxes = random_boxes(rng, 2, 3000)
    model = constraint(boxes.variables())
    assert isinstance(model, Model)
    cut, outside = cut_by(boxes, model)
    for _ in range(100):
        y = points(rng, boxes)
        value = constraint([y[0], y[1]])
        assert isinstance(value, np.ndarray)
        inside = value <= -1e-12
        assert held(cut, y)[inside].all()
        assert not outside[inside].any()
    # It does drop: many boxes shrink, some vanish.
    assert (cut.upper - cut.lower).sum() < 0.9 * (boxes.upper - boxes.lower).sum()
    assert outside.any()


def test_what_is_not_known_cuts_nothing() -> None:
    boxes = random_boxes(np.random.default_rng(1), 2, 5)
    x = boxes.variables()[0]
    broken = Model(x.algebra, x.coefficients * np.nan, x.error)
    with np.errstate(all="ignore"):
        cut, outside = cut_by(boxes, broken)
    assert not outside.any()
    np.testing.assert_array_equal(cut.lower, boxes.lower)
    np.testing.assert_array_equal(cut.upper, boxes.upper)


def test_middle_and_radius_cover_the_box() -> None:
    boxes = random_boxes(np.random.default_rng(2), 3, 500)
    assert (boxes.middle - boxes.radius <= boxes.lower).all()
    assert (boxes.middle + boxes.radius >= boxes.upper).all()


def test_halves_make_up_the_box() -> None:
    rng = np.random.default_rng(3)
    boxes = random_boxes(rng, 3, 200)
    halves = boxes.halves(rng.integers(0, 3, 200))
    assert halves.count == 400
    below, above = halves.only(slice(200)), halves.only(slice(200, None))
    for _ in range(20):
        y = points(rng, boxes)
        assert (held(below, y) | held(above, y)).all()


def test_joined_batches_keep_all_boxes() -> None:
    boxes = random_boxes(np.random.default_rng(4), 2, 6)
    again = joined([boxes.only(slice(2)), boxes.only(slice(2, None))])
    np.testing.assert_array_equal(again.lower, boxes.lower)
    assert not is_empty(again).any()
