"""Interval forms of operations, and the compiled interpreter of programs made of them.

Every end is computed in floats and moved outwards, by |end| times

    sqrt and the arithmetic     WIDER (IEEE: error of at most half a unit)
    the other functions         FUNCTION_WIDER (4 units; glibc documents at most 2)

plus SMALLEST, below which floats lose digits. Each factor includes the rounding of the
move itself. A move to the next float instead would need a branch in the code.

If a function is undefined somewhere in the box, or an end is not a number, the result
is the whole line, which states nothing.

NumPy's functions are used instead of math's: without compilation (NUMBA_DISABLE_JIT)
those of math raise errors when NumPy's return infinity or NaN. Only erf is not in
NumPy.

One kernel, compiled once, interprets any program, one instruction at a time for a whole
block of boxes. The values of BLOCK boxes stay in the processor's cache. The results of
comparisons, which occur in derivatives, are intervals of 0 (false) and 1 (true).

Source: Moore, Kearfott and Cloud (2009), Introduction to Interval Analysis; the GNU C
Library Reference Manual, "Errors in Math Functions".
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.machine_code import ieee_kernel

WIDER = 2.3e-16
"""Relative: half a unit for the operation and half a unit for moving its end."""
FUNCTION_WIDER = 1.2e-15
SMALLEST = 1e-300
PERIOD_SLACK = 1e-12
"""Relative error of an angle at which a turning point still counts as in the box."""

FUNCTIONS = (
    "sin cos tan cosh exp atan tanh sinh asinh erf expm1 "
    "sqrt log log1p asin acosh atanh acos"
).split()
(
    _SIN, _COS, _TAN, _COSH, _EXP, _ATAN, _TANH, _SINH, _ASINH, _ERF, _EXPM1,
    _SQRT, _LOG, _LOG1P, _ASIN, _ACOSH, _ATANH, _ACOS,
) = range(len(FUNCTIONS))  # fmt: skip

# An open end is replaced by the next float inside.
_DOMAINS = {
    "sqrt": (0.0, np.inf),
    "log": (float(np.nextafter(0.0, 1.0)), np.inf),
    "log1p": (float(np.nextafter(-1.0, 0.0)), np.inf),
    "asin": (-1.0, 1.0),
    "acos": (-1.0, 1.0),
    "acosh": (1.0, np.inf),
    "atanh": (float(np.nextafter(-1.0, 0.0)), float(np.nextafter(1.0, 0.0))),
}
_RANGES = {
    "sin": (-1.0, 1.0),
    "cos": (-1.0, 1.0),
    "cosh": (1.0, np.inf),
    "exp": (0.0, np.inf),
    "tanh": (-1.0, 1.0),
    "erf": (-1.0, 1.0),
    "expm1": (-1.0, np.inf),
    "sqrt": (0.0, np.inf),
    "acosh": (0.0, np.inf),
    "acos": (0.0, np.inf),
}
_LINE = (-np.inf, np.inf)
_FROM, _TO = np.array([_DOMAINS.get(name, _LINE) for name in FUNCTIONS]).T.copy()
_BOTTOM, _TOP = np.array([_RANGES.get(name, _LINE) for name in FUNCTIONS]).T.copy()

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
def outward(low: float, high: float, wider: float) -> tuple[float, float]:
    """Move the ends outwards; NaN becomes the whole line."""
    low -= abs(low) * wider + SMALLEST
    high += abs(high) * wider + SMALLEST
    lost = not low <= high
    return (-np.inf if lost else low), (np.inf if lost else high)


@ieee_kernel
def hull(s: float, t: float, u: float, v: float, wider: float) -> tuple[float, float]:
    """Return the interval of the values at four corners; the whole line for NaN."""
    low, high = outward(min(s, t, u, v), max(s, t, u, v), wider)
    # min and max may pass NaN over.
    lost = np.isnan((s + t) + (u + v))
    return (-np.inf if lost else low), (np.inf if lost else high)


@ieee_kernel
def elementary(code: int, a: float, b: float) -> tuple[float, float]:
    """Return the interval of a function of [a, b].

    Args:
        code: The function's number in FUNCTIONS.
        a: Lower end.
        b: Upper end, at least a.
    """
    if not (_FROM[code] <= a and b <= _TO[code]):
        return -np.inf, np.inf
    # A pole at x = pi/2 + k pi: 2 x = pi + 2 k pi.
    if code == _TAN and _turns(2.0 * a, 2.0 * b, np.pi):
        return -np.inf, np.inf
    if code in (_SIN, _COS):
        low, high = _wave(code, a, b)
    elif code == _COSH:
        # Of the least and of the largest |x|.
        low, high = np.cosh(max(a, -b, 0.0)), np.cosh(max(-a, b))
    elif code == _ACOS:
        low, high = np.arccos(b), np.arccos(a)  # It falls.
    else:
        low, high = _rising(code, a), _rising(code, b)
    low, high = outward(low, high, WIDER if code == _SQRT else FUNCTION_WIDER)
    return max(low, _BOTTOM[code]), min(high, _TOP[code])


@ieee_kernel
def _rising(code: int, x: float) -> float:
    """Return the value of a function that rises on its domain."""
    if code == _TAN:
        return float(np.tan(x))
    if code < _SQRT:
        return _rising_on_the_line(code, x)
    return _rising_on_a_part(code, x)


@ieee_kernel
def _rising_on_the_line(code: int, x: float) -> float:
    if code == _EXP:
        value = np.exp(x)
    elif code == _ATAN:
        value = np.arctan(x)
    elif code == _TANH:
        value = np.tanh(x)
    elif code == _SINH:
        value = np.sinh(x)
    elif code == _ASINH:
        value = np.arcsinh(x)
    elif code == _ERF:
        value = math.erf(x)
    else:
        value = np.expm1(x)
    return float(value)


@ieee_kernel
def _rising_on_a_part(code: int, x: float) -> float:
    if code == _SQRT:
        value = np.sqrt(x)
    elif code == _LOG:
        value = np.log(x)
    elif code == _LOG1P:
        value = np.log1p(x)
    elif code == _ASIN:
        value = np.arcsin(x)
    elif code == _ACOSH:
        value = np.arccosh(x)
    else:
        value = np.arctanh(x)
    return float(value)


@ieee_kernel
def _wave(code: int, a: float, b: float) -> tuple[float, float]:
    """Return the ends of sin or cos, from the box's ends and the turning points."""
    if code == _SIN:
        s, t, highest = np.sin(a), np.sin(b), 0.5 * np.pi
    else:
        s, t, highest = np.cos(a), np.cos(b), 0.0
    low, high = min(s, t), max(s, t)
    if _turns(a, b, highest - np.pi):
        low = -1.0
    if _turns(a, b, highest):
        high = 1.0
    return low, high


@ieee_kernel
def _turns(a: float, b: float, at: float) -> bool:
    """Return whether at + 2 pi k may lie in [a, b] for some integer k."""
    size = max(abs(a), abs(b))
    if not size < 1.0 / PERIOD_SLACK:  # The slack would be 1 and more.
        return True
    slack = PERIOD_SLACK * (1.0 + size)
    first = np.ceil((a - slack - at) / (2.0 * np.pi))
    return bool(at + 2.0 * np.pi * first <= b + slack)


@ieee_kernel
def power(a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """Return [a, b] to the power of [c, d]; its extremes are at corners of the box."""
    if c == d and c == np.floor(c):
        return _whole_power(a, b, c)
    if a < 0.0 or (a == 0.0 and c < 0.0):
        return -np.inf, np.inf
    low, high = hull(a**c, a**d, b**c, b**d, FUNCTION_WIDER)
    return max(low, 0.0), high


@ieee_kernel
def _whole_power(a: float, b: float, n: float) -> tuple[float, float]:
    """Return [a, b] to a power that is a whole number, also of negative numbers."""
    has_zero = a <= 0.0 and b >= 0.0
    if n < 0.0 and has_zero:
        return -np.inf, np.inf
    s, t = a**n, b**n
    if n % 2.0 != 0.0:
        return outward(min(s, t), max(s, t), FUNCTION_WIDER)
    least = 0.0 if has_zero and n > 0.0 else min(s, t)
    low, high = outward(least, max(s, t), FUNCTION_WIDER)
    return max(low, 0.0), high


@ieee_kernel
def angle(a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """Return atan2 of y in [a, b] and x in [c, d]; its extremes are at corners.

    On the branch cut, y = 0 and x <= 0, atan2 jumps: a box that touches the branch cut
    gets the whole line.
    """
    if c <= 0.0 and a <= 0.0 and b >= 0.0:
        return -np.inf, np.inf
    return hull(
        np.arctan2(a, c),
        np.arctan2(a, d),
        np.arctan2(b, c),
        np.arctan2(b, d),
        FUNCTION_WIDER,
    )


@ieee_kernel
def distance(a: float, b: float, c: float, d: float) -> tuple[float, float]:
    """Return hypot of [a, b] and [c, d]."""
    nearest = np.hypot(max(a, -b, 0.0), max(c, -d, 0.0))
    farthest = np.hypot(max(-a, b), max(-c, d))
    low, high = outward(nearest, farthest, FUNCTION_WIDER)
    return max(low, 0.0), high


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
        instructions: Instructions of the program; see `intervals._Program`, also for
            `inputs` and `outputs`.
        inputs: For each input a register, and the row of `boxes` that is loaded into
            it, shape (number, 2).
        outputs: Registers of the outputs.
        boxes: Lower and upper corners, shape (2, inputs, m).
        work: The registers, shape (registers, 2, BLOCK); those of constants are
            filled already.
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
    """Return [a, b] <= [c, d] as 0 to 1, or how many of <= and >= are true."""
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
