"""Boxes of radii and directions as cells of a ball.

A direction is u = w / |w| with w on a face of the cube [-1, 1]^n, and a point of the
ball is z = rho w / |w|. So 2n boxes of (rho, w) cover the ball exactly. A function is
bounded over a cell by its series about a point in the middle (`taylor.py`). For that,
this module gives the size of a cell and the maximum of a linear function on it.
"""

from __future__ import annotations

import numpy as np

from swarmstart.arrays import Array

PADDING = 1e-12
"""Padding of sums of products, relative to the sum of their sizes; above rounding."""


class Cells:
    """Boxes of (rho, w) as cells of z = rho w / |w|.

    Attributes:
        z: A point of each cell, to expand about, (nx, m).
        reach: Distance from there to the ends of the cell along each axis, (nx, m).
        z_middle: Middle of the box around each cell, (nx, m).
        z_reach: Half widths of that box, (nx, m).
        half: Half the widths of the boxes, (1 + nx, m).
        radii: Lower and upper ends of rho, each (m,).
    """

    def __init__(self, lower: Array, upper: Array) -> None:
        """Compute the cells of boxes.

        Args:
            lower: Lower corners, shape (1 + nx, m), rho > 0.
            upper: Upper corners, same shape.
        """
        self.radii, w = (lower[0], upper[0]), (lower[1:] + upper[1:]) / 2
        self._faces = (lower[1:], upper[1:])
        self.half = (upper - lower) / 2 * (1 + PADDING)
        self._u = w / np.linalg.norm(w, axis=0)
        least, most = squares(lower[1:], upper[1:])
        self._nearest = np.sqrt(least.sum(axis=0)) * (1 - PADDING)
        low = _directions(lower[1:], most, least, sign=-1.0)
        high = _directions(upper[1:], most, least, sign=1.0)
        low, high = low - PADDING * np.abs(low), high + PADDING * np.abs(high)
        low = np.minimum(low * lower[0], low * upper[0])
        high = np.maximum(high * lower[0], high * upper[0])
        self.z_middle, self.z_reach = (low + high) / 2, (high - low) / 2
        self.z = self._u * (lower[0] + upper[0]) / 2
        self._rho_middle = (lower[0] + upper[0]) / 2
        self.reach = np.maximum(high - self.z, self.z - low)
        self.reach += PADDING * np.abs(self.z)

    @property
    def directions(self) -> Cells:
        """The same boxes of w, at rho = 1."""
        ones = np.ones((1, self.half.shape[1]))
        low, high = (np.vstack([ones, w]) for w in self._faces)
        return Cells(low, high)

    def linear(self, g: Array) -> tuple[Array, Array]:
        """Return terms whose sum is an upper bound of g'(x - z), x in the cell.

        With g = g_r u + g_t, g_t at right angles to the middle direction u, and x =
        rho w / |w|, w = |w_m| u + dw: g'x = rho (g_r cos(u, w) + g_t'dw / |w|).

        Args:
            g: Slopes, shape (nx, m).

        Returns:
            The terms, (2 + nx, m); the slope along rho and along each w, (1 + nx, m).
        """
        radial = (g * self._u).sum(axis=0)
        beside = g - radial * self._u
        sine = np.linalg.norm(self.half[1:], axis=0) / self._nearest
        least = np.where(sine < 1, np.sqrt(np.maximum(1 - sine**2, 0.0)), -1.0)
        cosine = np.where(radial > 0, 1.0, least - PADDING)
        turned = np.abs(beside) * self.half[1:] / self._nearest
        sup = radial * cosine + turned.sum(axis=0)
        rho = np.where(sup > 0, self.radii[1], self.radii[0])
        at = radial * self._rho_middle
        terms = np.vstack([rho * radial * cosine - at, rho * turned])
        rounding = PADDING * rho * np.abs(g).sum(axis=0)
        along = np.vstack([np.abs(radial), np.abs(beside) * rho / self._nearest])
        return np.vstack([terms, rounding]), along

    def spread(self, along: Array, pull: Array) -> Array:
        """Return the variation of a function along rho and each w, (1 + nx, m).

        Args:
            along: Slopes along them in the middle, (1 + nx, m).
            pull: Bounds of the slopes' deviations from the middle, along z, (nx, m).
        """
        radial = (pull * np.abs(self._u)).sum(axis=0)
        beside = pull * self.radii[1] / self._nearest
        return np.asarray(self.half * (along + np.vstack([radial, beside])))


class TimedCells(Cells):
    """Cells of a ball over an interval of times, with t as the last coordinate."""

    def __init__(self, lower: Array, upper: Array, times: tuple[float, float]) -> None:
        """Compute where the cells are.

        Args:
            lower: Lower corners, shape (1 + nx, m), rho > 0.
            upper: Upper corners, same shape.
            times: First and last time, the same for all.
        """
        super().__init__(lower, upper)
        middle, half = (times[0] + times[1]) / 2, (times[1] - times[0]) / 2
        self._half_time = half * (1 + PADDING) + PADDING * middle

        def below(rows: Array, value: float) -> Array:
            return np.vstack([rows, np.full((1, rows.shape[1]), value)])

        self.z, self.reach = below(self.z, middle), below(self.reach, self._half_time)
        self.z_middle = below(self.z_middle, middle)
        self.z_reach = below(self.z_reach, self._half_time)

    def linear(self, g: Array) -> tuple[Array, Array]:
        """Return terms and slopes; see `Cells`, g with a last row for t."""
        terms, along = super().linear(g[:-1])
        return np.vstack([terms, self._half_time * np.abs(g[-1:])]), along

    def spread(self, along: Array, pull: Array) -> Array:
        """Return the variation of a function along rho and each w; see `Cells`."""
        return super().spread(along, pull[:-1])


def _directions(w: Array, most: Array, least: Array, *, sign: float) -> Array:
    """Return the extreme entries of w / |w|: each is monotone in all of w.

    Args:
        w: The ends to take, (nx, m).
        most: The largest squares of the entries.
        least: The least.
        sign: 1 for the largest entries, -1 for the smallest.
    """
    outwards = sign * w >= 0
    others = np.where(outwards, least.sum(axis=0) - least, most.sum(axis=0) - most)
    length = np.sqrt(w**2 + np.maximum(others, 0.0))
    return np.where(length > 0, w / np.where(length > 0, length, 1.0), sign)


def squares(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Return the least and the largest squares of numbers between two ends.

    Args:
        lower: Lower ends.
        upper: Upper ends, same shape.
    """
    inside = (lower <= 0) & (upper >= 0)
    ends = lower**2, upper**2
    return np.where(inside, 0.0, np.minimum(*ends)), np.maximum(*ends)


def added_up(start: Array, steps: Array) -> Array:
    """Return start + the sum of steps, rounded up.

    Args:
        start: Shape (m,).
        steps: Shape (k, m).
    """
    total = start + steps.sum(axis=0)
    size = np.abs(start) + np.abs(steps).sum(axis=0)
    return np.asarray(total + PADDING * size)
