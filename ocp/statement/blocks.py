"""Move blocking: blocks of control intervals that share one control.

    blocks (1, 1, 2, 4):  u_0 | u_1 | u_2 = u_3 | u_4 = u_5 = u_6 = u_7

The grid of the states, the checks and the closed loop is not changed; only the number
of decisions falls. A search has one column of controls for each block. An NLP has the
equation u_k = u_k-1 within a block. The same equations tie the members of an ensemble
over the intervals in which they share their controls.

Source: Cagienard, Grieder, Kerrigan and Morari (2007), Move blocking strategies in
receding horizon control, Journal of Process Control 17.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError

Index = NDArray[np.intp]


def block_lengths(given: Sequence[int], intervals: int) -> tuple[int, ...]:
    """Return the validated block lengths; empty: every interval is its own block.

    Args:
        given: Number of intervals of each block, in order.
        intervals: Number N of intervals.

    Raises:
        InvalidProblemError: If they are not positive whole numbers with the sum N.
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
    """Return the number of the block that each interval belongs to, shape (N,)."""
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
    """Return a label for each control of each interval, shape (controls, intervals).

    Controls that must be equal have the same label.

    Args:
        blocks: Lengths of the blocks; empty: every interval is its own block.
        intervals: Number N of intervals.
        controls: Number of controls, of all members of an ensemble together.
        own: Number of controls of one member; the controls of the members correspond by
            their number within the member.
        shared: Number of intervals in which all members have the same controls. A block
            that begins within them is shared up to its end.
    """
    block = block_numbers(blocks, intervals)
    first = first_intervals(blocks, intervals)[block]
    row = np.arange(controls)[:, None]
    return np.where(first < shared, row % own, row) + controls * block


def first_of(labels: Index) -> Index:
    """Return the index of the first control of each label, in ca.vec of the labels."""
    return np.sort(np.unique(labels.ravel(order="F"), return_index=True)[1])


def variables_of(labels: Index) -> Index:
    """Return, for each label in ca.vec, the index of its first control."""
    numbers = labels.ravel(order="F")
    rank = {label: place for place, label in enumerate(numbers[first_of(labels)])}
    return np.array([rank[label] for label in numbers], dtype=np.intp)


def ties(labels: Index) -> tuple[Index, Index]:
    """Return index pairs (later, earlier), in ca.vec, of controls that are equal."""
    last: dict[int, int] = {}
    now, before = [], []
    for place, label in enumerate(labels.ravel(order="F").tolist()):
        if label in last:
            now.append(place)
            before.append(last[label])
        last[label] = place
    return np.array(now, dtype=np.intp), np.array(before, dtype=np.intp)


def same_in_labels(controls: Array, labels: Index) -> Array:
    """Return a copy of controls (nu, N) in which each label has its mean value."""
    values, number = controls.ravel(order="F"), variables_of(labels)
    count = np.bincount(number)
    means = np.bincount(number, weights=values) / count
    least, most = np.full(count.size, np.inf), np.full(count.size, -np.inf)
    np.minimum.at(least, number, values)
    np.maximum.at(most, number, values)
    # If all values are the same, keep them without rounding errors.
    found = np.where(least == most, least, means)[number]
    return found.reshape(controls.shape, order="F")


def averaged(controls: Array, blocks: Sequence[int]) -> Array:
    """Return a copy of controls (nu, N) in which each block has its mean value."""
    if not blocks:
        return controls.copy()
    first = first_intervals(blocks, controls.shape[1])
    lengths = np.array(blocks)
    means = np.add.reduceat(controls, first, axis=1) / lengths
    least, most = (
        f.reduceat(controls, first, axis=1) for f in (np.minimum, np.maximum)
    )
    # If all values are the same, keep them without rounding errors.
    return np.repeat(np.where(least == most, least, means), lengths, axis=1)
