"""Signals that jump or bend between two checks, where plans take them as linear."""

from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp import Free, OptimalControlProblem
from swarmstart.ocp.common.expressions import symbol_names
from swarmstart.ocp.loop import ReferenceSignals

_PARTS = 8
"""Parts of the time between two checks, at whose ends signals are compared."""
_JUMPS = 0.1
"""Distance from the straight line, in ranges of the signal, from which on it counts."""


class Ramp(NamedTuple):
    """A signal that plans take as linear between two checks, though it is not.

    Attributes:
        name: Name of the signal.
        begin: Time of the check before the jump or bend [s].
        end: Time of the check after it [s].

    Example:
        >>> str(Ramp("price", 1.0, 2.0))
        'price jumps or bends between 1 s and 2 s, where plans take it as linear'
    """

    name: str
    begin: float
    end: float

    def __str__(self) -> str:
        """Return what plans do, in words."""
        return (
            f"{self.name} jumps or bends between {self.begin:g} s and {self.end:g} s, "
            "where plans take it as linear"
        )


def ramps_of(
    problem: OptimalControlProblem, reference: ReferenceSignals | None
) -> list[Ramp]:
    """Return the first ramp of each signal that has one in the first plan.

    Args:
        problem: The problem; of one whose end time is decided nothing is known.
        reference: Times -> values of its first signals; None: it has none.
    """
    if reference is None or isinstance(problem.horizon, Free) or problem.clock:
        return []
    checks = np.asarray(problem.expected_times)
    parts = np.linspace(0.0, 1.0, _PARTS + 1)[:-1]
    between = (checks[:-1, None] + np.diff(checks)[:, None] * parts).ravel()
    true, nodes = reference(between), reference(checks)
    found = []
    for name, row, at in zip(symbol_names(problem.signals), true, nodes, strict=False):
        off = np.abs(row - np.interp(between, checks, at)).reshape(-1, _PARTS)
        far = np.flatnonzero(off.max(axis=1) > _JUMPS * _range(row, at))
        if far.size:
            first = far[0]
            found.append(Ramp(name, float(checks[first]), float(checks[first + 1])))
    return found


def _range(row: Array, at: Array) -> float:
    """Return the range of a signal; infinity if it is constant."""
    both = np.concatenate([row, at])
    return float(np.ptp(both)) or np.inf
