"""Blocks of control intervals that have one control: move blocking.

    blocks (1, 1, 2, 4):  u_0 | u_1 | u_2 = u_3 | u_4 = u_5 = u_6 = u_7

The grid of the states, the checks and the closed loop stays that of the intervals; the
decisions are fewer. A search has one column of controls for each block. An NLP has an
equation u_k = u_k-1 within them.

Source: Cagienard, Grieder, Kerrigan and Morari (2007), Move blocking strategies in
receding horizon control, Journal of Process Control 17.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.errors import InvalidProblemError

Array = NDArray[np.float64]


def block_lengths(given: Sequence[int], intervals: int) -> tuple[int, ...]:
    """Return the lengths of the blocks, checked; empty: every interval is its own.

    Args:
        given: Number of intervals of each block, in order.
        intervals: Number N of intervals.

    Raises:
        InvalidProblemError: If they are no positive whole numbers with the sum N.
    """
    numbers = not isinstance(given, str) and all(
        isinstance(n, int | np.integer) and not isinstance(n, bool) and n > 0
        for n in given
    )
    if not numbers or (len(given) and sum(given) != intervals):
        raise InvalidProblemError(
            "blocks must be lengths, positive whole numbers, that sum to the "
            f"{intervals} intervals, got {given!r}"
        )
    lengths = tuple(int(n) for n in given)
    return () if len(lengths) == intervals else lengths


def block_numbers(blocks: Sequence[int], intervals: int) -> NDArray[np.intp]:
    """Return the number of the block of each interval, shape (N,)."""
    if not blocks:
        return np.arange(intervals)
    return np.repeat(np.arange(len(blocks)), blocks)


def first_intervals(blocks: Sequence[int], intervals: int) -> NDArray[np.intp]:
    """Return the first interval of each block."""
    numbers = block_numbers(blocks, intervals)
    return np.flatnonzero(np.diff(numbers, prepend=-1))


def tied_intervals(blocks: Sequence[int], intervals: int) -> list[int]:
    """Return the intervals that have the control of the one before."""
    if not blocks:
        return []
    first = first_intervals(blocks, intervals)
    return list(np.setdiff1d(np.arange(intervals), first))


def averaged(controls: Array, blocks: Sequence[int]) -> Array:
    """Return controls, (nu, N), with the mean of each block; a copy."""
    if not blocks:
        return controls.copy()
    first = first_intervals(blocks, controls.shape[1])
    lengths = np.array(blocks)
    means = np.add.reduceat(controls, first, axis=1) / lengths
    least, most = (
        f.reduceat(controls, first, axis=1) for f in (np.minimum, np.maximum)
    )
    # Without rounding errors where all are the same.
    return np.repeat(np.where(least == most, least, means), lengths, axis=1)
