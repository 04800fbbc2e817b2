"""Evaluation of a tape with Taylor models, elementary functions included.

A tape is a list of instructions, of which each computes a value from earlier values.
The same functions evaluate models of values, and values along rays (`rays.py`): each
elementary function returns its Taylor series about a number (`models.Series`).

NumPy's exp, log, sqrt, sin, cos and arctan are assumed to be right to 16 units in the
last place of the result's size (of 1 for sin and cos, so that cancellation does not
matter).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, TypeVar, cast

import numpy as np

from swarmstart.terminal_set.checker.findings import NEVER, Deadline
from swarmstart.terminal_set.checker.models import (
    ELEMENTARY,
    GROWTH,
    ORDER,
    Array,
    Model,
    Series,
)
from swarmstart.terminal_set.checker.rays import Along

_FARTHEST_ANGLE = 1e6
_STEPS_A_LOOK = 32  # instructions between looks at the clock
_LARGEST_WHOLE = 64  # exponents up to here are products, others exp(b log a)

Enclosure = TypeVar("Enclosure", Model, Along)
Value = Model | Along | Fraction
"""A value over boxes: models, or one number for all boxes."""


def _series(factors: list[Array], last: Array) -> Series:
    # The remainder's own rounding is far below this share of it.
    sizes = [np.abs(factor) for factor in factors]
    return Series(factors, last * (1.0 + ELEMENTARY), sizes)


def _least_size(a: Model) -> Array:
    """Lower bound of |a| over the box; NaN if 0 may be in it."""
    least = np.maximum(a.lower, -a.upper)
    return np.where(least > 0.0, least, np.nan)


def _positive(a: Model) -> Array:
    """Lower bound of a over the box; NaN if it may reach 0."""
    low = a.lower
    return np.where(low > 0.0, low, np.nan)


def _inverse(at: Array, a: Model) -> Series:
    r = 1.0 / at
    # |g^(4)| / 4! is largest at the end of the box that is nearest to 0.
    return _series([r, -(r**2), r**3, -(r**4)], 1.0 / _least_size(a) ** 5)


def _exponential(at: Array, a: Model) -> Series:
    e = np.exp(at)
    return _series([e, e, e / 2.0, e / 6.0], np.exp(a.upper) / 24.0)


def _logarithm(at: Array, a: Model) -> Series:
    low, r = _positive(a), 1.0 / at
    factors = [np.log(at), r, -(r**2) / 2.0, r**3 / 3.0]
    return _series(factors, 1.0 / (4.0 * low**4))


def _root(at: Array, a: Model) -> Series:
    low, y = _positive(a), np.sqrt(at)
    r = 1.0 / at
    factors = [y, y * r / 2.0, -y * r**2 / 8.0, y * r**3 / 16.0]
    return _series(factors, 5.0 / 128.0 / (low**3 * np.sqrt(low)))


def _angles(at: Array, turns: int) -> Series:
    sine, cosine = np.sin(at), np.cos(at)
    cycle = [sine, cosine, -sine, -cosine, sine]
    scales = (1.0, 1.0, 2.0, 6.0)
    # Beyond it, neither the spacing of floats nor the library's reduction is reliable:
    # only that values and slopes are within [-1, 1].
    near = np.abs(at) <= _FARTHEST_ANGLE
    factors = [
        np.where(near, cycle[turns + k] / scales[k], 0.0) for k in range(ORDER + 1)
    ]
    one = np.where(near, 1.0, 0.0)
    unknown = np.where(near, 1.0, 1.0 / ELEMENTARY)
    # |g^(4)| <= 1, over 4!.
    return Series(factors, one / 24.0 * GROWTH, [unknown, unknown, one, one])


def _arctangent(x: Array, a: Model) -> Series:
    """The series of atan; |atan^(n)| <= (n - 1)!."""
    w = 1.0 / (1.0 + x * x)
    factors = [np.arctan(x), w, -x * w**2, (3.0 * x * x - 1.0) * w**3 / 3.0]
    sizes = [np.abs(factor) for factor in factors[:ORDER]]
    sizes.append((3.0 * x * x + 1.0) * w**3)  # its difference may cancel
    return Series(factors, np.full_like(x, 0.25), sizes)  # 3! / 4!.


def inverse(a: Enclosure) -> Enclosure:
    """Return 1/a."""
    return a.composed(_inverse)


def exponential(a: Enclosure) -> Enclosure:
    """Return e^a."""
    return a.composed(_exponential)


def logarithm(a: Enclosure) -> Enclosure:
    """Return log(a)."""
    return a.composed(_logarithm)


def root(a: Enclosure) -> Enclosure:
    """Return sqrt(a), for a > 0 over the box."""
    return a.composed(_root)


def sine(a: Enclosure) -> Enclosure:
    """Return sin(a)."""
    return a.composed(lambda at, _: _angles(at, 0))


def cosine(a: Enclosure) -> Enclosure:
    """Return cos(a)."""
    return a.composed(lambda at, _: _angles(at, 1))


def hyperbolic_tangent(a: Enclosure) -> Enclosure:
    """Return tanh(a) = sign (1 - p) / (1 + p) with p = e^(-2 sign a).

    The sign, 1 or -1, is that of a at the middle of each box, so that p stays small.
    """
    sign = np.where(a.middle > 0.0, -1.0, 1.0)
    e = exponential(a.scaled(2.0 * sign))
    return ((e.shifted(-1.0)) * inverse(e.shifted(1.0))).scaled(sign)


def power(a: Enclosure, b: Enclosure | float) -> Enclosure:
    """Return a^b; by products if b is a constant whole number."""
    if not isinstance(b, float):
        return exponential(b * logarithm(a))
    if b == int(b) and abs(b) <= _LARGEST_WHOLE:
        raised = _whole_power(a, int(abs(b)))
        return inverse(raised) if b < 0 else raised
    if b == 0.5:  # noqa: PLR2004
        return root(a)
    return exponential(logarithm(a).scaled(b))


def _whole_power(a: Enclosure, n: int) -> Enclosure:
    if n == 0:
        return a.number(1.0)
    half = _whole_power(a, n // 2) if n > 1 else None
    squared = a if half is None else half * half
    return squared * a if n > 1 and n % 2 else squared


def _halves(a: Enclosure, b: Enclosure, sign: float) -> Enclosure:
    return (a + b + (a - b).absolute().scaled(sign)).scaled(0.5)


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a * inverse(b),
    "pow": power,
    "fmin": lambda a, b: _halves(a, b, -1.0),
    "fmax": lambda a, b: _halves(a, b, 1.0),
    "neg": lambda a: -a,
    "sq": lambda a: a * a,
    "twice": lambda a: a.scaled(2.0),
    "inv": inverse,
    "fabs": lambda a: a.absolute(),
    "sqrt": root,
    "sin": sine,
    "cos": cosine,
    "tan": lambda a: sine(a) * inverse(cosine(a)),
    "exp": exponential,
    "log": logarithm,
    "atan": lambda a: a.composed(_arctangent),
    "tanh": hyperbolic_tangent,
}
"""Name of an operation on a tape -> the function of models."""


@dataclass(frozen=True, slots=True)
class Node:
    """One value of a tape.

    Attributes:
        operation: "const", "point" or a tape's operation.
        operands: Indices of earlier values; for "point" the index of the variable.
        value: Value of a constant.
    """

    operation: str
    operands: tuple[int, ...] = ()
    value: Fraction = Fraction(0)


class Program:
    """The instructions that some wanted values need, in order.

    Attributes:
        outputs: Indices of the wanted values, in the order given, with repetitions.
        wanted: The same indices, each once.
        points: Indices of the variables on which the wanted values depend.
    """

    def __init__(
        self,
        nodes: Sequence[Node],
        wanted: Iterable[int],
        deadline: Deadline = NEVER,
    ) -> None:
        """Select the instructions that the wanted values need."""
        self.outputs = tuple(wanted)
        self.wanted, self._deadline = frozenset(self.outputs), deadline
        needed = set(self.wanted)
        for number in range(len(nodes) - 1, -1, -1):
            if number in needed and nodes[number].operation != "point":
                needed.update(nodes[number].operands)
        self.steps = [(number, nodes[number]) for number in sorted(needed)]
        self.points = frozenset(
            node.operands[0] for _, node in self.steps if node.operation == "point"
        )
        last: dict[int, int] = {}
        for number, node in self.steps:
            if node.operation != "point":
                last |= dict.fromkeys(node.operands, number)
        # Models of many boxes are large: each is dropped after its last use.
        self._done: dict[int, list[int]] = {}
        for operand, number in last.items():
            if operand not in self.wanted:
                self._done.setdefault(number, []).append(operand)

    def __call__(
        self,
        variables: Sequence[Any],
        applied: Callable[[str, list[Any]], Any] | None = None,
    ) -> dict[int, Any]:
        """Evaluate the wanted values.

        Args:
            variables: The variables: Taylor models, or values of another type.
            applied: Function (operation, its operands) -> the result, for values of
                another type; some operands may be fractions. None for Taylor models.

        Returns:
            Index of a wanted value -> the value.

        Raises:
            TimeIsUpError: If the deadline has passed.
        """
        values: dict[int, Any] = {}
        for place, (number, node) in enumerate(self.steps):
            # An instruction takes up to some milliseconds, for all boxes together.
            if place % _STEPS_A_LOOK == 0:
                self._deadline.check()
            if node.operation == "const":
                values[number] = node.value
            elif node.operation == "point":
                values[number] = variables[node.operands[0]]
            else:
                operands = [values[operand] for operand in node.operands]
                values[number] = (
                    _applied(node.operation, operands, variables[0])
                    if applied is None
                    else applied(node.operation, operands)
                )
            for operand in self._done.get(number, ()):
                values.pop(operand, None)
        return {number: values[number] for number in self.wanted}


def rounded(number: Fraction) -> tuple[float, float]:
    """Return the nearest float and an upper bound of its distance."""
    try:
        near = float(number)
    except OverflowError:
        return math.nan, math.nan  # Nothing is known, so nothing is proven.
    off = abs(number - Fraction(near))
    return near, math.nextafter(float(off), math.inf) if off else 0.0


def as_model(value: Value, like: Enclosure) -> Enclosure:
    """Return a value as models over the boxes of the models `like`."""
    if isinstance(value, Fraction):
        return like.number(*rounded(value))
    return cast("Enclosure", value)


def times(a: Value, b: Value) -> Value:
    """Return the product of two values."""
    if isinstance(a, Fraction):
        a, b = b, a
    if isinstance(b, Fraction):
        return a * b if isinstance(a, Fraction) else a.scaled(*rounded(b))
    return a * b  # type: ignore[operator]


def plus(a: Value, b: Value) -> Value:
    """Return the sum of two values."""
    if isinstance(a, Fraction):
        a, b = b, a
    if isinstance(b, Fraction):
        return a + b if isinstance(a, Fraction) else a.shifted(*rounded(b))
    return a + b  # type: ignore[operator]


def _applied(operation: str, operands: list[Value], like: Enclosure) -> Value:
    first, last = operands[0], operands[-1]
    if operation == "mul":
        return times(first, last)
    if operation == "add" or (operation == "sub" and isinstance(last, Fraction)):
        return plus(first, last if operation == "add" else -last)
    if operation == "div" and isinstance(first, Fraction):
        return times(inverse(as_model(last, like)), first)
    if operation == "div" and isinstance(last, Fraction) and last:
        return times(first, 1 / last)
    models = [as_model(operand, like) for operand in operands]
    if operation == "pow" and isinstance(operands[1], Fraction):
        exponent, error = rounded(operands[1])
        if error == 0.0:
            return power(models[0], exponent)
    return cast("Value", FUNCTIONS[operation](*models))
