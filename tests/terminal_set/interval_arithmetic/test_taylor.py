"""Bounds on cells of a ball hold at the points of the cells."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations, product
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.terminal_set.interval_arithmetic import taylor
from swarmstart.terminal_set.interval_arithmetic.taylor import Cells, TaylorForm

NX, BOXES, POINTS = 3, 40, 60

seeds = st.integers(0, 2**32 - 1)
widths = st.floats(1e-6, 1.0)


def boxes(rng: np.random.Generator, width: float) -> tuple[Array, Array]:
    """Boxes of (rho, w), w on a face of the cube, (1 + nx, m)."""
    lower = rng.uniform(-1, 1, (1 + NX, BOXES))
    upper = np.minimum(lower + width * rng.random((1 + NX, BOXES)), 1.0)
    face, each = 1 + rng.integers(NX, size=BOXES), np.arange(BOXES)
    lower[face, each] = upper[face, each] = rng.choice([-1.0, 1.0], BOXES)
    lower[0] = rng.uniform(0.05, 3, BOXES)
    upper[0] = lower[0] + width * rng.random(BOXES)
    return lower, upper


def points_in(lower: Array, upper: Array, rng: np.random.Generator) -> Array:
    """Points z of each cell, corners among them, (nx, m, points)."""
    share = rng.random((1 + NX, BOXES, POINTS))
    share[..., : POINTS // 2] = share[..., : POINTS // 2].round()
    v = lower[..., None] + share * (upper - lower)[..., None]
    return np.asarray(v[0] * v[1:] / np.linalg.norm(v[1:], axis=0))


def example() -> ca.Function:
    e = ca.SX.sym("e", NX)
    c = (
        ca.sin(e[0]) * e[1] ** 2
        - 3 * e[2] ** 2
        + ca.exp(0.3 * e[1]) * e[0]
        + ca.cos(e[2] + e[0]) / (4 + ca.sin(e[1]))
    )
    return ca.Function("c", [e], [c])


@settings(deadline=None, max_examples=40)
@given(seed=seeds, width=widths)
def test_a_cell_holds_its_points(seed: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    lower, upper = boxes(rng, width)
    cells, z = Cells(lower, upper), points_in(lower, upper, rng)
    assert np.all(np.abs(z - cells.z[..., None]) <= cells.reach[..., None] * (1 + 1e-9))
    from_middle = np.abs(z - cells.z_middle[..., None])
    assert np.all(from_middle <= cells.z_reach[..., None] * (1 + 1e-9))


@settings(deadline=None, max_examples=40)
@given(seed=seeds, width=widths)
def test_a_linear_function_stays_below_its_bound(seed: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    lower, upper = boxes(rng, width)
    cells, z = Cells(lower, upper), points_in(lower, upper, rng)
    g = rng.normal(size=(NX, BOXES)) * 10.0 ** rng.uniform(-3, 3, BOXES)
    terms, _ = cells.linear(g)
    found = np.einsum("im,imk->mk", g, z - cells.z[..., None])
    assert np.all(found <= terms.sum(axis=0)[:, None] + 1e-12 * np.abs(g).sum())


@settings(deadline=None, max_examples=40)
@given(seed=seeds, width=widths)
def test_a_function_stays_below_its_bound(seed: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    T = rng.normal(size=(NX, NX))
    c = example()
    lower, upper = boxes(rng, width)
    bound, spread = TaylorForm(c, T)(Cells(lower, upper))
    z = points_in(lower, upper, rng)
    e = np.einsum("ij,jmk->imk", T, z).reshape(NX, -1)
    found = np.array(c.map(e.shape[1])(e)).reshape(BOXES, POINTS)
    assert np.all(found <= bound[:, None] + 1e-12 * (1 + np.abs(bound[:, None])))
    assert spread.shape == lower.shape and np.all(spread >= 0)


def with_kinks() -> ca.Function:
    """Kinks through the cells: without a look at them the second order is too small."""
    e = ca.SX.sym("e", NX)
    c = (
        -4 * ca.fabs(e[0] - 0.3)
        + 5 * ca.fmax(e[1], 0.2 * e[2])
        + ca.fmin(e[2] ** 2, ca.exp(e[0]) - 1)
        - e[0] * ca.fmax(0.5, ca.sin(e[1]))
    )
    return ca.Function("c", [e], [c])


@settings(deadline=None, max_examples=40)
@given(seed=seeds, width=widths)
def test_a_function_with_kinks_stays_below_its_bound(seed: int, width: float) -> None:
    rng = np.random.default_rng(seed)
    T = rng.normal(size=(NX, NX))
    c = with_kinks()
    lower, upper = boxes(rng, width)
    bound, spread = TaylorForm(c, T)(Cells(lower, upper))
    z = points_in(lower, upper, rng)
    e = np.einsum("ij,jmk->imk", T, z).reshape(NX, -1)
    found = np.array(c.map(e.shape[1])(e)).reshape(BOXES, POINTS)
    assert np.all(np.isfinite(bound))
    assert np.all(found <= bound[:, None] + 1e-12 * (1 + np.abs(bound[:, None])))
    assert spread.shape == lower.shape and np.all(spread >= 0)


def test_across_a_kink_the_bound_is_that_of_the_slopes() -> None:
    """|e0| over cells about e0 = 0: half the width of the slopes' hull, no more."""
    e = ca.SX.sym("e", 2)
    form = TaylorForm(ca.Function("c", [e], [ca.fabs(e[0])]), np.eye(2))
    for half in (0.1, 0.01):
        lower, upper = np.array([[1.0], [-half], [1.0]]), np.array([[1.0], [half], [1]])
        bound, _ = form(Cells(lower, upper))
        assert half * 0.98 <= bound[0] <= 1.05 * half


def test_a_cell_with_a_cut_is_not_bounded() -> None:
    """And its widest side is to be cut."""
    e = ca.SX.sym("e", 2)
    form = TaylorForm(ca.Function("c", [e], [ca.atan2(e[0], -e[1])]), np.eye(2))
    lower, upper = np.array([[1.0], [-0.1], [1.0]]), np.array([[1.1], [0.2], [1.0]])
    bound, spread = form(Cells(lower, upper))
    assert bound[0] == np.inf and spread[:, 0].argmax() == 1
    lower[1] = 0.01
    beside, _ = form(Cells(lower, upper))
    assert np.pi - 0.02 < beside[0] < np.pi + 0.02


def test_the_series_about_a_point_is_not_used_across_a_kink() -> None:
    e = ca.SX.sym("e", 2)
    form = TaylorForm(ca.Function("c", [e], [ca.fmax(e[0], 0.5)]), np.eye(2))
    lower, upper = np.array([[0.1], [1.0], [-0.1]]), np.array([[0.4], [1.0], [0.1]])
    d = np.ones((2, 1))
    assert form.beyond_second_order(Cells(lower, upper), d)[0] < 1e-9
    upper[0] = 0.6
    assert form.beyond_second_order(Cells(lower, upper), d)[0] == np.inf


def test_a_bound_comes_near_the_supremum_to_third_order() -> None:
    """Half the width, an eighth of the error; of a convex function, at a corner."""
    e = ca.SX.sym("e", 2)
    c = ca.Function("c", [e], [ca.exp(e[0]) + ca.exp(e[1])])
    form = TaylorForm(c, np.eye(2))
    w = np.array([[1.0], [0.5]])
    errors = []
    for half in (0.08, 0.04, 0.02):
        lower, upper = np.vstack([[[1.0]], w]), np.vstack([[[1.0 + 2 * half]], w])
        bound, _ = form(Cells(lower, upper))
        outer = upper[0, 0] * w[:, 0] / np.linalg.norm(w)
        errors.append(bound[0] - float(c(outer)))
    assert errors[-1] > 0
    assert errors[0] / errors[1] > 6 and errors[1] / errors[2] > 6


def test_where_nothing_is_known_the_widest_side_is_to_be_cut() -> None:
    e = ca.SX.sym("e", 2)
    c = ca.Function("c", [e], [1 / e[0] + e[1]])
    lower, upper = np.array([[0.5], [-0.4], [1.0]]), np.array([[0.6], [0.5], [1.0]])
    bound, spread = TaylorForm(c, np.eye(2))(Cells(lower, upper))
    assert not bound[0] < np.inf
    assert spread[:, 0].argmax() == 1


DIFFERENT = [(i, j) for i in range(NX) for j in range(i, NX)]
TRIPLES = [(i, j, k) for i, j in DIFFERENT for k in range(j, NX)]


class Cubic:
    """c = g'e + e'He/2 + D[e, e, e]/6 by chance, with H and D symmetric.

    Attributes:
        function: e -> c(e).
        H: Hessian at 0.
        D: Third derivatives.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.g, H = rng.normal(size=NX), rng.normal(size=(NX, NX))
        D = rng.normal(size=(NX, NX, NX))
        self.H: Array = H + H.T
        orders = permutations(range(3))
        self.D: Array = np.sum([np.transpose(D, order) for order in orders], axis=0)
        e = ca.SX.sym("e", NX)
        c = ca.dot(ca.DM(self.g), e) + ca.bilin(ca.DM(self.H), e, e) / 2
        for i, j, k in product(range(NX), repeat=3):
            c += self.D[i, j, k] * e[i] * e[j] * e[k] / 6
        self.function = ca.Function("c", [e], [c])

    def bends(self, e: Array) -> Array:
        """Return Hessians at points, (n, n, m)."""
        moved: Array = np.einsum("ijk,km->ijm", self.D, e)
        return self.H[..., None] + moved

    def value_and_slope(self, e: Array) -> Array:
        """Return value and gradient, (1 + n, m)."""
        slope = self.g[:, None] + np.einsum("ij,jm->im", self.H, e)
        slope += np.einsum("ijk,jm,km->im", self.D, e, e) / 2
        values: Array = np.array(self.function.map(e.shape[1])(e))
        return np.vstack([values, slope])

    def hessian(self, e: Array) -> Array:
        """Return the different entries of the Hessian."""
        return np.array([self.bends(e)[pair] for pair in DIFFERENT])

    def third(self, e: Array) -> Array:
        """Return the different third derivatives."""
        return np.array([np.full(e.shape[1], self.D[triple]) for triple in TRIPLES])


def known_within(
    exact: Callable[[Array], Array], share: float
) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Return an interval evaluation whose intervals reach a share to each side."""

    def evaluation(lower: Array, upper: Array) -> tuple[Array, Array]:
        value = exact((lower + upper) / 2)
        half = share * np.abs(value)
        return value - half, value + half

    return evaluation


def turned(D: Array, T: Array) -> Array:
    return np.asarray(np.einsum("ijk,ia,jb,kc->abc", D, T, T, T))


def bound_and_pull(
    c: Cubic, T: Array, cell: Cells, share: float
) -> tuple[float, Array, Array]:
    """Return the head's bound in one cell, its slopes along z, and how they differ.

    Args:
        c: The cubic.
        T: e = T z.
        cell: One cell.
        share: Half the width of all intervals; a quarter of it is padding.
    """
    z, d, size = cell.z[:, 0], cell.reach[:, 0], np.abs(T)
    value, *slopes = c.value_and_slope((T @ z)[:, None])[:, 0]
    slope = np.array(slopes)
    highest = slope + share * np.abs(slope)
    steps, along = cell.linear(T.T @ slope[:, None])
    bends = c.bends((T @ z)[:, None])[..., 0]
    largest = np.abs(bends) * (1 + share)
    wide = size.T @ (share * np.abs(bends) + share / 4 * largest) @ size
    # Slopes are unsure by their own intervals, and by the rounding of the point.
    unsure = size.T @ (share * np.abs(slope) + share / 4 * np.abs(highest))
    unsure += wide @ np.abs(z)
    moved = np.abs(highest) @ (share / 4 * size @ np.abs(z))
    M = T.T @ bends @ T
    entries = np.abs(M) + wide
    np.fill_diagonal(entries, np.maximum(np.diag(M) + np.diag(wide), 0))
    tensor = np.abs(c.D) * (share + share / 4 * (1 + share))
    third = np.einsum("ijk,j,k->i", np.abs(turned(c.D, T)), d, d)
    third += np.einsum("ijk,j,k->i", turned(tensor, size), d, d)
    bound = value + share * abs(value) + steps.sum() + unsure @ d + moved
    bound += d @ entries @ d / 2 + third @ d / 6
    return bound, along, (np.abs(M) + wide) @ d + third / 2


def widen(patch: pytest.MonkeyPatch, padding: float) -> None:
    """Make the padding of Taylor forms visible; cells and sums keep theirs."""
    own = taylor.PADDING

    def keeping(function: Callable[..., Any]) -> Callable[..., Any]:
        def called(*arguments: Any) -> Any:
            with pytest.MonkeyPatch.context() as kept:
                kept.setattr(taylor, "PADDING", own)
                return function(*arguments)

        return called

    patch.setattr(taylor, "PADDING", padding)
    patch.setattr(taylor, "added_up", keeping(taylor.added_up))
    patch.setattr(Cells, "linear", keeping(Cells.linear))


@settings(deadline=None, max_examples=15)
@given(seed=seeds)
@pytest.mark.parametrize("share", [0.0, 2.0**-5])
def test_bound_is_the_sum_of_its_terms(share: float, seed: int) -> None:
    """Of a cubic, one cell after the other; intervals and rounding visibly wide."""
    rng = np.random.default_rng(seed)
    c, T = Cubic(rng), rng.normal(size=(NX, NX))
    form = TaylorForm(c.function, np.eye(NX)).turned(T)
    lower, upper = boxes(rng, 0.7)
    cells = Cells(lower, upper)
    patch = pytest.MonkeyPatch()
    widen(patch, share / 4)
    if share:
        for name in ("value_and_slope", "hessian", "third"):
            exact = getattr(c, name)
            patch.setattr(form, f"_{name}", known_within(exact, share))
    bound, spread = form(cells)
    patch.undo()
    for m in range(BOXES):
        one = Cells(lower[:, [m]], upper[:, [m]])
        expected, along, pull = bound_and_pull(c, T, one, share)
        # A random T may lose nine digits.
        assert bound[m] == pytest.approx(expected, rel=1e-7, abs=1e-7)
        np.testing.assert_allclose(
            spread[:, m], one.spread(along, pull[:, None])[:, 0], rtol=1e-7
        )


def test_third_order_grows_with_the_cube_of_the_distance() -> None:
    """And is looked for in the whole box around a cell, with room for rounding."""
    rng = np.random.default_rng(3)
    c, T = Cubic(rng), rng.normal(size=(NX, NX))
    cells, d = Cells(*boxes(rng, 0.7)), rng.random((NX, BOXES))
    form = TaylorForm(c.function, T)
    asked: list[tuple[Array, Array]] = []

    def third(lower: Array, upper: Array) -> tuple[Array, Array]:
        asked.append((lower, upper))
        return c.third(lower), c.third(upper)

    patch = pytest.MonkeyPatch()
    patch.setattr(form, "_third", third)
    widen(patch, 2.0**-6)
    found = form.beyond_second_order(cells, d)
    patch.undo()
    sizes = np.abs(turned(c.D, T)) + turned(np.abs(c.D), np.abs(T)) * 2.0**-6
    expected = np.einsum("ijk,im,jm,km->m", sizes, d, d, d) / 6
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    ((lower, upper),) = asked
    reach = np.abs(T) @ cells.z_reach * (1 + 2.0**-6)
    np.testing.assert_allclose(lower, T @ cells.z_middle - reach, rtol=1e-12)
    np.testing.assert_allclose(upper, T @ cells.z_middle + reach, rtol=1e-12)


def test_where_one_slope_is_unknown_the_widest_side_is_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(4)
    cells, form = Cells(*boxes(rng, 0.7)), TaylorForm(example(), np.eye(NX))
    spread = np.ones((1 + NX, BOXES))
    spread[1, 3], spread[2, 5] = np.nan, np.inf
    monkeypatch.setattr(form, "_bounded", lambda _: (np.zeros(BOXES), spread))
    _, found = form(cells)
    for m in range(BOXES):
        expected = cells.half[:, m] if m in (3, 5) else np.ones(1 + NX)
        np.testing.assert_array_equal(found[:, m], expected)


def test_derivatives_over_boxes_are_turned_with_room_for_all_in_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(0)
    c, T = Cubic(rng), rng.normal(size=(NX, NX))
    form, size = TaylorForm(c.function, T), np.abs(T)
    lower, width = rng.normal(size=(NX, BOXES)), rng.random((NX, BOXES))
    middle, radius = form.hessians(lower, lower + width)
    at = c.bends(lower + width / 2)
    off = np.einsum("ijk,km->ijm", np.abs(c.D), width / 2)
    for m in range(BOXES):
        np.testing.assert_allclose(middle[m], T.T @ at[..., m] @ T, atol=1e-9)
        np.testing.assert_allclose(radius[m], size.T @ off[..., m] @ size, atol=1e-9)
    monkeypatch.setattr(form, "_third", known_within(c.third, 0.25))
    slopes = form.hessian_slopes(lower, lower + width)
    expected = np.abs(turned(c.D, T)) + turned(0.25 * np.abs(c.D), size)
    np.testing.assert_allclose(slopes, np.stack([expected[..., -1]] * BOXES), atol=1e-9)
