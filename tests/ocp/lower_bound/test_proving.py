"""Proofs by branch and bound of functions whose least value is known."""

import time as clock
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.hamiltonian import Bounds
from swarmstart.ocp.lower_bound.proving import (
    BEYOND,
    CHUNK,
    FEW,
    Floor,
    Limits,
    halved,
    proven_floor,
)

Mask = NDArray[np.bool_]

CENTER = np.array([[0.3], [-0.2]])
SQUARE = (np.full((2, 1), -1.0), np.full((2, 1), 1.0))
SLOPE = np.array([[1.0], [2.0]])


def bowl(points: Array) -> Array:
    """|y - c|^2 - 2, whose least value is -2."""
    return np.asarray(((points - CENTER) ** 2).sum(axis=0) - 2)


def bowl_bounds(lower: Array, upper: Array) -> Bounds:
    """Bounds by the slope in the middle: as poor as the squares of the sides."""
    middle, reach = (lower + upper) / 2, (upper - lower) / 2
    spread = 2 * np.abs(middle - CENTER) * reach + reach**2
    return Bounds(bowl(middle) - spread.sum(axis=0), spread)


def nothing(lower: Array, _: Array) -> Mask:
    return np.zeros(lower.shape[1], dtype=np.bool_)


def soon(seconds: float = 5.0, **others: float) -> Limits:
    return Limits(until=clock.perf_counter() + seconds, **others)  # type: ignore[arg-type]


def ring(radius: float) -> tuple[Callable[[Array, Array], Mask], Callable[..., Array]]:
    """The square with a hole about the bowl's deepest point."""

    def outside(lower: Array, upper: Array) -> Mask:
        far = np.maximum(np.abs(lower - CENTER), np.abs(upper - CENTER))
        return np.asarray((far**2).sum(axis=0) < radius**2)

    def value(points: Array) -> Array:
        inside = ((points - CENTER) ** 2).sum(axis=0) >= radius**2
        return np.where(inside, bowl(points), np.inf)

    return outside, value


def searched(hoped: float, limits: Limits | None = None) -> Floor:
    return proven_floor(bowl_bounds, nothing, bowl, SQUARE, hoped, limits or soon())


def test_the_slack_is_the_least_value_of_the_function_or_little_more() -> None:
    found = searched(0.1)
    assert found.proven
    assert 2.0 <= found.slack <= BEYOND * 2.0
    # The points lie in the set, below what was hoped for, the lowest first.
    values = bowl(found.points)
    assert found.points.shape[1] > 0
    assert (np.abs(found.points) <= 1).all()
    assert (values < -0.1).all()
    assert (np.diff(values) >= 0).all()
    assert found.lowest == values[0]


@pytest.mark.parametrize("hoped", [2.001, 2.5, 30.0])
def test_what_is_hoped_for_stays_if_it_is_true(hoped: float) -> None:
    found = searched(hoped)
    assert found.proven
    assert found.slack == hoped
    assert found.points.shape == (2, 0)
    assert found.lowest == np.inf


@pytest.mark.parametrize("hoped", [1.96, 1.99, 1.999, 1.9999])
def test_what_is_hoped_for_in_vain_by_little_is_not_kept(hoped: float) -> None:
    found = searched(hoped)
    assert found.proven
    assert 2.0 <= found.slack <= BEYOND * 2.0


@pytest.mark.parametrize("max_boxes", [0, 3, 10, 30, 100, 300])
@pytest.mark.parametrize("hoped", [0.5, 1.9, 2.0])
def test_a_limit_of_boxes_leaves_a_poor_proof(max_boxes: int, hoped: float) -> None:
    found = searched(hoped, soon(max_boxes=max_boxes))
    assert found.proven
    assert 2.0 <= found.slack <= 10.0
    assert found.boxes <= max(4 * max_boxes, 4)


def test_more_boxes_make_a_better_proof() -> None:
    slacks = [searched(2.0, soon(max_boxes=n)).slack for n in (0, 10, 100, 1000)]
    assert slacks == sorted(slacks, reverse=True)
    assert slacks[0] > slacks[-1]


def test_an_end_in_time_leaves_a_poor_proof() -> None:
    found = searched(0.5, soon(-1.0))
    assert found.proven
    assert found.slack >= 2.0
    assert found.boxes == 1


@pytest.mark.parametrize("radius", [0.1, 0.5, 0.9])
def test_a_hole_of_the_set_is_left_out(radius: float) -> None:
    outside, value = ring(radius)
    true = 2 - radius**2
    found = proven_floor(bowl_bounds, outside, value, SQUARE, true * 1.01, soon())
    assert found.proven
    assert found.slack == true * 1.01
    assert not found.points.size
    found = proven_floor(bowl_bounds, outside, value, SQUARE, 0.1, soon())
    assert found.proven
    assert true <= found.slack <= BEYOND * true
    assert (((found.points - CENTER) ** 2).sum(axis=0) >= radius**2).all()


def test_points_outside_of_the_set_are_no_counterexamples() -> None:
    # The boxes of the hole cannot be left out, so they are cut till the limit.
    _, value = ring(0.5)
    found = proven_floor(bowl_bounds, nothing, value, SQUARE, 0.1, soon(max_boxes=2000))
    assert (((found.points - CENTER) ** 2).sum(axis=0) >= 0.25).all()
    assert found.slack >= 2.0  # As of the boxes that are left.


def test_a_set_without_points_has_any_floor() -> None:
    def all_outside(lower: Array, _: Array) -> Mask:
        return np.ones(lower.shape[1], dtype=np.bool_)

    found = proven_floor(bowl_bounds, all_outside, bowl, SQUARE, 0.1, soon())
    assert found.proven
    assert (found.slack, found.boxes) == (0.1, 0)


@pytest.mark.parametrize("low", [np.nan, -np.inf])
@pytest.mark.parametrize("everywhere", [True, False])
@pytest.mark.parametrize("hoped", [0.1, 3.0])
def test_without_bounds_nothing_is_proven(
    low: float, everywhere: bool, hoped: float
) -> None:
    def bounds(lower: Array, upper: Array) -> Bounds:
        found = bowl_bounds(lower, upper)
        at = ((lower <= 0.7) & (upper >= 0.7)).all(axis=0) | everywhere
        found.low[at] = low
        return found

    found = proven_floor(bounds, nothing, bowl, SQUARE, hoped, soon(max_boxes=500))
    assert not found.proven
    assert found.slack == np.inf


def test_boxes_that_cannot_be_cut_end_the_search() -> None:
    def flat(lower: Array, upper: Array) -> Bounds:
        return Bounds(np.full(lower.shape[1], -1.5), np.zeros_like(upper))

    def high(points: Array) -> Array:
        return np.zeros(points.shape[1])

    found = proven_floor(flat, nothing, high, SQUARE, 0.1, soon(60.0))
    assert found.proven
    assert found.slack == 1.5
    assert found.boxes < 10


def test_a_search_of_no_use_ends_after_a_few_boxes_with_a_floor() -> None:
    # A narrow valley: nothing shows where the least value is.
    def tilted(points: Array) -> Array:
        return np.asarray(np.abs((SLOPE * points).sum(axis=0)) - 1)

    def bounds(lower: Array, upper: Array) -> Bounds:
        spread = SLOPE * (upper - lower)
        return Bounds(tilted((lower + upper) / 2) - 60 * spread.sum(axis=0), spread)

    limits = soon(30.0, useless=0.5)
    found = proven_floor(bounds, nothing, tilted, SQUARE, 0.1, limits)
    assert found.slack >= 1.0
    assert found.proven
    assert FEW < found.boxes <= FEW + 3 * CHUNK


def test_starts_of_many_boxes_are_all_searched() -> None:
    # More than one chunk; the least value is in the last box.
    edges = np.linspace(-3.0, 0.3, 2 * CHUNK + 7)
    lower = np.vstack([edges[:-1], np.full(edges.size - 1, -0.2)])
    upper = np.vstack([edges[1:], np.full(edges.size - 1, 0.0)])
    for turn in (1, -1):
        start = (lower[:, ::turn], upper[:, ::turn])
        found = proven_floor(bowl_bounds, nothing, bowl, start, 0.1, soon())
        assert found.proven
        assert 2.0 <= found.slack <= BEYOND * 2.0
        late = proven_floor(bowl_bounds, nothing, bowl, start, 0.1, soon(-1.0))
        assert late.slack >= 2.0


def test_halves_cover_their_box_and_share_its_longest_spread() -> None:
    rng = np.random.default_rng(0)
    lower = rng.normal(size=(3, 50))
    upper = lower + rng.random((3, 50))
    spread = rng.random((3, 50))
    below, above = halved(lower, upper, spread)
    assert below.shape == above.shape == (3, 100)
    first, second = slice(0, 50), slice(50, 100)
    axis, each = spread.argmax(axis=0), np.arange(50)
    cut = above[axis, each]
    assert (cut == below[:, second][axis, each]).all()
    assert cut == pytest.approx((lower + upper)[axis, each] / 2)
    assert (below[:, first] == lower).all()
    assert (above[:, second] == upper).all()
    others = np.arange(3)[:, None] != axis
    assert (above[:, first] == upper)[others].all()
    assert (below[:, second] == lower)[others].all()
