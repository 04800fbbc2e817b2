"""Interval evaluation of a function over blocks of boxes.

An interval [lo, hi] stands for every number in it. A function of boxes returns an
interval that holds the function's value at every point of the box, rounding included:
every operation's ends are computed in floats and moved outwards, by |end| times

    + - * / sqrt         WIDER (IEEE: half a unit in the last place off at most)
    the functions        FUNCTION_WIDER (NumPy documents at most 4 units)

and SMALLEST, below which floats lose digits.

What is undefined somewhere in a box, a quotient by an interval with 0 or a root of a
negative number, is the whole line: no statement.

`IntervalEvaluation` is what a proof asks for; `interval_function` makes one that walks
the tape of an SX function in NumPy, one instruction for all boxes at a time. A faster
one may be passed in from above.

Source: Moore, Kearfott and Cloud (2009), Introduction to Interval Analysis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.errors import SwarmstartError

Array = NDArray[np.float64]
Interval = tuple[Array, Array]
"""Lower and upper ends, each (m,): one interval for each of m boxes."""

WIDER = 2.3e-16
"""Relative: half a unit of the operation and half a unit of moving its end."""
FUNCTION_WIDER = 1.2e-15
SMALLEST = 1e-300
MOST_PRODUCTS = 16
"""The largest whole power that is made of squares and products."""
PERIOD_SLACK = 1e-12
"""By which part of an angle a turning point may be mistaken for inside a box."""


class IntervalEvaluation(Protocol):
    """A function of boxes."""

    def __call__(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Return enclosures of the values, each (outputs, m).

        Args:
            lower: Lower corners of m boxes, shape (inputs, m).
            upper: Upper corners, same shape.
        """


@dataclass(eq=False)
class UnknownIntervalOperationError(SwarmstartError, NotImplementedError):
    """The function has an operation that has no interval form here.

    Attributes:
        function: The function's name.
        operation: What the operation is called.
    """

    function: str
    operation: str

    def __str__(self) -> str:
        """Say which."""
        return (
            f"{self.function} has the operation {self.operation}, which has no "
            "interval form here (a proof takes derivatives: those of fabs, fmin and "
            "fmax have none)"
        )


def operation_name(code: int) -> str:
    """Return what CasADi calls an operation, or its number.

    Args:
        code: CasADi's number of it.
    """
    return _NAMES.get(code, str(code))


def interval_function(function: ca.Function) -> IntervalEvaluation:
    """Return an SX function of one column as a function of boxes.

    Args:
        function: x (n, 1) -> y (k, 1); of a matrix y the columns follow each other.

    Raises:
        UnknownIntervalOperationError: If it has an operation without interval form.
    """
    expanded = function if function.is_a("SXFunction") else function.expand()
    tape = _tape(expanded)
    for operation, *_ in tape:
        if operation not in (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, *_FORMS):
            raise UnknownIntervalOperationError(
                function.name(), operation_name(operation)
            )
    outputs, registers = expanded.numel_out(0), expanded.sz_w()
    # The tape counts the entries that are not zero by structure.
    taken, given = expanded.sparsity_in(0).find(), expanded.sparsity_out(0).find()

    def evaluate(lower: Array, upper: Array) -> tuple[Array, Array]:
        boxes = lower.shape[1]
        work: list[Interval] = [(np.empty(0), np.empty(0))] * registers
        low, high = np.zeros((outputs, boxes)), np.zeros((outputs, boxes))
        with np.errstate(all="ignore"):
            for operation, ins, outs, constant in tape:
                if operation == ca.OP_INPUT:
                    entry = taken[ins[1]]
                    work[outs[0]] = lower[entry], upper[entry]
                elif operation == ca.OP_OUTPUT:
                    entry = given[outs[1]]
                    low[entry], high[entry] = work[ins[0]]
                elif operation == ca.OP_CONST:
                    work[outs[0]] = (np.full(boxes, constant),) * 2
                else:
                    work[outs[0]] = _FORMS[operation](*[work[k] for k in ins])
        return low, high

    return evaluate


_NAMES = {
    getattr(ca, name): name.removeprefix("OP_").lower()
    for name in dir(ca)
    if name.startswith("OP_")
}

Instruction = tuple[int, list[int], list[int], float]
"""An operation, its inputs, its outputs, and its constant where it is one."""


def _tape(function: ca.Function) -> list[Instruction]:
    """Return the instructions of an SX function."""
    tape = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        is_constant = operation == ca.OP_CONST
        tape.append(
            (
                operation,
                function.instruction_input(k),
                function.instruction_output(k),
                function.instruction_constant(k) if is_constant else 0.0,
            )
        )
    return tape


def _outward(low: Array, high: Array, wider: float = WIDER) -> Interval:
    """Move the ends outwards; what is no number becomes the whole line."""
    low = low - (np.abs(low) * wider + SMALLEST)
    high = high + (np.abs(high) * wider + SMALLEST)
    lost = ~(low <= high)
    if lost.any():
        return np.where(lost, -np.inf, low), np.where(lost, np.inf, high)
    return low, high


def _whole(where: NDArray[np.bool_], interval: Interval) -> Interval:
    """Return the whole line where asked for."""
    low, high = interval
    return np.where(where, -np.inf, low), np.where(where, np.inf, high)


def _add(a: Interval, b: Interval) -> Interval:
    return _outward(a[0] + b[0], a[1] + b[1])


def _subtract(a: Interval, b: Interval) -> Interval:
    return _outward(a[0] - b[1], a[1] - b[0])


def _multiply(a: Interval, b: Interval) -> Interval:
    return _hull(a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1])


def _divide(a: Interval, b: Interval) -> Interval:
    through_zero = (b[0] <= 0) & (b[1] >= 0)
    ends = _hull(a[0] / b[0], a[0] / b[1], a[1] / b[0], a[1] / b[1])
    return _whole(through_zero, ends)


def _hull(s: Array, t: Array, u: Array, v: Array) -> Interval:
    """Return the interval of four products or quotients; NaN spreads, as it must."""
    low = np.minimum(np.minimum(s, t), np.minimum(u, v))
    return _outward(low, np.maximum(np.maximum(s, t), np.maximum(u, v)))


def _negate(a: Interval) -> Interval:
    return -a[1], -a[0]


def _square(a: Interval) -> Interval:
    """By its ends: the product of an interval with itself would go below 0."""
    least = np.where((a[0] <= 0) & (a[1] >= 0), 0.0, np.minimum(a[0] ** 2, a[1] ** 2))
    low, high = _outward(least, np.maximum(a[0] ** 2, a[1] ** 2))
    return np.maximum(low, 0.0), high


def _twice(a: Interval) -> Interval:
    return _outward(2 * a[0], 2 * a[1])


def _invert(a: Interval) -> Interval:
    one = np.ones_like(a[0])
    return _divide((one, one), a)


def _absolute(a: Interval) -> Interval:
    inside = (a[0] <= 0) & (a[1] >= 0)
    low = np.where(inside, 0.0, np.minimum(np.abs(a[0]), np.abs(a[1])))
    return low, np.maximum(np.abs(a[0]), np.abs(a[1]))


def _least(a: Interval, b: Interval) -> Interval:
    return np.minimum(a[0], b[0]), np.minimum(a[1], b[1])


def _greatest(a: Interval, b: Interval) -> Interval:
    return np.maximum(a[0], b[0]), np.maximum(a[1], b[1])


def _root(a: Interval) -> Interval:
    low, high = _outward(np.sqrt(a[0]), np.sqrt(a[1]))
    return _whole(a[0] < 0, (np.maximum(low, 0.0), high))


def _rising(function: Callable[[Array], Array]) -> Callable[[Interval], Interval]:
    """Return the interval form of a function that rises everywhere."""
    return lambda a: _outward(function(a[0]), function(a[1]), FUNCTION_WIDER)


def _logarithm(a: Interval) -> Interval:
    return _whole(a[0] <= 0, _rising(np.log)(a))


def _turns(a: Interval, at: float) -> NDArray[np.bool_]:
    """Return whether at + 2 pi k lies in an interval, or may, for some integer k."""
    slack = PERIOD_SLACK * (1.0 + np.maximum(np.abs(a[0]), np.abs(a[1])))
    first = np.ceil((a[0] - slack - at) / (2 * np.pi))
    return np.asarray(at + 2 * np.pi * first <= a[1] + slack)


def _wave(
    function: Callable[[Array], Array], highest: float
) -> Callable[[Interval], Interval]:
    """Return the interval form of sin or cos, which is highest at an angle."""

    def enclosed(a: Interval) -> Interval:
        ends = function(a[0]), function(a[1])
        low, high = _outward(np.minimum(*ends), np.maximum(*ends), FUNCTION_WIDER)
        far = ~(np.maximum(np.abs(a[0]), np.abs(a[1])) < 1 / PERIOD_SLACK)
        low = np.where(far | _turns(a, highest - np.pi), -1.0, np.maximum(low, -1.0))
        high = np.where(far | _turns(a, highest), 1.0, np.minimum(high, 1.0))
        return _whole(~(a[0] <= a[1]), (low, high))

    return enclosed


def _tangent(a: Interval) -> Interval:
    """Rises between its poles, pi apart."""
    double = 2 * a[0], 2 * a[1]
    far = ~(np.maximum(np.abs(a[0]), np.abs(a[1])) < 1 / PERIOD_SLACK)
    return _whole(far | _turns(double, np.pi), _rising(np.tan)(a))


def _power(a: Interval, b: Interval) -> Interval:
    """Of a positive base, by exp(b log a); whole numbers are squares and products."""
    exponent = b[0]
    if (b[0] == b[1]).all() and (exponent == exponent[0]).all():
        whole = float(exponent[0])
        if whole.is_integer() and 0 <= whole <= MOST_PRODUCTS:
            return _whole_power(a, int(whole))
    return _whole(a[0] <= 0, _rising(np.exp)(_multiply(b, _logarithm(a))))


def _whole_power(a: Interval, exponent: int) -> Interval:
    result = np.ones_like(a[0]), np.ones_like(a[0])
    for _ in range(exponent // 2):
        result = _multiply(result, _square(a))
    return _multiply(result, a) if exponent % 2 else result


_FORMS: dict[int, Callable[..., Interval]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_NEG: _negate,
    ca.OP_SQ: _square,
    ca.OP_TWICE: _twice,
    ca.OP_INV: _invert,
    ca.OP_FABS: _absolute,
    ca.OP_SQRT: _root,
    ca.OP_SIN: _wave(np.sin, np.pi / 2),
    ca.OP_COS: _wave(np.cos, 0.0),
    ca.OP_TAN: _tangent,
    ca.OP_EXP: _rising(np.exp),
    ca.OP_LOG: _logarithm,
    ca.OP_ATAN: _rising(np.arctan),
    ca.OP_TANH: _rising(np.tanh),
    ca.OP_ADD: _add,
    ca.OP_SUB: _subtract,
    ca.OP_MUL: _multiply,
    ca.OP_DIV: _divide,
    ca.OP_FMIN: _least,
    ca.OP_FMAX: _greatest,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
}
