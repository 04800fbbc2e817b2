"""A model's right-hand side as data: instructions that anybody can evaluate.

A list [operation, operands...], one a value, whose number is its index:

    ["const", 9.81]  ["x", 0]  ["u", 1]  ["sin", 3]  ["mul", 0, 4]

Operands are numbers of earlier values. The operations are those of `OPERATIONS`.
"""

from __future__ import annotations

import casadi as ca

from swarmstart.terminal_set.intervals import (
    UnknownIntervalOperationError,
    operation_name,
)

Instruction = list[str | int | float]

OPERATIONS: dict[int, str] = {
    getattr(ca, f"OP_{name.upper()}"): name
    for name in (
        "add sub mul div pow fmin fmax neg sq twice inv fabs sqrt sin cos tan exp log "
        "atan tanh"
    ).split()
} | {ca.OP_CONSTPOW: "pow"}


def tape_of(dynamics: ca.Function) -> tuple[list[Instruction], list[int]]:
    """Return a function's instructions, and which values are its results.

    Args:
        dynamics: f(x, u) -> xdot, of SX or of MX that can be expanded.

    Returns:
        The instructions; the number of the value of each entry of xdot.

    Raises:
        UnknownIntervalOperationError: It has an operation that is not in OPERATIONS.
    """
    function = dynamics if dynamics.is_a("SXFunction") else dynamics.expand()
    tape: list[Instruction] = []
    work: dict[int, int] = {}
    names = ("x", "u")
    taken = [function.sparsity_in(argument).find() for argument in range(2)]
    given, results = function.sparsity_out(0).find(), {}
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_OUTPUT:
            results[given[target[1]]] = work[source[0]]
            continue
        if code == ca.OP_INPUT:
            tape.append([names[source[0]], int(taken[source[0]][source[1]])])
        elif code == ca.OP_CONST:
            tape.append(["const", float(function.instruction_constant(k))])
        elif code in OPERATIONS:
            tape.append([OPERATIONS[code], *[work[operand] for operand in source]])
        else:
            raise UnknownIntervalOperationError(function.name(), operation_name(code))
        work[target[0]] = len(tape) - 1
    if len(results) < function.numel_out(0):
        tape.append(["const", 0.0])  # Of the entries that are zero by structure.
    zero = len(tape) - 1
    return tape, [results.get(entry, zero) for entry in range(function.numel_out(0))]
