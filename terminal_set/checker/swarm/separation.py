"""Distances of tubes (`certificate_file.Tube`), proven by a separating plane in floats.

Between two steps the difference of two chords is a segment from a to b. If n is a
vector of at most unit length,

    |a + s (b - a)| >= n . (a + s (b - a)) >= min(n . a, n . b)    for s in [0, 1].

The vector only has to be good, not exact: it points to about the nearest point of the
segment. What is left is the rounding of differences and products, below 2^-48 of the
sizes of a, b and the distance.
"""

import numpy as np
from numpy.typing import NDArray

ROUNDING = 2.0**-48
"""Bound of relative rounding errors of differences and products of three: 32 units."""
Array = NDArray[np.float64]


def separated(start: Array, end: Array, least: Array) -> NDArray[np.bool_]:
    """Return whether segments are proven to stay a distance away from the origin.

    Args:
        start: Beginnings of the segments, shape (..., 3); rounded differences of two
            floats.
        end: Ends of the segments, shape (..., 3).
        least: The distances to be kept, shape (...).
    """
    way = end - start
    length = (way**2).sum(axis=-1)
    along = -(start * way).sum(axis=-1) / np.where(length > 0.0, length, 1.0)
    near = start + np.clip(along, 0.0, 1.0)[..., None] * way
    size = np.sqrt((near**2).sum(axis=-1))
    normal = near / np.where(size > 0.0, size, 1.0)[..., None] * (1.0 - ROUNDING)
    slack = ROUNDING * (
        np.abs(start).sum(axis=-1) + np.abs(end).sum(axis=-1) + np.abs(least)
    )
    found = np.minimum((normal * start).sum(axis=-1), (normal * end).sum(axis=-1))
    return np.asarray(found - slack >= least)
