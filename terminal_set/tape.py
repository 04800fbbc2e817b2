"""A model's right-hand side as data: instructions that anybody can evaluate.

A list [operation, operands...], one a value, whose number is its index:

    ["const", 9.81]  ["x", 0]  ["u", 1]  ["sin", 3]  ["mul", 0, 4]

Operands are numbers of earlier values. The operations are those of `OPERATIONS`.
"""

from __future__ import annotations

import casadi as ca

from swarmstart.tape import Node
from swarmstart.terminal_set.intervals import (
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
    """Return a function's instructions, and which values are its results.

    Args:
        dynamics: f(x, u) -> xdot, of SX or of MX that can be expanded.

    Returns:
        The instructions; the number of the value of each entry of xdot.

    Raises:
        UnknownIntervalOperationError: It has an operation that is not in OPERATIONS.
    """
    tape = expanded_tape(dynamics)
    instructions = [_instruction(node, dynamics.name()) for node in tape.nodes]
    return instructions, list(tape.outputs[0])


def _instruction(node: Node, function: str) -> Instruction:
    """Return a value as a file has it."""
    if node.operation == "constant":
        return ["const", node.value]
    if node.operation == "input":
        argument, entry = node.arguments
        return [("x", "u")[argument], entry]
    if node.operation not in OPERATIONS:
        reason = "a certificate's file cannot hold"
        raise UnknownIntervalOperationError(function, node.operation, reason)
    return [OPERATIONS[node.operation], *node.arguments]
