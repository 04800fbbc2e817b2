"""Cells: extremes found by trying all ends, and bounds with rounding made visible."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.terminal_set.interval_arithmetic import taylor as cells
from swarmstart.terminal_set.interval_arithmetic.taylor import (
    Cells,
    TimedCells,
    added_up,
    squares,
)

COUNT = 12
VISIBLE = 2.0**-6
"""In place of the padding for rounding, so that each place if it is added counts."""

seeds = st.integers(0, 2**32 - 1)
sizes = st.integers(1, 4)


@pytest.fixture(scope="module", autouse=True)
def visible() -> object:
    patch = pytest.MonkeyPatch()
    patch.setattr(cells, "PADDING", VISIBLE)
    yield
    patch.undo()


def boxes(rng: np.random.Generator, nx: int) -> tuple[Array, Array]:
    """Boxes of (rho, w), w on a face of the cube, some with 0 inside, (1 + nx, m)."""
    lower = rng.uniform(-1, 1, (1 + nx, COUNT))
    upper = np.minimum(lower + rng.uniform(0, 0.8, (1 + nx, COUNT)), 1.0)
    face, each = 1 + rng.integers(nx, size=COUNT), np.arange(COUNT)
    lower[face, each] = upper[face, each] = rng.choice([-1.0, 1.0], COUNT)
    lower[0] = rng.uniform(0.05, 3, COUNT)
    upper[0] = lower[0] + rng.random(COUNT)
    return lower, upper


def directions(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Return the least and largest entries of w / |w|: at ends, or where w_j is 0."""
    least, largest = np.empty_like(lower), np.empty_like(lower)
    for k in range(lower.shape[1]):
        ends = [
            {low, high} | ({0.0} if low < 0 < high else set())
            for low, high in zip(lower[:, k], upper[:, k], strict=True)
        ]
        u = np.array([np.array(w) / np.linalg.norm(w) for w in product(*ends)])
        least[:, k], largest[:, k] = u.min(axis=0), u.max(axis=0)
    return least, largest


@settings(deadline=None, max_examples=25)
@given(seed=seeds, nx=sizes)
def test_box_around_a_cell_is_the_smallest_but_for_rounding(seed: int, nx: int) -> None:
    lower, upper = boxes(np.random.default_rng(seed), nx)
    found = Cells(lower, upper)
    low, high = directions(lower[1:], upper[1:])
    low, high = low - VISIBLE * np.abs(low), high + VISIBLE * np.abs(high)
    low = np.minimum(low * lower[0], low * upper[0])
    high = np.maximum(high * lower[0], high * upper[0])
    np.testing.assert_allclose(found.z_middle - found.z_reach, low, atol=1e-12)
    np.testing.assert_allclose(found.z_middle + found.z_reach, high, atol=1e-12)
    w = (lower[1:] + upper[1:]) / 2
    z = w / np.sqrt((w**2).sum(axis=0)) * (lower[0] + upper[0]) / 2
    np.testing.assert_allclose(found.z, z, atol=1e-14)
    reach = np.maximum(high - z, z - low) + VISIBLE * np.abs(z)
    np.testing.assert_allclose(found.reach, reach, atol=1e-12)
    half = (upper - lower) / 2 * (1 + VISIBLE)
    np.testing.assert_allclose(found.half, half, atol=1e-15)


@settings(deadline=None, max_examples=10)
@given(seed=seeds, nx=sizes)
def test_directions_of_a_cell_are_the_cell_of_radius_one(seed: int, nx: int) -> None:
    lower, upper = boxes(np.random.default_rng(seed), nx)
    found = Cells(lower, upper).directions
    lower[0] = upper[0] = 1.0
    expected = Cells(lower, upper)
    for name in ("z", "reach", "z_middle", "z_reach", "half"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def linear_bound(
    lower: Array, upper: Array, g: Array
) -> tuple[float, tuple[float, Array]]:
    """Return an upper bound of g'(x - z) in one cell, and the slopes; the head's."""
    w, half = (lower[1:] + upper[1:]) / 2, (upper - lower)[1:] / 2 * (1 + VISIBLE)
    inside = (lower[1:] <= 0) & (upper[1:] >= 0)
    least = np.where(inside, 0, np.minimum(np.abs(lower[1:]), np.abs(upper[1:])))
    nearest = np.linalg.norm(least) * (1 - VISIBLE)
    u = w / np.linalg.norm(w)
    radial = float(g @ u)
    beside = np.abs(g - radial * u)
    sine = np.linalg.norm(half) / nearest
    cosine = 1.0
    if radial <= 0:  # As far from the middle direction as it gets.
        cosine = (np.sqrt(1 - sine**2) if sine < 1 else -1) - VISIBLE
    sup = radial * cosine + (beside * half).sum() / nearest
    rho = upper[0] if sup > 0 else lower[0]
    bound = rho * sup - radial * (lower[0] + upper[0]) / 2
    bound += VISIBLE * rho * np.abs(g).sum()
    return bound, (abs(radial), beside * rho / nearest)


@settings(deadline=None, max_examples=25)
@given(seed=seeds, nx=sizes)
def test_linear_function_is_bounded_by_its_parts_along_and_beside(
    seed: int, nx: int
) -> None:
    rng = np.random.default_rng(seed)
    lower, upper = boxes(rng, nx)
    g = rng.normal(size=(nx, COUNT))
    pull = rng.random((nx, COUNT))
    found = Cells(lower, upper)
    terms, along = found.linear(g)
    spread = found.spread(along, pull)
    for k in range(COUNT):
        bound, (radial, beside) = linear_bound(lower[:, k], upper[:, k], g[:, k])
        assert terms[:, k].sum() == pytest.approx(bound, rel=1e-9, abs=1e-9)
        np.testing.assert_allclose(along[:, k], [radial, *beside], rtol=1e-9)
        # The slopes of z along rho is the direction, along w it is rho / |w| at most.
        w = (lower[1:, k] + upper[1:, k]) / 2
        more = [pull[:, k] @ np.abs(w) / np.linalg.norm(w)]
        inside = (lower[1:, k] <= 0) & (upper[1:, k] >= 0)
        ends = np.minimum(np.abs(lower[1:, k]), np.abs(upper[1:, k]))
        nearest = np.linalg.norm(np.where(inside, 0, ends)) * (1 - VISIBLE)
        more += [*(pull[:, k] * upper[0, k] / nearest)]
        expected = found.half[:, k] * (along[:, k] + more)
        np.testing.assert_allclose(spread[:, k], expected, rtol=1e-9)


def test_cell_that_sees_all_directions_reaches_everywhere() -> None:
    """A box with w = 0 in it: no entry of w / |w| is bounded but by one."""
    lower, upper = np.array([[0.5], [-1.0], [-1.0]]), np.array([[2.0], [1.0], [1.0]])
    w = np.array([[0.0], [0.25]])
    lower[1:] += w
    found = Cells(lower, upper)
    most = 2 * (1 + VISIBLE)
    np.testing.assert_allclose(found.z_middle + found.z_reach, most)
    np.testing.assert_allclose(found.z_middle - found.z_reach, -most)


@settings(deadline=None, max_examples=10)
@given(seed=seeds, nx=sizes)
def test_timed_cell_has_the_time_below_its_state(seed: int, nx: int) -> None:
    rng = np.random.default_rng(seed)
    lower, upper = boxes(rng, nx)
    still, timed = Cells(lower, upper), TimedCells(lower, upper, (0.5, 0.75))
    half = 0.125 * (1 + VISIBLE) + VISIBLE * 0.625
    for name, below in (
        ("z", 0.625), ("reach", half), ("z_middle", 0.625), ("z_reach", half)
    ):  # fmt: skip
        rows = getattr(timed, name)
        np.testing.assert_array_equal(rows[:-1], getattr(still, name))
        np.testing.assert_allclose(rows[-1], below, rtol=1e-15)
    g, pull = rng.normal(size=(1 + nx, COUNT)), rng.random((1 + nx, COUNT))
    terms, along = timed.linear(g)
    expected, slopes = still.linear(g[:-1])
    np.testing.assert_array_equal(terms[:-1], expected)
    np.testing.assert_allclose(terms[-1], half * np.abs(g[-1]), rtol=1e-15)
    np.testing.assert_array_equal(along, slopes)
    np.testing.assert_array_equal(
        timed.spread(along, pull), still.spread(slopes, pull[:-1])
    )


@given(ends=st.lists(st.tuples(st.floats(-9, 9), st.floats(0, 9)), min_size=1))
def test_squares_between_two_ends(ends: list[tuple[float, float]]) -> None:
    lower = np.array([low for low, _ in ends])
    upper = np.array([low + width for low, width in ends])
    least, most = squares(lower, upper)
    points = lower + np.linspace(0, 1, 11)[:, None] * (upper - lower)
    assert (points**2 <= most * (1 + 1e-12)).all()
    assert (points**2 >= least * (1 - 1e-12)).all()
    np.testing.assert_array_equal(most, np.maximum(lower**2, upper**2))
    nearest = np.clip(0.0, lower, upper)
    np.testing.assert_array_equal(least, nearest**2)


def test_sum_is_rounded_up_by_the_sizes_of_what_is_added() -> None:
    start, steps = np.array([1.0, -2.0]), np.array([[0.5, 4.0], [-0.25, -1.0]])
    expected = [1.25 + VISIBLE * 1.75, 1.0 + VISIBLE * 7.0]
    np.testing.assert_allclose(added_up(start, steps), expected, rtol=1e-15)
