"""A tape without controls, evaluated with Taylor models."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction

from swarmstart.ocp.lower_bound.checker.controls import Node
from swarmstart.ocp.lower_bound.checker.functions import FUNCTIONS, inverse, power
from swarmstart.ocp.lower_bound.checker.models import Model

Value = Model | Fraction
"""A value over boxes: models, or one number for all boxes."""


class Program:
    """The instructions that some wanted values need, in order.

    Attributes:
        wanted: Numbers of the wanted values.
    """

    def __init__(self, nodes: Sequence[Node], wanted: Iterable[int]) -> None:
        """Select the instructions that the wanted values need.

        Args:
            nodes: The tape.
            wanted: Numbers of the wanted values.
        """
        self.wanted = frozenset(wanted)
        needed = set(self.wanted)
        for number in range(len(nodes) - 1, -1, -1):
            if number in needed and nodes[number].operation != "point":
                needed.update(nodes[number].operands)
        self._steps = [(number, nodes[number]) for number in sorted(needed)]
        last: dict[int, int] = {}
        for number, node in self._steps:
            if node.operation != "point":
                last |= dict.fromkeys(node.operands, number)
        self._done: dict[int, list[int]] = {}
        for operand, number in last.items():
            if operand not in self.wanted:
                self._done.setdefault(number, []).append(operand)

    def __call__(self, variables: Sequence[Model]) -> dict[int, Value]:
        """Evaluate the wanted values.

        Args:
            variables: Models of t, x and the boxed controls.

        Returns:
            Number of a wanted value -> the value.
        """
        values: dict[int, Value] = {}
        for number, node in self._steps:
            if node.operation == "const":
                values[number] = node.value
            elif node.operation == "point":
                values[number] = variables[node.operands[0]]
            else:
                operands = [values[operand] for operand in node.operands]
                values[number] = _applied(node.operation, operands, variables[0])
            for operand in self._done.get(number, ()):
                values.pop(operand, None)
        return {number: values[number] for number in self.wanted}


def rounded(number: Fraction) -> tuple[float, float]:
    """Return the nearest float and an upper bound of its distance."""
    try:
        near = float(number)
    except OverflowError:
        return math.nan, math.nan
    return near, math.nextafter(float(abs(number - Fraction(near))), math.inf)


def as_model(value: Value, like: Model) -> Model:
    """Return a value as models over the same boxes as another."""
    if isinstance(value, Model):
        return value
    near, error = rounded(value)
    return like.algebra.constant(0.0 * like.error + near, error)


def times(a: Value, b: Value, like: Model) -> Value:
    """Return a product."""
    if isinstance(a, Fraction):
        a, b = b, a
    if isinstance(a, Fraction) and isinstance(b, Fraction):
        return a * b
    if isinstance(a, Model) and isinstance(b, Model):
        return a * b
    if isinstance(a, Model) and isinstance(b, Fraction):
        factor, error = rounded(b)
        scaled = a.scaled(factor)
        return scaled.widened((a.size + a.error) * error) if error > 0.0 else scaled
    raise TypeError


def plus(a: Value, b: Value) -> Value:
    """Return a sum."""
    if isinstance(a, Fraction):
        a, b = b, a
    if isinstance(a, Model):
        return a + b if isinstance(b, Model) else a.shifted(*rounded(b))
    return a + b  # type: ignore[operator]


def _applied(operation: str, operands: list[Value], like: Model) -> Value:
    first, last = operands[0], operands[-1]
    if operation == "mul":
        return times(first, last, like)
    if operation == "add" or (operation == "sub" and isinstance(last, Fraction)):
        return plus(first, last if operation == "add" else -last)
    if operation == "div" and isinstance(first, Fraction):
        return times(inverse(as_model(last, like)), first, like)
    if operation == "div" and isinstance(last, Fraction) and last:
        return times(first, 1 / last, like)
    models = [as_model(operand, like) for operand in operands]
    if operation == "pow" and isinstance(operands[1], Fraction):
        exponent, error = rounded(operands[1])
        if operands[1] == Fraction(exponent) and error < 1e-300:  # noqa: PLR2004
            return power(models[0], exponent)
    return FUNCTIONS[operation](*models)
