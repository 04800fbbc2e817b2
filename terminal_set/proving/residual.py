"""The curve of the Runge-Kutta map over a hold, and its residual.

Let F_s(x, u) be the classic Runge-Kutta step of length s from x for x' = f(x, u), with
u held. On each of the n steps of length h the curve is p(s) = F_s(p_j, u), 0 <= s <= h,
with p_j the end of the step before. It does not satisfy the dynamics exactly: its
residual

    r(s) = p'(s) - f(p(s), u) = integral of (s - q)^3 / 6 r4(q) dq from 0 to s

is of order s^4, since the map is of order 4; r4, the fourth derivative of r, is an
expression in (p_j, u, s). Let e be the deviation from the reference at the beginning of
the hold. Here r4 and its derivatives in e are enclosed over cells of a ball
(`taylor.py`), and the Jacobian f_x in a tube around the curve.

Source: Hairer, Norsett and Wanner (1993), Solving Ordinary Differential Equations I,
II.6; Enright (1989), Analysis of error control strategies for continuous Runge-Kutta
methods, SIAM Journal on Numerical Analysis 26 (the residual of such a curve).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set.certificates.design import TerminalSet
from swarmstart.terminal_set.interval_arithmetic.intervals import IntervalEvaluation
from swarmstart.terminal_set.interval_arithmetic.smoothness import Kinks
from swarmstart.terminal_set.interval_arithmetic.taylor import (
    PADDING,
    evaluated,
    middle_and_radius,
)
from swarmstart.terminal_set.linear.arrays import Mask
from swarmstart.terminal_set.proving.decrease import ORDER
from swarmstart.terminal_set.proving.enclosure import defect

Balls = tuple[Array, Array]
"""Middles and radii, of columns (nx, m) or of matrices (m, nx, nx)."""
Times = tuple[float, float]
"""First and last time of an interval [s]."""

ULPS = 4 * float(np.finfo(np.float64).eps)
"""Padding of sums of two numbers, relative to their sizes; it exceeds rounding."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class StepStart:
    """Enclosures of state and input at the beginning of a Runge-Kutta step.

    There is one for each of m boxes of the deviation e at the beginning of the hold.

    Attributes:
        lower: Lower corners of the boxes that enclose (x, u), shape (nx + nu, m).
        upper: Upper corners.
        slopes: Derivative of (x, u) by e: middles and radii, each (m, nx + nu, nx).
    """

    lower: Array
    upper: Array
    slopes: Balls


class Residual:
    """Enclosures of the curve of the Runge-Kutta map over a hold, and of its residual.

    The deviation from the reference is e = T z, with |e|_P = |z|.

    Attributes:
        nx: Number of states.
        substeps: Number of steps n.
        h: Length of a step [s].
        T: Matrix T of e = T z, shape (nx, nx).
        off: A bound of the rounding errors |T'PT - I| and |S T - I|, with S the
            transposed Cholesky factor of P (S'S = P); T is the computed inverse of S.
    """

    def __init__(
        self, dynamics: ca.Function, law: TerminalSet, *, dt: float, substeps: int
    ) -> None:
        """Build the functions that are evaluated.

        Args:
            dynamics: f(x, u) -> xdot.
            law: The law and P; its level is not used.
            dt: Time for which the input is held [s].
            substeps: Number of Runge-Kutta steps in a hold.

        Raises:
            UnknownIntervalOperationError: If f jumps, or has an operation without
                interval form.
        """
        self.nx, self.substeps, self.h = len(law.P), substeps, dt / substeps
        identity = np.eye(self.nx)
        # S'S = P, so that |e|_P = |S e| = |z|.
        self._law, self._S = law, np.linalg.cholesky(law.P).T
        self.T = np.asarray(np.linalg.inv(self._S))
        self.off = defect(self.T, law.P, identity)
        self.off += float(np.abs(self._S @ self.T - identity).sum(axis=1).max())
        x, u = ca.SX.sym("x", self.nx), ca.SX.sym("u", len(law.u_ref))
        s, v, e = ca.SX.sym("s"), ca.SX.sym("v", self.nx), ca.SX.sym("e", self.nx)
        xu, step = ca.vertcat(x, u), ca.simpleRK(dynamics, 1, ORDER).expand()
        curve, rate = step(x, u, s), dynamics(x, u)
        residual = ca.jtimes(curve, s, 1) - dynamics(curve, u)
        for _ in range(ORDER):
            # Without cse the expression grows many times with every derivative.
            residual = ca.jtimes(ca.cse(residual), s, 1)
        bend = _slopes(ca.jtimes(rate, x, v), xu)
        starts, now = [e], ca.DM(law.x_ref) + e
        for _ in range(substeps - 1):
            now = step(now, ca.DM(law.u_ref) - ca.DM(law.K) @ e, self.h)
            starts += [now, _slopes(now, e)]

        def of(arguments: list[ca.SX], *columns: ca.SX) -> IntervalEvaluation:
            column, v = ca.vertcat(*columns), ca.vertcat(*arguments)
            return evaluated(column, v, takes_jumps=True)

        timed, stages = ca.vertcat(xu, s), ca.vertcat(curve, dynamics(curve, u))
        self._stage_kinks = Kinks(ca.Function("the_hold", [timed], [stages]))
        self._rate_kinks = Kinks(ca.Function(dynamics.name(), [xu], [rate]))

        self._residual = of([xu, s], residual, _slopes(residual, xu))
        self._curve = of([xu, s], curve, _slopes(curve, xu))
        self._field = of([xu, v], _slopes(rate, x), bend)
        self._starts = of([e], *starts)

    def start(self, number: int, middle: Array, reach: Array) -> StepStart:
        """Enclose state and input at the beginning of a step, for boxes of z.

        Args:
            number: Number of the step, from 0.
            middle: Middles of boxes of z, shape (nx, m).
            reach: Half widths of the boxes.
        """
        law, nx, m = self._law, self.nx, middle.shape[1]
        e, du = self.T @ middle, law.K @ self.T @ middle
        wide = _spread(self.T, middle, reach)
        wide_u = _spread(law.K @ self.T, middle, reach)
        u, wide_u = _shifted(law.u_ref, -du, wide_u)
        x, wide_x = _shifted(law.x_ref, e, wide)
        low, high = x - wide_x, x + wide_x
        slopes = np.broadcast_to(np.eye(nx), (m, nx, nx))
        blur = np.zeros((m, nx, nx))
        if number:  # The first step begins at x_ref + e itself.
            first = nx + (number - 1) * (nx + nx**2)
            found = self._starts(e - wide, e + wide)
            low, high = (ends[first : first + nx] for ends in found)
            rows = slice(first + nx, first + nx + nx**2)
            slopes, blur = _matrices(found[0][rows], found[1][rows], nx)
        law_slopes = np.broadcast_to(-law.K, (m, *law.K.shape))
        return StepStart(
            lower=np.vstack([low, u - wide_u]),
            upper=np.vstack([high, u + wide_u]),
            slopes=(
                np.concatenate([slopes, law_slopes], axis=1),
                np.concatenate([blur, 0 * law_slopes], axis=1),
            ),
        )

    def fourth(self, start: StepStart, times: Times) -> tuple[Balls, Balls]:
        """Enclose r4 and its slopes along e, in the coordinates z.

        r4 is the fourth derivative in time of the curve's residual.

        Args:
            start: Beginning of the step.
            times: First and last time, from the beginning of the step on [s].

        Returns:
            r4 as columns, and its slopes as matrices; each as middles and radii.
        """
        boxes = _timed(start, times)
        low, high = _known(self._residual(*boxes), self._stage_kinks(*boxes))
        middle, radius = middle_and_radius(low[: self.nx], high[: self.nx])
        slopes = _product(low[self.nx :], high[self.nx :], start.slopes)
        value = self._S @ middle, np.abs(self._S) @ radius
        return value, self._turned(slopes)

    def field(self, start: StepStart, times: Times, tube: float) -> tuple[Balls, Balls]:
        """Enclose f_x in a tube around a step of the curve, in the coordinates z.

        f_x is the Jacobian of the dynamics f(x, u) in x.

        Args:
            start: Beginning of the step.
            times: First and last time, from the beginning of the step on [s].
            tube: The radius of the tube, in |z|.

        Returns:
            f_x as matrices, and as further matrices the slopes of f_x v along e for all
            v with |v|_P <= 1; each as middles and radii.
        """
        nx = self.nx
        low, high = self._curve(*_timed(start, times))
        slopes, blur = _product(low[nx:], high[nx:], start.slopes)
        moved = (
            np.concatenate([slopes, start.slopes[0][:, nx:]], axis=1),
            np.concatenate([blur, start.slopes[1][:, nx:]], axis=1),
        )
        # |e_j| <= |T_j| |z|, for the tube and for v alike.
        length = np.linalg.norm(self.T, axis=1)[:, None] * (1 + self.off + PADDING)
        unit = np.broadcast_to(length, low[:nx].shape)
        lower = np.vstack([low[:nx] - tube * length, start.lower[nx:]])
        upper = np.vstack([high[:nx] + tube * length, start.upper[nx:]])
        found = self._field(np.vstack([lower, -unit]), np.vstack([upper, unit]))
        found = _known(found, self._rate_kinks(lower, upper))
        (low, high), count = found, nx * nx
        rates = _matrices(low[:count], high[:count], nx)
        bends = _product(low[count:], high[count:], moved)
        return self._turned(rates), self._turned(bends)

    def _turned(self, matrices: Balls) -> Balls:
        """Return S M T of matrices M."""
        middle, radius = matrices
        left, right = np.abs(self._S), np.abs(self.T)
        radius = radius + (PADDING + self.off) * np.abs(middle)
        return self._S @ middle @ self.T, left @ radius @ right


def _slopes(expression: ca.SX, v: ca.SX) -> ca.SX:
    """Return a derivative as one dense column, row after row."""
    return ca.vec(ca.densify(ca.jacobian(expression, v)).T)


def _spread(matrix: Array, middle: Array, reach: Array) -> Array:
    """Return half widths of matrix times z over boxes of z, rounding included."""
    return np.asarray(np.abs(matrix) @ (reach + PADDING * (reach + np.abs(middle))))


def _shifted(reference: Array, e: Array, wide: Array) -> Balls:
    """Return reference + e as middle and radius."""
    at = reference[:, None]
    return at + e, wide + ULPS * (np.abs(at) + np.abs(e) + wide)


def _timed(start: StepStart, times: Times) -> tuple[Array, Array]:
    """Return the boxes of (x, u, s)."""
    first, last = (np.full((1, start.lower.shape[1]), time) for time in times)
    return np.vstack([start.lower, first]), np.vstack([start.upper, last])


def _known(ends: tuple[Array, Array], kinks: tuple[Mask, Mask]) -> tuple[Array, Array]:
    """Return ends of intervals, infinite in boxes with kinks or cuts.

    In these boxes derivatives do not bound Taylor's remainder.
    """
    unknown = kinks[0] | kinks[1]
    return np.where(unknown, -np.inf, ends[0]), np.where(unknown, np.inf, ends[1])


def _matrices(low: Array, high: Array, rows: int) -> Balls:
    """Return middles and radii of matrices given row after row."""
    middle, radius = middle_and_radius(low, high)
    shape = (low.shape[1], rows, -1)
    return middle.T.reshape(shape), radius.T.reshape(shape)


def _product(low: Array, high: Array, right: Balls) -> Balls:
    """Return matrices, given row after row, times others."""
    columns = right[0].shape[1]
    middle, radius = _matrices(low, high, len(low) // columns)
    slopes, blur = right
    wide = radius @ (np.abs(slopes) + blur) + np.abs(middle) @ blur
    return middle @ slopes, wide + PADDING * (np.abs(middle) @ np.abs(slopes))
