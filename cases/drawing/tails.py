"""The end of a run in which nothing happens, which figures leave out.

A line that is constant at the end, or goes on at a constant rate, ends as a straight
line. Its tail begins at the time from which it differs from that straight line by at
most 1 % of its range. A figure ends soon after the last of its lines has begun its
tail, and says so.
"""

from collections.abc import Iterable

import numpy as np

from swarmstart.arrays import Array

_STRAIGHT = 0.01
"""Part of its range by which a line may be off the straight one."""
_LONGER, _MOST = 1.25, 0.5
"""Shown are so many times the time until all lines settle; at most this part of the
whole, else all is shown."""
_FEWEST = 20
"""Instants of a line: with fewer, nothing is left out."""


def tail_from(lines: Iterable[tuple[Array, Array]]) -> float | None:
    """Return the time from which a figure may leave out the rest; None if it may not.

    Args:
        lines: Times (n,) [s] and values (rows, n) of all lines of one run.

    Example:
        >>> times = np.linspace(0.0, 60.0, 601)
        >>> tail_from([(times, np.stack([np.minimum(times, 8.0), 15.0 * times]))])
        10.0
    """
    settled, begin, end = -np.inf, np.inf, -np.inf
    for times, rows in lines:
        settled = max(settled, _straight_from(times, rows))
        begin, end = min(begin, float(times[0])), max(end, float(times[-1]))
    shown = float(f"{_LONGER * (settled - begin):.2g}")
    return begin + shown if 0 < shown < _MOST * (end - begin) else None


def _straight_from(times: Array, rows: Array) -> float:
    """Return the time from which on rows go straight on; the end if they never do."""
    end = float(times[-1])
    if times.size < _FEWEST:
        return end
    half = times.size // 2
    rates = (rows[:, -1:] - rows[:, [half]]) / (times[-1] - times[half])
    straight = rows[:, -1:] + rates * (times - times[-1])
    near = np.abs(rows - straight) <= _STRAIGHT * np.ptp(rows, axis=1, keepdims=True)
    # What is not finite is never near.
    moving = np.flatnonzero(~near.all(axis=0))
    after = int(moving[-1]) + 1 if moving.size else 0
    return float(times[min(after, times.size - 1)])


def tail_in_words(begin: float, end: float) -> str:
    """Return the note in a figure that leaves out a tail.

    Args:
        begin: Beginning of the tail [s].
        end: End of the run [s].

    Example:
        >>> tail_in_words(10.0, 60.0)
        'the first 10 s of 60 s; then all go straight on'
    """
    return f"the first {begin:g} s of {end:g} s; then all go straight on"
