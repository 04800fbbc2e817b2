"""Coordinates of an ellipsoid; matrix properties are checked in ball arithmetic.

The ellipsoid is V(e) = e'Pe <= alpha, with e the deviation from a reference. The
coordinates z with e = T z have T = L^-T U, rounded, with L the Cholesky factor of P,
and U a rotation that makes the quadratic part of the change of V nearly diagonal. The
proof needs only a delta with |T'PT - I| <= delta, computed in balls (intervals of real
numbers). Then (1 - delta) |z|^2 <= V(e) <= (1 + delta) |z|^2.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from flint import arb, arb_mat

Floats = list[list[float]]
_SWEEPS = 60


def square(a: arb) -> arb:
    """Square of a ball, from its ends.

    The square of [-1, 1] is [0, 1], but the product a * a would be [-1, 1].
    """
    low, high = a.abs_lower(), a.abs_upper()
    return (low * low).union(high * high)


def absolute(a: arb) -> arb:
    """Absolute value of a ball, from its ends."""
    return a.abs_lower().union(a.abs_upper())


class IndefiniteError(ValueError):
    """A matrix cannot be shown to be positive definite in ball arithmetic."""


def symmetric(rows: Sequence[Sequence[float]]) -> arb_mat:
    """The symmetric part of a square matrix, in balls."""
    n = len(rows)
    return arb_mat(
        [[(arb(rows[i][j]) + arb(rows[j][i])) / 2 for j in range(n)] for i in range(n)]
    )


def identity(n: int) -> arb_mat:
    """The identity matrix, shape (n, n)."""
    return arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])


def is_positive_definite(matrix: arb_mat) -> bool:
    """Return whether every matrix in a matrix of balls is positive definite.

    Args:
        matrix: Symmetric, of balls (intervals of real numbers), shape (n, n).

    Returns:
        False also if the balls are too wide to decide it.
    """
    n = matrix.nrows()
    factor = [[arb(0)] * n for _ in range(n)]
    for j in range(n):
        pivot = matrix[j, j] - sum((square(factor[j][k]) for k in range(j)), arb(0))
        if not pivot > 0:
            return False
        factor[j][j] = pivot.sqrt()
        for i in range(j + 1, n):
            rest = sum((factor[i][k] * factor[j][k] for k in range(j)), arb(0))
            factor[i][j] = (matrix[i, j] - rest) / factor[j][j]
    return True


def root_of_inverse(matrix: arb_mat) -> Floats:
    """L^-T of a positive definite matrix LL', rounded.

    Args:
        matrix: Symmetric, shape (n, n).

    Returns:
        Floats, shape (n, n).

    Raises:
        IndefiniteError: If it cannot be shown positive definite in balls.
    """
    if not is_positive_definite(matrix):
        raise IndefiniteError
    n = matrix.nrows()
    a = middle(matrix)
    factor = [[0.0] * n for _ in range(n)]
    for j in range(n):
        rest = a[j][j] - sum(factor[j][k] ** 2 for k in range(j))
        # Shown positive in balls; in floats it may round to 0 or below.
        factor[j][j] = math.sqrt(max(rest, 5e-324))
        for i in range(j + 1, n):
            done = sum(factor[i][k] * factor[j][k] for k in range(j))
            factor[i][j] = (a[i][j] - done) / factor[j][j]
    inverse = arb_mat(factor).inv()
    return middle(inverse.transpose())


def middle(matrix: arb_mat) -> Floats:
    """The middles of the balls as floats."""
    return [[float(entry.mid()) for entry in row] for row in matrix.tolist()]


def distance_from_identity(matrix: arb_mat) -> arb:
    """An upper bound of |matrix - I| in the Frobenius norm."""
    n = matrix.nrows()
    rest = matrix - identity(n)
    total = sum((square(entry) for entry in rest.entries()), arb(0))
    # The ball of a sum of squares may reach below 0 by its rounding.
    return total.upper().sqrt().upper()


def rotation(matrix: Floats) -> Floats:
    """Eigenvectors of a symmetric matrix by Jacobi's rotations, rounded.

    Args:
        matrix: Symmetric, shape (n, n).

    Returns:
        Eigenvectors as columns, shape (n, n).
    """
    n = len(matrix)
    a = [row[:] for row in matrix]
    vectors = [[float(i == j) for j in range(n)] for i in range(n)]
    for _ in range(_SWEEPS):
        # Products: powers of floats raise an error if they overflow.
        rest = sum(a[i][j] * a[i][j] for i in range(n) for j in range(n) if i != j)
        # Squares: the entries beside the diagonal are below rounding.
        if rest <= 1e-34 * sum(a[i][j] * a[i][j] for i in range(n) for j in range(n)):
            break
        for i in range(n):
            for j in range(i + 1, n):
                _rotate(a, vectors, i, j)
    return vectors


def _rotate(a: Floats, vectors: Floats, i: int, j: int) -> None:
    if a[i][j] == 0.0:
        return
    angle = 0.5 * math.atan2(2 * a[i][j], a[j][j] - a[i][i])
    c, s = math.cos(angle), math.sin(angle)
    for row in (*a, *vectors):
        row[i], row[j] = c * row[i] - s * row[j], s * row[i] + c * row[j]
    a[i], a[j] = (
        [c * p - s * q for p, q in zip(a[i], a[j], strict=True)],
        [s * p + c * q for p, q in zip(a[i], a[j], strict=True)],
    )
