"""Intervals hold what they stand for, in arithmetic of fifty digits."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import Any

import casadi as ca
import mpmath
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmstart.terminal_set.intervals import (
    UnknownIntervalOperationError,
    interval_function,
)

Array = NDArray[np.float64]
DIGITS = 50
numbers = st.floats(-30, 30, allow_subnormal=False)
shares = st.floats(0, 1)
widths = st.floats(0, 8)

ONE: dict[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    "sin": (ca.sin, mpmath.sin),
    "cos": (ca.cos, mpmath.cos),
    "tan": (ca.tan, mpmath.tan),
    "exp": (ca.exp, mpmath.exp),
    "log": (ca.log, mpmath.log),
    "sqrt": (ca.sqrt, mpmath.sqrt),
    "atan": (ca.atan, mpmath.atan),
    "tanh": (ca.tanh, mpmath.tanh),
    "fabs": (ca.fabs, abs),
    "square": (lambda x: x * x, lambda x: x * x),
    "cube": (lambda x: x**3, lambda x: x**3),
    "fifth": (lambda x: ca.power(x, 5), lambda x: x**5),
    "inverse": (lambda x: 1 / x, lambda x: 1 / x),
    "power": (lambda x: x**1.5, lambda x: x ** mpmath.mpf("1.5")),
    "negative": (operator.neg, operator.neg),
    "twice": (lambda x: x + x, lambda x: x + x),
}
TWO: dict[str, tuple[Callable[[Any, Any], Any], Callable[[Any, Any], Any]]] = {
    "plus": (operator.add, operator.add),
    "minus": (operator.sub, operator.sub),
    "times": (operator.mul, operator.mul),
    "by": (operator.truediv, operator.truediv),
    "least": (ca.fmin, min),
    "greatest": (ca.fmax, max),
}


@functools.cache
def of_one(name: str) -> Any:
    x = ca.SX.sym("x")
    return interval_function(ca.Function(name, [x], [ONE[name][0](x)]))


@functools.cache
def of_two(name: str) -> Any:
    x = ca.SX.sym("x", 2)
    return interval_function(ca.Function(name, [x], [TWO[name][0](x[0], x[1])]))


def holds(low: float, high: float, value: Any) -> bool:
    return bool(mpmath.mpf(low) <= value <= mpmath.mpf(high))


@settings(deadline=None)
@given(low=numbers, width=widths, share=shares)
@pytest.mark.parametrize("name", ONE)
def test_the_value_at_every_point_is_in_the_interval(
    name: str, low: float, width: float, share: float
) -> None:
    high = low + width
    point = min(max(low + share * width, low), high)
    bottom, top = of_one(name)(np.array([[low]]), np.array([[high]]))
    try:
        with mpmath.workdps(DIGITS):
            value = ONE[name][1](mpmath.mpf(point))
            inside = mpmath.im(value) == 0 and holds(bottom[0, 0], top[0, 0], value)
    except (ZeroDivisionError, ValueError):
        inside = np.isinf(bottom[0, 0]) and np.isinf(top[0, 0])
    whole = np.isinf(bottom[0, 0]) and np.isinf(top[0, 0])
    assert inside or whole


@settings(deadline=None)
@given(lows=st.tuples(numbers, numbers), wide=st.tuples(widths, widths),
       share=st.tuples(shares, shares))  # fmt: skip
@pytest.mark.parametrize("name", TWO)
def test_so_is_that_of_two(
    name: str,
    lows: tuple[float, float],
    wide: tuple[float, float],
    share: tuple[float, float],
) -> None:
    low = np.array(lows)
    high = low + np.array(wide)
    point = np.clip(low + np.array(share) * np.array(wide), low, high)
    assume(name != "by" or point[1] != 0)
    bottom, top = of_two(name)(low[:, None], high[:, None])
    with mpmath.workdps(DIGITS):
        value = TWO[name][1](*map(mpmath.mpf, point))
        assert holds(bottom[0, 0], top[0, 0], value)


@pytest.mark.parametrize(
    ("name", "low", "high", "bottom", "top"),
    [
        ("sin", 1.0, 2.0, np.sin(1.0), 1.0),
        ("sin", -2.0, 2.0, -1.0, 1.0),
        ("sin", 0.1, 0.2, np.sin(0.1), np.sin(0.2)),
        ("cos", -0.5, 1.0, np.cos(1.0), 1.0),
        ("cos", 3.0, 3.5, -1.0, np.cos(3.5)),
        ("tan", -1.0, 1.0, np.tan(-1.0), np.tan(1.0)),
        ("tan", 1.0, 2.0, -np.inf, np.inf),
        ("square", -1.0, 2.0, 0.0, 4.0),
        ("fabs", -3.0, 1.0, 0.0, 3.0),
        ("inverse", 2.0, 4.0, 0.25, 0.5),
        ("inverse", -1.0, 1.0, -np.inf, np.inf),
        ("sqrt", -1.0, 1.0, -np.inf, np.inf),
        ("log", 1.0, np.e, 0.0, 1.0),
        ("fifth", -2.0, 1.0, -32.0, 16.0),
    ],
)
def test_intervals_are_as_tight_as_the_function_allows(
    name: str, low: float, high: float, bottom: float, top: float
) -> None:
    """To rounding; but for the fifth power, which is x times a square."""
    found = [end[0, 0] for end in of_one(name)(np.array([[low]]), np.array([[high]]))]
    np.testing.assert_allclose(found, [bottom, top], rtol=1e-14, atol=1e-14)


def test_a_point_stays_a_point_but_for_rounding() -> None:
    x = ca.SX.sym("x", 4)
    f = ca.Function("f", [x], [ca.vertcat(x[0] * ca.cos(x[1]), x[2] / x[3] + 1)])
    points = np.random.default_rng(0).uniform(1, 2, (4, 50))
    low, high = interval_function(f)(points, points)
    exact = np.array(f.map(50)(points))
    assert np.all((low <= exact) & (exact <= high))
    np.testing.assert_allclose(high - low, 0, atol=1e-14)


def test_blocks_of_boxes_are_evaluated_one_by_one() -> None:
    """Smaller boxes have smaller intervals: inclusion is monotone."""
    x = ca.SX.sym("x", 2)
    f = interval_function(ca.Function("f", [x], [ca.sin(x[0]) * x[1] - x[0] ** 2]))
    rng = np.random.default_rng(1)
    low = rng.normal(size=(2, 200))
    high = low + rng.random((2, 200))
    inner_low, inner_high = 0.7 * low + 0.3 * high, 0.4 * low + 0.6 * high
    outer, inner = f(low, high), f(inner_low, inner_high)
    assert np.all(outer[0] <= inner[0]) and np.all(inner[1] <= outer[1])
    alone = [f(low[:, [k]], high[:, [k]]) for k in range(200)]
    np.testing.assert_array_equal(outer[0], np.hstack([one[0] for one in alone]))


def test_entries_that_are_zero_by_structure_keep_their_places() -> None:
    x = ca.SX.sym("x", 3)
    hessian, _ = ca.hessian(x[0] * x[2] + ca.sin(x[1]), x)
    f = ca.Function("f", [x], [hessian])
    assert f.sparsity_out(0).nnz() < f.numel_out(0)
    point = np.array([[1.0], [2.0], [3.0]])
    low, high = interval_function(f)(point, point)
    expected = [0, 0, 1, 0, -np.sin(2.0), 0, 1, 0, 0]
    np.testing.assert_allclose(low[:, 0], expected, atol=1e-14)
    np.testing.assert_allclose(high[:, 0], expected, atol=1e-14)


def test_what_has_no_interval_form_is_named() -> None:
    x = ca.SX.sym("x")
    f = ca.Function("stairs", [x], [ca.floor(x)])
    with pytest.raises(UnknownIntervalOperationError, match="stairs has the operation"):
        interval_function(f)
