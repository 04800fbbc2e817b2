"""Interval forms of the operations, and the compiled interpreter that applies them.

The values of BLOCK boxes stay in the processor's cache; one kernel, compiled once,
interprets any program, an instruction for the whole block at a time.

Every end is computed in floats and moved outwards, by |end| times

    + - * / sqrt         WIDER (IEEE: half a unit in the last place off at most)
    the functions        FUNCTION_WIDER (4 units: the C library documents 1 or 2)

plus SMALLEST, below which floats lose digits. Each factor holds the rounding of the
move itself; moving to the next number instead would take a branch.

If the operation is undefined somewhere in a box (a quotient by an interval with 0, a
root of a negative number), or an end is no number, the result is the whole line: no
statement.

NumPy's functions are used instead of math's: as plain Python (NUMBA_DISABLE_JIT) those
of math raise where these return infinity or NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmstart.kernel import ieee_kernel

Array = NDArray[np.float64]
Codes = NDArray[np.int64]

WIDER = 2.3e-16
"""Relative: half a unit of the operation and half a unit of moving its end."""
FUNCTION_WIDER = 1.2e-15
SMALLEST = 1e-300
PERIOD_SLACK = 1e-12
"""By which part of an angle a turning point may be mistaken for inside a box."""
BLOCK = 256

OPERATIONS = (
    "add sub mul div pow fmin fmax neg sq twice fabs sqrt sin cos tan exp log atan tanh"
).split()
CODES = {name: code for code, name in enumerate(OPERATIONS)}
(
    _ADD, _SUB, _MUL, _DIV, _POW, _FMIN, _FMAX, _NEG, _SQ, _TWICE, _FABS, _SQRT,
    _SIN, _COS, _TAN, _EXP, _LOG, _ATAN, _TANH,
) = range(len(OPERATIONS))  # fmt: skip


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
        values: Where the enclosures go, shape (2, outputs, m).
    """
    total = boxes.shape[2]
    for begin in range(0, total, BLOCK):
        count = min(BLOCK, total - begin)
        for i in range(inputs.shape[0]):
            register, entry = inputs[i]
            for k in range(BLOCK):
                box = begin + min(k, count - 1)
                low, high = boxes[0, entry, box], boxes[1, entry, box]
                is_interval = low <= high  # Not if an end is NaN.
                work[register, 0, k] = low if is_interval else -np.inf
                work[register, 1, k] = high if is_interval else np.inf
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
        out[0, k], out[1, k] = _hull(a * c, a * d, b * c, b * d, WIDER)


@ieee_kernel
def _divide(x: Array, y: Array, out: Array) -> None:
    for k in range(BLOCK):
        a, b, c, d = x[0, k], x[1, k], y[0, k], y[1, k]
        low, high = _hull(a / c, a / d, b / c, b / d, WIDER)
        through_zero = (c <= 0.0) & (d >= 0.0)
        out[0, k] = -np.inf if through_zero else low
        out[1, k] = np.inf if through_zero else high


@ieee_kernel
def _raise(x: Array, y: Array, out: Array) -> None:
    for k in range(BLOCK):
        a, b, c, d = x[0, k], x[1, k], y[0, k], y[1, k]
        if c == d and c == np.floor(c):
            out[0, k], out[1, k] = _whole_power(a, b, c)
        else:
            out[0, k], out[1, k] = _power(a, b, c, d)


@ieee_kernel
def _power(a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """Return [a, b] to the power of [c, d], extreme in their corners."""
    if a < 0.0 or (a == 0.0 and c < 0.0):
        return -np.inf, np.inf
    low, high = _hull(a**c, a**d, b**c, b**d, FUNCTION_WIDER)
    return max(low, 0.0), high


@ieee_kernel
def _whole_power(a: float, b: float, n: float) -> tuple[float, float]:
    """Return [a, b] to a power that is a whole number, also of negative numbers."""
    has_zero = a <= 0.0 and b >= 0.0
    if n < 0.0 and has_zero:
        return -np.inf, np.inf
    s, t = a**n, b**n
    if n % 2.0 != 0.0:
        return _outward(min(s, t), max(s, t), FUNCTION_WIDER)
    least = 0.0 if has_zero and n > 0.0 else min(s, t)
    low, high = _outward(least, max(s, t), FUNCTION_WIDER)
    return max(low, 0.0), high


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
        low, high = _outward(np.sqrt(a), np.sqrt(b), WIDER)
        return max(low, 0.0), high
    if code == _LOG and a > 0.0:
        low, high = np.log(a), np.log(b)
    elif code == _ATAN:
        low, high = np.arctan(a), np.arctan(b)
    elif code == _TANH:
        low, high = np.tanh(a), np.tanh(b)
    elif code == _TAN and not _turns(2.0 * a, 2.0 * b, np.pi):
        low, high = np.tan(a), np.tan(b)
    return _outward(low, high, FUNCTION_WIDER)


@ieee_kernel
def _wave(code: int, a: float, b: float) -> tuple[float, float]:
    """Return the interval of sin or cos from its ends and where it is highest."""
    if code == _SIN:
        s, t, highest = np.sin(a), np.sin(b), 0.5 * np.pi
    else:
        s, t, highest = np.cos(a), np.cos(b), 0.0
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
    first = np.ceil((a - slack - at) / (2.0 * np.pi))
    return bool(at + 2.0 * np.pi * first <= b + slack)


@ieee_kernel
def _outward(low: float, high: float, wider: float) -> tuple[float, float]:
    """Move the ends outwards; what is no number becomes the whole line."""
    low -= abs(low) * wider + SMALLEST
    high += abs(high) * wider + SMALLEST
    lost = not low <= high
    return (-np.inf if lost else low), (np.inf if lost else high)


@ieee_kernel
def _hull(s: float, t: float, u: float, v: float, wider: float) -> tuple[float, float]:
    """Return the interval of the values at four corners; NaN makes it the whole."""
    low, high = _outward(min(s, t, u, v), max(s, t, u, v), wider)
    lost = np.isnan((s + t) + (u + v))
    return (-np.inf if lost else low), (np.inf if lost else high)
