"""Upper bounds of the change of e'Pe on boxes of radii and directions.

Let e be the deviation from the reference and c(e) the change of e'Pe (`decrease.py`).
With z = T^-1 e and T'PT = I, the ellipsoid e'Pe <= alpha is the ball |z| <= r,
r^2 = alpha; T also diagonalises the quadratic part of c. On a box of (rho, w) with
z = rho u, u = w / |w| (`taylor.py`), either

    c(rho T u) / rho^2 <= u'Mu + rho sup b + rho^2 sup d   over [0, rho_hi] x w

with rho_hi the largest rho of the box; or, if its least rho is above 0, c itself is
bounded by its Taylor form. The first bound holds at the origin too. M is half of the
Hessian of c(T z) at 0. With m(s) the motion at e = s T u, that is, the rate of e or e
after a step,

    continuous  b = (PTu)'m''(s),      d = 0
    held        b = m'(0)'P m''(s),    d = m''(s)'P m''(s) / 4.

Even if the motion has a kink at the centre, m(rho) / rho is a mean of m'(s)
(`smoothness.py`), so that over the same box

    continuous  c(rho T u) / rho^2 <= sup 2 (PTu)'m'(s) + (Tu)'Q_m Tu
    held        c(rho T u) / rho^2 <= sup m'(s)'P m'(s) - 1 + (Tu)'Q_m Tu.

u'Mu over a box of directions is bounded by `quadratic_bound`, as M is diagonal except
for rounding, which is added. Everything is evaluated in intervals with outward
rounding, or rounded up by more than the rounding of the sum.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set.interval_arithmetic.smoothness import (
    NEIGHBOURHOOD,
    Kinks,
    require_bounded,
)
from swarmstart.terminal_set.interval_arithmetic.taylor import (
    PADDING,
    Cells,
    TaylorForm,
    added_up,
    evaluated,
    squares,
)
from swarmstart.terminal_set.proving.decrease import Change


class Undecided(NamedTuple):
    """Boxes that are not decided yet.

    Attributes:
        lower: Lower corners, shape (1 + nx, m).
        upper: Upper corners.
        spread: Variation of the bounded function along each coordinate, or for boxes at
            the centre a number made from their widths; a box is cut along the
            coordinate with the largest entry.
    """

    lower: Array
    upper: Array
    spread: Array


class DecreaseBounds:
    """Proofs that the change c(e) of e'Pe is negative on boxes of (rho, w).

    The points of a box are e = rho T w / |w|.

    Attributes:
        T: Matrix T, shape (nx, nx); T'PT = I except for rounding.
        defect: A bound of |T'PT - I|.
    """

    def __init__(self, change: Change) -> None:
        """Build the functions that are evaluated.

        Raises:
            UnknownIntervalOperationError: If c has an operation without interval form.
            NotSmoothError: If c jumps at the reference, or leaves its domain.
        """
        zero, one = np.zeros((len(change.P), 1)), np.eye(len(change.P))
        form = TaylorForm(change.function, one)
        kinks = Kinks(change.motion)
        kinks.require_no_cut(zero, zero, change.motion.name())
        self._is_kinked = bool(kinks(zero, zero)[0].any())
        _, around = form.hessians(zero - NEIGHBOURHOOD, zero + NEIGHBOURHOOD)
        if not np.all(np.isfinite(around)):
            require_bounded(change.motion, zero[:, 0])
        self.T = _diagonalising(change)
        self.defect = defect(self.T, change.P, one)
        self._form = form.turned(self.T)
        middle, radius = self._form.hessians(zero, zero)
        self._M = beside_diagonal(middle[0], radius[0])
        self._rays = _Rays(change, self.T)

    def __call__(self, lower: Array, upper: Array) -> Undecided:
        """Return the boxes for which c < 0 is not shown.

        Args:
            lower: Lower corners, shape (1 + nx, m).
            upper: Upper corners, same shape.
        """
        quadratic, remainder = self._about_centre(lower, upper)

        def away_from_centre(lower: Array, upper: Array) -> tuple[Array, Array]:
            return self._form(Cells(lower, upper))

        return undecided(away_from_centre, lower, upper, quadratic, remainder)

    def _about_centre(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Return upper bounds of u'Mu and of rho b + rho^2 d, each (m,).

        If the centre has a kink, they are those of the bound by slopes at it, and of
        the remainder.
        """
        from_zero = lower.copy()
        from_zero[0] = 0.0
        _, (b, d) = self._rays.bends(from_zero, upper)
        # Which end of rho is worse depends on the sign of b.
        rho = np.where(b > 0, upper[0], lower[0])
        remainder = added_up(0 * rho, np.stack([rho * b, upper[0] ** 2 * d]))
        quadratic = quadratic_bound(*self._M, lower[1:], upper[1:])
        kinks, cuts = self._rays.kinks(from_zero, upper)
        if not self._is_kinked:
            return quadratic, np.where(kinks | cuts, np.inf, remainder)
        # A kink at the centre is in every box from there.
        _, (whole,) = self._rays.slopes(from_zero, upper)
        at_zero = upper.copy()
        at_zero[0] = 0.0
        _, (centre,) = self._rays.slopes(from_zero, at_zero)
        # The bound is the sum, which is rounded up once more.
        rest = np.where(np.isfinite(whole), whole - centre, np.inf)
        rest += PADDING * (np.abs(whole) + np.abs(centre))
        return centre, np.where(cuts, np.inf, rest)


def undecided(
    bounded: Callable[[Array, Array], tuple[Array, Array]],
    lower: Array,
    upper: Array,
    quadratic: Array,
    remainder: Array,
) -> Undecided:
    """Return the boxes of (rho, w) for which neither of two bounds shows that c < 0.

    The first bound is c / rho^2 <= quadratic + remainder, the second is `bounded`.

    Args:
        bounded: Function: lower and upper corners of m boxes with rho > 0 -> upper
            bounds of c, (m,), and the variation of c along each coordinate, (1 + nx,
            m).
        lower: Lower corners, shape (1 + nx, m).
        upper: Upper corners.
        quadratic: Upper bounds of the part of c / rho^2 that does not depend on rho,
            (m,).
        remainder: Upper bounds of the rest of c / rho^2, (m,).
    """
    left = ~(quadratic + remainder < 0)
    lower, upper, quadratic = lower[:, left], upper[:, left], quadratic[left]
    spread = upper - lower
    # Near the centre, once the quadratic part is negative, the radius matters most.
    inner = lower[0] == 0
    spread[0] = np.where(inner, np.where(quadratic < 0, np.inf, 0.0), spread[0])
    shown = np.zeros(inner.size, dtype=bool)
    outer = np.flatnonzero(~inner)
    if outer.size:
        bound, spread[:, outer] = bounded(lower[:, outer], upper[:, outer])
        shown[outer] = bound < 0
    return Undecided(lower[:, ~shown], upper[:, ~shown], spread[:, ~shown])


def beside_diagonal(middle: Array, radius: Array) -> tuple[Array, float]:
    """Return the diagonal of M = H/2, and a bound of its off-diagonal part.

    Args:
        middle: Middles of the entries of H, which are intervals, shape (nx, nx).
        radius: Radii of the entries of H, shape (nx, nx).
    """
    M = middle / 2
    beside = radius / 2 + np.abs(M - np.diag(np.diag(M)))
    return np.diag(M).copy(), float(beside.sum(axis=1).max())


def quadratic_bound(
    diagonal: Array, beside: float, lower: Array, upper: Array
) -> Array:
    """Return an upper bound of u'Mu over boxes of w, with u = w / |w|, shape (m,).

    For a matrix M with the diagonal d and nothing beside it, u'Mu is sum d_i s_i / sum
    s_i with s_i = w_i^2. It is largest if the s_i of the largest d_i are at their upper
    ends and the others at their lower ends.

    Args:
        diagonal: Diagonal of M, shape (nx,).
        beside: A bound of the off-diagonal part of M.
        lower: Lower corners, shape (nx, m).
        upper: Upper corners.
    """
    least, most = squares(lower, upper)
    order = np.argsort(-diagonal)
    d = diagonal[order][:, None]
    s, best = least[order].copy(), np.full(lower.shape[1], -np.inf)
    for k in range(len(order) + 1):
        if k:
            s[k - 1] = most[order[k - 1]]
        # The sum is at least 1: on a face of the cube one w is 1 or -1.
        with np.errstate(invalid="ignore"):  # M may be infinite.
            best = np.maximum(best, (d * s).sum(axis=0) / s.sum(axis=0))
    return np.asarray(best + PADDING * np.abs(diagonal).max() + beside)


def _diagonalising(change: Change) -> Array:
    """Return T with T'PT = I and T'(Hessian of c at 0)T diagonal, to rounding."""
    e = ca.SX.sym("e", len(change.P))
    hessian = ca.Function("hessian", [e], [ca.hessian(change.function(e), e)[0]])
    root = np.linalg.inv(np.linalg.cholesky(change.P)).T
    _, turn = np.linalg.eigh(root.T @ np.array(hessian(0)) @ root)
    return np.asarray(root @ turn)


class _Rays:
    """The motion along rays from the centre, (s, w) -> ...

    Attributes:
        kinks: Kinks and branch cuts of the motion.
        bends: (s, w) -> (b, d) of the bound by second derivatives.
        slopes: (s, w) -> a bound of c / s^2 by first derivatives.
    """

    def __init__(self, change: Change, T: Array) -> None:
        """Build the functions that are evaluated."""
        nx, P = len(T), ca.DM(change.P)
        s, w = ca.SX.sym("s"), ca.SX.sym("w", nx)
        direction = ca.DM(T) @ (w / ca.norm_2(w))
        moved = change.motion(s * direction)
        first = ca.jacobian(moved, s)
        second = ca.jacobian(first, s)
        if change.is_held:
            # P is S'S to rounding: squares have tighter intervals than a form in P.
            S: Array = np.linalg.inv(T).astype(np.float64)
            wider = 1 + defect(S, np.eye(nx), change.P) * np.linalg.norm(T) ** 2
            b = ca.dot(P @ ca.substitute(first, s, 0), second)
            d = wider / 4 * ca.sumsqr(ca.DM(S) @ second)
            slope = wider * ca.sumsqr(ca.DM(S) @ first)
            slope -= 1 - defect(T, change.P, np.eye(nx))
        else:
            b, d = ca.dot(P @ direction, second), ca.SX(0)
            slope = 2 * ca.dot(P @ direction, first)
        slope += ca.bilin(ca.DM(change.Q_m), direction, direction)
        v = ca.vertcat(s, w)
        self.kinks = Kinks(ca.Function(change.motion.name(), [v], [moved]))
        self.bends = evaluated(ca.vertcat(b, d), v, takes_jumps=True)
        self.slopes = evaluated(slope, v, takes_jumps=True)


def defect(T: Array, P: Array, expected: Array) -> float:
    """Return a bound of |T'PT - expected|, rounding included.

    Args:
        T: Shape (nx, nx).
        P: Shape (nx, nx).
        expected: Shape (nx, nx).
    """
    off = np.abs(T.T @ P @ T - expected)
    size = np.abs(T).T @ np.abs(P) @ np.abs(T)
    return float((off + 4 * len(P) * np.finfo(float).eps * size).sum(axis=1).max())
