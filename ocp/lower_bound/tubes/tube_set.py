"""Queries of a tube: its levels over a time, boxes outside, points inside.

Proofs use `levels_over`, `box_over`, `outside` and `starting_boxes`, which are rounded
outwards. `inside` and `sampled` are for samples only, in plain floats.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.stated.evidence import Tube
from swarmstart.ocp.lower_bound.tubes.support import PAD
from swarmstart.ocp.lower_bound.tubes.tube_kernel import mark_outside

Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

_AT_ENDS = 0.04
"""Fraction of the samples at the first time, and as many at the last."""
_ROUNDS = 6
_SLABS_WALKED = 16
_STEPS = 12


def levels_over(tube: Tube, t_low: Array, t_high: Array) -> Array:
    """Return upper bounds of the levels over intervals of time.

    Args:
        tube: The tube.
        t_low: Beginnings [s], shape (m,).
        t_high: Ends, shape (m,), at least t_low. Times before 0 count as 0, times after
            the latest end as that.

    Returns:
        Shape (K, m).
    """
    return _levels_over(tube, tube.levels.T, t_low, t_high)


def box_over(tube: Tube, t_low: Array, t_high: Array) -> tuple[Array, Array]:
    """Return boxes that hold the tube over intervals of time.

    Args:
        tube: The tube.
        t_low: Beginnings [s], shape (m,).
        t_high: Ends, shape (m,).

    Returns:
        Lower and upper corners, each (n, m).
    """
    axes = tube.levels.T[: 2 * tube.directions.shape[1]]
    levels = _levels_over(tube, axes, t_low, t_high)
    return -levels[1::2], levels[0::2]


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
        upper: Upper corners.

    Returns:
        Shape (m,); False for boxes with a NaN.
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
        points: Shape (1 + n, N).

    Returns:
        Shape (N,).
    """
    is_time = (points[0] >= tube.times[0]) & (points[0] <= tube.times[-1])
    levels = _levels_at(tube.times, tube.levels.T, points[0])
    is_in = (tube.directions @ points[1:] <= levels).all(axis=0)
    return np.asarray(is_in & is_time)


def sampled(
    tube: Tube,
    rng: np.random.Generator,
    count: int,
    *,
    between: tuple[float, float] | None = None,
) -> Array:
    """Return random points (t, x) of the tube, roughly uniform in its volume.

    About 4 % are at the first time, and as many at the last.

    Args:
        tube: The tube.
        rng: Source of randomness.
        count: Number of points, at least 1.
        between: First and last time [s], which may be the same; None means all times.

    Returns:
        Shape (1 + n, count), in no order.
    """
    low, high = (tube.times[0], tube.times[-1]) if between is None else between
    at_ends = int(np.ceil(_AT_ENDS * count))
    parts = [
        _accepted(tube, rng, _times(tube, rng, span, tried))[:, :wanted]
        for span, tried, wanted in (
            ((low, low), 16 * at_ends, at_ends),
            ((high, high), 16 * at_ends, at_ends),
        )
    ]
    found = parts[0].shape[1] + parts[1].shape[1]
    for number in range(_ROUNDS):
        if found >= count:
            break
        tried = 2**number * (2 * count + 100)
        parts.append(_accepted(tube, rng, _times(tube, rng, (low, high), tried)))
        found += parts[-1].shape[1]
    if found < count:
        parts.append(_walked(tube, rng, (low, high), count - found))
    points = np.hstack(parts)[:, :count]
    return np.asarray(points[:, rng.permutation(count)])


def _levels_over(tube: Tube, levels: Array, t_low: Array, t_high: Array) -> Array:
    """Return upper bounds of some levels over intervals of time.

    Args:
        tube: Of the times.
        levels: Shape (rows, M + 1).
        t_low: Begins, shape (m,).
        t_high: Ends.
    """
    times = tube.times
    low, high = _slab(times, t_low, "right"), _slab(times, t_high, "left")
    most = np.maximum(
        _levels_at(times, levels, t_low, low), _levels_at(times, levels, t_high, high)
    )
    # Interpolation has an error of a few 2^-51 of the levels at both ends of a slab.
    most += PAD * np.abs(levels).max(axis=1, keepdims=True)
    several = np.flatnonzero(high > low)
    if several.size:
        knots = _greatest(levels, low[several] + 1, high[several])
        most[:, several] = np.maximum(most[:, several], knots)
    return np.asarray(most)


def _slab(times: Array, t: Array, side: str) -> Index:
    """Return the slab of each time; of two slabs, the later one for side "right"."""
    last = len(times) - 2
    if side == "right":
        return np.clip(np.searchsorted(times, t, side="right") - 1, 0, last)
    return np.clip(np.searchsorted(times, t, side="left") - 1, 0, last)


def _levels_at(
    times: Array, levels: Array, t: Array, slab: Index | None = None
) -> Array:
    """Return levels at times, in plain floats, shape (rows, m)."""
    slab = _slab(times, t, "right") if slab is None else slab
    begin = times[slab]
    part = np.clip((t - begin) / (times[slab + 1] - begin), 0.0, 1.0)
    start = levels[:, slab]
    return np.asarray(start + (levels[:, slab + 1] - start) * part)


def _greatest(levels: Array, first: Index, last: Index) -> Array:
    """Return the greatest level at the times first, ..., last of each, (rows, m)."""
    # Row p of the table holds the greatest of 2^p times from each time on.
    table = [levels]
    while 2 ** len(table) <= levels.shape[1]:
        before, step = table[-1], 2 ** (len(table) - 1)
        table.append(np.maximum(before[:, :-step], before[:, step:]))
    power = np.frexp((last - first + 1).astype(np.float64))[1] - 1
    most = np.empty((levels.shape[0], len(first)))
    for p in np.unique(power):
        chosen = power == p
        one, other = first[chosen], last[chosen] + 1 - 2**p
        most[:, chosen] = np.maximum(table[p][:, one], table[p][:, other])
    return most


def _times(
    tube: Tube, rng: np.random.Generator, span: tuple[float, float], count: int
) -> Array:
    """Return random times, more often those at which the tube's box is large."""
    low, high = span
    if not low < high:
        return np.full(count, low)
    begins, ends = (
        np.clip(part, low, high) for part in (tube.times[:-1], tube.times[1:])
    )
    lower, upper = starting_boxes(tube)
    volumes = (upper - lower)[1:].prod(axis=0) * (ends - begins)
    if not volumes.sum() > 0.0:
        volumes = ends - begins
    slab = rng.choice(len(volumes), size=count, p=volumes / volumes.sum())
    return np.asarray(begins[slab] + (ends - begins)[slab] * rng.random(count))


def _accepted(tube: Tube, rng: np.random.Generator, t: Array) -> Array:
    """Return random points of the tube's boxes at some times that are in the tube."""
    n = tube.directions.shape[1]
    levels = _levels_at(tube.times, tube.levels.T[: 2 * n], t)
    lower, upper = -levels[1::2], levels[0::2]
    points = np.vstack([t, lower + (upper - lower) * rng.random(lower.shape)])
    return points[:, inside(tube, points)]


def _walked(
    tube: Tube, rng: np.random.Generator, span: tuple[float, float], count: int
) -> Array:
    """Return points of a thin tube, by random walks from the middles of some slabs.

    Source: Smith (1984), Operations Research 32 (6), 1296-1308 (hit and run).
    """
    slabs = _slab(tube.times, _times(tube, rng, span, _SLABS_WALKED), "right")
    middles = np.array([[_middle(tube, s), _middle(tube, s + 1)] for s in slabs])
    chosen = rng.integers(len(slabs), size=count)
    begins, ends = tube.times[slabs[chosen]], tube.times[slabs[chosen] + 1]
    t = np.clip(begins + (ends - begins) * rng.random(count), *span)
    part = (t - begins) / (ends - begins)
    x = (
        middles[chosen, 0] * (1 - part)[:, None] + middles[chosen, 1] * part[:, None]
    ).T
    levels = _levels_at(tube.times, tube.levels.T, t, slabs[chosen])
    for _ in range(_STEPS):
        way = rng.standard_normal(x.shape)
        speed = tube.directions @ way
        room = np.maximum(levels - tube.directions @ x, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            steps = room / speed
        ahead = np.where(speed > 0.0, steps, np.inf).min(axis=0)
        behind = np.where(speed < 0.0, steps, -np.inf).max(axis=0)
        x = x + (behind + (ahead - behind) * rng.random(count)) * way
    return np.vstack([t, x])


def _middle(tube: Tube, knot: int) -> Array:
    """Return the middle of the largest ball in the tube at one of its times."""
    n = tube.directions.shape[1]
    rows = np.column_stack([tube.directions, np.ones(len(tube.directions))])
    found = linprog(
        np.append(np.zeros(n), -1.0),
        A_ub=rows,
        b_ub=tube.levels[knot],
        bounds=[(None, None)] * n + [(0.0, None)],
    )
    if found.x is not None:
        return np.asarray(found.x[:n])
    levels = tube.levels[knot]
    return np.asarray(0.5 * (levels[0 : 2 * n : 2] - levels[1 : 2 * n : 2]))
