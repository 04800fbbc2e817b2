"""Blocks in the plane, discs and rounded rectangles, and distances from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array

Point = tuple[float, float]
Box = tuple[Point, Point]
SIGNS = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])


@dataclass(frozen=True, slots=True)
class Block:
    """Axis-parallel rectangle with rounded corners; a disc if all three sizes agree.

    It is the open set {p : dist(p, core) < r}.

    Attributes:
        center: Centre (x, y) [m].
        half_width: a, half the size along x, at least the radius [m].
        half_height: b, half the size along y, at least the radius [m].
        radius: r of the corners [m]; 0 for sharp ones.

    Raises:
        ValueError: If a number is not finite, r is negative, or a or b is less than r
            or not positive.
    """

    center: Point
    half_width: float
    half_height: float
    radius: float

    def __post_init__(self) -> None:
        """Validate the sizes."""
        least = min(self.half_width, self.half_height)
        sizes = (*self.center, self.half_width, self.half_height, self.radius)
        if not (np.isfinite(sizes).all() and 0 <= self.radius <= least and least > 0):
            raise ValueError(
                "a block needs finite numbers, half sizes above 0 and a radius from 0 "
                f"to the lesser half size, got {self}"
            )

    @property
    def core(self) -> Array:
        """Half sizes (a - r, b - r) of the core, shape (2,) [m]."""
        return np.array([self.half_width, self.half_height]) - self.radius


def disc(center: Point, radius: float) -> Block:
    """Return a disc."""
    return Block(center, radius, radius, radius)


def enlarged(block: Block, by: float) -> Block:
    """Return a block whose boundary is moved outwards [m]; the core stays."""
    a, b, r = block.half_width + by, block.half_height + by, block.radius + by
    return Block(block.center, a, b, r)


def corners(blocks: Sequence[Block]) -> Array:
    """Return centres and radii (x, y, r) of all different corners, shape (3, n) [m]."""
    found = [np.empty((3, 0))]
    for block in blocks:
        centers = np.unique(block.center + SIGNS * block.core, axis=0).T
        found.append(np.vstack([centers, np.full(centers.shape[1], block.radius)]))
    return np.hstack(found)


def in_box(points: Array, box: Box) -> NDArray[np.bool_]:
    """Return whether points, shape (2, n), are in a box, its boundary included."""
    lower, upper = np.array(box, dtype=float)[:, :, None]
    return np.asarray(((lower <= points) & (points <= upper)).all(axis=0))


def clearance(points: Array, block: Block) -> Array:
    """Return how far points are from a block, negative inside it.

    Args:
        points: Shape (2, n) [m].
        block: The obstacle.

    Returns:
        Distance to the core less the radius, shape (n,) [m]; in the core -r.
    """
    outside = abs(points - np.array(block.center)[:, None]) - block.core[:, None]
    return np.asarray(np.hypot(*np.maximum(outside, 0.0)) - block.radius)


def segment_clearance(start: Array, end: Array, block: Block) -> Array:
    """Return how far segments are from a block, negative if they meet its inside.

    The distance of two disjoint convex polygons is that of a corner of one to the
    other; whether they meet is seen along separating axes: x, y, the segment's normal.

    Args:
        start: Shape (2, n) [m].
        end: Shape (2, n) [m].
        block: The obstacle.

    Returns:
        Distance to the core less the radius, shape (n,) [m].
    """
    nearest = np.minimum(clearance(start, block), clearance(end, block))
    middle, half = np.array(block.center)[:, None], block.core[:, None]
    edge = end - start
    lower, upper = np.minimum(start, end), np.maximum(start, end)
    meets = ((lower <= middle + half) & (upper >= middle - half)).all(axis=0)
    square = np.maximum((edge**2).sum(axis=0), np.finfo(float).tiny)
    sides = []
    for sign in SIGNS:
        corner = middle + half * sign[:, None] - start
        share = np.clip((corner * edge).sum(axis=0) / square, 0, 1)
        nearest = np.minimum(nearest, np.hypot(*(corner - share * edge)) - block.radius)
        sides.append(edge[0] * corner[1] - edge[1] * corner[0])
    meets &= (np.min(sides, axis=0) <= 0) & (np.max(sides, axis=0) >= 0)
    return np.where(meets, -block.radius, nearest)
