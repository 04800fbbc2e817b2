"""Interval evaluation by a compiled interpreter: one instruction, a block of boxes.

What `terminal_set.intervals` does in NumPy, an instruction at a time for all boxes, is
done here for BLOCK boxes whose values all stay in the cache. One kernel, compiled once,
interprets any tape: compiling the code of each function takes longer than a proof.

An end is moved outwards by |end| WIDER + SMALLEST instead of to the next number: that
holds rounding to nearest and the move's own rounding, and takes no branch. Functions of
the C library are off by 1 unit in the last place (glibc) to 4; FUNCTION_WIDER holds 4.
What is undefined in a box, or no number, is the whole line.
"""

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.kernel import ieee_kernel
from swarmstart.ocp.compiled.tape import (
    Node,
    Tape,
    TapeBuilder,
    UnknownOperationError,
    read_tape,
)
from swarmstart.terminal_set.intervals import (
    FUNCTION_WIDER,
    MOST_PRODUCTS,
    PERIOD_SLACK,
    SMALLEST,
    WIDER,
    IntervalEvaluation,
    UnknownIntervalOperationError,
)

Array = NDArray[np.float64]
Codes = NDArray[np.int64]

BLOCK = 256
_LOADED = ("constant", "input")
"""What is in its register before the first instruction."""
_OPERATIONS = (
    "add sub mul div pow fmin fmax neg sq twice fabs sqrt sin cos tan exp log atan tanh"
).split()
_CODES = {name: code for code, name in enumerate(_OPERATIONS)}
(
    _ADD, _SUB, _MUL, _DIV, _POW, _FMIN, _FMAX, _NEG, _SQ, _TWICE, _FABS, _SQRT,
    _SIN, _COS, _TAN, _EXP, _LOG, _ATAN, _TANH,
) = range(len(_OPERATIONS))  # fmt: skip


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


def compiled_intervals(function: ca.Function) -> IntervalEvaluation:
    """Return an SX function of one column as a function of boxes.

    Args:
        function: x (n, 1) -> y (k, 1); of a matrix y the columns follow each other.

    Raises:
        UnknownIntervalOperationError: If it has an operation without interval form.
    """
    expanded = function if function.is_a("SXFunction") else function.expand()
    try:
        program = _program(_reduced(read_tape(expanded)))
    except UnknownOperationError as error:
        raise UnknownIntervalOperationError(function.name(), str(error)) from error

    def evaluate(lower: Array, upper: Array) -> tuple[Array, Array]:
        values = np.empty((2, len(program.outputs), lower.shape[1]))
        work = np.empty((program.registers, 2, BLOCK))
        work[program.constants] = program.values[:, None, None]
        boxes = np.stack([lower, upper])
        _interpret(
            program.instructions, program.inputs, program.outputs, boxes, work, values
        )
        return values[0], values[1]

    return evaluate


def _reduced(tape: Tape) -> Tape:
    """Return a tape whose whole powers and inverses are products and quotients."""
    builder = TapeBuilder()
    numbers: list[int] = []
    for node in tape.nodes:
        if node.operation in _LOADED:
            numbers.append(builder.number(node))
            continue
        arguments = tuple(numbers[a] for a in node.arguments)
        if node.operation in ("pow", "constpow"):
            numbers.append(_power(builder, *arguments))
        elif node.operation == "inv":
            one = builder.number(Node("constant", (), 1.0))
            numbers.append(builder.apply("div", (one, *arguments)))
        elif node.operation in _CODES:
            numbers.append(builder.apply(node.operation, arguments))
        else:
            raise UnknownOperationError(node.operation)
    outputs = [[numbers[number] for number in output] for output in tape.outputs]
    return builder.tape(outputs, tape.inputs)


def _power(builder: TapeBuilder, base: int, exponent: int) -> int:
    """Return the number of a power, by squares where the exponent is a whole number."""
    node = builder.nodes[exponent]
    if node.operation == "constant" and node.value.is_integer():
        whole = int(node.value)
        if 0 <= whole <= MOST_PRODUCTS:
            return _whole_power(builder, base, whole)
    return builder.apply("pow", (base, exponent))


def _whole_power(builder: TapeBuilder, base: int, exponent: int) -> int:
    if exponent == 0:
        return builder.number(Node("constant", (), 1.0))
    if exponent == 1:
        return base
    if exponent % 2:
        even = _whole_power(builder, base, exponent - 1)
        return builder.apply("mul", (even, base))
    half = _whole_power(builder, base, exponent // 2)
    return builder.apply("sq", (half,))


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
            rows.append((_CODES[node.operation], register[number], used[0], used[-1]))
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


@ieee_kernel
def _interpret(
    instructions: Codes,
    inputs: Codes,
    outputs: Codes,
    boxes: Array,
    work: Array,
    values: Array,
) -> None:
    """Evaluate all boxes, a block at a time.

    Args:
        instructions: See `_Program`, like the two after it.
        inputs: Registers and entries.
        outputs: Registers.
        boxes: Lower and upper corners, shape (2, inputs, m).
        work: The registers, shape (registers, 2, BLOCK), constants in place.
        values: Where the enclosures go, shape (2, outputs, m).
    """
    total = boxes.shape[2]
    for begin in range(0, total, BLOCK):
        count = min(BLOCK, total - begin)
        for i in range(inputs.shape[0]):
            register, entry = inputs[i]
            for k in range(BLOCK):
                box = begin + min(k, count - 1)
                work[register, 0, k] = boxes[0, entry, box]
                work[register, 1, k] = boxes[1, entry, box]
        for i in range(instructions.shape[0]):
            code, target, first, second = instructions[i]
            if code < _NEG:
                _apply_two(code, work[first], work[second], work[target])
            else:
                _apply_one(code, work[first], work[target])
        for i in range(outputs.shape[0]):
            for k in range(count):
                values[0, i, begin + k] = work[outputs[i], 0, k]
                values[1, i, begin + k] = work[outputs[i], 1, k]


@ieee_kernel
def _apply_two(code: int, x: Array, y: Array, out: Array) -> None:
    """Put an operation of x and y, intervals of BLOCK boxes, (2, BLOCK), in out."""
    if code == _ADD:
        for k in range(BLOCK):
            out[0, k], out[1, k] = _outward(x[0, k] + y[0, k], x[1, k] + y[1, k], WIDER)
    elif code == _SUB:
        for k in range(BLOCK):
            out[0, k], out[1, k] = _outward(x[0, k] - y[1, k], x[1, k] - y[0, k], WIDER)
    elif code == _MUL:
        _multiply(x, y, out)
    elif code == _DIV:
        _divide(x, y, out)
    elif code == _POW:
        _raise(x, y, out)
    else:
        _extreme(code, x, y, out)


@ieee_kernel
def _multiply(x: Array, y: Array, out: Array) -> None:
    for k in range(BLOCK):
        a, b, c, d = x[0, k], x[1, k], y[0, k], y[1, k]
        out[0, k], out[1, k] = _hull(a * c, a * d, b * c, b * d)


@ieee_kernel
def _divide(x: Array, y: Array, out: Array) -> None:
    for k in range(BLOCK):
        a, b, c, d = x[0, k], x[1, k], y[0, k], y[1, k]
        low, high = _hull(a / c, a / d, b / c, b / d)
        through_zero = (c <= 0.0) & (d >= 0.0)
        out[0, k] = -np.inf if through_zero else low
        out[1, k] = np.inf if through_zero else high


@ieee_kernel
def _raise(x: Array, y: Array, out: Array) -> None:
    """Put x to the power of y, exp(y log x), in out."""
    for k in range(BLOCK):
        a, b, c, d = x[0, k], x[1, k], y[0, k], y[1, k]
        low, high = -np.inf, np.inf
        if a > 0.0:
            s, t = _function(_LOG, a, b)
            u, v = _hull(c * s, c * t, d * s, d * t)
            low, high = _function(_EXP, u, v)
        out[0, k], out[1, k] = low, high


@ieee_kernel
def _extreme(code: int, x: Array, y: Array, out: Array) -> None:
    """Put the smaller or the larger of x and y in out."""
    for side in range(2):
        for k in range(BLOCK):
            a, b = x[side, k], y[side, k]
            out[side, k] = min(a, b) if code == _FMIN else max(a, b)


@ieee_kernel
def _apply_one(code: int, x: Array, out: Array) -> None:
    """Put an operation of x, intervals of BLOCK boxes, (2, BLOCK), in out."""
    if code == _NEG:
        for k in range(BLOCK):
            out[0, k], out[1, k] = -x[1, k], -x[0, k]
    elif code == _TWICE:
        for k in range(BLOCK):
            out[0, k], out[1, k] = _outward(2.0 * x[0, k], 2.0 * x[1, k], WIDER)
    elif code in (_SQ, _FABS):
        _size(code, x, out)
    else:
        for k in range(BLOCK):
            out[0, k], out[1, k] = _function(code, x[0, k], x[1, k])


@ieee_kernel
def _size(code: int, x: Array, out: Array) -> None:
    """Put the absolute value of x, or its square, in out."""
    for k in range(BLOCK):
        least = max(x[0, k], -x[1, k], 0.0)
        most = max(-x[0, k], x[1, k])
        if code == _SQ:
            low, high = _outward(least * least, most * most, WIDER)
            out[0, k], out[1, k] = max(low, 0.0), high
        else:
            out[0, k], out[1, k] = least, most


@ieee_kernel
def _function(code: int, a: float, b: float) -> tuple[float, float]:
    """Return the interval of an elementary function."""
    low, high = -np.inf, np.inf
    if code in (_SIN, _COS):
        return _wave(code, a, b)
    if code == _EXP:
        low, high = _outward(np.exp(a), np.exp(b), FUNCTION_WIDER)
        return max(low, 0.0), high
    if code == _SQRT and a >= 0.0:
        low, high = _outward(math.sqrt(a), math.sqrt(b), WIDER)
        return max(low, 0.0), high
    if code == _LOG and a > 0.0:
        low, high = math.log(a), math.log(b)
    elif code == _ATAN:
        low, high = math.atan(a), math.atan(b)
    elif code == _TANH:
        low, high = math.tanh(a), math.tanh(b)
    elif code == _TAN and not _turns(2.0 * a, 2.0 * b, np.pi):
        low, high = math.tan(a), math.tan(b)
    return _outward(low, high, FUNCTION_WIDER)


@ieee_kernel
def _wave(code: int, a: float, b: float) -> tuple[float, float]:
    """Return the interval of sin or cos from its ends and where it is highest."""
    if code == _SIN:
        s, t, highest = math.sin(a), math.sin(b), 0.5 * np.pi
    else:
        s, t, highest = math.cos(a), math.cos(b), 0.0
    low, high = _outward(min(s, t), max(s, t), FUNCTION_WIDER)
    if not a <= b:
        return -np.inf, np.inf
    if _turns(a, b, highest - np.pi) or not low >= -1.0:
        low = -1.0
    if _turns(a, b, highest) or not high <= 1.0:
        high = 1.0
    return low, high


@ieee_kernel
def _turns(a: float, b: float, at: float) -> bool:
    """Return whether at + 2 pi k lies in [a, b], or may, for some integer k."""
    size = max(abs(a), abs(b))
    if not size < 1.0 / PERIOD_SLACK:
        return True
    slack = PERIOD_SLACK * (1.0 + size)
    first = math.ceil((a - slack - at) / (2.0 * np.pi))
    return at + 2.0 * np.pi * first <= b + slack


@ieee_kernel
def _outward(low: float, high: float, wider: float) -> tuple[float, float]:
    """Move the ends outwards; what is no number becomes the whole line."""
    low -= abs(low) * wider + SMALLEST
    high += abs(high) * wider + SMALLEST
    lost = not low <= high
    return (-np.inf if lost else low), (np.inf if lost else high)


@ieee_kernel
def _hull(s: float, t: float, u: float, v: float) -> tuple[float, float]:
    """Return the interval of four products or quotients; NaN makes it the whole."""
    low, high = _outward(min(s, t, u, v), max(s, t, u, v), WIDER)
    lost = math.isnan((s + t) + (u + v))
    return (-np.inf if lost else low), (np.inf if lost else high)
