"""The intervals of functions hold their values, in arithmetic of forty digits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import mpmath
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.terminal_set.interval_arithmetic.interval_kernel import hull, outward
from swarmstart.terminal_set.interval_arithmetic.intervals import interval_function

DIGITS = 40
EPS = float(np.finfo(float).eps)
PI = float(np.pi)

ONE: dict[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    "sin": (ca.sin, mpmath.sin),
    "cos": (ca.cos, mpmath.cos),
    "tan": (ca.tan, mpmath.tan),
    "exp": (ca.exp, mpmath.exp),
    "expm1": (ca.expm1, mpmath.expm1),
    "sinh": (ca.sinh, mpmath.sinh),
    "cosh": (ca.cosh, mpmath.cosh),
    "tanh": (ca.tanh, mpmath.tanh),
    "asinh": (ca.asinh, mpmath.asinh),
    "atan": (ca.atan, mpmath.atan),
    "erf": (ca.erf, mpmath.erf),
    "sqrt": (ca.sqrt, mpmath.sqrt),
    "log": (ca.log, mpmath.log),
    "log1p": (ca.log1p, mpmath.log1p),
    "asin": (ca.asin, mpmath.asin),
    "acos": (ca.acos, mpmath.acos),
    "acosh": (ca.acosh, mpmath.acosh),
    "atanh": (ca.atanh, mpmath.atanh),
    "power": (lambda x: x**1.5, lambda x: x ** mpmath.mpf(1.5)),
    "odd power": (lambda x: ca.power(x, 101), lambda x: x**101),
    "even power": (lambda x: ca.power(x, 102), lambda x: x**102),
    "negative power": (lambda x: ca.power(x, -101), lambda x: x**-101),
}
TWO: dict[str, tuple[Callable[[Any, Any], Any], Callable[[Any, Any], Any]]] = {
    "pow": (ca.power, lambda x, y: x**y),
    "atan2": (ca.atan2, mpmath.atan2),
    "hypot": (ca.hypot, mpmath.hypot),
}


def evaluated(name: str, low: Any, high: Any) -> tuple[Array, Array]:
    """Intervals of a function over boxes, (m,), from their corners, (n, m) or (m,)."""
    low, high = np.atleast_2d(low), np.atleast_2d(high)
    x = ca.SX.sym("x", len(low))
    made = ONE[name][0](x) if name in ONE else TWO[name][0](x[0], x[1])
    bottom, top = interval_function(ca.Function("f", [x], [made]))(low, high)
    return bottom[0], top[0]


def value_at(name: str, *point: float) -> Any:
    """The value in many digits; None if it is not a real number."""
    function = ONE[name][1] if name in ONE else TWO[name][1]
    try:
        value = function(*map(mpmath.mpf, point))
    except (ZeroDivisionError, ValueError):
        return None
    return value if mpmath.im(value) == 0 and mpmath.isfinite(value) else None


def boxes(rng: np.random.Generator, number: int) -> tuple[Array, Array]:
    """Boxes (number,): wide, narrow, points, tiny, huge, and about the edges."""
    middle = rng.choice([0.0, 1.0, -1.0, 0.5 * PI, 2.0], number)
    middle += rng.normal(size=number) * rng.choice([0.0, 1e-8, 0.3, 3.0, 30.0], number)
    middle *= rng.choice([1.0, 1.0, 1.0, 1e-12, 1e-170, 20.0], number)
    width = np.abs(middle) * rng.choice([0.0, 1e-15, 1e-6, 0.1, 1.0, 3.0], number)
    return middle - width * rng.random(number), middle + width * rng.random(number)


def points_of(low: float, high: float, rng: np.random.Generator) -> list[float]:
    """Points of an interval: its ends, others, and those at which sin and cos turn."""
    inside = np.clip(low + (high - low) * rng.random(2), low, high)
    turning = np.ceil(low / (PI / 2)) * PI / 2 + np.arange(4) * PI / 2
    turning = turning[(turning >= low) & (turning <= high)]
    zero = [0.0] if low <= 0 <= high else []
    return [low, high, *inside, *turning, *zero]


def is_whole(bottom: float, top: float) -> bool:
    return bool(bottom == -np.inf and top == np.inf)


@pytest.mark.parametrize("name", ONE)
def test_every_value_is_in_the_interval(name: str) -> None:
    """The interval is the whole line if there is no value at some point."""
    rng = np.random.default_rng(0)
    low, high = boxes(rng, 400)
    with mpmath.workdps(DIGITS):
        found = evaluated(name, low, high)
        for a, b, bottom, top in zip(low, high, *found, strict=True):
            for point in points_of(a, b, rng):
                value = value_at(name, point)
                if value is None:
                    assert is_whole(bottom, top), (name, a, b, point)
                else:
                    assert bottom <= value <= top, (name, a, b, point)


@pytest.mark.parametrize("name", TWO)
def test_so_is_every_value_of_two(name: str) -> None:
    rng = np.random.default_rng(1)
    number = 800
    sides = [boxes(rng, number) for _ in range(2)]
    low, high = (np.array([side[end] for side in sides]) for end in range(2))
    if name == "pow":
        low[0], high[0] = np.abs(low[0]), np.abs(low[0]) + (high[0] - low[0])
    found = evaluated(name, low, high)
    with mpmath.workdps(DIGITS):
        for k in range(number):
            bottom, top = found[0][k], found[1][k]
            share = rng.random((2, 8))
            share[:, :4] = [[0, 0, 1, 1], [0, 1, 0, 1]]
            inside = low[:, [k]] + share * (high - low)[:, [k]]
            for point in np.clip(inside, low[:, [k]], high[:, [k]]).T:
                value = value_at(name, *point)
                if value is None:
                    assert is_whole(bottom, top), (name, point)
                else:
                    assert bottom <= value <= top, (name, point)


@pytest.mark.parametrize("name", [*ONE, *TWO])
def test_what_is_smaller_has_a_smaller_interval(name: str) -> None:
    rng = np.random.default_rng(2)
    low, high = (rng.uniform(0.1, 0.9, (1 + (name in TWO), 500)) for _ in range(2))
    low, high = np.minimum(low, high), np.maximum(low, high)
    inner_low, inner_high = 0.7 * low + 0.3 * high, 0.4 * low + 0.6 * high
    if name == "acosh":
        low, high, inner_low, inner_high = (
            1 + x for x in (low, high, inner_low, inner_high)
        )
    outer, inner = evaluated(name, low, high), evaluated(name, inner_low, inner_high)
    assert np.all(np.isfinite(outer))
    # The functions of the C library rise but for a unit in the last place.
    slack = EPS * np.abs(inner)
    assert np.all(outer[0] <= inner[0] + slack[0])
    assert np.all(inner[1] <= outer[1] + slack[1])


@pytest.mark.parametrize("name", [*ONE, *TWO])
def test_of_a_point_no_more_is_added_than_is_stated(name: str) -> None:
    """And the function itself is right to the 4 units that the widening is made for."""
    rng = np.random.default_rng(3)
    point = rng.uniform(0.05, 0.95, (1 + (name in TWO), 300)) + (name == "acosh")
    bottom, top = evaluated(name, point, point)
    wider = 2.3e-16 if name == "sqrt" else 1.2e-15
    np.testing.assert_array_less(top - bottom, (2 * wider + EPS) * np.abs(top) * 1.01)
    middle = (bottom + top) / 2
    with mpmath.workdps(DIGITS):
        exact = [value_at(name, *column) for column in point.T]
        off = [abs(m / e - 1) for m, e in zip(middle, exact, strict=True)]
    assert max(off) < 4 * EPS


def test_ends_are_moved_by_a_share_of_themselves_and_a_little() -> None:
    assert outward(0.0, 0.0, 2.3e-16) == (-1e-300, 1e-300)
    assert outward(-2.0, 4.0, 0.25) == (-2.5, 5.0)
    assert outward(2.0, 1.0, 0.0) == outward(np.nan, 1.0, 0.0) == (-np.inf, np.inf)


def test_a_hull_of_values_is_the_whole_line_only_if_one_is_no_number() -> None:
    assert hull(5.0, 2.0, np.inf, np.inf, 0.25) == (1.5, np.inf)
    assert hull(-np.inf, -np.inf, 3.0, 4.0, 0.25) == (-np.inf, 5.0)
    for place in range(4):
        a, b, c, d = (np.nan if k == place else 1.0 + k for k in range(4))
        assert hull(a, b, c, d, 0.25) == (-np.inf, np.inf)


@pytest.mark.parametrize(
    ("name", "low", "high", "bottom", "top"),
    [
        ("sin", 1.0, 2.0, np.sin(1.0), 1.0),
        ("sin", -2.0, 2.0, -1.0, 1.0),
        ("sin", 0.1, 0.2, np.sin(0.1), np.sin(0.2)),
        ("sin", 4.0, 5.0, -1.0, np.sin(4.0)),
        ("sin", 1e13, 1e13, -1.0, 1.0),
        ("cos", -0.5, 1.0, np.cos(1.0), 1.0),
        ("cos", 3.0, 3.5, -1.0, np.cos(3.5)),
        ("cos", 2.0, 3.0, np.cos(3.0), np.cos(2.0)),
        ("tan", -1.0, 1.0, np.tan(-1.0), np.tan(1.0)),
        ("tan", 1.0, 2.0, -np.inf, np.inf),
        ("tan", 2.0, 4.0, np.tan(2.0), np.tan(4.0)),
        ("tan", 1.0, PI / 2 - 2.3e-12, np.tan(1.0), np.tan(PI / 2 - 2.3e-12)),
        ("tan", 1.0, PI / 2 - 1.9e-12, -np.inf, np.inf),
        ("tan", PI / 2 + 2.8e-12, 2.0, np.tan(PI / 2 + 2.8e-12), np.tan(2.0)),
        ("tan", PI / 2 + 2.2e-12, 2.0, -np.inf, np.inf),
        ("cosh", -1.0, 2.0, 1.0, np.cosh(2.0)),
        ("cosh", -2.0, -1.0, np.cosh(1.0), np.cosh(2.0)),
        ("sinh", -800.0, 1.0, -np.inf, np.sinh(1.0)),
        ("exp", -800.0, 0.0, 0.0, 1.0),
        ("exp", 0.0, 800.0, 1.0, np.inf),
        ("expm1", -800.0, 0.0, -1.0, 0.0),
        ("erf", -30.0, 30.0, -1.0, 1.0),
        ("tanh", -np.inf, np.inf, -1.0, 1.0),
        ("atan", -np.inf, np.inf, -PI / 2, PI / 2),
        ("sqrt", 0.0, 4.0, 0.0, 2.0),
        ("sqrt", -1e-300, 1.0, -np.inf, np.inf),
        ("log", 1.0, np.e, 0.0, 1.0),
        ("log", 0.0, 1.0, -np.inf, np.inf),
        ("log1p", -1.0, 0.0, -np.inf, np.inf),
        ("log1p", -1 + 2**-53, 0.0, -53 * np.log(2), 0.0),
        ("asin", -1.0, 1.0, -PI / 2, PI / 2),
        ("asin", 0.0, 1 + EPS, -np.inf, np.inf),
        ("acos", -1.0, 1.0, 0.0, PI),
        ("acos", 0.25, 0.5, np.arccos(0.5), np.arccos(0.25)),
        ("acos", -1 - EPS, 0.0, -np.inf, np.inf),
        ("acosh", 1.0, 2.0, 0.0, np.arccosh(2.0)),
        ("acosh", 1 - EPS, 2.0, -np.inf, np.inf),
        ("atanh", -0.5, 0.5, np.arctanh(-0.5), np.arctanh(0.5)),
        ("atanh", 0.0, 1.0, -np.inf, np.inf),
        ("atanh", -1.0, 0.0, -np.inf, np.inf),
        ("power", 0.0, 4.0, 0.0, 8.0),
        ("power", -1e-300, 4.0, -np.inf, np.inf),
        ("odd power", -1.0, 1.0, -1.0, 1.0),
        ("even power", -1.0, 0.5, 0.0, 1.0),
        ("even power", -1.0, -0.5, 0.5**102, 1.0),
        ("negative power", -1.0, -0.5, -(2.0**101), -1.0),
        ("negative power", -1.0, 1.0, -np.inf, np.inf),
    ],
)
def test_intervals_end_where_the_function_does(
    name: str, low: float, high: float, bottom: float, top: float
) -> None:
    found = [end[0] for end in evaluated(name, [low], [high])]
    np.testing.assert_allclose(found, [bottom, top], rtol=4e-15, atol=4e-15)


@pytest.mark.parametrize(
    ("name", "x", "y", "bottom", "top"),
    [
        ("pow", (0.5, 2.0), (-1.0, 3.0), 0.125, 8.0),
        ("pow", (0.0, 2.0), (0.0, 3.0), 0.0, 8.0),
        ("pow", (0.0, 0.5), (0.0, 3.0), 0.0, 1.0),
        ("pow", (0.0, 2.0), (-0.5, 3.0), -np.inf, np.inf),
        ("pow", (-2.0, -1.0), (3.0, 3.0), -8.0, -1.0),
        ("pow", (-2.0, 1.0), (2.0, 2.0), 0.0, 4.0),
        ("pow", (-2.0, 1.0), (0.0, 0.0), 1.0, 1.0),
        ("pow", (-2.0, -1.0), (-2.0, -2.0), 0.25, 1.0),
        ("pow", (-2.0, 1.0), (-2.0, -2.0), -np.inf, np.inf),
        ("pow", (-2.0, -1.0), (2.5, 2.5), -np.inf, np.inf),
        ("pow", (-2.0, -1.0), (2.0, 3.0), -np.inf, np.inf),
        ("hypot", (-3.0, 1.0), (-1.0, 4.0), 0.0, 5.0),
        ("hypot", (3.0, 6.0), (-8.0, -4.0), 5.0, 10.0),
        ("hypot", (-6.0, -3.0), (4.0, 8.0), 5.0, 10.0),
        # atan2(y, x) in each quadrant and over each half axis
        ("atan2", (1.0, 2.0), (1.0, 2.0), np.arctan(0.5), np.arctan(2.0)),
        ("atan2", (1.0, 2.0), (-2.0, -1.0), PI - np.arctan(2), PI - np.arctan(0.5)),
        ("atan2", (-2.0, -1.0), (-2.0, -1.0), np.arctan(0.5) - PI, np.arctan(2) - PI),
        ("atan2", (-2.0, -1.0), (1.0, 2.0), -np.arctan(2.0), -np.arctan(0.5)),
        ("atan2", (-1.0, 1.0), (1.0, 2.0), -PI / 4, PI / 4),
        ("atan2", (1.0, 2.0), (-1.0, 1.0), PI / 4, 3 * PI / 4),
        ("atan2", (-2.0, -1.0), (-1.0, 1.0), -3 * PI / 4, -PI / 4),
        ("atan2", (-1.0, 1.0), (-2.0, -1.0), -np.inf, np.inf),
        ("atan2", (-1.0, 0.0), (-2.0, -1.0), -np.inf, np.inf),
        ("atan2", (0.0, 1.0), (-2.0, -1.0), -np.inf, np.inf),
        ("atan2", (-1.0, 1.0), (0.0, 1.0), -np.inf, np.inf),
    ],
)
def test_so_do_those_of_two(
    name: str,
    x: tuple[float, float],
    y: tuple[float, float],
    bottom: float,
    top: float,
) -> None:
    low, high = np.array([x, y]).T[:, :, None]
    found = [end[0] for end in evaluated(name, low, high)]
    np.testing.assert_allclose(found, [bottom, top], rtol=4e-15, atol=4e-15)


RANGES: dict[str, tuple[tuple[float, float], float, float]] = {
    "sqrt": ((0, 1), 0, np.inf),
    "sin": ((-4, 4), -1, 1),
    "cos": ((0.5, 9), -1, 1),
    "tanh": ((-40, 40), -1, 1),
    "erf": ((-9, 9), -1, 1),
    "cosh": ((-4, 4), 1, np.inf),
    "exp": ((-800, 0), 0, np.inf),
    "expm1": ((-800, 0), -1, np.inf),
    "acosh": ((1, 2), 0, np.inf),
    "acos": ((0, 1), 0, np.inf),
}
"""A box on which a function takes the ends of its range, or nearly so; the ends."""


@pytest.mark.parametrize("name", RANGES)
def test_rounding_never_leaves_the_range_of_a_function(name: str) -> None:
    box, least, most = RANGES[name]
    bottom, top = evaluated(name, [box[0]], [box[1]])
    assert bottom[0] == least
    assert top[0] == most if most == 1 else np.isfinite(top[0])
