"""Polar coordinates of an ellipsoid, with matrix properties checked in balls.

e = rho T u with |u| = 1 and u = w/|w|, w on a face of the cube [-1, 1]^n. T = L^-T U is
rounded: L the Cholesky factor of P, U a rotation that makes the quadratic part nearly
diagonal. The proof needs delta with |T'PT - I| <= delta only, which is computed in
balls: then (1 - delta) rho^2 <= V(e) <= (1 + delta) rho^2, and
rho^2 <= alpha / (1 - delta) on the whole set.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from flint import arb, arb_mat

from swarmstart.terminal_set.checker.jets import absolute, square

Floats = list[list[float]]
Balls = list[arb]
_SWEEPS = 60
_ROUNDING = 2.0**-52


class IndefiniteError(ValueError):
    """A matrix cannot be shown positive definite in balls."""


def symmetric(rows: Sequence[Sequence[float]]) -> arb_mat:
    """The symmetric part of a square matrix, in balls."""
    n = len(rows)
    return arb_mat(
        [[(arb(rows[i][j]) + arb(rows[j][i])) / 2 for j in range(n)] for i in range(n)]
    )


def identity(n: int) -> arb_mat:
    """The identity, shape (n, n)."""
    return arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])


def is_positive_definite(matrix: arb_mat) -> bool:
    """Return whether every enclosed matrix has a Cholesky factor with positive pivots.

    Args:
        matrix: Symmetric, shape (n, n).

    Returns:
        False also if balls cannot decide it.
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
        rest = sum(a[i][j] ** 2 for i in range(n) for j in range(n) if i != j)
        # Squares: the entries beside the diagonal are below rounding.
        if rest <= 1e-34 * sum(a[i][j] ** 2 for i in range(n) for j in range(n)):
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


def hull(low: float, high: float) -> arb:
    """The ball around an interval of floats."""
    return arb(low) if low == high else arb(low).union(arb(high))


def scaled_by(a: arb, low: float, high: float) -> arb:
    """Return the ball a times an interval of factors, by its ends.

    A product of two balls would be wider.
    """
    return a * low if low == high else (a * low).union(a * high)


def direction_box(w: Sequence[tuple[float, float]]) -> Balls:
    """The box around w/|w| for w in a box on a face of the cube.

    Each entry w_i / sqrt(w_i^2 + r^2) grows with w_i, r being the norm of the others;
    its ends are computed in floats and moved outwards by more than their rounding.

    Args:
        w: Intervals, one of them 1 or -1.

    Returns:
        Balls, shape (n,).
    """
    low2 = [0.0 if a <= 0.0 <= b else min(a * a, b * b) for a, b in w]
    high2 = [max(a * a, b * b) for a, b in w]
    slack = (len(w) + 8) * _ROUNDING
    box = []
    for i, (a, b) in enumerate(w):
        least = sum(low2[:i]) + sum(low2[i + 1 :])
        most = sum(high2[:i]) + sum(high2[i + 1 :])
        low = _share(a, most if a >= 0.0 else least)
        high = _share(b, least if b >= 0.0 else most)
        box.append(arb(low - slack).union(arb(high + slack)))
    return box


def _share(w: float, others: float) -> float:
    return 0.0 if w == 0.0 else w / math.sqrt(w * w + others)


def direction(w: Sequence[float]) -> Balls:
    """The unit vector w/|w| in balls."""
    norm = sum((square(arb(entry)) for entry in w), arb(0)).sqrt()
    return [arb(entry) / norm for entry in w]


class QuadraticPart:
    """Upper bounds of u'Bu over boxes of directions.

    With B nearly diagonal, u'Bu is close to sum_i B_ii w_i^2 / sum_i w_i^2. That
    quotient is monotone in each w_i^2. It is largest with the w_i^2 of the largest B_ii
    at their upper ends and the others at their lower ends: n + 1 candidates.
    """

    def __init__(self, matrix: arb_mat) -> None:
        """Take B symmetric, shape (n, n), in balls."""
        n = matrix.nrows()
        ends = [math.nextafter(float(matrix[i, i].upper()), math.inf) for i in range(n)]
        self._diagonal = [arb(end) for end in ends]
        self._order = sorted(range(n), key=lambda i: -ends[i])
        self._rest = arb(0)
        self._pairs: list[tuple[int, int, arb]] = []
        for i in range(n):
            for j in range(i + 1, n):
                twice = matrix[i, j] + matrix[j, i]
                if twice.abs_upper() < 1e-11:  # noqa: PLR2004  far below any margin
                    self._rest += twice.abs_upper() / 2  # |u_i u_j| <= 1/2
                else:
                    self._pairs.append((i, j, twice))

    @property
    def largest(self) -> arb:
        """An upper bound over all directions."""
        off = sum((absolute(twice) for _, _, twice in self._pairs), arb(0))
        return (self._diagonal[self._order[0]] + self._rest + off).upper()

    def upper(self, w: Sequence[tuple[float, float]], u: Balls) -> arb:
        """An upper bound over a box.

        Args:
            w: Intervals of the cube's face.
            u: The same box as directions.

        Returns:
            A ball whose upper end bounds u'Bu.
        """
        low = [
            arb(0) if a <= 0.0 <= b else square(arb(min(abs(a), abs(b)))) for a, b in w
        ]
        high = [square(arb(max(abs(a), abs(b)))) for a, b in w]
        total = sum(low, arb(0))
        value = sum((d * q for d, q in zip(self._diagonal, low, strict=True)), arb(0))
        best = None
        for i in self._order:
            value += self._diagonal[i] * (high[i] - low[i])
            total += high[i] - low[i]
            if not total > 0:
                continue
            ratio = value / total
            best = ratio if best is None else best.max(ratio)
        bound = self._diagonal[self._order[0]] if best is None else best
        for i, j, twice in self._pairs:
            bound += twice * u[i] * u[j]
        return bound + self._rest
