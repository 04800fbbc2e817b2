"""Proof of a lower bound of a function on a set, by branch and bound.

The search chooses the bound itself: it begins with a target, and lowers the bound
whenever the function is smaller at a point of the set. So a search always ends with
some bound, unless a box has no bound at all. The points found show where the function,
which is made from a polynomial (subsolution.py), must become larger.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.machine_code import done, now
from swarmstart.ocp.lower_bound.hamiltonian import Bounds

Mask = NDArray[np.bool_]
CHUNK = 8192  # Boxes evaluated at a time.
BEYOND = 1.05
"""Factor by which the slack is set above what the lowest point found needs."""
FEW = 40_000
"""Number of boxes still searched for points when the bound is useless already."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Floor:
    """The outcome of a search.

    Attributes:
        slack: The function is at least -slack on the set, if `proven`.
        proven: Whether the slack is proven; False if a box has no bound at all.
        boxes: Number of boxes searched.
        points: Points of the set at which the function is less than minus the target
            of the slack, shape (d, N), the lowest first.
        lowest: Least value of the function at these points; infinite if there are no
            such points.
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
        until: Value of `machine_code.now()`, which counts work, at which the search
            ends.
        useless: Slack at or above which the outcome would be useless.
        max_boxes: Largest number of boxes.
    """

    until: float
    useless: float = np.inf
    max_boxes: int = 20_000_000


_PER_PASS, _PER_BOX = 1e6, 2000.0
"""Work of a pass over boxes, in operations, and of each box, without its bounds."""


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
        bounds: (lower, upper corners of boxes, each (d, m)) -> lower bounds of the
            function.
        outside: (lower, upper corners of boxes) -> mask of the boxes that certainly
            have no point of the set.
        value: Points (d, N) -> values of the function; infinite for points outside of
            the set.
        start: Lower and upper corners of boxes that cover the set, each (d, m).
        hoped: Target of the slack, > 0.
        limits: Limits at which the search ends.
    """
    stack, boxes, slack = [start], 0, hoped
    met: list[Array] = []
    values: list[Array] = []
    useless_since = -1
    while stack:
        lower, upper = _next(stack)
        lower, upper = _left(outside, lower, upper)
        boxes += lower.shape[1]
        done(_PER_PASS + _PER_BOX * lower.shape[1])
        if not lower.size:
            continue
        found = bounds(lower, upper)
        # Not `<`: a bound that is NaN proves nothing.
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
            # With no more slack than the point needs, boxes around it would be halved
            # without end.
            slack = max(slack, -BEYOND * float(at.min()))
        stack.append(halved(lower, upper, spread))
        if slack >= limits.useless and useless_since < 0:
            useless_since = boxes
        given_up = useless_since >= 0 and boxes > useless_since + FEW
        too_long = boxes > limits.max_boxes or not now() < limits.until
        # If a box has no spread, no cut makes its bound better.
        if given_up or too_long or (spread.max(axis=0) <= 0).any():
            break
    # The remaining boxes have lower bounds too, so even a search cut short is a proof.
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
            # The built-in min would skip a NaN.
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
