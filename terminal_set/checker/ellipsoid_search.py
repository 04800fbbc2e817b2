"""c(e) < 0 on an ellipsoid without its centre, as a task for branch and bound.

The ellipsoid is V(e) = e'Pe <= alpha, and e the deviation from a reference. Every e !=
0 is e = s v, v = T w for one pair of a number s > 0 and a point w on a face of the cube
[-1, 1]^n. The matrix T makes T'PT nearly I and the quadratic part of c nearly diagonal;
these two properties are needed for speed only. c is a quadratic form of e and of R(e),
which is the rate of e (continuous input) or e after a hold (held input; `motion.py`).
With a symmetric matrix M, which has the margins,

  continuous   c(e) = 2 e'P R(e) + e'Me
  held         c(e) = R(e)'P R(e) + e'Me

Boxes that begin at s = 0 are judged by c(s v) / s^2, a form of v and of R(s v) / s,
which `rays.py` bounds without 0/0; all other boxes are judged by c itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swarmstart.terminal_set.checker.evaluation import rounded
from swarmstart.terminal_set.checker.models import (
    ROUNDING,
    TINY,
    Array,
    Model,
    algebra_of,
)
from swarmstart.terminal_set.checker.motion import RelativeMotion
from swarmstart.terminal_set.checker.rays import Along
from swarmstart.terminal_set.checker.search import (
    Boxes,
    Flags,
    Judgement,
    judgement,
    lowest,
)

Rows = Sequence[Sequence[Fraction]]
Vector = tuple[float, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Change:
    """The form c(e) of a deviation e, which is claimed to be negative.

    For a continuous input, R(e) is the rate of e and c(e) = 2 e'P R(e) + e'Me. For a
    held input, R(e) is the deviation after `time` and c(e) = R(e)'P R(e) + e'Me.

    Attributes:
        motion: The motion relative to the reference.
        P: Matrix of V(e) = e'Pe, symmetric, exact, shape (nx, nx).
        M: Matrix of the second term of c, symmetric, exact, shape (nx, nx).
        time: Time for which inputs are held [s]; None for a continuous input, or if the
            time is a coordinate of the boxes.
    """

    motion: RelativeMotion
    P: Rows
    M: Rows
    time: Fraction | None

    def level(self, e: Sequence[Model]) -> Model:
        """Return V(e) = e'Pe."""
        return _form(self.P, e, e)

    def of(self, e: Sequence[Model], time: Model | None = None) -> Model:
        """Return c(e), the form that is claimed to be negative.

        Args:
            e: State relative to the reference.
            time: Time in the hold, if it is a coordinate; None: the time of `self`.
        """
        duration = self.time if time is None else time
        return self._form(e, self.motion.relative(e, duration))

    def over_square(
        self, v: Sequence[Model], s: Model, time: Model | None = None
    ) -> Model:
        """Return c(s v) / s^2 for boxes that begin at s = 0.

        Args:
            v: Directions.
            s: The coordinate along them.
            time: Time in the hold, if it is a coordinate; None: the time of `self`.
        """
        zero = s.number(0.0)
        duration = self.time if time is None else Along(time, zero, s)
        e = [Along(zero, entry, s) for entry in v]
        return self._form(v, [entry.slope for entry in self.motion.run(e, duration)])

    def _form(self, e: Sequence[Model], moved: Sequence[Model]) -> Model:
        kept = _form(self.M, e, e)
        if self.motion.held:
            return _form(self.P, moved, moved) + kept
        return _form(self.P, e, moved).scaled(2.0) + kept


def _form(matrix: Rows, a: Sequence[Model], b: Sequence[Model]) -> Model:
    """Return a'(matrix)b."""
    total = a[0].number(0.0)
    for entry, row in zip(a, matrix, strict=True):
        terms = [x.scaled(*rounded(m)) for m, x in zip(row, b, strict=True) if m]
        if terms:
            total = total + entry * _added(terms)
    return total


def _added(terms: Sequence[Model]) -> Model:
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return total


@dataclass(frozen=True, kw_only=True, eq=False)
class DecreaseTask:
    """The task c(e) < 0 for 0 < V(e) = e'Pe <= alpha, for all `times` if given.

    Every e != 0 is s T w with a number s > 0 and a point w on a face of the cube
    [-1, 1]^nx. The coordinates of a box are s, the entries of w except the one that is
    1 or -1 on the face, and the time, unless `times` is None. Each box belongs to one
    piece of time, with the number p, and to one of the 2 nx faces of the cube, with the
    number k. Its entry of `Boxes.slab` is 2 nx p + k.

    Attributes:
        change: The form c that is to be proven negative; a bound of the rounding of its
            matrices may be added to it.
        stated: c as the file states it, without such a bound: a counterexample must
            have c >= 0 by this form.
        alpha: Level of the ellipsoid.
        T: Matrix T of e = s T w for each piece of time, shape (pieces, nx, nx).
        delta: Upper bounds of |T'PT - I|, below 1, shape (pieces,).
        times: Ends of the pieces of time, shape (pieces + 1,); None if the time is
            fixed.
    """

    change: Change
    stated: Change
    alpha: float
    T: Array
    delta: Array
    times: Array | None

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.T.shape[1])

    @cached_property
    def _others(self) -> NDArray[np.int64]:
        """The axes beside each one, shape (nx - 1, nx)."""
        n = self.n
        rows = [[j for j in range(n) if j != face] for face in range(n)]
        return np.array(rows, dtype=np.int64).reshape(n, n - 1).T

    def roots(self) -> Boxes:
        """Return a box for each face of the cube and each piece of time."""
        n, pieces = self.n, len(self.T)
        slab = np.arange(2 * n * pieces)
        lower, upper = -np.ones((n, slab.size)), np.ones((n, slab.size))
        lower[0], upper[0] = 0.0, np.inf
        if self.times is not None:
            piece = slab // (2 * n)
            lower = np.vstack([lower, self.times[piece]])
            upper = np.vstack([upper, self.times[piece + 1]])
        return self.cut(Boxes(lower, upper, slab))[0]

    def cut(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop what is outside of the ellipsoid, by V(e) >= s^2 (1 - delta) |w|^2."""
        w = slice(1, self.n)
        least = np.maximum(np.maximum(boxes.lower[w], -boxes.upper[w]), 0.0)
        square = 1.0 + (least**2).sum(axis=0) * (1.0 - ROUNDING)
        room = (1.0 - self.delta[boxes.slab // (2 * self.n)]) * square
        most = np.sqrt(self.alpha / room) * (1.0 + ROUNDING)
        upper = boxes.upper.copy()
        upper[0] = np.minimum(upper[0], most)
        return Boxes(boxes.lower, upper, boxes.slab), boxes.lower[0] > most

    def cut_more(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Return the boxes as they are: there is no further test."""
        return boxes, np.zeros(boxes.count, dtype=np.bool_)

    def _directions(self, boxes: Boxes) -> list[Model]:
        """Return v = T w as models."""
        n, each = self.n, np.arange(boxes.count)
        face, place = boxes.slab % (2 * n), boxes.slab // (2 * n)
        axes = self._others[:, face // 2]
        middle, radius = np.zeros((n, boxes.count)), np.zeros((n, boxes.count))
        middle[face // 2, each] = np.where(face % 2 == 0, 1.0, -1.0)
        middle[axes, each] = boxes.middle[1:n]
        radius[axes, each] = boxes.radius[1:n]
        T = self.T[place]
        values = np.einsum("bij,jb->ib", T, middle)
        sizes = np.einsum("bij,jb->ib", np.abs(T), np.abs(middle) + radius)
        algebra, found = algebra_of(len(boxes.lower)), []
        for i in range(n):
            model = algebra.constant(values[i], ROUNDING * sizes[i] + TINY)
            model.coefficients[2 : 1 + n] = T[each, i, axes] * radius[axes, each]
            found.append(model)
        return found

    def _change(self, boxes: Boxes) -> Model:
        """Return c over boxes, or c / s^2 if they begin at s = 0."""
        variables, v = boxes.variables(), self._directions(boxes)
        s = variables[0]
        time = None if self.times is None else variables[-1]
        if not boxes.lower[0].any():
            return self.change.over_square(v, s, time)
        return self.change.of([s * entry for entry in v], time)

    def judge(self, boxes: Boxes) -> Judgement:
        """Judge c < 0 over boxes; over boxes that contain e = 0, c / s^2 < 0.

        c is the change that is to be proven negative, and s the factor of e = s T w.
        """
        proven, suspect = np.zeros((2, boxes.count), dtype=np.bool_)
        pull = np.zeros_like(boxes.lower)
        for which in (boxes.lower[0] == 0.0, boxes.lower[0] > 0.0):
            if which.any():
                part = boxes.only(which)
                below = -self._change(part)
                judged = judgement(
                    below, part, proven=lowest(below) > 0.0, suspect=below.middle < 0.0
                )
                proven[which], suspect[which] = judged.proven, judged.suspect
                pull[:, which] = judged.pull
        return Judgement(proven, suspect, pull)

    def refuted(self, points: Boxes) -> Flags:
        """Return the points of the ellipsoid at which c >= 0 for certain, as a mask."""
        variables, v = points.variables(), self._directions(points)
        s = variables[0]
        e = [s * entry for entry in v]
        time = None if self.times is None else variables[-1]
        level = self.stated.level(e)
        inside = (level.upper <= self.alpha) & (level.lower > 0.0)
        if inside.any():
            inside &= self.stated.of(e, time).lower >= 0.0
        return inside

    def shown(self, points: Boxes) -> Vector:
        """Return the state e of the first point."""
        e = [points.lower[0, 0] * entry.middle[0] for entry in self._directions(points)]
        return tuple(map(float, e))

    @property
    def largest(self) -> float:
        """The largest quotient of the quadratic part of c and |w|^2, rounded."""
        forms = quadratic_forms(self.change, self.T, self.times)
        if not np.isfinite(forms).all():
            return float("inf")
        return float(max(np.linalg.eigvalsh(form)[-1] for form in forms))


def quadratic_forms(change: Change, T: Array, times: Array | None) -> Array:
    """Return B with c(s T w) = s^2 w'Bw + O(s^3), rounded, shape (pieces, nx, nx).

    Args:
        change: The form c.
        T: Coordinates, shape (pieces, nx, nx).
        times: Ends of the pieces of time, shape (pieces + 1,), at the middles of which
            c is taken; None if the time is fixed.
    """
    pieces, n = T.shape[:2]
    zero = np.zeros(pieces)
    algebra = algebra_of(n + 1)
    s = algebra.constant(zero)
    w = [algebra.variable(1 + j, zero, zero + 1.0) for j in range(n)]
    v = [_added([w[j].scaled(T[:, i, j]) for j in range(n)]) for i in range(n)]
    middles = None
    if times is not None:
        middles = algebra.constant(0.5 * (times[1:] + times[:-1]))
    found = change.over_square(v, s, middles).coefficients
    B = np.zeros((pieces, n, n))
    for i in range(n):
        for j in range(n):
            exponents = [0] * (n + 1)
            exponents[1 + i] += 1
            exponents[1 + j] += 1
            share = 1.0 if i == j else 0.5
            B[:, i, j] = share * found[algebra.numbers[tuple(exponents)]]
    return B
