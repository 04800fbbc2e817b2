"""Blocks of control intervals that have one control: move blocking.

    blocks (1, 1, 2, 4):  u_0 | u_1 | u_2 = u_3 | u_4 = u_5 = u_6 = u_7

The grid of the states, the checks and the closed loop stays that of the intervals; the
decisions are fewer. A search has one column of controls for each block. An NLP has an
equation u_k = u_k-1 within them. Members of an ensemble that have controls of their own
after some intervals have the same ones before in the same way.

Source: Cagienard, Grieder, Kerrigan and Morari (2007), Move blocking strategies in
receding horizon control, Journal of Process Control 17.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.errors import InvalidProblemError

Array = NDArray[np.float64]
Index = NDArray[np.intp]


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


def control_labels(
    blocks: Sequence[int], intervals: int, *, controls: int, own: int, shared: int
) -> Index:
    """Return a number for each control of each interval, shape (controls, intervals).

    Controls that must be the same have the same number.

    Args:
        blocks: Lengths of the blocks; empty: every interval is its own.
        intervals: Number N of intervals.
        controls: Number of controls, those of all members of an ensemble.
        own: Number of controls of a member; number j of a member is that of another.
        shared: Number of intervals in which members have the same controls; a block
            that begins within them is shared to its end.
    """
    block = block_numbers(blocks, intervals)
    first = first_intervals(blocks, intervals)[block]
    row = np.arange(controls)[:, None]
    return np.where(first < shared, row % own, row) + controls * block


def first_of(labels: Index) -> Index:
    """Return the places of the first control of each label, of ca.vec of labels."""
    return np.sort(np.unique(labels.ravel(order="F"), return_index=True)[1])


def variables_of(labels: Index) -> Index:
    """Return for ca.vec of labels which of the first ones each stands for."""
    numbers = labels.ravel(order="F")
    rank = {label: place for place, label in enumerate(numbers[first_of(labels)])}
    return np.array([rank[label] for label in numbers], dtype=np.intp)


def ties(labels: Index) -> tuple[Index, Index]:
    """Return (those, the ones before): controls, in ca.vec, that are the same."""
    last: dict[int, int] = {}
    now, before = [], []
    for place, label in enumerate(labels.ravel(order="F").tolist()):
        if label in last:
            now.append(place)
            before.append(last[label])
        last[label] = place
    return np.array(now, dtype=np.intp), np.array(before, dtype=np.intp)


def same_in_labels(controls: Array, labels: Index) -> Array:
    """Return controls, (nu, N), with the mean of those of each label; a copy."""
    values, number = controls.ravel(order="F"), variables_of(labels)
    count = np.bincount(number)
    means = np.bincount(number, weights=values) / count
    least, most = np.full(count.size, np.inf), np.full(count.size, -np.inf)
    np.minimum.at(least, number, values)
    np.maximum.at(most, number, values)
    # Without rounding errors where all are the same.
    found = np.where(least == most, least, means)[number]
    return found.reshape(controls.shape, order="F")


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
