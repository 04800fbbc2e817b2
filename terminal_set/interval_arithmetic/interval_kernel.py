"""The compiled interpreter of interval programs, a block of boxes at a time.

The values of BLOCK boxes stay in the processor's cache. One kernel, compiled once,
interprets any program, one instruction at a time for the whole block. The interval
forms of the functions are in `interval_functions.py`.

Flags, of comparisons in derivatives, are intervals of 0 (false) and 1 (true).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.machine_code import ieee_kernel
from swarmstart.terminal_set.interval_arithmetic.interval_functions import (
    FUNCTIONS,
    WIDER,
    angle,
    distance,
    elementary,
    hull,
    outward,
    power,
)

Codes = NDArray[np.int64]

BLOCK = 256

_ONE = "neg sq twice fabs sign not".split()
_TWO = "add sub mul div pow atan2 hypot fmin fmax le ties".split()
OPERATIONS = (*FUNCTIONS, *_ONE, *_TWO)
CODES = {name: code for code, name in enumerate(OPERATIONS)}
_FIRST_OF_ONE, _FIRST_OF_TWO = CODES[_ONE[0]], CODES[_TWO[0]]
(_NEG, _SQ, _TWICE, _FABS, _SIGN, _NOT) = range(_FIRST_OF_ONE, _FIRST_OF_TWO)
(
    _ADD, _SUB, _MUL, _DIV, _POW, _ATAN2, _HYPOT, _FMIN, _FMAX, _LE, _TIES,
) = range(_FIRST_OF_TWO, len(OPERATIONS))  # fmt: skip


@ieee_kernel
def interpret(
    instructions: Codes,
    inputs: Codes,
    outputs: Codes,
    boxes: Array,
    work: Array,
    values: Array,
) -> None:
    """Evaluate all boxes, a block at a time.

    Args:
        instructions: See `intervals._Program`, like the two after it.
        inputs: Registers and entries.
        outputs: Registers.
        boxes: Lower and upper corners, shape (2, inputs, m).
        work: The registers, shape (registers, 2, BLOCK), constants in place.
        values: Filled with the enclosures, shape (2, outputs, m).
    """
    total = boxes.shape[2]
    for begin in range(0, total, BLOCK):
        count = min(BLOCK, total - begin)
        _load(inputs, boxes[:, :, begin : begin + count], work)
        for i in range(instructions.shape[0]):
            code, target, first, second = instructions[i]
            if code < _FIRST_OF_TWO:
                _apply_one(code, work[first], work[target])
            elif code < _POW:
                _apply_arithmetic(code, work[first], work[second], work[target])
            else:
                _apply_two(code, work[first], work[second], work[target])
        for i in range(outputs.shape[0]):
            for k in range(count):
                values[0, i, begin + k] = work[outputs[i], 0, k]
                values[1, i, begin + k] = work[outputs[i], 1, k]


@ieee_kernel
def _load(inputs: Codes, boxes: Array, work: Array) -> None:
    """Load up to BLOCK boxes into registers; repeat the last one to fill the block."""
    for i in range(inputs.shape[0]):
        register, entry = inputs[i]
        for k in range(BLOCK):
            box = min(k, boxes.shape[2] - 1)
            low, high = boxes[0, entry, box], boxes[1, entry, box]
            is_interval = low <= high  # Not if an end is NaN.
            work[register, 0, k] = low if is_interval else -np.inf
            work[register, 1, k] = high if is_interval else np.inf


@ieee_kernel
def _apply_arithmetic(code: int, x: Array, y: Array, out: Array) -> None:
    """Write an operation of x and y, intervals of BLOCK boxes (2, BLOCK), to out."""
    if code == _ADD:
        for k in range(BLOCK):
            out[0, k], out[1, k] = outward(x[0, k] + y[0, k], x[1, k] + y[1, k], WIDER)
    elif code == _SUB:
        for k in range(BLOCK):
            out[0, k], out[1, k] = outward(x[0, k] - y[1, k], x[1, k] - y[0, k], WIDER)
    elif code == _MUL:
        _multiply(x, y, out)
    else:
        _divide(x, y, out)


@ieee_kernel
def _multiply(x: Array, y: Array, out: Array) -> None:
    for k in range(BLOCK):
        a, b, c, d = x[0, k], x[1, k], y[0, k], y[1, k]
        out[0, k], out[1, k] = hull(a * c, a * d, b * c, b * d, WIDER)


@ieee_kernel
def _divide(x: Array, y: Array, out: Array) -> None:
    for k in range(BLOCK):
        a, b, c, d = x[0, k], x[1, k], y[0, k], y[1, k]
        low, high = hull(a / c, a / d, b / c, b / d, WIDER)
        through_zero = (c <= 0.0) & (d >= 0.0)
        out[0, k] = -np.inf if through_zero else low
        out[1, k] = np.inf if through_zero else high


@ieee_kernel
def _apply_two(code: int, x: Array, y: Array, out: Array) -> None:
    """Write operations of x and y that `_apply_arithmetic` lacks to out."""
    for k in range(BLOCK):
        a, b, c, d = x[0, k], x[1, k], y[0, k], y[1, k]
        if code == _POW:
            out[0, k], out[1, k] = power(a, b, c, d)
        elif code == _ATAN2:
            out[0, k], out[1, k] = angle(a, b, c, d)
        elif code == _HYPOT:
            out[0, k], out[1, k] = distance(a, b, c, d)
        elif code == _FMIN:
            out[0, k], out[1, k] = min(a, c), min(b, d)
        elif code == _FMAX:
            out[0, k], out[1, k] = max(a, c), max(b, d)
        else:
            out[0, k], out[1, k] = _compare(code, a, b, c, d)


@ieee_kernel
def _compare(code: int, a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """Return [a, b] <= [c, d] as a flag, or the number of true ones of <= and >=."""
    if code == _LE:
        return (1.0 if b <= c else 0.0), (0.0 if a > d else 1.0)
    return 1.0, (1.0 if b < c or a > d else 2.0)


@ieee_kernel
def _apply_one(code: int, x: Array, out: Array) -> None:
    """Write an operation of x, intervals of BLOCK boxes (2, BLOCK), to out."""
    if code < _FIRST_OF_ONE:
        for k in range(BLOCK):
            out[0, k], out[1, k] = elementary(code, x[0, k], x[1, k])
    elif code == _NEG:
        for k in range(BLOCK):
            out[0, k], out[1, k] = -x[1, k], -x[0, k]
    elif code == _TWICE:
        for k in range(BLOCK):
            out[0, k], out[1, k] = outward(2.0 * x[0, k], 2.0 * x[1, k], WIDER)
    elif code in (_SQ, _FABS):
        _size(code, x, out)
    else:
        _sign(code, x, out)


@ieee_kernel
def _size(code: int, x: Array, out: Array) -> None:
    """Write the absolute value of x, or its square, to out."""
    for k in range(BLOCK):
        least = max(x[0, k], -x[1, k], 0.0)
        most = max(-x[0, k], x[1, k])
        if code == _SQ:
            low, high = outward(least * least, most * most, WIDER)
            out[0, k], out[1, k] = max(low, 0.0), high
        else:
            out[0, k], out[1, k] = least, most


@ieee_kernel
def _sign(code: int, x: Array, out: Array) -> None:
    """Write the sign of x, or whether it is 0, to out."""
    for k in range(BLOCK):
        above, below = x[0, k] > 0.0, x[1, k] < 0.0
        if code == _SIGN:
            out[0, k] = 1.0 if above else -1.0
            out[1, k] = -1.0 if below else 1.0
        else:
            out[0, k] = 1.0 if x[0, k] == 0.0 and x[1, k] == 0.0 else 0.0
            out[1, k] = 0.0 if above or below else 1.0
