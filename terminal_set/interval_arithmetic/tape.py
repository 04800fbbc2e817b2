"""A model's right-hand side as data: instructions that any program can evaluate.

Each value is a list [operation, operands...], and its number is the list's index:

    ["const", 9.81]  ["x", 0]  ["u", 1]  ["sin", 3]  ["mul", 0, 4]

Operands are numbers of earlier values. There are only a few operations (`OPERATIONS`),
so that a checker stays small; others are expressed in them by identities that are exact
at all points at which the operation is smooth:

    sinh, cosh   (e^a -+ e^-a) / 2          asinh   log(a + sqrt(a^2 + 1))
    expm1        e^a - 1                    acosh   log(a + sqrt(a^2 - 1))
    log1p        log(1 + a)                 atanh   log((1 + a) / (1 - a)) / 2
    asin         atan(a / sqrt(1 - a^2))    hypot   sqrt(a^2 + b^2)
    acos         2 atan(sqrt((1 - a) / (1 + a)))
    atan2        2 atan(a / (sqrt(a^2 + b^2) + b))
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from swarmstart.tape import Node, TapeBuilder
from swarmstart.terminal_set.interval_arithmetic.intervals import (
    UnknownIntervalOperationError,
    expanded_tape,
)

Instruction = list[str | int | float]

OPERATIONS: dict[str, str] = {
    name: name
    for name in (
        "add sub mul div pow fmin fmax neg sq twice inv fabs sqrt sin cos tan exp log "
        "atan tanh"
    ).split()
} | {"constpow": "pow"}
"""CasADi's name of an operation -> its name in a file."""


def tape_of(dynamics: ca.Function) -> tuple[list[Instruction], list[int]]:
    """Return a function's instructions, and the indices of those for its results.

    Args:
        dynamics: f(x, u) -> xdot, of SX or of MX that can be expanded.

    Returns:
        The instructions; for each entry of xdot the index of its instruction.

    Raises:
        UnknownIntervalOperationError: If it has an operation that a file cannot hold.
    """
    writer = _Writer()

    def write(node: Node, operands: tuple[int, ...]) -> int:
        if node.operation in OPERATIONS:
            return writer.apply(OPERATIONS[node.operation], *operands)
        if node.operation in _IDENTITIES:
            return _IDENTITIES[node.operation](writer, *operands)
        reason = "a certificate's file cannot hold"
        raise UnknownIntervalOperationError(dynamics.name(), node.operation, reason)

    written = writer.builder.rewritten(expanded_tape(dynamics), write)
    return [_instruction(node) for node in written.nodes], list(written.outputs[0])


class _Writer:
    """Writer of values that writes equal ones only once."""

    def __init__(self) -> None:
        """Begin an empty tape."""
        self.builder = TapeBuilder()

    def constant(self, value: float) -> int:
        """Return the index of the instruction for a constant, added if it is new."""
        return self.builder.number(Node("constant", (), value))

    def apply(self, operation: str, *operands: int) -> int:
        """Return the index of the instruction for an operation, added if it is new."""
        return self.builder.apply(operation, operands)


def _hyperbolic(operation: str) -> Callable[[_Writer, int], int]:
    """Return a writer of (e^a +- e^-a) / 2."""

    def written(write: _Writer, a: int) -> int:
        e = write.apply("exp", a)
        both = write.apply(operation, e, write.apply("inv", e))
        return write.apply("mul", write.constant(0.5), both)

    return written


def _area(operation: str) -> Callable[[_Writer, int], int]:
    """Return a writer of log(a + sqrt(a^2 +- 1))."""

    def written(write: _Writer, a: int) -> int:
        square = write.apply(operation, write.apply("sq", a), write.constant(1.0))
        return write.apply("log", write.apply("add", a, write.apply("sqrt", square)))

    return written


def _atanh(write: _Writer, a: int) -> int:
    one = write.constant(1.0)
    above, below = write.apply("add", one, a), write.apply("sub", one, a)
    double = write.apply("log", write.apply("div", above, below))
    return write.apply("mul", write.constant(0.5), double)


def _asin(write: _Writer, a: int) -> int:
    other = write.apply("sub", write.constant(1.0), write.apply("sq", a))
    return write.apply("atan", write.apply("div", a, write.apply("sqrt", other)))


def _acos(write: _Writer, a: int) -> int:
    one = write.constant(1.0)
    above, below = write.apply("add", one, a), write.apply("sub", one, a)
    tangent = write.apply("sqrt", write.apply("div", below, above))
    return write.apply("twice", write.apply("atan", tangent))


def _hypot(write: _Writer, a: int, b: int) -> int:
    squares = write.apply("add", write.apply("sq", a), write.apply("sq", b))
    return write.apply("sqrt", squares)


def _atan2(write: _Writer, a: int, b: int) -> int:
    below = write.apply("add", _hypot(write, a, b), b)
    return write.apply("twice", write.apply("atan", write.apply("div", a, below)))


_IDENTITIES: dict[str, Callable[..., int]] = {
    "sinh": _hyperbolic("sub"),
    "cosh": _hyperbolic("add"),
    "expm1": lambda write, a: write.apply(
        "sub", write.apply("exp", a), write.constant(1.0)
    ),
    "log1p": lambda write, a: write.apply(
        "log", write.apply("add", write.constant(1.0), a)
    ),
    "asinh": _area("add"),
    "acosh": _area("sub"),
    "atanh": _atanh,
    "asin": _asin,
    "acos": _acos,
    "hypot": _hypot,
    "atan2": _atan2,
}


def _instruction(node: Node) -> Instruction:
    """Return a value in the file's form."""
    if node.operation == "constant":
        return ["const", node.value]
    if node.operation == "input":
        argument, entry = node.arguments
        return [("x", "u")[argument], entry]
    return [node.operation, *node.arguments]
