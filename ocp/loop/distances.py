"""Smallest and largest distance of two points that move along polynomials.

Two points a(s), b(s), 0 <= s <= 1, of degree 5 each; r = a - b. Two steps:

1.  Pieces that cannot contain the extreme are excluded. With d the distance at the
    ends, l the length of the chord of r, and e the largest distance of a point from
    its chord,

        (d_0 + d_1 - l) / 2 - e_a - e_b  <=  |r|  <=  max(d_0, d_1) + e_a + e_b

2.  On the other pieces |r|^2 is a polynomial of degree 10 in Bernstein form. It lies
    between its smallest and its largest coefficient; the first and the last one are
    its values at the ends. Pieces are halved (de Casteljau) until no bound exceeds
    the best end by TOLERANCE: branch and bound, so no extreme between samples is
    missed.

Source: Farin (2002), Curves and Surfaces for CAGD, chapters 4 and 5.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.loop.dense_output import DEGREE, choices

Indices = NDArray[np.intp]

TOLERANCE = 1e-8
"""Largest error of a distance, in the points' unit."""
BLOCK = 2**20
"""Number of pairs times pieces that are processed together."""
MOST_HALVINGS = 50
"""Largest number of halvings; then a piece is shorter than the rounding of its ends."""


def smallest_distance(curves: Array, first: Indices, second: Indices) -> float:
    """Return the smallest distance of any pair over all time.

    Args:
        curves: Bernstein coefficients of the points' coordinates, shape
            (points, dimensions, pieces, 6).
        first: Index of one point of each pair, shape (pairs,).
        second: Index of the other point, shape (pairs,).

    Raises:
        InvalidProblemError: If there is no pair.

    Example:
        Two points on crossing lines, one a second before the other:

        >>> import numpy as np
        >>> from swarmstart.ocp import smallest_distance
        >>> s = np.linspace(0.0, 1.0, 6)
        >>> one, other = [4 * s - 2, 0 * s], [0 * s, 4 * s - 1]
        >>> curves = np.array([one, other])[:, :, None, :]
        >>> distance = smallest_distance(curves, np.array([0]), np.array([1]))
        >>> print(round(distance, 9), round(0.5**0.5, 9))
        0.707106781 0.707106781
    """
    return _extreme(curves, first, second, sign=1)


def largest_distance(curves: Array, first: Indices, second: Indices) -> float:
    """Return the largest distance of any pair over all time; see `smallest_distance`.

    Example:
        >>> import numpy as np
        >>> from swarmstart.ocp import largest_distance
        >>> s = np.linspace(0.0, 1.0, 6)
        >>> curves = np.array([[3 * s, 4 * s], [0 * s, 0 * s]])[:, :, None, :]
        >>> print(largest_distance(curves, np.array([0]), np.array([1])))
        5.0
    """
    return _extreme(curves, first, second, sign=-1)


def _extreme(curves: Array, first: Indices, second: Indices, *, sign: int) -> float:
    """Return the distance with the smallest sign |r|."""
    if not first.size:
        raise InvalidProblemError("expected at least one pair of points, got none")
    bends, best = _bends(curves), np.inf
    for i, j in _blocks(first, second, pieces=curves.shape[2]):
        ends, low = _bounds(curves, bends[i] + bends[j], i, j, sign=sign)
        best = min(best, float(ends.min()))
        pair, piece = np.nonzero(low < best - TOLERANCE)
        relative = curves[i[pair], :, piece] - curves[j[pair], :, piece]
        best = _least(relative, best, sign=sign)
    return abs(best)


def _blocks(
    first: Indices, second: Indices, *, pieces: int
) -> Iterator[tuple[Indices, Indices]]:
    """Yield the pairs in groups that fit into memory."""
    size = max(1, BLOCK // pieces)
    for begin in range(0, first.size, size):
        yield first[begin : begin + size], second[begin : begin + size]


def _bends(curves: Array) -> Array:
    """Return the largest distance of a point from its chord, shape (points, pieces)."""
    s = np.arange(DEGREE + 1) / DEGREE
    chords = curves[..., :1] * (1.0 - s) + curves[..., -1:] * s
    return np.asarray(np.linalg.norm(curves - chords, axis=1).max(axis=-1))


def _bounds(
    curves: Array, bends: Array, i: Indices, j: Indices, *, sign: int
) -> tuple[Array, Array]:
    """Return sign |r| at the nearer end, and a lower bound of it: (pairs, pieces)."""
    begins, ends = curves[..., 0], curves[..., -1]
    begin, end = begins[i] - begins[j], ends[i] - ends[j]
    d0, d1 = np.linalg.norm(begin, axis=1), np.linalg.norm(end, axis=1)
    if sign < 0:
        farther = np.maximum(d0, d1)
        return -farther, -farther - bends
    chord = np.linalg.norm(end - begin, axis=1)
    return np.minimum(d0, d1), (d0 + d1 - chord) / 2 - bends


def _squares(relative: Array) -> Array:
    """Return |r|^2 in Bernstein form, shape (n, 11), of r, shape (n, dimensions, 6)."""
    products = np.einsum("ndi,ndj->nij", relative, relative)
    return np.asarray(products.reshape(-1, (DEGREE + 1) ** 2) @ _PRODUCT)


def _least(relative: Array, best: float, *, sign: int) -> float:
    """Return the smallest sign |r|.

    Args:
        relative: Bernstein coefficients of r, shape (n, dimensions, 6).
        best: The smallest sign |r| known so far.
        sign: 1 or -1.
    """
    for _ in range(MOST_HALVINGS):
        if not relative.size:
            break
        squares = _squares(relative)
        ends = np.sqrt(np.maximum(squares[:, [0, -1]], 0.0))
        best = min(best, float((sign * ends).min()))
        # |a - b| <= TOLERANCE follows from |a^2 - b^2| <= TOLERANCE max(|a|, |b|).
        room = TOLERANCE * max(abs(best), TOLERANCE)
        low = (sign * squares).min(axis=1)
        # r is halved, not |r|^2, whose rounding would hide small distances.
        relative = relative[low < sign * best**2 - room]
        relative = np.concatenate([relative @ _FRONT_HALF, relative @ _BACK_HALF])
    return best


_EACH = np.arange(DEGREE + 1)
_SUMS = (_EACH[:, None] + _EACH).ravel()
_CHOICES = np.outer(choices(DEGREE, _EACH), choices(DEGREE, _EACH)).ravel()
_PRODUCT = (_CHOICES / choices(2 * DEGREE, _SUMS))[:, None] * (
    _SUMS[:, None] == np.arange(2 * DEGREE + 1)
)
"""Products of coefficients (i, j) -> coefficients of the product."""
_FRONT_HALF = choices(_EACH, _EACH[:, None]) / 2.0**_EACH
_BACK_HALF = _FRONT_HALF[::-1, ::-1]
