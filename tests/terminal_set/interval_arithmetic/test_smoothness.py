"""Kinks and cuts, which the formulas of derivatives do not show, are found."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.terminal_set.interval_arithmetic.intervals import (
    UnknownIntervalOperationError,
)
from swarmstart.terminal_set.interval_arithmetic.smoothness import (
    Kinks,
    NotSmoothError,
    require_bounded,
    require_smooth,
)


def of(make: Callable[[Any, Any], Any]) -> ca.Function:
    x = ca.SX.sym("x", 2)
    return ca.Function("motion", [x], [make(x[0], x[1])])


def found(
    make: Callable[[Any, Any], Any], low: list[float], high: list[float]
) -> tuple[bool, bool]:
    """Return whether a box may have a kink, and a cut."""
    kinks, cuts = Kinks(of(make))(np.array(low)[:, None], np.array(high)[:, None])
    assert kinks.shape == cuts.shape == (1,)
    return bool(kinks[0]), bool(cuts[0])


@pytest.mark.parametrize(
    ("make", "inside", "beside"),
    [
        (lambda x, y: ca.fabs(x - y), ([0, 1], [2, 3]), ([0, 4], [2, 5])),
        (lambda x, y: ca.fabs(x - y), ([2, 0], [3, 2]), ([3, 0], [4, 2])),
        (lambda x, y: ca.fmin(x, y**2), ([3, 1], [5, 2]), ([5, 1], [6, 2])),
        (lambda x, y: ca.fmin(x, y**2), ([0, 1], [1, 2]), ([-1, 1], [0, 2])),
        (ca.fmax, ([0, 1], [1, 2]), ([0, 1.1], [1, 2])),
        (
            lambda x, y: y + ca.fmax(1, ca.sin(y) * 2),
            ([0, 0], [0, 1]),
            ([0, -1], [0, 0]),
        ),
        (
            lambda x, y: ca.fabs(y) + ca.fabs(x),
            ([-1, 2], [1, 3]),
            ([1, 2], [2, 3]),
        ),
    ],
)
def test_a_kink_is_found_inside_a_box_and_not_beside_it(
    make: Callable[[Any, Any], Any],
    inside: tuple[list[float], list[float]],
    beside: tuple[list[float], list[float]],
) -> None:
    assert found(make, *inside) == (True, False)
    assert found(make, *beside) == (False, False)


@pytest.mark.parametrize(
    ("low", "high", "is_cut"),
    [
        ([-1, -2], [1, -1], True),  # y, x: across the cut
        ([0, -2], [1, -1], True),  # it begins at the cut
        ([-1, -2], [0, -1], True),
        ([-1, 0], [1, 1], True),  # the origin at its edge
        ([-1, 1], [1, 2], False),  # across the other half of the axis
        ([1, -2], [2, -1], False),  # above the cut
        ([-2, -2], [-1, -1], False),  # below it
    ],
)
def test_the_cut_of_atan2_is_found(
    low: list[float], high: list[float], is_cut: bool
) -> None:
    assert found(ca.atan2, low, high) == (False, is_cut)


def test_kinks_and_cuts_of_one_function_are_told_apart() -> None:
    def both(x: ca.SX, y: ca.SX) -> Any:
        return ca.fabs(x - 5) + ca.atan2(x, y) * ca.fmin(y, 3) + ca.atan2(1, y)

    assert found(both, [4, 1], [6, 2]) == (True, False)
    assert found(both, [-1, -2], [1, -1]) == (False, True)
    assert found(both, [-1, -2], [6, 4]) == (True, True)
    assert found(both, [1, 1], [2, 2]) == (False, False)


def test_of_two_angles_each_has_its_cut() -> None:
    def both(x: ca.SX, y: ca.SX) -> Any:
        return ca.atan2(x, y) + ca.atan2(x, -y)

    assert found(both, [-1, 1], [1, 2]) == (False, True)
    assert found(both, [-1, -2], [1, -1]) == (False, True)
    assert found(both, [1, -1], [2, 1]) == (False, False)


def test_of_many_boxes_each_is_judged() -> None:
    low = np.array([[0.0, 2.0, -1.0], [1.0, 1.0, 0.0]])
    kinks, cuts = Kinks(of(ca.fmax))(low, low + 0.5)
    assert kinks.tolist() == [False, False, False] and not cuts.any()
    kinks, cuts = Kinks(of(ca.fmax))(low, low + 1.0)
    assert kinks.tolist() == [True, True, True] and not cuts.any()
    kinks, cuts = Kinks(of(lambda x, y: x * y))(low, low + 1.0)
    assert kinks.tolist() == cuts.tolist() == [False, False, False]


def test_a_function_that_jumps_is_refused() -> None:
    with pytest.raises(UnknownIntervalOperationError, match="sign, which jumps"):
        Kinks(of(lambda x, y: ca.sign(x) * y))


def test_a_point_with_a_cut_is_refused_and_one_with_a_kink_is_not() -> None:
    zero, one = np.zeros((2, 1)), np.ones((2, 1))
    angle = Kinks(of(ca.atan2))
    angle.require_no_cut(one, one, "the law")
    with pytest.raises(NotSmoothError, match="atan2 of the law has its cut"):
        angle.require_no_cut(zero, zero, "the law")
    Kinks(of(lambda x, y: ca.fabs(x))).require_no_cut(zero, zero, "the law")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda x, y: x**1.5, "the operation pow of motion is at the edge of its"),
        (lambda x, y: x**2.5, "pow of motion is at the edge"),
        (lambda x, y: ca.power(1 + x, y) * ca.log(y), "log of motion leaves its dom"),
        (lambda x, y: y / x, "div of motion leaves its domain"),
        (lambda x, y: ca.asin(2 + x), "asin of motion leaves its domain"),
        (lambda x, y: ca.asin(1 + x), "asin of motion is at the edge"),
        (lambda x, y: ca.sqrt(x**2 + y**2), "sqrt of motion is at the edge"),
        (ca.hypot, "hypot of motion is at the edge"),
        (lambda x, y: ca.asin(x - 1), "asin of motion is at the edge"),
        (lambda x, y: ca.acos(ca.cos(x)), "acos of motion"),
        (lambda x, y: ca.acos(x - ca.cosh(x)), "acos of motion is at the edge"),
        (lambda x, y: ca.acosh(ca.cosh(x)), "acosh of motion"),
        (lambda x, y: ca.power(x**2 + y**2, 0.7), "pow of motion is at the edge"),
    ],
)
def test_the_operation_that_has_no_derivatives_is_named(
    make: Callable[[Any, Any], Any], message: str
) -> None:
    with pytest.raises(NotSmoothError, match=message):
        require_bounded(of(make), np.zeros(2))


def test_all_reasons_are_looked_for_at_the_point_itself() -> None:
    zero = np.zeros(2)
    require_smooth(of(lambda x, y: ca.fabs(x) * y + ca.atan2(x, 1 + y)), zero)
    with pytest.raises(NotSmoothError, match="atan2 of motion has its cut"):
        require_smooth(of(lambda x, y: ca.atan2(x, y - 1)), zero)
    for make in (lambda x, y: y**2.5, lambda x, y: ca.hypot(x, y) + y):
        with pytest.raises(NotSmoothError, match="is at the edge of its smooth"):
            require_smooth(of(make), zero)
        require_smooth(of(make), zero + 1)


def test_where_all_derivatives_are_bounded_nothing_is_refused() -> None:
    def model(x: ca.SX, y: ca.SX) -> Any:
        return ca.sqrt(1 + x) + ca.asin(y / 2) + ca.hypot(1, x) + (2 + y) ** 1.5

    require_bounded(of(model), np.zeros(2))


@pytest.mark.parametrize("rough", [0, 1])
def test_one_row_without_bounded_derivatives_is_enough(rough: int) -> None:
    """x^2 and x^1.5 at 0: of the second derivatives only one has no bound."""
    x = ca.SX.sym("x")
    rows = [x**2, x**2]
    rows[rough] = x**1.5
    with pytest.raises(NotSmoothError):
        require_smooth(ca.Function("f", [x], [ca.vertcat(*rows)]), np.zeros(1))
