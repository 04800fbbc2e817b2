"""The intervals of the arithmetic hold its values, in exact fractions."""

from __future__ import annotations

import operator
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.tape import Node, Tape
from swarmstart.terminal_set.interval_arithmetic.interval_kernel import BLOCK, _load
from swarmstart.terminal_set.interval_arithmetic.intervals import (
    interval_function,
    interval_program,
)

Exact = Callable[..., Any]

OPERATIONS: dict[str, tuple[int, Exact]] = {
    "add": (2, operator.add),
    "sub": (2, operator.sub),
    "mul": (2, operator.mul),
    "div": (2, operator.truediv),
    "fmin": (2, min),
    "fmax": (2, max),
    "le": (2, lambda x, y: int(x <= y)),
    "ties": (2, lambda x, y: int(x <= y) + int(y <= x)),
    "neg": (1, operator.neg),
    "sq": (1, lambda x: x * x),
    "twice": (1, lambda x: 2 * x),
    "fabs": (1, abs),
    "sign": (1, lambda x: (x > 0) - (x < 0)),
    "not": (1, lambda x: int(x == 0)),
}


def of(operation: str, size: int | None = None) -> Any:
    """The interval evaluation of one operation."""
    size = OPERATIONS[operation][0] if size is None else size
    inputs = tuple(Node("input", (0, entry)) for entry in range(size))
    made = Node(operation, tuple(range(size)))
    tape = Tape(nodes=(*inputs, made), outputs=((size,),), inputs=(size,))
    return interval_program(tape, operation)


def boxes(rng: np.random.Generator, size: int, number: int) -> tuple[Array, Array]:
    """Boxes (size, number): wide, narrow, points, whole numbers, tiny, huge."""
    middle = rng.normal(size=(size, number)) * rng.choice([1.0, 30.0], number)
    middle = np.where(rng.random(middle.shape) < 0.3, middle.round(), middle)
    middle *= rng.choice([1.0, 1.0, 1e-170, 1e-300, 1e150], number)
    width = np.abs(middle) * rng.choice([0.0, 1e-15, 0.1, 3.0], middle.shape)
    return middle - width, middle + width


@pytest.mark.parametrize("operation", OPERATIONS)
def test_every_exact_value_is_in_the_interval(operation: str) -> None:
    size, exact = OPERATIONS[operation]
    rng = np.random.default_rng(0)
    low, high = boxes(rng, size, 1500)
    (bottom,), (top,) = of(operation)(low, high)
    corners = np.array(np.meshgrid(*[[0, 1]] * size)).reshape(size, -1)
    for k in range(low.shape[1]):
        inside = rng.random((size, 2))
        share = np.hstack([corners, inside])
        points = low[:, [k]] + share * (high - low)[:, [k]]
        for point in np.clip(points, low[:, [k]], high[:, [k]]).T:
            try:
                value = exact(*map(Fraction, point))
            except ZeroDivisionError:
                value = None
            if value is None or not np.isfinite([bottom[k], top[k]]).all():
                assert bottom[k] == -np.inf or abs(value) > 1e300
                continue
            assert Fraction(bottom[k]) <= value <= Fraction(top[k]), (low[:, k], point)


@pytest.mark.parametrize(
    ("operation", "x", "y", "bottom", "top"),
    [
        ("add", (1.0, 2.0), (-3.0, 5.0), -2.0, 7.0),
        ("sub", (1.0, 2.0), (-3.0, 5.0), -4.0, 5.0),
        ("mul", (-1.0, 2.0), (-3.0, 5.0), -6.0, 10.0),
        ("mul", (-2.0, -1.0), (-5.0, -3.0), 3.0, 10.0),
        ("mul", (0.0, 0.0), (-np.inf, np.inf), -np.inf, np.inf),
        ("div", (1.0, 2.0), (-4.0, -2.0), -1.0, -0.25),
        ("div", (-1.0, 2.0), (2.0, 4.0), -0.5, 1.0),
        ("div", (1.0, 2.0), (-1.0, 1.0), -np.inf, np.inf),
        ("div", (1.0, 2.0), (0.0, 1.0), -np.inf, np.inf),
        ("div", (1.0, 2.0), (-1.0, 0.0), -np.inf, np.inf),
        ("fmin", (-1.0, 4.0), (0.0, 2.0), -1.0, 2.0),
        ("fmin", (0.0, 2.0), (-1.0, 4.0), -1.0, 2.0),
        ("fmax", (-1.0, 4.0), (0.0, 2.0), 0.0, 4.0),
        ("fmax", (0.0, 2.0), (-1.0, 4.0), 0.0, 4.0),
        ("neg", (-1.0, 2.0), None, -2.0, 1.0),
        ("twice", (-1.0, 2.0), None, -2.0, 4.0),
        ("sq", (-1.0, 2.0), None, 0.0, 4.0),
        ("sq", (-3.0, -2.0), None, 4.0, 9.0),
        ("fabs", (-3.0, 1.0), None, 0.0, 3.0),
        ("fabs", (-3.0, -2.0), None, 2.0, 3.0),
        ("fabs", (2.0, 3.0), None, 2.0, 3.0),
        ("sign", (0.5, 1.0), None, 1.0, 1.0),
        ("sign", (-1.0, -0.5), None, -1.0, -1.0),
        ("sign", (0.0, 1.0), None, -1.0, 1.0),
        ("sign", (-1.0, 0.0), None, -1.0, 1.0),
        ("not", (0.0, 0.0), None, 1.0, 1.0),
        ("not", (0.0, 1.0), None, 0.0, 1.0),
        ("not", (1.0, 1.0), None, 0.0, 0.0),
        ("not", (-1.0, -1.0), None, 0.0, 0.0),
        ("le", (0.0, 1.0), (1.0, 2.0), 1.0, 1.0),
        ("le", (0.0, 1.0), (0.5, 2.0), 0.0, 1.0),
        ("le", (1.0, 2.0), (0.0, 1.0), 0.0, 1.0),
        ("le", (1.5, 2.0), (0.0, 1.0), 0.0, 0.0),
        ("ties", (0.0, 1.0), (2.0, 3.0), 1.0, 1.0),
        ("ties", (2.0, 3.0), (0.0, 1.0), 1.0, 1.0),
        ("ties", (0.0, 1.0), (1.0, 3.0), 1.0, 2.0),
        ("ties", (1.0, 3.0), (0.0, 1.0), 1.0, 2.0),
        ("exp", (-1.0, 2.0), None, np.exp(-1.0), np.exp(2.0)),
        ("acos", (-0.5, 0.25), None, np.arccos(0.25), np.arccos(-0.5)),
        ("pow", (0.25, 4.0), (-0.5, 1.5), 0.125, 8.0),
        ("atan2", (1.0, 2.0), (-1.0, 3.0), np.arctan(1 / 3), 3 * np.pi / 4),
        ("hypot", (3.0, 6.0), (-8.0, -4.0), 5.0, 10.0),
    ],
)
def test_intervals_are_as_tight_as_rounding_allows(
    operation: str,
    x: tuple[float, float],
    y: tuple[float, float] | None,
    bottom: float,
    top: float,
) -> None:
    low, high = np.array([x] if y is None else [x, y]).T[:, :, None]
    (found_bottom,), (found_top,) = of(operation, len(low))(low, high)
    np.testing.assert_allclose(found_bottom, bottom, rtol=2e-15, atol=1e-299)
    np.testing.assert_allclose(found_top, top, rtol=2e-15, atol=1e-299)


@pytest.mark.parametrize("operation", ["add", "mul", "div", "sq", "twice"])
def test_an_overflow_is_no_statement(operation: str) -> None:
    """Infinity for both ends would be: every value is infinite."""
    size = OPERATIONS[operation][0]
    point = np.array([1.7e308, 1e-10 if operation == "div" else 1.7e308])[:size, None]
    (bottom,), (top,) = of(operation)(point, point)
    assert bottom[0] < 1.8e308 and top[0] == np.inf


@pytest.mark.parametrize("operation", OPERATIONS)
def test_what_is_no_number_is_the_whole_line(operation: str) -> None:
    size = OPERATIONS[operation][0]
    one = np.ones((size, 1))
    whole = of(operation)(-np.inf * one, np.inf * one)
    for low, high in ((np.nan, 1.0), (1.0, np.nan), (np.nan, np.nan), (2.0, 1.0)):
        found = of(operation)(low * one, high * one)
        np.testing.assert_array_equal(found, whole)


def test_blocks_that_are_full_broken_and_alone_say_the_same() -> None:
    x = ca.SX.sym("x", 2)
    f = interval_function(ca.Function("f", [x], [ca.sin(x[0]) * x[1] - x[0] ** 2]))
    rng = np.random.default_rng(1)
    low = rng.normal(size=(2, 2 * BLOCK + 5))
    high = low + rng.random(low.shape)
    together = f(low, high)
    for number in (1, BLOCK - 1, BLOCK, BLOCK + 1):
        part = f(low[:, :number], high[:, :number])
        np.testing.assert_array_equal(part[0], together[0][:, :number])
        np.testing.assert_array_equal(part[1], together[1][:, :number])
    last = f(low[:, -1:], high[:, -1:])
    np.testing.assert_array_equal(last[1][:, 0], together[1][:, -1])


def test_what_is_left_of_a_block_holds_its_last_box_and_none_beside_it() -> None:
    whole = np.stack([np.arange(4.0), np.arange(4.0) + 0.5])[:, None, :]
    work = np.empty((1, 2, BLOCK))
    _load(np.zeros((1, 2), dtype=np.int64), whole[:, :, 1:3], work)
    left = BLOCK - 2
    np.testing.assert_array_equal(work[0, 0], [1.0, *[2.0] * (left + 1)])
    np.testing.assert_array_equal(work[0, 1], [1.5, *[2.5] * (left + 1)])
