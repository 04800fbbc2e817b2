"""Derivatives in interval arithmetic, and bounds on the cells of a ball from them.

The ball is |z| <= r in n dimensions, and its points are z = rho w / |w| with w on a
face of the cube [-1, 1]^n. So the ball is covered exactly by 2n boxes of (rho, w),
which are divided further. The points z of such a box are a cell. Needed of a cell are
its size and the maximum of a linear function on it.

Let c be a function of e = T z with a constant matrix T, m a point of a cell (in z), and
d = z - m for the points z of the cell. Then

    c <= c(m) + sup g'd + sup d'Hd/2 + sup |D^3 c [d, d, d]| / 6,

with g and H the gradient and the Hessian at m, the third derivatives over the whole
cell, and sup over the points of the cell. On a cell with a kink only the first
derivatives may be used (`smoothness.py`):

    c <= c(m) + sup g'd,

with g over the whole cell. On a cell in which the function may jump, as atan2 does at
its branch cut, there is no bound.

All derivatives are evaluated in interval arithmetic in the coordinates e, in which
those of a model's linear parts are constants; T is then applied to the numbers that
result. Intervals of transformed expressions would be many times wider, since intervals
do not cancel.

Source: Neumaier (1990), Interval Methods for Systems of Equations; Makino and Berz
(2003), Taylor models and other validated functional inclusion methods.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from itertools import combinations_with_replacement

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.terminal_set.interval_arithmetic.intervals import (
    IntervalEvaluation,
    interval_function,
)
from swarmstart.terminal_set.interval_arithmetic.smoothness import Kinks
from swarmstart.terminal_set.linear.arrays import Mask

PADDING = 1e-12
"""Padding of sums of products, relative to the sum of sizes; it exceeds rounding."""


class Derivatives:
    """Derivatives of functions up to the third order, in interval arithmetic.

    Attributes:
        pairs: Numbers (i, j), i <= j, of the coordinates of each second derivative.
        triples: Numbers (i, j, k), i <= j <= k, of the coordinates of each third
            derivative.
    """

    def __init__(
        self, functions: Sequence[ca.SX], point: ca.SX, parameters: ca.SX | None = None
    ) -> None:
        """Form the derivatives.

        Args:
            functions: Scalar expressions of the point and the parameters.
            point: Symbols of the coordinates, shape (d, 1).
            parameters: Symbols of further inputs, shape (p, 1); None means no further
                inputs.
        """
        d = range(point.numel())
        self.pairs = [(i, j) for i in d for j in d if i <= j]
        self.triples = list(combinations_with_replacement(d, 3))
        self._inputs = point if parameters is None else ca.vertcat(point, parameters)
        self._orders: list[tuple[ca.SX, ca.SX, ca.SX, ca.SX]] = []
        for function in functions:
            slope = ca.gradient(function, point)
            full = ca.jacobian(slope, point)
            bends = ca.vertcat(*[full[pair] for pair in self.pairs])
            turns = ca.jacobian(bends, point)
            third = [turns[self.pairs.index((i, j)), k] for i, j, k in self.triples]
            self._orders.append((function, slope, bends, ca.vertcat(*third)))

    def of(self, *orders: int, takes_jumps: bool = False) -> IntervalEvaluation:
        """Return the interval evaluation of all derivatives of the given orders.

        Its outputs are a column: all derivatives of the first function, then all of the
        next function, and so on.

        Args:
            orders: 0 for the value, 1 for slopes, and so on to 3.
            takes_jumps: See `evaluated`.
        """
        column = ca.vertcat(*[all_[order] for all_ in self._orders for order in orders])
        return evaluated(ca.densify(column), self._inputs, takes_jumps=takes_jumps)


class TaylorForm:
    """Upper bounds of a function c(e) on cells: parts of a ball of z, with e = T z."""

    def __init__(self, c: ca.Function, T: Array) -> None:
        """Build the functions that are evaluated.

        Args:
            c: Function e (n, 1) -> a number.
            T: Matrix T of e = T z, shape (n, n).

        Raises:
            UnknownIntervalOperationError: If c has an operation without interval form.
        """
        e = ca.SX.sym("e", len(T))
        self._kinks = Kinks(c)
        derivatives = Derivatives([c(e)], e)
        self._pairs = _symmetric_entries(len(T), derivatives.pairs)
        self._triples = _symmetric_entries(len(T), derivatives.triples)
        self._value_and_slope, self._hessian, self._third = (
            derivatives.of(*orders, takes_jumps=True) for orders in ((0, 1), (2,), (3,))
        )
        self._T, self._size = T, np.abs(T)

    def turned(self, T: Array) -> TaylorForm:
        """Return the form of the same function c(e) with another matrix in e = T z.

        Args:
            T: The new matrix, shape (n, n).
        """
        other = copy(self)
        other._T, other._size = T, np.abs(T)
        return other

    def __call__(self, cells: Cells) -> tuple[Array, Array]:
        """Bound c on cells.

        Args:
            cells: m cells.

        Returns:
            Upper bounds, (m,); variation of c along rho and each w, (1 + nx, m).
        """
        with np.errstate(invalid="ignore", over="ignore"):
            bound, spread = self._bounded(cells)
            box = self._box(cells)
            kinks, cuts = self._kinks(*box)
            if kinks.any():
                first, wide = self._bounded_by_slopes(cells, *box)
                bound = np.where(kinks, first, bound)
                spread = np.where(kinks, wide, spread)
        bound, spread = np.where(cuts, np.inf, bound), np.where(cuts, np.nan, spread)
        # If nothing is known, the widest side is cut.
        known = np.isfinite(spread).all(axis=0)
        return bound, np.where(known, spread, cells.half)

    def _bounded(self, cells: Cells) -> tuple[Array, Array]:
        """Return bounds and spread, NaN if a derivative is unbounded."""
        size, d = self._size, cells.reach
        at = self._T @ cells.z
        low, high = self._value_and_slope(at, at)
        slope = self._T.T @ ((low[1:] + high[1:]) / 2)
        unsure = size.T @ ((high[1:] - low[1:]) / 2 + PADDING * np.abs(high[1:]))
        bends, wide = self.hessians(at, at)
        most = np.abs(bends) + wide
        own = np.einsum("mii->im", bends + wide)
        sizes = np.einsum("mii->im", most).copy()
        np.einsum("mii->mi", most)[...] = 0.0  # A view of the diagonals.
        crossed = np.einsum("mij,jm->im", most, d)
        pull = crossed + sizes * d
        # Since d_i^2 >= 0, only a positive H_ii adds to the bound.
        bent = (np.maximum(own, 0.0) * d + crossed) * d / 2
        # The point is T z rounded, which changes the slopes and the value.
        rounded = PADDING * (size @ np.abs(cells.z))
        moved = np.abs(high[1:]) * rounded
        unsure += np.einsum("mij,jm->im", wide, np.abs(cells.z))
        third = self._third_order(cells, d)
        steps, along = cells.linear(slope)
        terms = [steps, unsure * d, moved, bent, third * d / 6]
        spread = cells.spread(along, pull + third / 2)
        return added_up(high[0], np.vstack(terms)), spread

    def _box(self, cells: Cells) -> tuple[Array, Array]:
        """Return boxes of e around the cells."""
        at, reach = self._T @ cells.z_middle, self._size @ cells.z_reach * (1 + PADDING)
        return at - reach, at + reach

    def _bounded_by_slopes(
        self, cells: Cells, lower: Array, upper: Array
    ) -> tuple[Array, Array]:
        """Return bounds and spread by first derivatives over the boxes of the cells."""
        size, at = self._size, self._T @ cells.z
        _, high = self._value_and_slope(at, at)
        middle, radius = middle_and_radius(*self._value_and_slope(lower, upper))
        slope, unsure = self._T.T @ middle[1:], size.T @ radius[1:]
        rounded = PADDING * (size @ np.abs(cells.z))
        moved = (np.abs(middle[1:]) + radius[1:]) * rounded
        # The transformed slopes are rounded too.
        unsure += PADDING * (size.T @ np.abs(middle[1:]))
        steps, along = cells.linear(slope)
        terms = np.vstack([steps, unsure * cells.reach, moved])
        return added_up(high[0], terms), cells.spread(along, unsure)

    def kinks(self, lower: Array, upper: Array) -> tuple[Mask, Mask]:
        """Return two masks (m,): boxes that may have kinks; boxes that may have cuts.

        Cuts are the branch cuts of atan2.
        """
        return self._kinks(lower, upper)

    def hessians(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Return T'(Hessian of c)T over boxes of e: middles and radii, (m, n, n).

        Args:
            lower: Lower corners, shape (n, m).
            upper: Upper corners.
        """
        middle, radius = middle_and_radius(*self._hessian(lower, upper))
        middle, radius = middle.T[:, self._pairs], radius.T[:, self._pairs]
        with np.errstate(invalid="ignore", over="ignore"):
            return self._T.T @ middle @ self._T, self._size.T @ radius @ self._size

    def beyond_second_order(self, cells: Cells, d: Array) -> Array:
        """Bound the third-order term of a Taylor series about a point.

        Args:
            cells: Cells that contain the point and the argument of the series.
            d: Largest distance between the two along each axis, (n, m).

        Returns:
            Upper bounds of |D^3 c [d, d, d]| / 6 over the cells, shape (m,); infinite
            in cells with a kink or a branch cut.
        """
        with np.errstate(invalid="ignore", over="ignore"):
            third = self._third_order(cells, d)
        kinks, cuts = self._kinks(*self._box(cells))
        return np.where(kinks | cuts, np.inf, added_up(0 * d[0], third * d / 6))

    def hessian_slopes(self, lower: Array, upper: Array) -> Array:
        """Bound the rate of change of T'(Hessian of c)T along the last axis, (m, n, n).

        Args:
            lower: Lower corners of boxes of e, shape (n, m).
            upper: Upper corners.
        """
        middle, radius = middle_and_radius(*self._third(lower, upper))
        tensor = np.abs(_turned(middle.T[:, self._triples], self._T))
        tensor += _turned(radius.T[:, self._triples], self._size)
        return np.asarray(tensor[..., -1])

    def _third_order(self, cells: Cells, d: Array) -> Array:
        """Bound |D^3 c [x, x, .]| over cells, |x_i| <= d_i, (n, m)."""
        middle, radius = middle_and_radius(*self._third(*self._box(cells)))
        tensor = _turned(middle.T[:, self._triples], self._T)
        along = _twice_along(np.abs(tensor), d.T)
        # This bound of the radius is enough, and faster.
        wide = _twice_along(radius.T[:, self._triples], (self._size @ d).T)
        return np.asarray((along + wide @ self._size).T)


def _turned(tensor: Array, T: Array) -> Array:
    """Return sum t_ijk T_ia T_jb T_kc of m tensors (m, n, n, n)."""
    for _ in range(3):
        # Apply T to the last axis, which then becomes the first one.
        turned = (tensor.reshape(-1, len(T)) @ T).reshape(tensor.shape)
        tensor = np.ascontiguousarray(np.moveaxis(turned, 3, 1))
    return tensor


def evaluated(
    expression: ca.SX, v: ca.SX, *, takes_jumps: bool = False
) -> IntervalEvaluation:
    """Return the interval evaluation of a column.

    Args:
        expression: The column.
        v: The column of symbols that it depends on.
        takes_jumps: Whether sign and <= are accepted, which occur in the derivatives of
            functions with kinks; at a jump the interval then holds the values of both
            sides, and the caller must look for the kinks (`smoothness.py`).

    Raises:
        UnknownIntervalOperationError: If it has an operation without interval form.
    """
    function = ca.Function("what_is_bounded", [v], [ca.cse(expression)])
    return interval_function(function, takes_jumps=takes_jumps)


def middle_and_radius(low: Array, high: Array) -> tuple[Array, Array]:
    """Return middles and radii of intervals, with room in the radii for rounding."""
    size = np.maximum(np.abs(low), np.abs(high))
    with np.errstate(invalid="ignore", over="ignore"):
        return (low + high) / 2, (high - low) / 2 + PADDING * size


def _symmetric_entries(
    size: int, different: Sequence[tuple[int, ...]]
) -> NDArray[np.intp]:
    """Return the number of the distinct entry for each entry of a symmetric tensor.

    Args:
        size: Range of each index.
        different: Indices of the distinct entries, each in order.

    Returns:
        Numbers of the distinct entries, shape (size,) * order.
    """
    numbers = {indices: number for number, indices in enumerate(different)}
    entries = np.empty((size,) * len(different[0]), dtype=np.intp)
    for indices in np.ndindex(entries.shape):
        entries[indices] = numbers[tuple(sorted(indices))]
    return entries


def _twice_along(tensor: Array, d: Array) -> Array:
    """Return sum_jk t_ijk d_j d_k of m tensors (m, n, n, n), d (m, n); (m, n)."""
    matrices = (tensor @ d[:, None, :, None])[..., 0]
    return np.asarray((matrices @ d[:, :, None])[..., 0])


class Cells:
    """The cells of a ball: the points z = rho w / |w| of boxes of (rho, w).

    Attributes:
        z: The point of each cell about which functions are expanded, (nx, m).
        reach: Distance from `z` to the ends of the cell along each axis, (nx, m).
        z_middle: Middle of the box around each cell, (nx, m).
        z_reach: Half widths of that box, (nx, m).
        half: Half of the width of each box in rho and w, (1 + nx, m).
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

        Let u be the unit vector along the middle w_m of the box of w, g = g_r u + g_t
        with g_t at right angles to u, x = rho w / |w|, and w = |w_m| u + dw. Then
        g'x = rho (g_r cos(u, w) + g_t'dw / |w|).

        Args:
            g: Slopes, shape (nx, m).

        Returns:
            The terms, (2 + nx, m); the slope along rho and along each w, (1 + nx, m).
        """
        radial = (g * self._u).sum(axis=0)
        beside = g - radial * self._u
        sine = np.linalg.norm(self.half[1:], axis=0) / self._nearest
        # cos >= sqrt(1 - sin^2) if the cell is narrow; else it may be -1.
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
            along: Slopes along rho and each w in the middle, (1 + nx, m).
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
        """Return terms and slopes as `Cells.linear`; the last row of g is for t."""
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
        least: The least squares of the entries.
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
