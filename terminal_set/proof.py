"""Proof of a level: e'Pe decreases on a whole ellipsoid, by interval branch and bound.

With z = T^-1 e, T'PT = I, the ellipsoid e'Pe <= alpha is the ball |z| <= r,
r^2 = alpha; T also diagonalises the quadratic part of c (`decrease.py`). A direction is
u = w / |w| with w on a face of the cube [-1, 1]^n, so that 2n boxes of (rho, w) cover
the ball exactly. Along a direction X(rho) = c(T rho u) has X(0) = X'(0) = 0. Shown is
q = X / rho^2 < 0 on every box, by one of two bounds,

    q <= u'Mu + rho/6 sup X'''     over [0, rho_hi] x w, M = half the Hessian of c at 0
    q <= q(m) + grad q (v - m)     about the middle m of a box with rho_lo > 0

or the box is split. The first holds at the origin, where q is 0/0: u'Mu over a box of
directions is bounded by its extreme candidates (M is diagonal but for rounding, which
is added). All else is evaluated in intervals with outward rounding.

Proven is c < 0 for 0 < |z| <= r, a ball that holds the ellipsoid of the given level,
with c the expression itself and its floating-point constants taken as exact. For a held
input that is the integrator's map, not the flow; what happens between samples is
another matter, and so are the bounds of inputs and states (`level.py`).
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.terminal_set.arrays import (
    FloatArray,
    NotPositiveError,
    positive_definite,
)
from swarmstart.terminal_set.intervals import interval_function

Array = NDArray[np.float64]

CHUNK = 8192
COVER = 1e-9
"""By which part the ball is larger than sqrt(alpha), at least: T'PT = I to rounding."""
PADDING = 1e-12
"""Of the extreme candidates of u'Mu, relative: their rounding."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Proof:
    """How a proof went.

    Attributes:
        proven: Whether c < 0 everywhere in the ellipsoid but at its centre.
        alpha: The level.
        boxes: How many were looked at.
        seconds: Wall time [s].
        counterexample: A deviation with c >= 0, shape (nx,), where one was met; None
            otherwise.
    """

    proven: bool
    alpha: float
    boxes: int
    seconds: float
    counterexample: FloatArray | None = None


def prove_level(
    change: ca.Function,
    P: ArrayLike,
    alpha: float,
    *,
    max_boxes: int = 2_000_000,
    max_seconds: float = 60.0,
) -> Proof:
    """Try to prove that e'Pe decreases in a whole ellipsoid.

    Args:
        change: e -> c(e), of `continuous_change` or `held_change`: c and its gradient
            are 0 at 0.
        P: Shape of the ellipsoid, (nx, nx), symmetric positive definite.
        alpha: Its level, > 0.
        max_boxes: After how many boxes it is given up.
        max_seconds: After how many seconds [s].

    Returns:
        The proof; not proven means no more than that, unless it has a counterexample.

    Raises:
        NotPositiveError: alpha is not positive and finite.
        UnknownIntervalOperationError: c has an operation without interval form.
        SwarmstartError: As `positive_definite` says of P.
    """
    P = positive_definite("P", P)
    if not 0 < alpha < np.inf:
        raise NotPositiveError("alpha", alpha)
    began = clock.perf_counter()
    bounds = _Bounds(change, P)
    radius = float(np.sqrt(alpha)) * (1 + COVER + bounds.defect(P))
    stack, boxes = [_faces(len(P), radius)], 0
    while stack:
        lower, upper = stack.pop()
        if lower.shape[1] > CHUNK:
            stack.append((lower[:, CHUNK:], upper[:, CHUNK:]))
            lower, upper = lower[:, :CHUNK], upper[:, :CHUNK]
        boxes += lower.shape[1]
        left, spread, broken = bounds(lower, upper)
        seconds = clock.perf_counter() - began
        if broken is not None:
            return Proof(
                proven=False, alpha=alpha, boxes=boxes, seconds=seconds,
                counterexample=broken,
            )  # fmt: skip
        if left.any():
            if boxes > max_boxes or seconds > max_seconds:
                return Proof(proven=False, alpha=alpha, boxes=boxes, seconds=seconds)
            stack.append(_halves(lower[:, left], upper[:, left], spread[:, left]))
    seconds = clock.perf_counter() - began
    return Proof(proven=True, alpha=alpha, boxes=boxes, seconds=seconds)


Boxes = tuple[Array, Array]
"""Lower and upper corners of boxes of (rho, w), each (1 + nx, m)."""


def _faces(nx: int, radius: float) -> Boxes:
    """Return the boxes that cover the ball: rho in [0, r], w on a face of the cube."""
    lower, upper = np.full((1 + nx, 2 * nx), -1.0), np.full((1 + nx, 2 * nx), 1.0)
    lower[0], upper[0] = 0.0, radius
    for axis in range(nx):
        for side, end in enumerate((-1.0, 1.0)):
            lower[1 + axis, 2 * axis + side] = upper[1 + axis, 2 * axis + side] = end
    return lower, upper


def _halves(lower: Array, upper: Array, spread: Array) -> Boxes:
    """Return the boxes cut in two along the coordinate of the largest spread."""
    axis, each = spread.argmax(axis=0), np.arange(lower.shape[1])
    middle = (lower[axis, each] + upper[axis, each]) / 2
    below, above = upper.copy(), lower.copy()
    below[axis, each], above[axis, each] = middle, middle
    return np.hstack([lower, above]), np.hstack([below, upper])


class _Bounds:
    """Upper bounds of q on boxes of (rho, w)."""

    def __init__(self, change: ca.Function, P: FloatArray) -> None:
        """Build the functions that are evaluated.

        Args:
            change: e -> c(e).
            P: Shape of the ellipsoid.
        """
        nx = len(P)
        e = ca.SX.sym("e", nx)
        half = ca.Function("half", [e], [ca.vec(ca.hessian(change(e), e)[0] / 2)])
        root = np.linalg.inv(np.linalg.cholesky(P)).T
        at_zero = np.array(half(0)).reshape(nx, nx, order="F")
        _, turn = np.linalg.eigh(root.T @ at_zero @ root)
        self.T = root @ turn
        self._diagonal, self._rest = self._quadratic_part(half)
        rho, w = ca.SX.sym("rho"), ca.SX.sym("w", nx)
        v = ca.vertcat(rho, w)
        u = w / ca.norm_2(w)
        X = change(ca.DM(self.T) @ (rho * u))
        third = X
        for _ in range(3):
            third = ca.jacobian(third, rho)
        q = X / rho**2
        self._third = interval_function(ca.Function("third", [v], [ca.cse(third)]))
        self._q = interval_function(ca.Function("q", [v], [ca.cse(q)]))
        slope = ca.cse(ca.jacobian(q, v).T)
        self._slope = interval_function(ca.Function("slope", [v], [slope]))
        self._change = change

    def defect(self, P: FloatArray) -> float:
        """Return a bound of |T'PT - I|, rounding included."""
        off = np.abs(self.T.T @ P @ self.T - np.eye(len(P)))
        size = np.abs(self.T).T @ np.abs(P) @ np.abs(self.T)
        return float((off + 4 * len(P) * np.finfo(float).eps * size).sum(axis=1).max())

    def _quadratic_part(self, half: ca.Function) -> tuple[Array, float]:
        """Return the diagonal of T'(Hessian / 2)T, and a bound of all beside it.

        The Hessian at 0 is enclosed in intervals; the products' rounding is bounded.
        """
        nx, zero = len(self.T), np.zeros((len(self.T), 1))
        low, high = (
            end[:, 0].reshape(nx, nx) for end in interval_function(half)(zero, zero)
        )
        middle, width = (low + high) / 2, (high - low) / 2
        M = self.T.T @ middle @ self.T
        size = np.abs(self.T).T @ (np.abs(middle) + width) @ np.abs(self.T)
        beside = np.abs(M - np.diag(np.diag(M)))
        beside += np.abs(self.T).T @ width @ np.abs(self.T)
        beside += 4 * nx * np.finfo(float).eps * size
        return np.diag(M).copy(), float(beside.sum(axis=1).max())

    def __call__(
        self, lower: Array, upper: Array
    ) -> tuple[NDArray[np.bool_], Array, FloatArray | None]:
        """Return which boxes are left, how much q spreads in them, a counterexample.

        Args:
            lower: Lower corners, shape (1 + nx, m).
            upper: Upper corners, same shape.
        """
        width = upper - lower
        from_zero = lower.copy()
        from_zero[0] = 0.0
        _, third = self._third(from_zero, upper)
        rho = np.where(third[0] > 0, upper[0], lower[0])
        remainder = rho / 6 * third[0]
        remainder += 4 * np.finfo(float).eps * np.abs(remainder)
        quadratic = self._quadratic(lower[1:], upper[1:])
        left = ~(quadratic + remainder < 0)
        spread = width.copy()
        # Near the centre it is the radius that counts, once the quadratic part is fine.
        spread[0] = np.where(lower[0] > 0, width[0], np.where(quadratic < 0, np.inf, 0))
        outer = np.flatnonzero(left & (lower[0] > 0))
        if outer.size:
            high, slopes = self._mean_value(lower[:, outer], upper[:, outer])
            left[outer] = ~(high < 0)
            finite = np.isfinite(slopes).all(axis=0)
            spread[:, outer[finite]] *= slopes[:, finite]
        broken = self._counterexample(lower[:, left], upper[:, left])
        return left, spread, broken

    def _quadratic(self, lower: Array, upper: Array) -> Array:
        """Return an upper bound of u'Mu over boxes of w.

        sum d_i s_i / sum s_i with s_i = w_i^2 between their ends is largest where the
        s_i of the largest d_i are at their upper ends and the others at their lower.
        """
        inside = (lower <= 0) & (upper >= 0)
        most = np.maximum(lower**2, upper**2)
        least = np.where(inside, 0.0, np.minimum(lower**2, upper**2))
        order = np.argsort(-self._diagonal)
        d = self._diagonal[order][:, None]
        s, best = least[order].copy(), np.full(lower.shape[1], -np.inf)
        for k in range(len(order) + 1):
            if k:
                s[k - 1] = most[order[k - 1]]
            total = s.sum(axis=0)
            with np.errstate(invalid="ignore"):
                value = np.where(total > 0, (d * s).sum(axis=0) / total, -np.inf)
            best = np.maximum(best, value)
        return np.asarray(best + PADDING * np.abs(self._diagonal).max() + self._rest)

    def _mean_value(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Return upper bounds of q, and the largest slopes, (1 + nx, m)."""
        middle = (lower + upper) / 2
        _, at_middle = self._q(middle, middle)
        low, high = self._slope(lower, upper)
        reach = np.nextafter(np.maximum(upper - middle, middle - lower), np.inf)
        slopes = np.maximum(np.abs(low), np.abs(high))
        steps = np.nextafter(slopes * reach, np.inf)
        steps = np.where(reach > 0, steps, 0.0)
        total = at_middle[0]
        for step in steps:
            total = np.nextafter(total + step, np.inf)
        _, plain = self._q(lower, upper)
        return np.fmin(total, plain[0]), slopes

    def _counterexample(self, lower: Array, upper: Array) -> FloatArray | None:
        """Return a deviation with c >= 0 among the outer ends of boxes, if any."""
        if not lower.shape[1]:
            return None
        w = (lower[1:] + upper[1:]) / 2
        e = self.T @ (upper[0] * w / np.linalg.norm(w, axis=0))
        values = np.array(self._change.map(e.shape[1])(e)).ravel()
        worst = int(np.argmax(values))
        return e[:, worst] if values[worst] >= 0 else None
