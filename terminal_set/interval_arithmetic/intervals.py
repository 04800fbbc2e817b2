"""Interval evaluation of a function over blocks of boxes.

An interval [lo, hi] stands for every number in it. A function of boxes returns an
interval that holds the function's value at every point of the box, rounding included.

`interval_function` turns a CasADi function into a program of registers, which one
compiled kernel interprets for all boxes (`interval_kernel.py`). Compiling the code of
each function would take longer than a proof.

The derivatives of fabs, fmin and fmax have the operations sign and <=, which jump. They
are accepted only on request. If a box has points on both sides of the jump, the
interval holds the values of both sides. `smoothness.py` says which conclusions are
valid.

Source: Moore, Kearfott and Cloud (2009), Introduction to Interval Analysis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np

from swarmstart.arguments import FLAG, checked, of_kind
from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.machine_code import done
from swarmstart.tape import (
    Node,
    Tape,
    TapeBuilder,
    UnknownOperationError,
    expanded,
    read_tape,
)
from swarmstart.terminal_set.interval_arithmetic.interval_kernel import (
    BLOCK,
    CODES,
    Codes,
    interpret,
)

JUMPS = frozenset(
    "sign lt le eq ne not and or if_else_zero floor ceil fmod remainder copysign"
    "".split()
)
"""Operations whose value jumps, which their derivatives do not show."""
_PER_CALL, _PER_INTERVAL = 2e5, 4.0
"""Work of an evaluation, in operations of floats, and of an operation of intervals."""
_JUMPS_REASON = (
    "jumps: a proof needs a continuous function (fmin, fmax and fabs are continuous)"
)
_LOADED = ("constant", "input")
"""Kinds of values that are in their registers before the first instruction."""


class IntervalEvaluation(Protocol):
    """A function of boxes, which encloses the values of a function of points."""

    def __call__(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Return lower and upper bounds of the values over boxes, each (outputs, m).

        Args:
            lower: Lower corners of m boxes, shape (inputs, m).
            upper: Upper corners, same shape.
        """


@dataclass(eq=False)
class UnknownIntervalOperationError(SwarmstartError, NotImplementedError):
    """The function has an operation that is not supported in proofs.

    Attributes:
        function: The function's name.
        operation: Name of the operation.
        reason: The reason, as a clause that follows "which".
    """

    function: str
    operation: str
    reason: str = "has no interval form"

    def __str__(self) -> str:
        """Return a message with the operation and the reason."""
        return (
            f"{self.function} has the operation {self.operation}, which {self.reason}"
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Program:
    """A tape with registers in place of values.

    Attributes:
        instructions: Code, target and both arguments' registers, shape (number, 4).
        inputs: Register and entry of the argument, shape (number, 2).
        constants: Registers of the constants, shape (number,), kept for them alone.
        values: Lower and upper ends of the constants, shape (number, 2).
        outputs: The register of each output, shape (number,).
        registers: Number of registers.
    """

    instructions: Codes
    inputs: Codes
    constants: Codes
    values: Array
    outputs: Codes
    registers: int


@checked(function=of_kind(ca.Function, "a casadi.Function"), takes_jumps=FLAG)
def interval_function(
    function: ca.Function, *, takes_jumps: bool = False
) -> IntervalEvaluation:
    """Return a function of one column as a function of boxes.

    Args:
        function: x (n, 1) -> y (k, 1), of SX or of MX that can be expanded; a matrix y
            is flattened column by column.
        takes_jumps: Whether sign and <= are accepted, too, which occur in derivatives
            of fabs, fmin and fmax. If a box has points on both sides of such a jump,
            the interval holds the values of both sides.

    Raises:
        UnknownIntervalOperationError: If it has an operation without interval form, or
            one that jumps and is not accepted.
    """
    tape = expanded_tape(function)
    if not takes_jumps:
        require_no_jumps(tape, function.name())
    return interval_program(tape, function.name())


def expanded_tape(function: ca.Function) -> Tape:
    """Return the tape of a function of SX, or of MX that can be expanded.

    Args:
        function: The function.

    Raises:
        UnknownIntervalOperationError: If an operation is unknown, or the function has
            no tape.
    """
    try:
        return read_tape(expanded(function))
    except UnknownOperationError as error:
        raise _refused(function.name(), error) from error


def require_no_jumps(tape: Tape, name: str) -> None:
    """Validate that a function does not jump.

    Raises:
        UnknownIntervalOperationError: If an operation jumps.
    """
    for node in tape.nodes:
        if node.operation in JUMPS:
            raise UnknownIntervalOperationError(name, node.operation, _JUMPS_REASON)


def interval_program(tape: Tape, name: str) -> IntervalEvaluation:
    """Return the interval evaluation of a tape.

    Args:
        tape: Tape with one input and one output.
        name: Name of its function, for errors.

    Raises:
        UnknownIntervalOperationError: If it has an operation without interval form.
    """
    try:
        program = _program(_reduced(tape))
    except UnknownOperationError as error:
        raise _refused(name, error) from error

    def evaluate(lower: Array, upper: Array) -> tuple[Array, Array]:
        values = np.empty((2, len(program.outputs), lower.shape[1]))
        work = np.empty((program.registers, 2, BLOCK))
        work[program.constants] = program.values[:, :, None]
        done(_PER_CALL + _PER_INTERVAL * len(program.instructions) * lower.shape[1])
        boxes = np.stack([lower, upper])
        with np.errstate(all="ignore"):  # Of the kernel when it is plain Python.
            interpret(
                program.instructions,
                program.inputs,
                program.outputs,
                boxes,
                work,
                values,
            )
        return values[0], values[1]

    return evaluate


def _refused(name: str, error: UnknownOperationError) -> UnknownIntervalOperationError:
    if not error.operation:
        return UnknownIntervalOperationError(name, "call", f"is of matrices: {error}")
    if error.operation in JUMPS:
        return UnknownIntervalOperationError(name, error.operation, _JUMPS_REASON)
    return UnknownIntervalOperationError(name, error.operation)


def _reduced(tape: Tape) -> Tape:
    """Return a tape of the kernel's operations."""
    builder = TapeBuilder()
    return builder.rewritten(
        tape, lambda node, arguments: _applied(builder, node.operation, arguments)
    )


def _applied(builder: TapeBuilder, operation: str, arguments: tuple[int, ...]) -> int:
    """Return the number of an operation's result, as the kernel computes it."""
    if operation == "inv":
        one = builder.number(Node("constant", (), 1.0))
        return builder.apply("div", (one, *arguments))
    if operation == "constpow":
        operation = "pow"
    if operation == "add" and _are_opposite(*(builder.nodes[a] for a in arguments)):
        # In derivatives of fmin and fmax: one of both is true, so this is not 0.
        operation, arguments = "ties", builder.nodes[arguments[0]].arguments
    if operation not in CODES:
        raise UnknownOperationError(f"{operation} has no interval form", operation)
    return builder.apply(operation, arguments)


def _are_opposite(one: Node, other: Node) -> bool:
    """Return whether two values are a <= b and b <= a."""
    return (
        one.operation == other.operation == "le"
        and one.arguments == other.arguments[::-1]
    )


def _program(tape: Tape) -> _Program:
    """Assign a register to every value; it is free again after the value's last use.

    Constants and inputs, which are loaded before the first instruction, keep theirs. A
    result never gets the register of an argument, as the kernel's loops require.
    """
    last = _last_uses(tape)
    register: dict[int, int] = {}
    free: list[int] = []
    count = 0
    rows, inputs, constants = [], [], []
    for number, node in enumerate(tape.nodes):
        is_loaded = node.operation in _LOADED
        if free and not is_loaded:
            register[number] = free.pop()
        else:
            register[number], count = count, count + 1
        if node.operation == "constant":
            constants.append((register[number], node.value))
        elif node.operation == "input":
            inputs.append((register[number], node.arguments[1]))
        else:
            # Of an operation with one argument, both registers are the same.
            used = [register[a] for a in node.arguments]
            rows.append((CODES[node.operation], register[number], used[0], used[-1]))
            free += [register[a] for a in last.get(number, ())]
    (outputs,) = tape.outputs
    return _Program(
        instructions=np.array(rows, dtype=np.int64).reshape(-1, 4),
        inputs=np.array(inputs, dtype=np.int64).reshape(-1, 2),
        constants=np.array([target for target, _ in constants], dtype=np.int64),
        values=np.array([_ends(value) for _, value in constants]).reshape(-1, 2),
        outputs=np.array([register[number] for number in outputs], dtype=np.int64),
        registers=count,
    )


def _ends(value: float) -> tuple[float, float]:
    """Return a constant's interval; the whole line if it is not a number."""
    return (-np.inf, np.inf) if np.isnan(value) else (value, value)


def _last_uses(tape: Tape) -> dict[int, list[int]]:
    """Return for each value the computed values that nothing uses after it."""
    used_last: dict[int, int] = {}
    for number, node in enumerate(tape.nodes):
        if node.operation not in _LOADED:
            used_last.update(dict.fromkeys(node.arguments, number))
    kept = set(tape.outputs[0])
    freed: dict[int, list[int]] = {}
    for value, user in used_last.items():
        if value not in kept and tape.nodes[value].operation not in _LOADED:
            freed.setdefault(user, []).append(value)
    return freed
