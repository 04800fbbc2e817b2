"""Bounds of the change on boxes: exact where the motion is quadratic, never below."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import product
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.terminal_set import Change
from swarmstart.terminal_set.interval_arithmetic.intervals import (
    UnknownIntervalOperationError,
)
from swarmstart.terminal_set.interval_arithmetic.smoothness import NotSmoothError
from swarmstart.terminal_set.proving import enclosure
from swarmstart.terminal_set.proving.enclosure import (
    DecreaseBounds,
    _Rays,
    beside_diagonal,
    defect,
    quadratic_bound,
    undecided,
)

BOXES = 12
VISIBLE = 2.0**-6
seeds = st.integers(0, 2**32 - 1)
EPS = float(np.finfo(float).eps)


def directions(rng: np.random.Generator, nx: int, width: float) -> tuple[Array, Array]:
    """Boxes of w on a face of the cube, (nx, m)."""
    lower = rng.uniform(-1, 1, (nx, BOXES))
    upper = np.minimum(lower + width * rng.random((nx, BOXES)), 1.0)
    face, each = rng.integers(nx, size=BOXES), np.arange(BOXES)
    lower[face, each] = upper[face, each] = rng.choice([-1.0, 1.0], BOXES)
    return lower, upper


@settings(deadline=None, max_examples=25)
@given(seed=seeds, nx=st.integers(1, 4))
def test_quadratic_form_is_largest_at_a_corner_of_the_squares(
    seed: int, nx: int
) -> None:
    """A ratio of linear functions of the squares: all corners are tried."""
    rng = np.random.default_rng(seed)
    diagonal, beside = rng.normal(size=nx), float(rng.random())
    lower, upper = directions(rng, nx, 1.5)
    patch = pytest.MonkeyPatch()
    patch.setattr(enclosure, "PADDING", VISIBLE)
    found = quadratic_bound(diagonal, beside, lower, upper)
    patch.undo()
    for k in range(BOXES):
        ends = [
            (0.0 if low <= 0 <= high else min(low**2, high**2), max(low**2, high**2))
            for low, high in zip(lower[:, k], upper[:, k], strict=True)
        ]
        values = [
            float(diagonal @ s) / sum(s)
            for s in map(np.array, product(*ends))
            if any(s)
        ]
        padded = max(values) + VISIBLE * np.abs(diagonal).max() + beside
        assert found[k] == pytest.approx(padded, rel=1e-12)


def test_what_is_beside_the_diagonal_is_the_largest_sum_of_a_row() -> None:
    H = np.array([[2.0, -3, 1], [-3, -4, 0], [1, 0, 8]])
    radius = np.array([[0.5, 0, 1], [0, 0.25, 2], [1, 2, 4]])
    diagonal, beside = beside_diagonal(H, radius)
    assert diagonal.tolist() == [1, -2, 4]
    # Half of |-3| + 1 + 0.5 + 0 + 1, of 3 + 0.25 + 2, of 1 + 1 + 2 + 4.
    assert beside == 8 / 2
    wide = np.diag([1.0, 20.0, 3.0])
    assert beside_diagonal(H, wide)[1] == (3 + 20) / 2


def test_defect_has_room_for_the_rounding_of_the_products() -> None:
    T, P = np.array([[1.0, -2], [0, 1]]), np.array([[1.0, 0], [0, -3]])
    product_of_sizes = np.array([[1.0, 2], [2, 7]])
    exact = np.array([[1.0, -2], [-2, 1]])
    assert defect(T, P, exact) == 4 * 2 * EPS * 9
    off = exact + np.array([[0, 0.5], [-0.25, 0]])
    assert defect(T, P, off) == pytest.approx(0.5, abs=1e-12)
    assert defect(T, P, exact - off) > 1
    assert product_of_sizes.sum(axis=1).max() == 9


def quadratic(rng: np.random.Generator, nx: int, *, is_held: bool) -> Change:
    """A motion A e + (e'D_i e)_i / 2, with P and a margin by chance."""
    e = ca.SX.sym("e", nx)
    bends = [ca.bilin(ca.DM(rng.normal(size=(nx, nx))), e, e) for _ in range(nx)]
    A, L, Q = (rng.normal(size=(nx, nx)) for _ in range(3))
    moved = ca.DM(A) @ e + ca.vertcat(*bends) / 2
    return Change(
        motion=ca.Function("motion", [e], [moved]),
        P=L @ L.T + np.eye(nx),
        Q_m=Q @ Q.T,
        is_held=is_held,
    )


@pytest.mark.parametrize("is_held", [False, True])
@settings(deadline=None, max_examples=10)
@given(seed=seeds)
def test_coordinates_make_p_the_identity_and_the_quadratic_part_diagonal(
    is_held: bool, seed: int
) -> None:
    change = quadratic(np.random.default_rng(seed), 3, is_held=is_held)
    bounds = DecreaseBounds(change)
    e = ca.SX.sym("e", 3)
    hessian = ca.Function("h", [e], [ca.hessian(change.function(e), e)[0]])
    T = bounds.T
    H = T.T @ np.array(hessian(0)) @ T
    np.testing.assert_allclose(T.T @ change.P @ T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(H, np.diag(np.diag(H)), atol=1e-12 * np.abs(H).max())
    assert np.abs(T.T @ change.P @ T - np.eye(3)).max() < bounds.defect < 1e-9


@pytest.mark.parametrize("is_held", [False, True])
@settings(deadline=None, max_examples=10)
@given(seed=seeds)
def test_bound_about_the_centre_is_reached_by_a_quadratic_motion(
    is_held: bool, seed: int
) -> None:
    """One direction, radii up to some: c / rho^2 is a polynomial of second degree."""
    rng = np.random.default_rng(seed)
    change = quadratic(rng, 3, is_held=is_held)
    bounds = DecreaseBounds(change)
    w, _ = directions(rng, 3, 0.0)
    least, most = rng.random(BOXES), 1 + rng.random(BOXES)
    lower, upper = np.vstack([least, w]), np.vstack([most, w])
    quadratic_part, remainder = bounds._about_centre(lower, upper)
    u = w / np.linalg.norm(w, axis=0)

    def per_square(rho: Array) -> Array:
        values = change.function.map(BOXES)(bounds.T @ (rho * u))
        return np.array(values).ravel() / rho**2

    # Of its coefficients the first is u'Mu; the others by differences.
    tiny = np.full(BOXES, 1e-3)
    values = np.array([per_square(k * tiny) for k in (1, 2, 3)])
    d = (values[0] - 2 * values[1] + values[2]) / (2 * 1e-6)
    b = (values[1] - values[0]) / 1e-3 - 3e-3 * d
    at_zero = values[0] - 1e-3 * b - 1e-6 * d
    size = np.abs(values).max() + np.abs(b).max()
    np.testing.assert_allclose(quadratic_part, at_zero, atol=1e-8 * size)
    rho = np.where(b > 0, most, least)
    expected = rho * b + most**2 * d
    np.testing.assert_allclose(remainder, expected, rtol=1e-5, atol=1e-6 * size)
    assert (quadratic_part + remainder >= per_square(most) - 1e-9 * size).all()


@pytest.mark.parametrize("P", [0.25, 4.0])
@pytest.mark.parametrize("TPT", [0.81, 1.21])
@pytest.mark.parametrize("slope", [0.1, 10.0])
def test_bounds_hold_in_coordinates_that_are_badly_rounded(
    slope: float, TPT: float, P: float
) -> None:
    """A held motion (k e + e^2) of one state, T'PT far from 1."""
    e, T = ca.SX.sym("e"), np.array([[np.sqrt(TPT / P)]])
    change = Change(
        motion=ca.Function("motion", [e], [slope * e + e**2]), P=np.array([[P]]),
        Q_m=np.zeros((1, 1)), is_held=True,
    )  # fmt: skip
    rays, at = _Rays(change, T), np.array([[0.0], [1.0]])
    _, (along,) = rays.slopes(at, at)
    # m'(0) = k T and m''(s) = 2 T^2; e'Pe of T itself is T'PT.
    assert (slope**2 - 1) * TPT <= along[0] < 1.5 * slope**2 - 0.5
    _, (_, d) = rays.bends(at, at)
    assert TPT**2 / P <= d[0] * (1 + 1e-12) < 2 * TPT**2 / P


@pytest.mark.parametrize("is_held", [False, True])
def test_nothing_is_shown_where_the_change_is_not_negative(is_held: bool) -> None:
    rng = np.random.default_rng(1)
    e = ca.SX.sym("e", 2)
    moved = 0.5 * e if is_held else -e
    moved = moved * (1 - 0.3 * ca.sumsqr(e)) + ca.vertcat(e[1] ** 2, 0) / 4
    change = Change(
        motion=ca.Function("motion", [e], [moved]), P=np.eye(2), Q_m=np.zeros((2, 2)),
        is_held=is_held,
    )  # fmt: skip
    bounds = DecreaseBounds(change)
    lower, upper = directions(rng, 2, 0.02)
    decided = 0
    for start in (0.0, 0.01, 0.5, 1.5, 2.0, 3.0):
        low = np.vstack([np.full(BOXES, start), lower])
        high = np.vstack([np.full(BOXES, start + 0.02), upper])
        left = bounds(low, high)
        w = (lower + upper) / 2
        z = (start + 0.01) * w / np.linalg.norm(w, axis=0)
        values = np.array(change.function.map(BOXES)(bounds.T @ z)).ravel()
        shown = ~(high.T[:, None] == left.upper.T[None]).all(axis=2).any(axis=1)
        assert not (shown & (values >= 0)).any()
        # And almost all of what is clearly negative is shown in boxes this small.
        clear = values < -0.2 * (start + 0.01) ** 2
        assert shown[clear].all()
        decided += int(shown.sum())
    assert 0 < decided < 6 * BOXES


def test_box_is_decided_by_either_bound_and_else_cut_where_it_spreads_most() -> None:
    """Five boxes: about the centre (2), then by the bound away from it (3)."""
    lower = np.array([[0.0, 0.0, 1.0, 1.0, 1.0], [-1, -1, -1, -1, -1.0]])
    upper = np.array([[0.5, 0.5, 2.0, 2.0, 2.0], [-0.5, -0.25, 0.5, 0.75, 1.0]])
    asked: list[tuple[Array, Array]] = []

    def bounded(low: Array, high: Array) -> tuple[Array, Array]:
        asked.append((low, high))
        return np.array([-1.0, 0.0]), np.array([[3.0, 4.0], [5.0, 6.0]])

    quadratic_part = np.array([-1.0, 0.5, -1.0, -1.0, 0.5])
    remainder = np.array([1.0, -0.25, 0.5, 2.0, np.nan])
    left = undecided(bounded, lower, upper, quadratic_part, remainder)
    ((low, high),) = asked
    np.testing.assert_array_equal(low, lower[:, [3, 4]])
    np.testing.assert_array_equal(high, upper[:, [3, 4]])
    np.testing.assert_array_equal(left.lower, lower[:, [0, 1, 4]])
    np.testing.assert_array_equal(left.upper, upper[:, [0, 1, 4]])
    # Near the centre the radius, once the quadratic part is negative; else directions.
    np.testing.assert_array_equal(left.spread, [[np.inf, 0, 4], [0.5, 0.75, 6]])
    only = undecided(bounded, lower[:, :2], upper[:, :2], np.ones(2), np.zeros(2))
    assert len(asked) == 1  # The bound away from the centre holds for rho > 0 only.
    assert only.lower.shape == (2, 2)
    none = undecided(bounded, lower, upper, -np.ones(5), np.zeros(5))
    assert none.lower.shape == (2, 0)


def change_of(make: Callable[[Any], ca.SX], *, is_held: bool) -> Change:
    """c of a motion of one state, with P = 1."""
    e = ca.SX.sym("e")
    motion = ca.Function("motion", [e], [make(e)])
    return Change(motion=motion, P=np.eye(1), Q_m=np.zeros((1, 1)), is_held=is_held)


def is_shown(change: Change, rho: tuple[float, float], *, side: float = 1.0) -> bool:
    """Return whether c < 0 is shown on one box; both ends of w are the side."""
    bounds = DecreaseBounds(change)
    sign = side * float(np.sign(bounds.T[0, 0]))  # T may turn the axis round.
    corners = (np.array([[end], [sign]]) for end in rho)
    return bool(bounds(*corners).lower.size == 0)


@pytest.mark.parametrize("is_held", [False, True])
def test_a_kink_is_never_passed_over(is_held: bool) -> None:
    """Up to e = 1 the motion is linear, from there on it grows; its formula of the
    second derivative is 0 on both sides.
    """
    start = 0.5 if is_held else -1.0
    change = change_of(lambda e: start * e + 3 * ca.fmax(e - 1, 0), is_held=is_held)
    edge = 1.2 if is_held else 1.5  # There V does not change any more.
    assert is_shown(change, (0.0, 0.99))
    assert not is_shown(change, (0.0, 2.0))
    assert not is_shown(change, (0.0, 1.01))  # It is to be cut first.
    for low, high in ((0.98, 1.02), (1.05, edge - 0.01)):
        assert is_shown(change, (low, high))
    assert not is_shown(change, (edge - 0.01, edge + 1e-6))


def test_a_box_with_a_kink_about_the_centre_is_cut_along_its_radius() -> None:
    change = change_of(lambda e: -e + 3 * ca.fmax(e - 1, 0), is_held=False)
    bounds = DecreaseBounds(change)
    sign = float(np.sign(bounds.T[0, 0]))
    left = bounds(np.array([[0.0], [sign]]), np.array([[1.4], [sign]]))
    assert left.spread[0, 0] == np.inf


@pytest.mark.parametrize("kink", [0.0, 0.01])
def test_a_cut_is_never_passed_over(kink: float) -> None:
    """With e > 0 behind it the motion points away; its derivatives do not tell."""

    def motion(e: ca.SX) -> Any:
        return -e + 2 * (ca.atan2(1e-3 + 0 * e, 1) - ca.atan2(1 - e, -1) + 0.75 * np.pi)

    f = ca.Function("f", [e := ca.SX.sym("e")], [motion(e)])
    centred = change_of(lambda e: f(e) - float(f(0)) - kink * ca.fabs(e), is_held=False)
    assert float(centred.function(0.9)) < 0 < float(centred.function(1.1))
    assert is_shown(centred, (0.0, 0.5))
    for rho in ((0.0, 1.1), (0.5, 1.0), (0.9, 1.01), (0.9999, 1.0001)):
        assert not is_shown(centred, rho)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda e: -e + ca.atan2(e, e), "atan2 of motion has its cut"),
        (lambda e: -e + e**1.5, "pow of motion is at the edge of its smooth domain"),
        (lambda e: -e + e**2.5, "pow of motion is at the edge of its smooth domain"),
        (lambda e: -e + (-e) ** 1.5, "pow of motion is at the edge of its smooth"),
    ],
)
def test_a_reference_without_second_derivatives_is_refused_with_the_reason(
    make: Callable[[Any], ca.SX], message: str
) -> None:
    with pytest.raises(NotSmoothError, match=message):
        DecreaseBounds(change_of(make, is_held=False))


def test_one_state_without_second_derivatives_is_enough_to_be_refused() -> None:
    e = ca.SX.sym("e", 2)
    change = Change(
        motion=ca.Function("motion", [e], [ca.vertcat(-e[0], e[1] ** 1.5 - e[1])]),
        P=np.eye(2), Q_m=np.zeros((2, 2)), is_held=False,
    )  # fmt: skip
    with pytest.raises(NotSmoothError, match="pow of motion is at the edge"):
        DecreaseBounds(change)


@pytest.mark.parametrize(
    ("make", "is_held", "falls"),
    [
        (lambda e: -e + 0.9 * ca.fabs(e), False, True),  # c = 2 e^2 (-1 +- 0.9)
        (lambda e: -e + 1.1 * ca.fabs(e), False, False),
        (lambda e: 0.4 * e + 0.5 * ca.fabs(e), True, True),  # (0.4 +- 0.5)^2 - 1
        (lambda e: 0.4 * e + 0.7 * ca.fabs(e), True, False),
        (lambda e: 0.4 * e - 0.7 * ca.fmax(-e, 0), True, False),
    ],
)
def test_a_kink_at_the_reference_is_bounded_by_the_slopes_of_its_sides(
    make: Callable[[Any], ca.SX], is_held: bool, falls: bool
) -> None:
    """At every radius alike; the sides are not told apart."""
    change = change_of(make, is_held=is_held)
    for radius in (1e-9, 1.0, 1e6):
        for side in (-1.0, 1.0):
            assert is_shown(change, (0.0, radius), side=side) == falls


def test_sum_of_both_parts_beside_a_kink_is_never_below_the_whole() -> None:
    """This is so for real numbers, though the rest is a rounded difference."""
    rng = np.random.default_rng(0)
    exponents = rng.uniform(-8, 8, (2, 400))
    whole, centre = rng.choice([-1.0, 1.0], (2, 400)) * 10.0**exponents
    centre[:100] = -whole[:100] * (1 + 1e-14)
    centre[100:200] = whole[100:200] * (1 + 1e-14)

    def slopes(lower: Array, upper: Array) -> tuple[None, tuple[Array]]:
        return None, ((centre if (upper[0] == 0.0).all() else whole).copy(),)

    def bends(*_: Array) -> tuple[None, tuple[Array, Array]]:
        return None, (np.zeros(400), np.zeros(400))

    def kinks(*_: Array) -> tuple[Array, Array]:
        return np.ones(400, bool), np.zeros(400, bool)

    bounds = DecreaseBounds(change_of(lambda e: -e + ca.fabs(e) / 2, is_held=False))
    bounds._rays = SimpleNamespace(slopes=slopes, bends=bends, kinks=kinks)  # type: ignore[assignment]
    lower, upper = (np.array([[rho] * 400, [1.0] * 400]) for rho in (0.0, 0.5))
    quadratic, rest = bounds._about_centre(lower, upper)
    for parts, exact in zip(zip(quadratic, rest, strict=True), whole, strict=True):
        total = sum(map(Fraction, map(float, parts)))
        assert Fraction(float(exact)) <= total
        reserve = 1e-11 * sum(map(abs, map(float, parts)))
        assert float(total - Fraction(float(exact))) <= reserve


def test_a_margin_counts_beside_the_slopes() -> None:
    e = ca.SX.sym("e")
    motion = ca.Function("motion", [e], [-e + 0.5 * ca.fabs(e)])
    for margin, falls in ((0.999, True), (1.001, False)):
        change = Change(
            motion=motion, P=np.eye(1), Q_m=margin * np.eye(1), is_held=False
        )
        assert is_shown(change, (0.0, 1.0)) == falls


def test_of_a_kink_at_the_centre_what_is_to_be_cut_is_told() -> None:
    """-e + 2 e |e|: at the centre it falls, so it is the radius that is too large."""
    change = change_of(lambda e: -e + 2 * e * ca.fabs(e), is_held=False)
    bounds = DecreaseBounds(change)
    left = bounds(np.array([[0.0], [1.0]]), np.array([[0.6], [1.0]]))
    assert left.spread[0, 0] == np.inf
    assert is_shown(change, (0.0, 0.15)) and is_shown(change, (0.15, 0.4))
    assert not is_shown(change, (0.15, 0.500001))
    steep = DecreaseBounds(change_of(lambda e: e * ca.fabs(e) + e, is_held=False))
    left = steep(np.array([[0.0], [0.9]]), np.array([[0.6], [1.0]]))
    assert left.spread[0, 0] == 0.0 and left.spread[1, 0] > 0


def test_a_motion_that_jumps_is_refused() -> None:
    change = change_of(lambda e: -e + ca.if_else(e > 1, e, 0), is_held=False)
    with pytest.raises(UnknownIntervalOperationError, match="lt, which jumps"):
        DecreaseBounds(change)
