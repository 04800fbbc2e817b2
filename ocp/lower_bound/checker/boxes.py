"""Boxes of (t, x, boxed controls), one per column, and their cutting by constraints.

A box holds all points with lower <= y <= upper. Cutting drops points that are proven to
be outside a set {c <= 0}; every bound is moved outwards by more than its rounding.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.lower_bound.checker.models import (
    GROWTH,
    ROUNDING,
    TINY,
    Array,
    Model,
    algebra_of,
)

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """A batch of boxes.

    Attributes:
        lower: Shape (d, N).
        upper: Shape (d, N).
        slab: Number of a slab of the tube for each box, (N,); used for the tube's faces
            only.
    """

    lower: Array
    upper: Array
    slab: NDArray[np.int64]

    @property
    def count(self) -> int:
        """Number of boxes."""
        return int(self.lower.shape[1])

    @property
    def middle(self) -> Array:
        """Points about the middles, floats, shape (d, N)."""
        return np.clip(0.5 * self.lower + 0.5 * self.upper, self.lower, self.upper)

    @property
    def radius(self) -> Array:
        """Distances from the middles to the farther ends, rounded up, shape (d, N)."""
        middle = self.middle
        reach = np.maximum(self.upper - middle, middle - self.lower)
        return np.where(reach > 0.0, np.nextafter(reach, np.inf), 0.0)

    def variables(self) -> list[Model]:
        """Return the coordinates as Taylor models."""
        algebra = algebra_of(len(self.lower))
        middle, radius = self.middle, self.radius
        return [
            algebra.variable(a, middle[a], radius[a]) for a in range(len(self.lower))
        ]

    def points(self) -> Boxes:
        """Return the middles as boxes without width."""
        middle = self.middle
        return Boxes(middle, middle, self.slab)

    def only(self, which: Flags | NDArray[np.int64] | slice) -> Boxes:
        """Return some of the boxes."""
        return Boxes(self.lower[:, which], self.upper[:, which], self.slab[which])

    def halves(self, axes: NDArray[np.int64]) -> tuple[Boxes, Flags]:
        """Cut each box in two along an axis.

        Args:
            axes: Axis for each box, (N,).

        Returns:
            Both halves of all boxes; a mask of boxes that are too thin to be cut.
        """
        each = np.arange(self.count)
        cut = self.middle[axes, each]
        thin = (cut <= self.lower[axes, each]) | (cut >= self.upper[axes, each])
        below, above = self.upper.copy(), self.lower.copy()
        below[axes, each], above[axes, each] = cut, cut
        return joined(
            [Boxes(self.lower, below, self.slab), Boxes(above, self.upper, self.slab)]
        ), thin


def joined(batches: list[Boxes]) -> Boxes:
    """Return all boxes of several batches, in order."""
    return Boxes(
        np.concatenate([batch.lower for batch in batches], axis=1),
        np.concatenate([batch.upper for batch in batches], axis=1),
        np.concatenate([batch.slab for batch in batches]),
    )


def is_empty(boxes: Boxes) -> Flags:
    """Return which boxes hold no point, (N,)."""
    return np.asarray((boxes.lower > boxes.upper).any(axis=0), dtype=np.bool_)


@np.errstate(all="ignore")
def cut_by(boxes: Boxes, constraint: Model) -> tuple[Boxes, Flags]:
    """Drop points with c > 0.

    c >= c_0 + sum of g_a s_a - rest over the box, so that c <= 0 needs, for each a,
    g_a s_a <= rest - c_0 + sum over the others of |g|.

    Args:
        boxes: Boxes.
        constraint: c as models over them.

    Returns:
        Smaller boxes; a mask of boxes without any point with c <= 0.
    """
    d = len(boxes.lower)
    slopes = constraint.coefficients[1 : 1 + d]
    sizes = np.abs(slopes)
    rest = (constraint.sums[2:].sum(axis=0) + constraint.error) * GROWTH
    middle, radius = boxes.middle, boxes.radius
    lower, upper = boxes.lower.copy(), boxes.upper.copy()
    total = sizes.sum(axis=0) * GROWTH
    for a in range(d):
        others = (sizes.sum(axis=0) - sizes[a]) + ROUNDING * total
        room = rest + others - constraint.middle
        room += ROUNDING * (rest + others + np.abs(constraint.middle)) + TINY
        reach = room / sizes[a]
        # The bound of s_a, moved out; at least -1 if the box is not empty.
        reach += ROUNDING * np.abs(reach) + TINY
        at = np.clip(reach, -1.0, 1.0) * radius[a]
        at += ROUNDING * radius[a] + TINY
        pad = 2.0**-50 * np.abs(middle[a])
        useful = np.isfinite(reach) & (reach < 1.0)
        right, left = useful & (slopes[a] > 0.0), useful & (slopes[a] < 0.0)
        upper[a] = np.where(right, np.minimum(upper[a], middle[a] + at + pad), upper[a])
        lower[a] = np.where(left, np.maximum(lower[a], middle[a] - at - pad), lower[a])
    return Boxes(lower, upper, boxes.slab), constraint.lower > 0.0
