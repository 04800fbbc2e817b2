"""Jets: coefficients are those of Taylor's series, and balls hold what is in them."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import mpmath
import pytest

flint = pytest.importorskip("flint")

from flint import arb  # noqa: E402

from swarmstart.terminal_set.checker.jets import (  # noqa: E402
    OPERATIONS,
    RAY,
    RAY_AND_TIME,
    VALUES,
    Algebra,
    Jet,
    absolute,
    combination,
    square,
    squared,
    whole_power,
)

mp = mpmath.mp
EXACT: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "pow": mp.power,
    "fmin": min,
    "fmax": max,
    "neg": lambda a: -a,
    "sq": lambda a: a * a,
    "twice": lambda a: 2 * a,
    "inv": lambda a: 1 / a,
    "fabs": abs,
    "sqrt": mpmath.sqrt,
    "sin": mpmath.sin,
    "cos": mpmath.cos,
    "tan": mpmath.tan,
    "exp": mpmath.exp,
    "log": mpmath.log,
    "atan": mpmath.atan,
    "tanh": mpmath.tanh,
}
TWO = ("add", "sub", "mul", "div", "pow", "fmin", "fmax")
AT = ([0.75, -0.5, 0.25, 1.5, -2.0], [1.25, 2.0, -0.75, 0.5, 0.125])
"""Coefficients of 1, s, s^2, t, t s of two arguments."""


def polynomial(c: list[float], s: Any, t: Any) -> Any:
    return c[0] + c[1] * s + c[2] * s**2 + c[3] * t + c[4] * t * s


def jet(algebra: Algebra, c: list[float]) -> Jet:
    return Jet(algebra, [arb(value) for value in c[: algebra.monomials + 1]])


def near(found: arb, expected: Any) -> bool:
    """Return whether a ball is a number, up to rounding."""
    expected = float(expected)
    middle, radius = float(found.mid()), float(found.rad())
    size = 1 + abs(expected)
    return bool(max(abs(middle - expected), radius) < 1e-12 * size)


def test_every_operation_has_a_definition_here() -> None:
    assert set(OPERATIONS) == set(EXACT)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("name", EXACT)
def test_coefficients_are_those_of_the_series(name: str, sign: int) -> None:
    if sign < 0 and name in ("log", "sqrt", "pow"):
        return
    first = [sign * value for value in AT[0]]
    given = [first, AT[1]][: 2 if name in TWO else 1]

    def exact(s: Any, t: Any) -> Any:
        return EXACT[name](*(polynomial(c, s, t) for c in given))

    mp.dps = 40
    orders = {0: (0, 0), 1: (1, 0), 2: (2, 0), 3: (0, 1), 4: (1, 1)}
    for algebra in (VALUES, RAY, RAY_AND_TIME):
        found = OPERATIONS[name](*(jet(algebra, c) for c in given))
        for k in range(algebra.monomials + 1):
            if orders[k] == (0, 0):
                expected = exact(0, 0)
            else:
                expected = mp.diff(exact, (0, 0), orders[k])
            expected /= mp.factorial(orders[k][0])
            assert near(found.slope(k), expected), (name, k)
    slopes = Algebra(monomials=2)
    a, *rest = (slopes.variable(arb(c[0]), {1: arb(c[1]), 2: arb(c[3])}) for c in given)
    found = OPERATIONS[name](a, *rest)
    for k, order in ((1, (1, 0)), (2, (0, 1))):
        assert near(found.slope(k), mp.diff(exact, (0, 0), order))


@pytest.mark.parametrize("missing", [{1}, {2}, {3}, {1, 2}, {3, 4}, {2, 3, 4}])
@pytest.mark.parametrize("name", EXACT)
def test_missing_coefficients_are_zeros(name: str, missing: set[int]) -> None:
    given = [jet(RAY_AND_TIME, c) for c in AT[: 2 if name in TWO else 1]]
    kept = [list(one.coefficients) for one in given]
    for others in ([], kept[1:]):  # One sparse, or all.
        sparse, zeros = ([list(c) for c in kept] for _ in range(2))
        for k in missing:
            for number in range(1 + len(others)):
                sparse[number][k], zeros[number][k] = None, arb(0)
        found, expected = (
            OPERATIONS[name](*(Jet(RAY_AND_TIME, c) for c in of))
            for of in (sparse, zeros)
        )
        for k in range(RAY_AND_TIME.monomials + 1):
            assert near(found.slope(k), expected.slope(k).mid()), k


@pytest.mark.parametrize("exponent", [-4, -3, -2, -1, 0, 1, 2, 3, 4, 7, 0.5, -1.5, 2.5])
@pytest.mark.parametrize("base", [0.75, 1.5, -1.25])
def test_powers_with_constant_exponents(base: float, exponent: float) -> None:
    if base < 0 and exponent != int(exponent):
        return
    c = [base, 0.5, -0.25]
    found = OPERATIONS["pow"](jet(RAY, c), RAY.constant(exponent))
    mp.dps = 40
    series = mp.taylor(lambda s: mp.power(polynomial([*c, 0, 0], s, 0), exponent), 0, 2)
    for k in range(3):
        assert near(found.slope(k), mp.re(series[k])), k


def test_whole_powers_beyond_the_limit_are_those_of_logarithms() -> None:
    for exponent in (1022.0, 1023.0, 1024.0):
        (found,) = OPERATIONS["pow"](
            jet(VALUES, [1.001]), VALUES.constant(exponent)
        ).coefficients
        assert found is not None and found.overlaps(arb(1.001) ** int(exponent))
    # By multiplication a negative base is fine; by logarithms it is not.
    for exponent, is_known in ((1022.0, True), (1023.0, False), (-1022.0, True)):
        value = OPERATIONS["pow"](jet(VALUES, [-1.0]), VALUES.constant(exponent)).value
        assert value.is_finite() is is_known


def balls(low: float, high: float) -> arb:
    return arb(low).union(arb(high))


def ends(ball: arb) -> list[float]:
    return [float(ball.lower()), float(ball.upper())]


@pytest.mark.parametrize(
    ("low", "high", "squares", "sizes", "cubes"),
    [
        (-1.0, 2.0, [0, 4], [0, 2], [-1, 8]),
        (1.0, 2.0, [1, 4], [1, 2], [1, 8]),
        (-2.0, -1.0, [1, 4], [1, 2], [-8, -1]),
    ],
)
def test_even_and_odd_powers_go_by_their_ends(
    low: float,
    high: float,
    squares: list[float],
    sizes: list[float],
    cubes: list[float],
) -> None:
    ball = balls(low, high)
    for found, expected in (
        (square(ball), squares), (absolute(ball), sizes),
        (whole_power(ball, 2), squares), (whole_power(ball, 3), cubes),
        (whole_power(ball, 1), [low, high]), (whole_power(ball, 0), [1, 1]),
        (squared(Jet(VALUES, [ball])).value, squares),
    ):  # fmt: skip
        assert ends(found) == pytest.approx(expected, abs=1e-6)
        assert ends(found)[0] <= expected[0] and expected[1] <= ends(found)[1]
    if low > 0:
        assert ends(whole_power(ball, -2)) == pytest.approx([1 / 4, 1], abs=1e-6)
        assert ends(whole_power(ball, -3)) == pytest.approx([1 / 8, 1], abs=1e-6)


@pytest.mark.parametrize("name", EXACT)
def test_balls_hold_the_series_at_all_their_points(name: str) -> None:
    chance = random.Random(0)
    for width in (1e-6, 0.1, 0.6):
        wide = [[balls(value - width, value + width) for value in c[:3]] for c in AT][
            : 2 if name in TWO else 1
        ]
        found = OPERATIONS[name](*(Jet(RAY, list(c)) for c in wide))
        for _ in range(10):
            at = [[arb(chance.uniform(*ends(b))) for b in c] for c in wide]
            inside = OPERATIONS[name](*(Jet(RAY, list(c)) for c in at))
            for ball, point in zip(
                found.coefficients, inside.coefficients, strict=True
            ):
                assert ball is not None and point is not None
                assert not ball.is_finite() or ball.overlaps(point)


def test_modulus_over_its_kink_has_every_slope_between_and_no_second() -> None:
    kink = [balls(-1.0, 2.0), arb(1), arb(0.5)]
    found = OPERATIONS["fabs"](Jet(RAY, list(kink)))
    assert ends(found.value) == pytest.approx([0, 2], abs=1e-6)
    assert ends(found.slope(1)) == pytest.approx([-1, 1])
    assert not found.slope(2).is_finite()
    for low, high in ((-0.5, 0.25), (-0.25, 0.5), (0.0, 0.5), (-0.5, 0.0)):
        near = OPERATIONS["fabs"](Jet(RAY, [balls(low, high), arb(1), arb(0)]))
        assert ends(near.value) == pytest.approx([0, max(-low, high)], abs=1e-6)
        assert ends(near.slope(1)) == pytest.approx([-1, 1])
    (value, slope, second) = OPERATIONS["fabs"](
        Jet(RAY, [arb(0), arb(1), arb(0)])
    ).coefficients
    assert value is not None and slope is not None and second is not None
    assert ends(slope) == pytest.approx([-1, 1]) and not second.is_finite()
    slopes = Algebra(monomials=1)
    gradient = OPERATIONS["fabs"](slopes.variable(balls(-1.0, 2.0), {1: arb(3)}))
    assert ends(gradient.slope(1)) == pytest.approx([-3, 3])


@pytest.mark.parametrize(("name", "value"), [("fmax", [1, 3]), ("fmin", [0, 2])])
def test_larger_of_two_that_overlap_has_the_slopes_of_both(
    name: str, value: list[float]
) -> None:
    slopes = Algebra(monomials=2)
    a = slopes.variable(balls(0.0, 3.0), {1: arb(1), 2: arb(5)})
    b = slopes.variable(balls(1.0, 2.0), {1: arb(-2), 2: arb(7)})
    for found in (OPERATIONS[name](a, b), OPERATIONS[name](b, a)):
        assert ends(found.value) == pytest.approx(value, abs=1e-6)
        assert ends(found.slope(1)) == pytest.approx([-2, 1], abs=1e-6)
        assert ends(found.slope(2)) == pytest.approx([5, 7], abs=1e-6)
    curved = [Jet(RAY, [j.value, arb(1), arb(1)]) for j in (a, b)]
    assert not OPERATIONS[name](*curved).slope(1).is_finite()
    far = slopes.variable(arb(9), {1: arb(4)})
    chosen = far if name == "fmax" else a
    for found in (OPERATIONS[name](a, far), OPERATIONS[name](far, a)):
        assert [str(c) for c in map(found.slope, range(3))] == [
            str(chosen.slope(k)) for k in range(3)
        ]


def test_coefficients_that_are_exactly_zero_stay_so() -> None:
    slopes = Algebra(monomials=2)
    a = slopes.variable(arb(2), {1: arb(3)})
    b = slopes.variable(arb(5), {2: arb(7)})
    constant = slopes.constant(4.0)
    assert constant.coefficients[1:] == [None, None]
    assert [float(x.mid()) for x in map((a + b).slope, range(3))] == [7, 3, 7]
    assert [float(x.mid()) for x in map((a * b).slope, range(3))] == [10, 15, 14]
    assert [float(x.mid()) for x in map((a - b).slope, range(3))] == [-3, 3, -7]
    assert (a * constant).coefficients[2] is None
    assert (constant + constant).coefficients[1] is None
    assert a.scaled(3).coefficients[2] is None
    assert (-a).coefficients[2] is None and float((-a).slope(1).mid()) == -3
    assert OPERATIONS["sin"](a).coefficients[2] is None
    assert Jet(slopes, [None, None, None]).value == 0


def test_matrix_times_vector() -> None:
    jets = [jet(RAY, AT[0]), jet(RAY, AT[1]), RAY.constant(3)]
    rows = [[1.0, -2.0, 4.0], [0.5, 0.0, 1.0]]
    found = combination([[arb(entry) for entry in row] for row in rows], jets)
    constant = [3.0, 0.0, 0.0]
    for (a, b, c), result in zip(rows, found, strict=True):
        for k in range(3):
            expected = a * AT[0][k] + b * AT[1][k] + c * constant[k]
            assert near(result.slope(k), expected)
