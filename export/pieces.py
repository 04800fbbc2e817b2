"""Polynomials over windows of time that follow a path, with their error.

The path between its samples is a cubic spline. Over n windows, a spline of the wanted
degree is fitted to this path by least squares, with both ends of the path kept exactly;
n is doubled until the fitted spline is near enough to every sample. A fitted spline of
degree k has k - 1 continuous derivatives.

Two divisions into windows are tried: windows of equal length, and windows that are the
shorter, the larger the cube root of the path's third derivative is. The nearer fit is
kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import factorial

import numpy as np
from numpy.polynomial import polynomial
from scipy.interpolate import CubicSpline, make_lsq_spline

from swarmstart.arrays import Array
from swarmstart.export.paths import AXES, ExportError, VehiclePath

POINTS = 24
"""Points for the fit in each window, more than a piece has coefficients."""
FINE, FLOOR = 20, 0.3
"""Points for the jerk in each window; part of its mean density that is added to it."""
PINNED = 1e6
"""Weight of both ends of the path."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Pieces:
    """Polynomials one after another.

    Attributes:
        knots: Times at which the pieces begin, and the end, shape (n + 1,) [s].
        coefficients: Coefficients of each piece, power and axis, shape (n, degree + 1,
            3). The constant comes first; time counts from the beginning of the piece.
        error: Largest distance of the polynomials from a sample of the path [m].
    """

    knots: Array
    coefficients: Array
    error: float

    @property
    def lengths(self) -> Array:
        """Duration of each piece, shape (n,) [s]."""
        return np.diff(self.knots)

    def at(self, times: Array, derivative: int = 0) -> Array:
        """Return the positions at times, or a derivative of them, shape (k, 3)."""
        last = len(self.coefficients) - 1
        number = np.clip(np.searchsorted(self.knots, times, "right") - 1, 0, last)
        given = self.coefficients[number]
        for _ in range(derivative):
            powers = np.arange(1, given.shape[1])
            given = given[:, 1:] * powers[None, :, None]
        since = (times - self.knots[number])[:, None]
        found = np.zeros((times.size, AXES))
        for power in range(given.shape[1] - 1, -1, -1):
            found = found * since + given[:, power]
        return found

    def largest(self, derivative: int) -> tuple[float, float]:
        """Return the largest Euclidean norm of a derivative, and its time [s].

        Args:
            derivative: Order of the derivative of the positions.
        """
        times = [float(self.knots[-1])]
        pieces = zip(self.knots[:-1], self.lengths, self.coefficients, strict=True)
        for begin, length, piece in pieces:
            of_axes = [polynomial.polyder(axis, derivative) for axis in piece.T]
            # Of the same degree, also if the leading coefficients are zero.
            squared = np.sum([np.convolve(one, one) for one in of_axes], axis=0)
            slope = np.trim_zeros(polynomial.polyder(squared), "b")
            roots = polynomial.polyroots(slope)
            real = roots[np.abs(roots.imag) < 1e-9 * length].real
            inside = real[(real >= 0.0) & (real <= length)]
            times += [begin, *(begin + inside)]
        sizes = np.linalg.norm(self.at(np.array(times), derivative), axis=1)
        place = int(sizes.argmax())
        return float(sizes[place]), float(times[place])


def fitted(path: VehiclePath, degree: int, error: float, most: int) -> Pieces:
    """Return the fewest pieces, 1, 2, 4 and so on, that are near enough to a path.

    Args:
        path: Path of the vehicle.
        degree: Degree of the polynomials.
        error: Largest allowed distance of the polynomials from the path's samples [m].
        most: Largest number of pieces.

    Raises:
        ExportError: If `most` pieces are still farther away than `error`.
    """
    through = CubicSpline(path.times, path.positions)
    count, found = 1, _nearest(path, through, degree, 1)
    while found.error > error and count < most:
        count = min(2 * count, most)
        found = _nearest(path, through, degree, count)
    if not found.error <= error:
        raise ExportError(
            f"vehicle {path.name}: expected an error of at most {error:g} m, found "
            f"{found.error:.3g} m with {most} pieces of degree {degree}, the most that "
            "the format has; allow a larger error, or export a shorter run"
        )
    return found


def _nearest(
    path: VehiclePath, through: CubicSpline, degree: int, count: int
) -> Pieces:
    """Return the fit over equal windows, or over others if that is nearer."""
    even = np.linspace(0.0, path.duration, count + 1)
    fits = [_of_windows(path, through, degree, even)]
    if count > 1:
        by_jerk = _knots_by_jerk(through, even)
        fits.append(_of_windows(path, through, degree, by_jerk))
    return min(fits, key=lambda one: one.error)


def _knots_by_jerk(through: CubicSpline, even: Array) -> Array:
    """Return knots with the same integral of the cube root of the jerk in between."""
    times = np.linspace(0.0, even[-1], FINE * even.size)
    middles = (times[1:] + times[:-1]) / 2.0
    density = np.linalg.norm(through(middles, nu=3), axis=1) ** (1.0 / 3.0)
    density += FLOOR * density.mean() + np.finfo(float).tiny
    share = np.concatenate([[0.0], np.cumsum(density)])
    found: Array = np.interp(even / even[-1] * share[-1], share, times)
    return found


def _of_windows(
    path: VehiclePath, through: CubicSpline, degree: int, knots: Array
) -> Pieces:
    """Return the fit over the windows between knots."""
    end = knots[-1]
    parts = np.arange(POINTS) / POINTS
    times = np.append((knots[:-1, None] + np.diff(knots)[:, None] * parts).ravel(), end)
    weights = np.ones(times.size)
    weights[[0, -1]] = PINNED
    every = np.concatenate([[0.0] * (degree + 1), knots[1:-1], [end] * (degree + 1)])
    spline = make_lsq_spline(times, through(times), every, k=degree, w=weights)
    # Of the Taylor series from the begin of each window; splines are right-continuous.
    powers = [spline(knots[:-1], nu=n) / factorial(n) for n in range(degree + 1)]
    found = Pieces(knots=knots, coefficients=np.stack(powers, axis=1), error=0.0)
    off = np.linalg.norm(found.at(path.times) - path.positions, axis=1).max()
    return replace(found, error=float(off))
