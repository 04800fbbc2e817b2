"""Proof that a function is not below a number on a set, by branch and bound.

The number is found on the way: it begins with what is hoped for, and where a point of
the set lies lower it is moved there. So a search that ends has proven something, and
the points that it met show where the polynomial must become better.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.lower_bound.hamiltonian import Bounds

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
CHUNK = 8192
BEYOND = 1.05
"""How much lower than a point that was met the number is set."""
FEW = 40_000
"""Boxes that are still looked at, for points, when the number is of no use any more."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Floor:
    """The outcome of a search.

    Attributes:
        slack: The function is at least -slack on the set, if `proven`.
        proven: Whether that is so: not if a box has no bound at all.
        boxes: How many were looked at.
        points: Points of the set where the function is below what was hoped for, shape
            (d, N), the lowest first.
        lowest: The least value met; infinite without points.
    """

    slack: float
    proven: bool
    boxes: int
    points: Array
    lowest: float


@dataclass(frozen=True, kw_only=True, slots=True)
class Limits:
    """Limits at which a search ends.

    Attributes:
        until: At which time, of `time.perf_counter` [s].
        useless: Slack from which on the outcome would be of no use.
        max_boxes: After how many boxes.
    """

    until: float
    useless: float = np.inf
    max_boxes: int = 20_000_000


def proven_floor(
    bounds: Callable[[Array, Array], Bounds],
    outside: Callable[[Array, Array], Mask],
    value: Callable[[Array], Array],
    start: tuple[Array, Array],
    hoped: float,
    limits: Limits,
) -> Floor:
    """Prove that a function is at least -slack on a set, with little slack.

    Args:
        bounds: Lower and upper corners of boxes, (d, m) -> lower bounds of it.
        outside: The same -> which boxes have surely no point of the set.
        value: Points (d, N) -> its values; infinite for points outside of the set.
        start: Boxes that cover the set, (d, m) each.
        hoped: The slack hoped for, > 0.
        limits: When the search ends.
    """
    stack, boxes, slack = [start], 0, hoped
    met: list[Array] = []
    values: list[Array] = []
    useless_since = -1
    while stack:
        lower, upper = _next(stack)
        lower, upper = _left(outside, lower, upper)
        boxes += lower.shape[1]
        if not lower.size:
            continue
        found = bounds(lower, upper)
        left = ~(found.low >= -slack)
        if not left.any():
            continue
        lower, upper, spread = lower[:, left], upper[:, left], found.spread[:, left]
        middle = (lower + upper) / 2
        at = value(middle)
        below = at < -hoped
        if below.any():
            met.append(middle[:, below])
            values.append(at[below])
            slack = max(slack, -BEYOND * float(at.min()))
        stack.append(halved(lower, upper, spread))
        if slack >= limits.useless and useless_since < 0:
            useless_since = boxes
        given_up = useless_since >= 0 and boxes > useless_since + FEW
        too_long = boxes > limits.max_boxes or clock.perf_counter() > limits.until
        if given_up or too_long or (spread.max(axis=0) <= 0).any():
            break
    # What is left has lower bounds, too: a poor proof is one all the same.
    slack = max(slack, -_least(bounds, outside, stack))
    d = start[0].shape[0]
    points = np.hstack(met) if met else np.zeros((d, 0))
    each = np.concatenate(values) if values else np.zeros(0)
    order = np.argsort(each)
    return Floor(
        slack=slack,
        proven=bool(np.isfinite(slack)),
        boxes=boxes,
        points=points[:, order],
        lowest=float(each.min()) if each.size else np.inf,
    )


def _left(
    outside: Callable[[Array, Array], Mask], lower: Array, upper: Array
) -> tuple[Array, Array]:
    """Return the boxes that may have points of the set."""
    kept = ~outside(lower, upper)
    return lower[:, kept], upper[:, kept]


def _least(
    bounds: Callable[[Array, Array], Bounds],
    outside: Callable[[Array, Array], Mask],
    stack: list[tuple[Array, Array]],
) -> float:
    """Return the least lower bound of boxes, infinite if there are none."""
    least = np.inf
    while stack:
        lower, upper = _left(outside, *_next(stack))
        if lower.size:
            low = bounds(lower, upper).low
            # The built-in min would pass over a bound that is NaN.
            least = min(least, float(np.where(np.isnan(low), -np.inf, low).min()))
    return least


def _next(stack: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    lower, upper = stack.pop()
    if lower.shape[1] > CHUNK:
        stack.append((lower[:, CHUNK:], upper[:, CHUNK:]))
        lower, upper = lower[:, :CHUNK], upper[:, :CHUNK]
    return lower, upper


def halved(lower: Array, upper: Array, spread: Array) -> tuple[Array, Array]:
    """Return boxes cut in two along the coordinate of the largest spread."""
    axis, each = spread.argmax(axis=0), np.arange(lower.shape[1])
    middle = (lower[axis, each] + upper[axis, each]) / 2
    below, above = upper.copy(), lower.copy()
    below[axis, each], above[axis, each] = middle, middle
    return np.hstack([lower, above]), np.hstack([below, upper])
