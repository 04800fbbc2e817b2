"""Validated arrays: finite, of the right shape, read-only copies.

A gain computed from a NaN or from a weight of the wrong sign would be wrong without
notice, so every input array is validated here; errors name the array.

The errors are data classes whose fields are their arguments, in order, so that they can
be pickled by a worker process.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError

Mask = NDArray[np.bool_]

SYMMETRY_TOLERANCE = 1e-8
"""Largest |M - M'| / |M| (Frobenius norms) of a matrix taken as symmetric."""


@dataclass(eq=False)
class NotFiniteError(SwarmstartError, ValueError):
    """An array holds NaN, an infinity or something that is not a real number.

    Attributes:
        name: Name of the array.
    """

    name: str

    def __str__(self) -> str:
        """Return a message with the array's name."""
        return f"{self.name} must hold finite real numbers only"


@dataclass(eq=False)
class InvalidShapeError(SwarmstartError, ValueError):
    """An array has another shape than the one it must have.

    Attributes:
        name: Name of the array.
        shape: Shape found.
        expected: Shape required; None stands for any size of at least 1.
    """

    name: str
    shape: tuple[int, ...]
    expected: tuple[int | None, ...]

    def __str__(self) -> str:
        """Say both shapes."""
        sizes = ["any" if size is None else str(size) for size in self.expected]
        wanted = f"({', '.join(sizes)}{',' if len(sizes) == 1 else ''})"
        return f"{self.name} must have shape {wanted}, got {self.shape}"


@dataclass(eq=False)
class NotPositiveError(SwarmstartError, ValueError):
    """A step, a level or a bound must be positive and finite, but is not.

    Attributes:
        name: Name of the number.
        value: The number found, the smallest one if there are several.
    """

    name: str
    value: float

    def __str__(self) -> str:
        """Say which number."""
        return f"{self.name} must be a positive number, got {self.value:.6g}"


@dataclass(eq=False)
class AsymmetricMatrixError(SwarmstartError, ValueError):
    """A matrix that must be symmetric is not.

    Attributes:
        name: Name of the matrix.
        asymmetry: |M - M'| / |M|, Frobenius norms.
    """

    name: str
    asymmetry: float

    def __str__(self) -> str:
        """Say by how much."""
        return (
            f"{self.name} must be symmetric, but |M - M'| / |M| is "
            f"{self.asymmetry:.3g} (allowed: {SYMMETRY_TOLERANCE:.0e})"
        )


@dataclass(eq=False)
class IndefiniteMatrixError(SwarmstartError, ValueError):
    """A weight or a Lyapunov matrix has an eigenvalue of the wrong sign.

    Attributes:
        name: Name of the matrix.
        smallest_eigenvalue: Its smallest eigenvalue.
        needed: "positive definite" or "positive semidefinite".
    """

    name: str
    smallest_eigenvalue: float
    needed: str

    def __str__(self) -> str:
        """Say by which eigenvalue."""
        return (
            f"{self.name} must be {self.needed}, but its smallest eigenvalue is "
            f"{self.smallest_eigenvalue:.6g}"
        )


def finite_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """Copy a value into a read-only float array of the shape given.

    Args:
        name: Name of the array in errors.
        value: Anything NumPy makes a real array of.
        shape: Required shape; None stands for any size of at least 1.

    Returns:
        A read-only copy.

    Raises:
        NotFiniteError: If the value holds NaN, infinity or no real numbers.
        InvalidShapeError: If the shape differs.
    """
    array = bound_array(name, value, shape)
    if not np.all(np.isfinite(array)):
        raise NotFiniteError(name)
    return array


def bound_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """Copy bounds into a read-only float array; an infinite one means "no bound".

    Args:
        name: Name of the array in errors.
        value: Anything NumPy makes a real array of.
        shape: Required shape; None stands for any size of at least 1.

    Returns:
        A read-only copy, without NaN.

    Raises:
        NotFiniteError: If the value holds NaN or no real numbers.
        InvalidShapeError: If the shape differs.
    """
    array = _real_array(name, value).astype(np.float64)
    if array.ndim != len(shape) or not all(
        found == size or (size is None and found > 0)
        for found, size in zip(array.shape, shape, strict=True)
    ):
        raise InvalidShapeError(name, array.shape, shape)
    if np.any(np.isnan(array)):
        raise NotFiniteError(name)
    return read_only(array)


def columns_of(name: str, value: ArrayLike, size: int) -> Array:
    """Return a point, or many as columns, without a copy; NaN is allowed.

    Args:
        name: Name of the array in errors.
        value: One point, shape (size,), or many, shape (size, n).
        size: Required number of rows.

    Returns:
        The value as a float array.

    Raises:
        NotFiniteError: If the value holds no real numbers.
        InvalidShapeError: If the number of rows differs.
    """
    columns = _real_array(name, value)
    if columns.ndim not in {1, 2} or len(columns) != size:
        expected = (size,) if columns.ndim < 2 else (size, None)  # noqa: PLR2004
        raise InvalidShapeError(name, columns.shape, expected)
    return columns


def _real_array(name: str, value: ArrayLike) -> Array:
    """Return a float array, without a copy if it is one."""
    try:  # Complex numbers and texts are refused, not converted.
        return np.asarray(value).astype(np.float64, casting="same_kind", copy=False)
    except (TypeError, ValueError) as error:
        raise NotFiniteError(name) from error


def read_only(array: Array) -> Array:
    """Set an array of the library itself read-only and return it."""
    array.setflags(write=False)
    return array


def square_matrix(name: str, value: ArrayLike, size: int | None = None) -> Array:
    """Copy a finite square matrix.

    Args:
        name: Name of the array in errors.
        value: The matrix, shape (size, size).
        size: Required number of rows; None means any number.

    Returns:
        A read-only copy.

    Raises:
        NotFiniteError: If the value holds NaN, infinity or no real numbers.
        InvalidShapeError: If it is no matrix, not square or of another size.
    """
    matrix = finite_array(name, value, (size, size))
    if matrix.shape[0] != matrix.shape[1]:
        raise InvalidShapeError(name, matrix.shape, (matrix.shape[0],) * 2)
    return matrix


def positive_definite(name: str, value: ArrayLike, size: int | None = None) -> Array:
    """Copy a symmetric positive definite matrix.

    Args:
        name: Name of the array in errors.
        value: The matrix, shape (size, size).
        size: Required number of rows; None means any number.

    Returns:
        A read-only copy, made symmetric to the last bit.

    Raises:
        NotFiniteError: If the value holds NaN, infinity or no real numbers.
        InvalidShapeError: If it is no matrix, not square or of another size.
        AsymmetricMatrixError: If it is not symmetric.
        IndefiniteMatrixError: If an eigenvalue is negative or, to rounding, zero.
    """
    matrix, smallest, rounding = _symmetric(name, value, size)
    if not smallest > rounding:
        raise IndefiniteMatrixError(name, smallest, "positive definite")
    return matrix


def positive_semidefinite(
    name: str, value: ArrayLike, size: int | None = None
) -> Array:
    """Copy a symmetric positive semidefinite matrix.

    Args:
        name: Name of the array in errors.
        value: The matrix, shape (size, size).
        size: Required number of rows; None means any number.

    Returns:
        A read-only copy, made symmetric to the last bit.

    Raises:
        NotFiniteError: If the value holds NaN, infinity or no real numbers.
        InvalidShapeError: If it is no matrix, not square or of another size.
        AsymmetricMatrixError: If it is not symmetric.
        IndefiniteMatrixError: If an eigenvalue is negative beyond rounding.
    """
    matrix, smallest, rounding = _symmetric(name, value, size)
    if not smallest >= -rounding:
        raise IndefiniteMatrixError(name, smallest, "positive semidefinite")
    return matrix


def _symmetric(
    name: str, value: ArrayLike, size: int | None
) -> tuple[Array, float, float]:
    """Copy a symmetric matrix; return it, its smallest eigenvalue, its rounding."""
    matrix = square_matrix(name, value, size)
    asymmetry = float(np.linalg.norm(matrix - matrix.T))
    norm = float(np.linalg.norm(matrix))
    if asymmetry > SYMMETRY_TOLERANCE * norm:  # The norm may be 0.
        raise AsymmetricMatrixError(name, asymmetry / norm)
    matrix = read_only((matrix + matrix.T) / 2)
    eigenvalues = np.linalg.eigvalsh(matrix)
    # A bound of the error of the computed eigenvalues.
    rounding = float(np.finfo(np.float64).eps * len(matrix) * np.abs(eigenvalues).max())
    return matrix, float(eigenvalues[0]), rounding
