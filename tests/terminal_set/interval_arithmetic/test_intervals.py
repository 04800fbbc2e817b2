"""Functions of boxes: CasADi's functions, and their derivatives, in intervals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import mpmath
import numpy as np
import pytest

from swarmstart.terminal_set.interval_arithmetic.intervals import (
    UnknownIntervalOperationError,
    interval_function,
)

Made = Callable[[Any, Any], Any]

# What a model may be made of, of two numbers between 0.1 and 0.9.
EXPRESSIONS: dict[str, tuple[Made, Made]] = {
    "polynomial": (lambda x, y: x**3 * y - y**2 / x, lambda x, y: x**3 * y - y**2 / x),
    "sin": (lambda x, y: ca.sin(x * y), lambda x, y: mpmath.sin(x * y)),
    "cos": (lambda x, y: ca.cos(x - y), lambda x, y: mpmath.cos(x - y)),
    "tan": (lambda x, y: ca.tan(x * y), lambda x, y: mpmath.tan(x * y)),
    "exp": (lambda x, y: ca.exp(-x / y), lambda x, y: mpmath.exp(-x / y)),
    "expm1": (lambda x, y: ca.expm1(x * y), lambda x, y: mpmath.expm1(x * y)),
    "log": (lambda x, y: ca.log(x + y), lambda x, y: mpmath.log(x + y)),
    "log1p": (lambda x, y: ca.log1p(x * y), lambda x, y: mpmath.log1p(x * y)),
    "sqrt": (lambda x, y: ca.sqrt(x + y), lambda x, y: mpmath.sqrt(x + y)),
    "sinh": (lambda x, y: ca.sinh(x * y), lambda x, y: mpmath.sinh(x * y)),
    "cosh": (lambda x, y: ca.cosh(x * y), lambda x, y: mpmath.cosh(x * y)),
    "tanh": (lambda x, y: ca.tanh(x * y), lambda x, y: mpmath.tanh(x * y)),
    "asinh": (lambda x, y: ca.asinh(x * y), lambda x, y: mpmath.asinh(x * y)),
    "acosh": (lambda x, y: ca.acosh(1 + x + y), lambda x, y: mpmath.acosh(1 + x + y)),
    "atanh": (lambda x, y: ca.atanh(x * y), lambda x, y: mpmath.atanh(x * y)),
    "asin": (lambda x, y: ca.asin(x * y), lambda x, y: mpmath.asin(x * y)),
    "acos": (lambda x, y: ca.acos(x * y), lambda x, y: mpmath.acos(x * y)),
    "atan": (lambda x, y: ca.atan(x / y), lambda x, y: mpmath.atan(x / y)),
    "atan2": (ca.atan2, mpmath.atan2),
    "hypot": (ca.hypot, mpmath.hypot),
    "erf": (lambda x, y: ca.erf(x - y), lambda x, y: mpmath.erf(x - y)),
    "power": (lambda x, y: (x * y) ** 1.5, lambda x, y: (x * y) ** mpmath.mpf(1.5)),
    "powers": (ca.power, lambda x, y: x**y),
    "high power": (lambda x, y: ca.power(x + y, 101), lambda x, y: (x + y) ** 101),
}
ORDERS = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
KINKS: dict[str, Callable[[Any, Any], ca.SX]] = {
    "fabs": lambda x, y: ca.fabs(x - y) * x,
    "fmin": lambda x, y: ca.fmin(ca.sin(x), y**2),
    "fmax": lambda x, y: ca.exp(ca.fmax(x, y) * y),
}


def of(make: Callable[[Any, Any], ca.SX]) -> ca.Function:
    x = ca.SX.sym("x", 2)
    return ca.Function("f", [x], [make(x[0], x[1])])


def slopes(function: ca.Function) -> ca.Function:
    x = ca.SX.sym("x", 2)
    return ca.Function("slopes", [x], [ca.gradient(function(x), x)])


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_values_and_derivatives_are_in_their_intervals(name: str) -> None:
    """Derivatives to second order, by differences in fifty digits.

    But for the constants that CasADi rounds as it differentiates (2 / sqrt(pi)).
    """
    make, exact = EXPRESSIONS[name]
    x = ca.SX.sym("x", 2)
    value = make(x[0], x[1])
    hessian, gradient = ca.hessian(value, x)
    column = ca.vertcat(value, gradient, hessian[0, 0], hessian[0, 1], hessian[1, 1])
    rng = np.random.default_rng(0)
    low = rng.uniform(0.1, 0.9, (2, 12))
    high = np.minimum(low + rng.choice([0.0, 1e-6, 0.1], 12), 0.9)
    bottom, top = interval_function(ca.Function("f", [x], [column]))(low, high)
    assert np.all(np.isfinite(bottom)) and np.all(np.isfinite(top))
    with mpmath.workdps(50):
        for k in range(low.shape[1]):
            point = np.clip(low[:, k] + rng.random(2) * (high - low)[:, k], 0.1, 0.9)
            at = tuple(map(mpmath.mpf, point))
            assert bottom[0, k] <= exact(*at) <= top[0, k]
            for entry, order in enumerate(ORDERS, start=1):
                slope = mpmath.diff(exact, at, order)
                slack = 4e-16 * abs(slope)
                assert bottom[entry, k] - slack <= slope <= top[entry, k] + slack


def test_turned_arguments_alone_are_no_tie() -> None:
    """atan2(x, y) + atan2(y, x) is pi / 2 in the first quadrant, not 0 to 1."""
    x = ca.SX.sym("x", 2)
    total = ca.atan2(x[0], x[1]) + ca.atan2(x[1], x[0])
    evaluate = interval_function(ca.Function("f", [x], [total]))
    low, high = evaluate(np.array([[0.3], [0.6]]), np.array([[0.3], [0.6]]))
    assert low[0, 0] <= np.pi / 2 <= high[0, 0] <= low[0, 0] + 1e-12


@pytest.mark.parametrize("name", KINKS)
def test_slopes_of_a_kink_hold_those_of_both_sides(name: str) -> None:
    """And c(x) - c(m) is one of them times x - m, for any x and m of the box."""
    f = of(KINKS[name])
    g = interval_function(slopes(f), takes_jumps=True)
    rng = np.random.default_rng(1)
    low = rng.uniform(-1, 1, (2, 300))
    high = low + rng.exponential(0.5, (2, 300))
    bottom, top = g(low, high)
    assert np.all(np.isfinite(bottom)) and np.all(np.isfinite(top))
    m, x = (low + rng.random((2, 300)) * (high - low) for _ in range(2))
    change = np.array(f.map(300)(x) - f.map(300)(m)).ravel()
    products = np.stack([bottom * (x - m), top * (x - m)])
    assert np.all(products.min(axis=0).sum(axis=0) <= change + 1e-12)
    assert np.all(change - 1e-12 <= products.max(axis=0).sum(axis=0))


@pytest.mark.parametrize("name", KINKS)
def test_slopes_beside_a_kink_are_those_of_its_side(name: str) -> None:
    f = of(KINKS[name])
    low = np.array([[0.5, 0.1], [0.1, 0.8]])
    bottom, top = interval_function(slopes(f), takes_jumps=True)(low, low + 1e-9)
    exact = np.array(slopes(f).map(2)(low))
    np.testing.assert_allclose(bottom, exact, atol=1e-7)
    np.testing.assert_allclose(top, exact, atol=1e-7)


def test_a_point_stays_a_point_but_for_rounding() -> None:
    x = ca.SX.sym("x", 4)
    f = ca.Function("f", [x], [ca.vertcat(x[0] * ca.cos(x[1]), x[2] / x[3] + 1)])
    points = np.random.default_rng(0).uniform(1, 2, (4, 50))
    low, high = interval_function(f)(points, points)
    exact = np.array(f.map(50)(points))
    assert np.all((low <= exact) & (exact <= high))
    np.testing.assert_allclose(high - low, 0, atol=1e-14)


def test_smaller_boxes_have_smaller_intervals() -> None:
    x = ca.SX.sym("x", 2)
    f = interval_function(ca.Function("f", [x], [ca.sin(x[0]) * x[1] - x[0] ** 2]))
    rng = np.random.default_rng(1)
    low = rng.normal(size=(2, 200))
    high = low + rng.random((2, 200))
    inner_low, inner_high = 0.7 * low + 0.3 * high, 0.4 * low + 0.6 * high
    outer, inner = f(low, high), f(inner_low, inner_high)
    assert np.all(outer[0] <= inner[0]) and np.all(inner[1] <= outer[1])


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


def test_a_function_of_matrices_is_expanded() -> None:
    x = ca.MX.sym("x", 2)
    f = ca.Function("f", [x], [ca.mtimes(ca.DM([[1, 2], [3, 4]]), x)])
    low, high = interval_function(f)(np.zeros((2, 1)), np.ones((2, 1)))
    np.testing.assert_allclose(low[:, 0], [0, 0], atol=1e-14)
    np.testing.assert_allclose(high[:, 0], [3, 7], rtol=1e-14)


def test_constants_that_are_no_numbers_are_the_whole_line() -> None:
    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [ca.vertcat(ca.fmin(x, ca.SX(np.nan)), ca.SX(2.5))])
    low, high = interval_function(f)(np.zeros((1, 1)), np.ones((1, 1)))
    np.testing.assert_array_equal(low[:, 0], [-np.inf, 2.5])
    np.testing.assert_array_equal(high[:, 0], [1.0, 2.5])


def test_many_values_share_few_registers_and_none_is_lost() -> None:
    """A chain whose every value is used once more at the end."""
    x = ca.SX.sym("x", 2)
    chain = [x[0]]
    for k in range(30):
        chain.append(ca.sin(chain[-1]) * x[1] + chain[k // 2])
    f = ca.Function("f", [x], [ca.vertcat(*chain, ca.sum1(ca.vertcat(*chain)))])
    points = np.random.default_rng(0).uniform(0, 1, (2, 20))
    low, high = interval_function(f)(points, points)
    exact = np.array(f.map(20)(points))
    np.testing.assert_allclose(low, exact, rtol=1e-11)
    np.testing.assert_allclose(high, exact, rtol=1e-11)


def test_what_has_no_interval_form_is_named() -> None:
    x = ca.SX.sym("x")
    f = ca.Function("inverse", [x], [ca.erfinv(x)])
    with pytest.raises(
        UnknownIntervalOperationError,
        match="inverse has the operation erfinv, which has no interval form",
    ):
        interval_function(f)


@pytest.mark.parametrize(
    ("operation", "make"),
    [
        ("floor", lambda x, y: ca.floor(x)),
        ("sign", lambda x, y: ca.sign(x)),
        ("lt", lambda x, y: ca.if_else(x < 1, y, 0)),
        ("fmod", ca.fmod),
    ],
)
def test_what_jumps_is_named_with_the_reason(operation: str, make: Made) -> None:
    with pytest.raises(
        UnknownIntervalOperationError,
        match=f"f has the operation {operation}, which jumps: a proof needs a cont",
    ):
        interval_function(of(make))


@pytest.mark.parametrize("name", KINKS)
def test_slopes_of_a_kink_are_given_only_if_asked_for(name: str) -> None:
    with pytest.raises(UnknownIntervalOperationError, match="which jumps"):
        interval_function(slopes(of(KINKS[name])))


def test_a_function_that_calls_another_program_is_refused() -> None:
    x = ca.MX.sym("x")
    table = ca.interpolant("table", "bspline", [[0.0, 1.0, 2.0, 3.0]], [0, 1, 4, 9])
    with pytest.raises(UnknownIntervalOperationError, match="f has the operation call"):
        interval_function(ca.Function("f", [x], [table(x)]))


def test_a_function_that_does_not_expand_is_refused() -> None:
    x = ca.MX.sym("x", 3)
    with pytest.raises(UnknownIntervalOperationError, match="f does not expand to SX"):
        interval_function(ca.Function("f", [x], [ca.find(x)]))
