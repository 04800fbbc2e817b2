"""The terminal region Omega = {e : e'Pe <= alpha} (5.8).

With P = LL', e = sqrt(alpha) L^-T d maps the unit ball of d onto it; its extent along
axis j is sqrt(alpha (P^-1)_jj), and its shadow on a plane of two axes is the ellipse of
the inverse of that block of P^-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.linear.arrays import (
    Mask,
    NotPositiveError,
    columns_of,
    positive_definite,
)


@dataclass(eq=False)
class InvalidPlaneError(SwarmstartError, ValueError):
    """A plane is not spanned by two different axes of the ellipsoid.

    Attributes:
        i: First axis as given.
        j: Second axis as given.
        nx: Number of axes of the ellipsoid.
    """

    i: int
    j: int
    nx: int

    def __str__(self) -> str:
        """Return a message with the axes that exist."""
        return (
            f"a plane needs two different axes from 0 to {self.nx - 1}, got "
            f"{self.i} and {self.j}"
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Ellipsoid:
    """The set e'Pe <= alpha around the origin.

    Attributes:
        P: Shape, (nx, nx), symmetric positive definite; copied and read-only.
        alpha: Level, > 0 and finite.

    Raises:
        InvalidShapeError: If P is not a square matrix.
        NotFiniteError: If P holds NaN or infinity.
        AsymmetricMatrixError: If P is not symmetric.
        IndefiniteMatrixError: If P is not positive definite.
        NotPositiveError: If alpha is not positive and finite.
    """

    P: Array
    alpha: float

    def __post_init__(self) -> None:
        """Check P and alpha; copy P."""
        object.__setattr__(self, "P", positive_definite("P", self.P))
        if not 0 < self.alpha < np.inf:
            raise NotPositiveError("alpha", self.alpha)

    def value(self, e: ArrayLike) -> Array:
        """Compute e'Pe.

        Args:
            e: A deviation from the reference, shape (nx,), or many, shape (nx, n).

        Returns:
            The value, shape () or (n,).

        Raises:
            InvalidShapeError: If e has another number of rows.
        """
        columns = columns_of("e", e, len(self.P))
        return np.asarray(np.einsum("i...,ij,j...->...", columns, self.P, columns))

    def contains(self, e: ArrayLike, *, tolerance: float = 0.0) -> Mask:
        """Return whether e'Pe <= alpha (1 + tolerance).

        Args:
            e: A deviation from the reference, shape (nx,), or many, shape (nx, n).
            tolerance: Allowance relative to alpha, for rounding.

        Returns:
            True for deviations inside, shape () or (n,); False for NaN.

        Raises:
            InvalidShapeError: If e has another number of rows.
        """
        return np.asarray(self.value(e) <= self.alpha * (1 + tolerance))

    def extent(self) -> Array:
        """Compute the half widths sqrt(alpha (P^-1)_jj), shape (nx,)."""
        return np.asarray(np.sqrt(self.alpha * np.diag(np.linalg.inv(self.P))))

    def boundary(self, directions: ArrayLike) -> Array:
        """Map directions onto the boundary, e'Pe = alpha.

        Directions that are uniform on the unit sphere are mapped to points that are
        uniform in the coordinates in which the ellipsoid is a ball.

        Args:
            directions: One direction, shape (nx,), or many, shape (nx, n), not zero.

        Returns:
            Points on the boundary, of the same shape.

        Raises:
            InvalidShapeError: If directions have another number of rows.
            NotPositiveError: If a direction is zero.
        """
        columns = columns_of("directions", directions, len(self.P))
        lengths = np.linalg.norm(columns, axis=0)
        if not np.all(lengths > 0):
            raise NotPositiveError("the length of a direction", float(np.min(lengths)))
        on_ball = np.sqrt(self.alpha) * columns / lengths
        return np.asarray(np.linalg.solve(np.linalg.cholesky(self.P).T, on_ball))

    def shadow(self, i: int, j: int, *, count: int = 201) -> Array:
        """Outline the projection on the plane of two axes, as for a figure.

        Args:
            i: First axis, 0 to nx - 1.
            j: Second axis, another one.
            count: Number of points; the last closes the curve.

        Returns:
            Points on the outline, shape (2, count), coordinate i in the first row.

        Raises:
            InvalidPlaneError: If the axes are equal or out of range.
        """
        nx = len(self.P)
        if i == j or not (0 <= i < nx and 0 <= j < nx):
            raise InvalidPlaneError(i, j, nx)
        block = np.linalg.inv(self.P)[np.ix_([i, j], [i, j])]
        angle = np.linspace(0.0, 2 * np.pi, count)
        circle = np.sqrt(self.alpha) * np.array([np.cos(angle), np.sin(angle)])
        return np.asarray(np.linalg.cholesky(block) @ circle)
