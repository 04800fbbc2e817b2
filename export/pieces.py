"""Polynomials over windows of equal length that follow a path, with their error.

The path between its samples is a cubic spline. Over n windows, a spline of the wanted
degree is fitted to it by least squares, with the ends pinned; n is doubled until it is
near enough to every sample. It has one continuous derivative less than its degree.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.polynomial import polynomial
from scipy.interpolate import CubicSpline, make_lsq_spline

from swarmstart.arrays import Array
from swarmstart.export.paths import AXES, ExportError, VehiclePath

POINTS = 24
"""Points for the fit in each window, more than a piece has coefficients."""
PINNED = 1e6
"""Weight of both ends of the path."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Pieces:
    """Polynomials one after another.

    Attributes:
        length: Time of each piece [s].
        coefficients: Of each piece, power and axis, the constant first and the time
            from the piece's begin, shape (n, degree + 1, 3).
        error: Largest distance from a sample of the path [m].
    """

    length: float
    coefficients: Array
    error: float

    def at(self, times: Array, derivative: int = 0) -> Array:
        """Return the positions at times, or a derivative of them, shape (k, 3)."""
        number = np.clip(
            (times / self.length).astype(int), 0, len(self.coefficients) - 1
        )
        given = self.coefficients[number]
        for _ in range(derivative):
            powers = np.arange(1, given.shape[1])
            given = given[:, 1:] * powers[None, :, None]
        since = (times - number * self.length)[:, None]
        found = np.zeros((times.size, AXES))
        for power in range(given.shape[1] - 1, -1, -1):
            found = found * since + given[:, power]
        return found

    def largest(self, derivative: int) -> tuple[float, float]:
        """Return the largest size of a derivative, and its time [s]."""
        times = [0.0, self.length * len(self.coefficients)]
        for number, piece in enumerate(self.coefficients):
            begin = number * self.length
            of_axes = [polynomial.polyder(axis, derivative) for axis in piece.T]
            squared = sum(
                (polynomial.polymul(one, one) for one in of_axes), np.zeros(1)
            )
            roots = polynomial.polyroots(
                np.trim_zeros(polynomial.polyder(squared), "b")
            )
            real = roots[np.abs(roots.imag) < 1e-9 * self.length].real
            inside = real[(real >= 0.0) & (real <= self.length)]
            times += [begin, *(begin + inside)]
        sizes = np.linalg.norm(self.at(np.array(times), derivative), axis=1)
        place = int(sizes.argmax())
        return float(sizes[place]), float(times[place])


def fitted(path: VehiclePath, degree: int, error: float, most: int) -> Pieces:
    """Return the fewest pieces, 1, 2, 4 and so on, that are near enough to a path.

    Args:
        path: The path.
        degree: Degree of the polynomials.
        error: Largest distance from its samples [m].
        most: Largest number of pieces.

    Raises:
        ExportError: If so many pieces are farther away.
    """
    through = CubicSpline(path.times, path.positions)
    count, found = 1, _of_windows(path, through, degree, 1)
    while found.error > error and count < most:
        count = min(2 * count, most)
        found = _of_windows(path, through, degree, count)
    if not found.error <= error:
        raise ExportError(
            f"vehicle {path.name}: expected an error of at most {error:g} m, found "
            f"{found.error:.3g} m with {most} pieces of degree {degree}, the most that "
            f"the format has: {path.duration:g} s are {path.duration / most:.3g} s for "
            "each; allow a larger error, or export a shorter run"
        )
    return found


def _of_windows(
    path: VehiclePath, through: CubicSpline, degree: int, count: int
) -> Pieces:
    """Return the fit over some windows."""
    end = path.duration
    knots = np.linspace(0.0, end, count + 1)
    times = np.linspace(0.0, end, POINTS * count + 1)
    weights = np.ones(times.size)
    weights[[0, -1]] = PINNED
    every = np.concatenate([[0.0] * (degree + 1), knots[1:-1], [end] * (degree + 1)])
    spline = make_lsq_spline(times, through(times), every, k=degree, w=weights)
    # Of the Taylor series from the begin of each window; splines are right-continuous.
    powers = [spline(knots[:-1], nu=n) / factorial(n) for n in range(degree + 1)]
    found = Pieces(length=end / count, coefficients=np.stack(powers, axis=1), error=0.0)
    off = np.linalg.norm(found.at(path.times) - path.positions, axis=1).max()
    return Pieces(
        length=found.length, coefficients=found.coefficients, error=float(off)
    )
