"""Upper bounds of q'x over a polytope {x : D x <= s}, rounding included.

By duality of linear programmes

    max {q'x : D x <= s} = min {y's : D'y = q, y >= 0}

Each y >= 0 gives an upper bound of q'x, and the best vertex of the dual, a y with n
nonzero entries, gives the exact maximum. The vertices do not depend on s: they are
listed once, and a bound for new levels s is a product and a minimum. On the face
d_k'x = s_k the entry y_k may have any sign.

A listed y solves D'y = q in floats only. Its residual r = q - D'y adds r'x, which is
bounded by the size of x: nothing here depends on a tolerance.

Source: Boyd and Vandenberghe (2004), Convex Optimization, section 5.2.4.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array

Index = NDArray[np.int64]

PAD = 2.0**-44
"""Padding, relative to the sum of the sizes of all terms. A float operation has a
relative error of at most 2^-53, so this is enough for sums of products of about 200
operations."""
_NEGATIVE = -1e-12
"""Negative entries of y above this count as 0; the residual r accounts for it."""
_STEEPEST = 1e4
"""Largest entry of y that is kept: larger ones come from nearly parallel rows and give
no good bound."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class DualVertices:
    """The vectors y of some directions q, n entries each.

    Attributes:
        rows: Rows of D that the entries belong to, shape (n, number).
        weights: The entries, shape (n, number).
        residual: Bound of |q - D'y|_1 and of the rounding of y's, relative to the
            largest of |x_i| and |s_k|, shape (number,).
        starts: Index of the first vertex of each q, shape (directions,).
    """

    rows: Index
    weights: Array
    residual: Array
    starts: Index

    def upper(self, levels: Array, reach: float) -> Array:
        """Return upper bounds of q'x over {x : D x <= s}, shape (directions,).

        Args:
            levels: s, shape (rows of D,); or several, shape (number, rows of D): the
                bound then holds for all of them, and for all between two of them.
            reach: Bound of |x_i| for all x in the polytopes and all i.
        """
        terms = self.weights * np.atleast_2d(levels)[:, self.rows]
        # y's is linear in s, so its maximum between two levels is at one of them.
        bounds = terms.sum(axis=1).max(axis=0)
        bounds += self.residual * max(reach, float(np.abs(levels).max()))
        return np.asarray(np.minimum.reduceat(bounds, self.starts))


def dual_vertices(rows: Array, directions: Array) -> DualVertices:
    """List the dual vertices of directions over the polytope itself.

    Args:
        rows: D, shape (R, n), rows that enclose a bounded polytope, the axes of both
            signs among them.
        directions: q, shape (number, n).
    """
    bases = np.array(list(combinations(range(len(rows)), rows.shape[1])))
    found = [_vertices_of(rows, bases, q, is_free=False) for q in directions]
    return _joined(found)


def dual_vertices_on_faces(rows: Array, directions: Array) -> DualVertices:
    """List the dual vertices of directions over faces of the polytope.

    Args:
        rows: D, as `dual_vertices` says.
        directions: Those for the face of each of the first rows, shape
            (faces, number, n), number >= 1.

    Returns:
        Those of directions[0, 0], directions[0, 1], ..., directions[1, 0], ...
    """
    others = rows.shape[1] - 1
    found = []
    for face, queries in enumerate(directions):
        rest = [row for row in range(len(rows)) if row != face]
        bases = np.array([(face, *chosen) for chosen in combinations(rest, others)])
        found += [_vertices_of(rows, bases, q, is_free=True) for q in queries]
    return _joined(found)


def _vertices_of(
    rows: Array, bases: Index, q: Array, *, is_free: bool
) -> tuple[Index, Array, Array]:
    """Return the bases with y >= 0, their y, and the bounds of the residuals."""
    matrices = np.swapaxes(rows[bases], 1, 2)
    is_regular = np.abs(np.linalg.det(matrices)) > 1.0 / _STEEPEST
    bases, matrices = bases[is_regular], matrices[is_regular]
    right = np.broadcast_to(q[:, None], (len(bases), len(q), 1))
    weights = np.linalg.solve(matrices, right)[:, :, 0]
    signed = weights[:, 1:] if is_free else weights
    is_dual = (signed >= _NEGATIVE).all(axis=1) & (
        np.abs(weights).max(axis=1) < _STEEPEST
    )
    bases, matrices, weights = bases[is_dual], matrices[is_dual], weights[is_dual]
    first = 1 if is_free else 0
    weights[:, first:] = np.maximum(weights[:, first:], 0.0)
    products = matrices * weights[:, None, :]
    left = np.abs(q - products.sum(axis=2)).sum(axis=1)
    size = np.abs(products).sum(axis=(1, 2)) + np.abs(q).sum()
    return bases, weights, left + PAD * (size + np.abs(weights).sum(axis=1))


def _joined(found: list[tuple[Index, Array, Array]]) -> DualVertices:
    counts = [len(bases) for bases, _, _ in found]
    return DualVertices(
        rows=np.concatenate([bases for bases, _, _ in found]).T.copy(),
        weights=np.concatenate([weights for _, weights, _ in found]).T.copy(),
        residual=np.concatenate([left for _, _, left in found]),
        starts=np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64),
    )
