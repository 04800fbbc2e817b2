"""A compiled test for boxes of (t, x) that have no point of a tube.

A proof tests every box, so this must not take longer than its interval evaluation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.machine_code import ieee_kernel
from swarmstart.ocp.lower_bound.tubes.support import PAD

Mask = NDArray[np.bool_]


@ieee_kernel
def mark_outside(
    times: Array,
    levels: Array,
    directions: Array,
    boxes: Array,
    marks: Mask,
) -> None:
    """Mark the boxes that have no point of the tube.

    Args:
        times: Times of the tube, shape (M + 1,).
        levels: Its levels, shape (M + 1, K).
        directions: Shape (K, n).
        boxes: Lower and upper corners, shape (2, 1 + n, m).
        marks: Filled with the answers, shape (m,).
    """
    last = times.size - 2
    for box in range(boxes.shape[2]):
        low, high = boxes[0, 0, box], boxes[1, 0, box]
        if low > times[-1] or high < times[0]:
            marks[box] = True
            continue
        marks[box] = False
        if not low <= high:  # A NaN.
            continue
        first = min(max(np.searchsorted(times, low, side="right") - 1, 0), last)
        final = min(max(np.searchsorted(times, high) - 1, 0), last)
        begin = _part(times, first, low)
        end = _part(times, final, high)
        for k in range(directions.shape[0]):
            most = max(
                _between(levels, first, k, begin), _between(levels, final, k, end)
            )
            for knot in range(first + 1, final + 1):
                most = max(most, levels[knot, k])
            if _least(directions, k, boxes, box) > most:
                marks[box] = True
                break


@ieee_kernel
def _part(times: Array, slab: int, time: float) -> float:
    """Return the elapsed fraction of a slab at a time: 0 before it, 1 after it."""
    part = (time - times[slab]) / (times[slab + 1] - times[slab])
    return float(min(max(part, 0.0), 1.0))


@ieee_kernel
def _between(levels: Array, slab: int, face: int, part: float) -> float:
    """Return an upper bound of a level within a slab."""
    start, stop = levels[slab, face], levels[slab + 1, face]
    pad = PAD * (abs(start) + abs(stop))  # Rounding is a few 2^-51 of both.
    return float(start + (stop - start) * part + pad)


@ieee_kernel
def _least(directions: Array, face: int, boxes: Array, box: int) -> float:
    """Return a lower bound of d'x over a box."""
    least, size = 0.0, 0.0
    for i in range(directions.shape[1]):
        d = directions[face, i]
        low, high = boxes[0, 1 + i, box], boxes[1, 1 + i, box]
        if d != 0.0:  # Zero times infinity is NaN.
            term = d * low if d > 0.0 else d * high
            least += term
            size += abs(term)
        if not low <= high:  # A NaN.
            return -np.inf
    return least - PAD * size
