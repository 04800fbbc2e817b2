"""Proof of a bound of the Runge-Kutta map's error against the flow, over a hold.

Let e be the deviation at the beginning of the hold, p the curve of the map from there,
with its residual r(e) and r4(e), the fourth derivative of r (`residual.py`), and x the
flow of x' = f from the same state. Let d = p - x, d_0 be the same difference from the
reference itself, that is, from e = 0, and |v|_P the root of v'Pv. With D = d - d_0

    D' = A D + B + r(e) - r(0),   A = f_x somewhere within |d| and |d_0| of p,

where f_x is the Jacobian of f in x, and B = O(d_0) e is small: it would be 0 if the
reference's curve were a solution of x' = f. With |r4(e) - r4(0)|_P <= R(q) |e|_P, the
length of r(e) - r(0) at the time s of a step is at most the integral of (s - q)^3 / 6
R(q) |e|_P over q from 0 to s. On a piece of time of length l, let m be a bound of the
logarithmic norm of T^-1 A T (with T'PT = I), the fastest growth rate of a vector under
A. Then |D|_P at the end of the piece is at most

    e^(m l) |D|_P + e^(max(m, 0) l) (k + b l) |e|_P

with |D|_P at the beginning of the piece, k |e|_P the bound of the residual integrated
over the piece, and b |e|_P a bound of |B|_P. R and m are proven by interval branch and
bound over the whole ellipsoid. R uses the mean-value theorem, so that
|r4(e) - r4(0)| / |e| is bounded, the origin included. A is taken over a tube around p.
That x stays in this tube follows from the bound of |D|_P itself: the bound is below the
tube's radius until the first time at which x would leave the tube, so there is no such
time.

Source: Dahlquist (1959), Stability and error bounds in the numerical integration of
ordinary differential equations; Hairer, Norsett and Wanner (1993), I.10, theorem 10.6.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set.interval_arithmetic.taylor import PADDING, Cells
from swarmstart.terminal_set.proving.enclosure import Undecided
from swarmstart.terminal_set.proving.proof import COVER, Limits, radius_of, search_ball
from swarmstart.terminal_set.proving.residual import Balls, Residual, Times

PIECES = 8
"""Least number of pieces of time in a hold."""
LOOSE = 2.0
"""Ratio of a bound and the largest value met at which the bound is tight enough."""
SMALL_SHARE = 0.05
"""Fraction of the total error that a piece of time may add with a loose bound."""
POINTS = 64
"""Number of states at which quantities are sampled, to see which bounds can hold."""
BOXES_OF_A_DOUBLING = 2000
"""Number of boxes after which a bound may be twice as loose."""
MOST_BOXES = 200_000
FASTEST = 30.0
"""Largest product of logarithmic norm and hold."""
THINNEST = 1e-9
"""Least radius of a tube, relative to that of the set."""
TUBES = 6
"""Largest number of times that the tube is widened."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class FlowError:
    """A proven bound of the Runge-Kutta map's error over a hold.

    Attributes:
        relative: c with |flow - map|_P <= c |e|_P at all times of the hold, for every
            initial deviation e in the ellipsoid; infinite if no bound was proven.
        boxes: Number of boxes examined.
    """

    relative: float
    boxes: int


def prove_flow_error(
    residual: Residual,
    alpha: float,
    *,
    enough: float,
    useless: float,
    until: float = np.inf,
) -> FlowError:
    """Prove a bound of the distance between the Runge-Kutta map and the flow.

    Args:
        residual: Residual of the Runge-Kutta map's curve.
        alpha: Level of the ellipsoid, > 0.
        enough: A bound c that is tight enough, > 0.
        useless: A bound that is too large to be useful: above it, the proof stops.
        until: Value of `now()` (machine_code/clocks.py) at which the proof stops.
    """
    search = ErrorSearch(residual, alpha, until)
    with np.errstate(all="ignore"):
        return FlowError(relative=search.error(enough, useless), boxes=search.boxes)


Measure = Callable[[Cells], tuple[Array, Array, Array]]
"""Cells -> upper bounds of a quantity, and of its values at their middles, each (m,);
its variation along rho and each w, (1 + nx, m)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Piece:
    """A piece of the time of one step.

    Attributes:
        step: Number of the step.
        times: First and last time in the piece [s].
    """

    step: int
    times: Times

    @property
    def length(self) -> float:
        """Length of the piece [s]."""
        return self.times[1] - self.times[0]

    def weight(self, earlier: Piece) -> float:
        """Return the integral of (s - q)^3 / 6 over s in this piece, q in `earlier`.

        Only times q < s count. The integral is 0 if the pieces are of different steps.
        """
        if self.step != earlier.step:
            return 0.0
        (low, high), (first, last) = self.times, earlier.times
        ends = ((high, first, 1), (high, last, -1), (low, first, -1), (low, last, 1))
        return sum(sign * max(s - q, 0.0) ** 5 for s, q, sign in ends) / 120


class ErrorSearch:
    """The search for three bounds, from which a bound of the map's error is computed.

    The map is the Runge-Kutta map over a hold. The three bounds are R, for the residual
    of the map's curve; m, for the growth of the distance between the curve and the
    flow; and b, for the map's error at the reference itself.
    """

    def __init__(self, residual: Residual, alpha: float, until: float) -> None:
        """Divide the hold into pieces of time."""
        self._residual, self._until, self.boxes = residual, until, 0
        self._radius = radius_of(alpha, residual.off)
        steps, h = residual.substeps, residual.h
        edges = np.linspace(0.0, h, -(-PIECES // steps) + 1).tolist()  # Rounded up.
        self._hold, self._steps = steps * h, range(steps)
        self._pieces = [
            Piece(step=step, times=times)
            for step in self._steps
            for times in pairwise(edges)
        ]
        self._weights = np.array(
            [[late.weight(early) for early in self._pieces] for late in self._pieces]
        )
        rng = np.random.default_rng(0)  # Bounds are valid for any samples.
        w = rng.normal(size=(residual.nx, POINTS))
        rho = self._radius * np.linspace(0.5, 1.0, POINTS)
        at = np.vstack([rho, w / np.abs(w).max(axis=0)])
        self._points = Cells(at, at)

    def error(self, enough: float, useless: float) -> float:
        """Return the bound; see `prove_flow_error`."""
        speeds = [
            float(self._speed(piece, 0.0)(self._points)[1].max())
            for piece in self._pieces
        ]
        residuals = self._residuals(speeds, enough, useless)
        own = [_lengths(*self._at_reference(piece)).max() for piece in self._pieces]
        tube, error = THINNEST * self._radius, self._grown(residuals, speeds)
        for _ in range(TUBES):
            drift = self._grown(own, speeds)
            # Wider than the error, which grows with the tube.
            tube = 2 * float(np.maximum(error * self._radius + drift, tube))
            if not tube < np.inf:
                break
            speeds = [self._fastest(piece, tube) for piece in self._pieces]
            drift = self._grown(own, speeds)
            bends = [self._bend(piece, tube, drift, error) for piece in self._pieces]
            error = self._grown(residuals, speeds, [drift * bend for bend in bends])
            if error * self._radius + drift < tube:
                # |e|_P equals |z|, and r'Pr that of z, up to this factor.
                return error * (1 + COVER) * (1 + 4 * self._residual.off)
        return float("inf")

    def _grown(
        self,
        residuals: list[float],
        speeds: list[float],
        sources: list[float] | None = None,
    ) -> float:
        """Return the largest error over the hold.

        Args:
            residuals: Bounds of r4, one for each piece of time.
            speeds: Bounds of the logarithmic norm, likewise.
            sources: Bounds of further sources of error, likewise; None for none.
        """
        error = largest = 0.0
        extra = sources or [0.0] * len(speeds)
        added = self._weights @ np.array(residuals)
        rows = zip(self._pieces, added.tolist(), speeds, extra, strict=True)
        for piece, residual, speed, source in rows:
            moved = residual + source * piece.length
            error = np.exp(speed * piece.length) * error
            error += np.exp(max(speed, 0.0) * piece.length) * moved
            largest = float(np.maximum(largest, error))  # Keeps NaN.
        return largest

    def _residuals(
        self, speeds: list[float], enough: float, useless: float
    ) -> list[float]:
        """Return bounds R of the relative r4, one for each piece of time."""
        measures = [self.relative_residual(piece) for piece in self._pieces]
        met = [float(measure(self._points)[1].max()) for measure in measures]
        ones = np.eye(len(self._pieces)).tolist()
        weights = [self._grown(one, speeds) for one in ones]
        total = sum(a * b for a, b in zip(met, weights, strict=True))
        share = max(SMALL_SHARE * total, enough / (2 * len(weights)))
        bounds = [np.inf] * len(weights)
        # The most important piece first: one useless bound ends it.
        for number in np.argsort(weights)[::-1].tolist():
            small = share / weights[number]
            bounds[number] = self._largest(
                measures[number],
                at_least=met[number],
                allowed=_loose(small),
                useless=useless / weights[number],
            )
            if not bounds[number] < np.inf:
                break
        return bounds

    def _fastest(self, piece: Piece, tube: float) -> float:
        """Return a bound of the logarithmic norm in a tube around the curve."""
        return self._largest(
            self._speed(piece, tube),
            at_least=-FASTEST / self._hold,
            allowed=lambda most: most + 1 / self._hold,
            useless=FASTEST / self._hold,
        )

    def _bend(self, piece: Piece, tube: float, drift: float, error: float) -> float:
        """Return a bound of the slopes of f_x in a tube around the curve."""
        if drift == 0:
            return 0.0

        def measure(cells: Cells) -> tuple[Array, Array, Array]:
            start = self._residual.start(piece.step, cells.z_middle, cells.z_reach)
            _, (middle, radius) = self._residual.field(start, piece.times, tube)
            size = _norms(middle, radius)
            return size, 0 * size, _widths(cells)

        small = SMALL_SHARE * error / (drift * self._hold)
        return self._largest(
            measure, at_least=0.0, allowed=lambda most: small, useless=np.inf
        )

    def _largest(
        self,
        measure: Measure,
        *,
        at_least: float,
        allowed: Callable[[float], float],
        useless: float,
    ) -> float:
        """Bound a quantity over the whole ellipsoid from above.

        Args:
            measure: The quantity on cells.
            at_least: A value that it reaches.
            allowed: The largest value met -> the largest bound that is tight enough.
            useless: The value at which a bound is useless.

        Returns:
            The bound; infinite if it is useless or was not found in time.
        """
        met, bound, looked, will_do = at_least, -np.inf, 0, allowed(at_least)

        def too_large(lower: Array, upper: Array) -> Undecided:
            nonlocal met, bound, looked, will_do
            above, values, spread = measure(Cells(lower, upper))
            looked += lower.shape[1]
            met = float(np.maximum(met, np.nanmax(values, initial=-np.inf)))
            will_do = 2.0 ** (looked // BOXES_OF_A_DOUBLING) * allowed(met)
            left = ~(above <= will_do)
            if will_do > useless:  # Ends the search; the bound is refused.
                left[:] = False
            bound = max(bound, float(above[~left].max(initial=-np.inf)))
            known = np.isfinite(spread).all(axis=0)
            spread = np.where(known, spread, _widths(Cells(lower, upper)))
            return Undecided(lower[:, left], upper[:, left], spread[:, left])

        limits = Limits(max_boxes=MOST_BOXES, until=self._until)
        search = search_ball(too_large, self._residual.nx, self._radius, limits=limits)
        self.boxes += search.boxes
        return bound if search.finished and will_do <= useless else float("inf")

    def _at_reference(self, piece: Piece) -> Balls:
        """Return r4 of the reference's own curve."""
        zero = np.zeros((self._residual.nx, 1))
        start = self._residual.start(piece.step, zero, zero)
        return self._residual.fourth(start, piece.times)[0]

    def _speed(self, piece: Piece, tube: float) -> Measure:
        """Return the logarithmic norm of f_x in a tube as a quantity on cells."""

        def measure(cells: Cells) -> tuple[Array, Array, Array]:
            residual = self._residual
            start = residual.start(piece.step, cells.z_middle, cells.z_reach)
            (middle, radius), _ = residual.field(start, piece.times, tube)
            at = residual.start(piece.step, cells.z, 0 * cells.z)
            (met, _), _ = residual.field(at, piece.times, 0.0)
            return (
                logarithmic_norms(middle, radius),
                logarithmic_norms(met, 0 * met),
                _widths(cells),
            )

        return measure

    @cached_property
    def _turns(self) -> Array:
        """Return the typical change of r4's derivative along each axis, (nx,).

        It is the median at a few points, at the end of the last step, and influences
        only the direction in which a cell is cut.
        """
        residual, (*_, last) = self._residual, self._pieces
        z = self._points.z[:, ::8]
        step = self._radius / 4

        def slopes(z: Array) -> Array:
            start = residual.start(last.step, z, 0 * z)
            return residual.fourth(start, last.times)[1][0]

        size, turns = np.median(np.linalg.norm(slopes(z), axis=(1, 2))), []
        for axis in step * np.eye(len(z))[:, :, None]:
            change = np.linalg.norm(slopes(z + axis) - slopes(z - axis), axis=(1, 2))
            turns.append(np.median(change) / (2 * step * size))
        return np.asarray(np.nan_to_num(turns), dtype=np.float64)

    def relative_residual(self, piece: Piece) -> Measure:
        """Return a function that bounds |r4(e) - r4(0)|_P / |e|_P on cells.

        r4(e) is the fourth derivative in time of the residual of the map's curve that
        begins at the deviation e. Cells are parts of the ellipsoid; the bounds hold at
        all times of the piece.
        """
        residual = self._residual
        own, own_wide = self._at_reference(piece)

        def slopes(z: Array, reach: Array) -> Balls:
            start = residual.start(piece.step, z, reach)
            return residual.fourth(start, piece.times)[1]

        def from_centre(z: Array, reach: Array) -> Balls:
            """Return the slopes over all of [0, z]."""
            low, high = np.minimum(z - reach, 0.0), np.maximum(z + reach, 0.0)
            return slopes((low + high) / 2, (high - low) / 2)

        def central(middle: Array, radius: Array, u: Array, beside: Array) -> Array:
            """Bound r4(z) / rho = J u, J the mean of the slopes over [0, z]."""
            wide = _times(radius, np.abs(u)) + _times(np.abs(middle) + radius, beside)
            return _lengths(_times(middle, u), wide)

        def measure(cells: Cells) -> tuple[Array, Array, Array]:
            (low, high), toward = cells.radii, cells.directions
            middle, radius = slopes(cells.z_middle, cells.z_reach)
            size, mean = np.abs(middle) + radius, (low + high) / 2
            # r4(z) / rho = q + (1 - rho_m / rho) (J u_m - q) + J (u - u_m)
            at = residual.start(piece.step, cells.z, 0 * cells.z)
            (value, wide), _ = residual.fourth(at, piece.times)
            q = (value - own) / mean
            wide = wide + own_wide + PADDING * (np.abs(value) + np.abs(own))
            reached = _lengths(q, wide / mean)
            apart = _lengths(
                _times(middle, toward.z) - q, _times(radius, np.abs(toward.z))
            )
            outer = np.maximum(1 - mean / high, mean / low - 1)
            above = (
                reached + outer * apart + _lengths(0 * q, _times(size, toward.reach))
            )
            near = central(middle, radius, toward.z, toward.reach)
            above = np.where(low > 0, above, near)
            if (_lengths(own_wide / mean, 0 * q) > reached / 10).any():
                # The reference's own r4 is too inaccurate to be divided by rho.
                still, to_cell = 0 * cells.z, (cells.z_middle, cells.z_reach)
                near = central(*from_centre(*to_cell), toward.z, toward.reach)
                above = np.fmin(above, near)
                near = central(*from_centre(cells.z, still), toward.z, still)
                reached = np.fmin(reached, near)
            turned = self._turns[:, None] * np.linalg.norm(size, axis=(1, 2)) * high
            pull = turned + np.linalg.norm(size, axis=1).T
            return above, reached, cells.spread(np.zeros_like(cells.half), pull)

        return measure


def _loose(small: float) -> Callable[[float], float]:
    """Return the largest bound that is tight enough: `small`, or LOOSE times values."""
    return lambda most: max(LOOSE * most, small)


def _widths(cells: Cells) -> Array:
    """Return the widths of cells along rho and each w, on one scale."""
    return cells.spread(np.zeros_like(cells.half), np.ones_like(cells.z))


def _times(matrices: Array, columns: Array) -> Array:
    """Return M c of matrices (m, nx, nx) and columns (nx, m), (nx, m)."""
    return np.asarray(np.einsum("mij,jm->im", matrices, columns))


def _lengths(middle: Array, radius: Array) -> Array:
    """Return upper bounds of the lengths of columns."""
    size = np.linalg.norm(middle, axis=0) + np.linalg.norm(radius, axis=0)
    return np.asarray(size * (1 + PADDING))


def _norms(middle: Array, radius: Array) -> Array:
    """Return upper bounds of the norms of matrices, (m,)."""
    return np.asarray(np.linalg.norm(np.abs(middle) + radius, axis=(1, 2)))


def logarithmic_norms(middle: Array, radius: Array) -> Array:
    """Return upper bounds of the logarithmic norms of matrices, (m,).

    The logarithmic norm of A is the largest eigenvalue of (A + A') / 2.

    Args:
        middle: Middles, shape (m, n, n).
        radius: Radii of their entries, same shape.
    """
    known = np.asarray(np.isfinite(np.abs(middle) + radius).all(axis=(1, 2)))
    middle = np.where(known[:, None, None], middle, 0.0)
    symmetric = (middle + middle.transpose(0, 2, 1)) / 2
    beside = np.linalg.norm(radius + PADDING * np.abs(middle), axis=(1, 2))
    return np.where(known, np.linalg.eigvalsh(symmetric)[:, -1] + beside, np.inf)
