"""Interval arithmetic with outward rounding, and Taylor forms on parts of a ball.

A function is a list of operations (`tape.py`), evaluated on many boxes at once. The
parts of a ball on which a Taylor form bounds a function are called cells (`taylor.py`).
"""

from swarmstart.terminal_set.interval_arithmetic.intervals import (
    IntervalEvaluation,
    UnknownIntervalOperationError,
    expanded_tape,
    interval_function,
)
from swarmstart.terminal_set.interval_arithmetic.smoothness import (
    Kinks,
)
from swarmstart.terminal_set.interval_arithmetic.tape import (
    Instruction,
    tape_of,
)
from swarmstart.terminal_set.interval_arithmetic.taylor import (
    PADDING,
    Derivatives,
    middle_and_radius,
)

__all__ = [
    "PADDING",
    "Derivatives",
    "Instruction",
    "IntervalEvaluation",
    "Kinks",
    "UnknownIntervalOperationError",
    "expanded_tape",
    "interval_function",
    "middle_and_radius",
    "tape_of",
]
