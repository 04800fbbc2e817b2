"""Interval evaluation of a function over blocks of boxes.

An interval [lo, hi] stands for every number in it. A function of boxes returns an
interval that holds the function's value at every point of the box, rounding included.

`interval_function` turns a CasADi function into a program of registers, which one
compiled kernel interprets for all boxes (`interval_kernel.py`, which also has the
interval form of each operation). Compiling the code of each function would take longer
than a proof.

Source: Moore, Kearfott and Cloud (2009), Introduction to Interval Analysis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.errors import SwarmstartError
from swarmstart.tape import (
    Node,
    Tape,
    TapeBuilder,
    UnknownOperationError,
    expanded,
    read_tape,
)
from swarmstart.terminal_set.interval_kernel import BLOCK, CODES, Codes, interpret

Array = NDArray[np.float64]

_LOADED = ("constant", "input")
"""What is in its register before the first instruction."""


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


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class _Program:
    """A tape with registers in place of values.

    Attributes:
        instructions: Code, target and both arguments' registers, shape (number, 4).
        inputs: Register and entry of the argument, shape (number, 2).
        constants: Registers of the constants, shape (number,), kept for them alone.
        values: The constants, shape (number,).
        outputs: The register of each output, shape (number,).
        registers: How many there are.
    """

    instructions: Codes
    inputs: Codes
    constants: Codes
    values: Array
    outputs: Codes
    registers: int


def interval_function(function: ca.Function) -> IntervalEvaluation:
    """Return a function of one column as a function of boxes.

    Args:
        function: x (n, 1) -> y (k, 1), of SX or of MX that can be expanded; of a matrix
            y the columns follow each other.

    Raises:
        UnknownIntervalOperationError: If it has an operation without interval form.
    """
    try:
        program = _program(_reduced(read_tape(expanded(function))))
    except UnknownOperationError as error:
        operation = error.operation or str(error)
        raise UnknownIntervalOperationError(function.name(), operation) from error

    def evaluate(lower: Array, upper: Array) -> tuple[Array, Array]:
        values = np.empty((2, len(program.outputs), lower.shape[1]))
        work = np.empty((program.registers, 2, BLOCK))
        work[program.constants] = program.values[:, None, None]
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


def _reduced(tape: Tape) -> Tape:
    """Return a tape of the kernel's operations."""
    builder = TapeBuilder()
    numbers: list[int] = []
    for node in tape.nodes:
        if node.operation in _LOADED:
            numbers.append(builder.number(node))
            continue
        arguments = tuple(numbers[a] for a in node.arguments)
        numbers.append(_applied(builder, node.operation, arguments))
    outputs = [[numbers[number] for number in output] for output in tape.outputs]
    return builder.tape(outputs, tape.inputs)


def _applied(builder: TapeBuilder, operation: str, arguments: tuple[int, ...]) -> int:
    """Return the number of an operation's result, as the kernel computes it."""
    if operation == "inv":
        one = builder.number(Node("constant", (), 1.0))
        return builder.apply("div", (one, *arguments))
    if operation == "constpow":
        operation = "pow"
    if operation not in CODES:
        raise UnknownOperationError(f"{operation} has no interval form", operation)
    return builder.apply(operation, arguments)


def _program(tape: Tape) -> _Program:
    """Give every value a register; one is free again after its value's last use.

    Constants and inputs, which are loaded before the first instruction, keep theirs. A
    result never gets the register of an argument: the kernel's loops rely on it.
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
            used = [register[a] for a in node.arguments]
            rows.append((CODES[node.operation], register[number], used[0], used[-1]))
            free += [register[a] for a in last.get(number, ())]
    (outputs,) = tape.outputs
    return _Program(
        instructions=np.array(rows, dtype=np.int64).reshape(-1, 4),
        inputs=np.array(inputs, dtype=np.int64).reshape(-1, 2),
        constants=np.array([target for target, _ in constants], dtype=np.int64),
        values=np.array([value for _, value in constants]),
        outputs=np.array([register[number] for number in outputs], dtype=np.int64),
        registers=count,
    )


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
