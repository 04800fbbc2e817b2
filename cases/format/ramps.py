"""Signals that jump or bend where plans take them as linear, or as constant.

Plans take a signal as linear between two checks. A signal of `HeldSignals` is constant
in plans over each interval, with its value at the start of the interval.
"""

from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp import Free, OptimalControlProblem
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.loop import ReferenceSignals
from swarmstart.ocp.statement import held_signals

_PARTS = 8
"""Parts of the time between two checks, at whose ends signals are compared."""
_JUMPS = 0.1
"""Distance from the straight line, in ranges of the signal, from which on it counts."""


class Ramp(NamedTuple):
    """A signal that jumps or bends where plans take it as linear or constant.

    Attributes:
        name: Name of the signal.
        begin: Time of the check before the jump or bend [s].
        end: Time of the check after it [s].
        is_held: Whether plans hold its value over each interval.

    Example:
        >>> str(Ramp("price", 1.0, 2.0))
        'price jumps or bends between 1 s and 2 s, where plans take it as linear'
    """

    name: str
    begin: float
    end: float
    is_held: bool = False

    def __str__(self) -> str:
        """Return what plans do, in words."""
        how = "keep its value" if self.is_held else "take it as linear"
        return (
            f"{self.name} jumps or bends between {self.begin:g} s and {self.end:g} s, "
            f"where plans {how}"
        )


def ramps_of(
    problem: OptimalControlProblem, reference: ReferenceSignals | None
) -> list[Ramp]:
    """Return the first ramp of each signal that has one in the first plan.

    Args:
        problem: The problem. If its end time is decided, the times of its checks are
            not known, and no ramp is returned.
        reference: Times -> values of the problem's first signals, those before the
            plans of other agents; None if there are no such signals.
    """
    if reference is None or isinstance(problem.horizon, Free) or problem.clock:
        return []
    checks = np.asarray(problem.expected_times)
    parts = np.linspace(0.0, 1.0, _PARTS + 1)[:-1]
    between = (checks[:-1, None] + np.diff(checks)[:, None] * parts).ravel()
    true, nodes = reference(between), reference(checks)
    found, held = [], held_signals(problem)
    for name, row, at in zip(symbol_names(problem.signals), true, nodes, strict=False):
        planned = np.interp(between, checks, at)
        if name in held:
            planned = np.repeat(at[: -1 : problem.checks], problem.checks * _PARTS)
        off = np.abs(row - planned).reshape(-1, _PARTS)
        far = np.flatnonzero(off.max(axis=1) > _JUMPS * _range(row, at))
        if far.size:
            begin, end = map(float, checks[far[0] : far[0] + 2])
            found.append(Ramp(name, begin, end, name in held))
    return found


def _range(row: Array, at: Array) -> float:
    """Return the range of a signal; infinity if it is constant."""
    both = np.concatenate([row, at])
    return float(np.ptp(both)) or np.inf
