"""Queries of a tube: boxes that cover it, boxes outside, points inside.

Proofs use `outside` and `starting_boxes`, which are rounded outwards. A proof tests
every box, so `outside` is compiled: a test must not take longer than the interval
evaluation of the box. `inside` is for samples only, in plain floats.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.machine_code import ieee_kernel
from swarmstart.ocp.lower_bound.stated.answer import Tube
from swarmstart.ocp.lower_bound.tubes.motion import PAD

Mask = NDArray[np.bool_]


def starting_boxes(tube: Tube) -> tuple[Array, Array]:
    """Return boxes of (t, x) that cover the tube, one for each slab.

    Returns:
        Lower and upper corners, each (1 + n, slabs).
    """
    axes = tube.levels.T[: 2 * tube.directions.shape[1]]
    most = np.maximum(axes[:, :-1], axes[:, 1:])
    return (
        np.vstack([tube.times[:-1], -most[1::2]]),
        np.vstack([tube.times[1:], most[0::2]]),
    )


def outside(tube: Tube, lower: Array, upper: Array) -> Mask:
    """Return which boxes of (t, x) certainly have no point of the tube.

    Args:
        tube: The tube.
        lower: Lower corners, shape (1 + n, m).
        upper: Upper corners, same shape.

    Returns:
        Mask, shape (m,); False for boxes with a NaN.
    """
    marks = np.empty(lower.shape[1], dtype=np.bool_)
    boxes = np.stack([lower, upper]).astype(np.float64, copy=False)
    with np.errstate(all="ignore"):  # Of the kernel when it is plain Python.
        mark_outside(tube.times, tube.levels, tube.directions, boxes, marks)
    return marks


def inside(tube: Tube, points: Array) -> Mask:
    """Return which points (t, x) are in the tube, up to rounding.

    Args:
        tube: The tube.
        points: Points, shape (1 + n, N).

    Returns:
        Mask, shape (N,).
    """
    is_time = (points[0] >= tube.times[0]) & (points[0] <= tube.times[-1])
    is_in = (tube.directions @ points[1:] <= _levels_at(tube, points[0])).all(axis=0)
    return np.asarray(is_in & is_time)


def _levels_at(tube: Tube, t: Array) -> Array:
    """Return the levels at times, in plain floats, shape (K, m)."""
    times, levels = tube.times, tube.levels.T
    # A time at which two slabs meet belongs to the later one.
    slab = np.searchsorted(times, t, side="right") - 1
    slab = np.clip(slab, 0, len(times) - 2)
    begin = times[slab]
    part = np.clip((t - begin) / (times[slab + 1] - begin), 0.0, 1.0)
    start = levels[:, slab]
    return np.asarray(start + (levels[:, slab + 1] - start) * part)


@ieee_kernel
def mark_outside(
    times: Array,
    levels: Array,
    directions: Array,
    boxes: Array,
    marks: NDArray[np.bool_],
) -> None:
    """Mark the boxes that have no point of the tube.

    Args:
        times: Times of the tube, shape (M + 1,).
        levels: Levels of the faces at these times, shape (M + 1, K).
        directions: Directions, shape (K, n).
        boxes: Lower and upper corners, shape (2, 1 + n, m).
        marks: Set to True for these boxes and to False for all others, shape (m,).
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
