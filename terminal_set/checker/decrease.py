"""Branch and bound over an ellipsoid, to prove q(t, rho, u) < 0 everywhere.

In the coordinates e = rho T u every statement on V becomes q < 0 with
  continuous       q = 2 u'Y + u'Mu,                     Y = T'P R(rho T u) / rho
  held             q = (1 + delta) |Y|^2 + u'Mu - k,     Y = T^-1 R_t(rho T u) / rho
where R is the motion relative to the reference. Three bounds decide a box:
  1. Y = Au + rho Z with Z in the second Taylor coefficients over [0, rho]: the
     quadratic part u'Bu is bounded nearly exactly, the rest by rho. There is no 0/0 at
     the origin, so this bound decides boxes at the centre.
  2. The sign of a derivative: if q is monotone in a coordinate, only the end with the
     larger q is examined further.
  3. The mean-value form around that end or the middle.
Undecided boxes are split along the largest |derivative| times width, depth first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from flint import arb, arb_mat

from swarmstart.terminal_set.checker.certificate_file import Vector
from swarmstart.terminal_set.checker.coordinates import (
    Balls,
    Floats,
    QuadraticPart,
    direction,
    direction_box,
    hull,
    scaled_by,
)
from swarmstart.terminal_set.checker.findings import Deadline, TimeIsUpError
from swarmstart.terminal_set.checker.jets import (
    RAY,
    RAY_AND_TIME,
    VALUES,
    Algebra,
    Jet,
    square,
)
from swarmstart.terminal_set.checker.motion import RelativeMotion, Stages

Interval = tuple[float, float]
Box = tuple[Interval, ...]  # time, rho, w_1 ... w_n
_RHO = 1
_W = 2


@dataclass(frozen=True, kw_only=True, slots=True)
class Statement:
    """q < 0 over times, radii and directions.

    Attributes:
        motion: The motion relative to the reference.
        T: Coordinates e = rho T u, shape (nx, nx).
        image: T'P (continuous) or T^-1 (held), in balls, shape (nx, nx).
        M: The reserve u'Mu, in balls, shape (nx, nx).
        scale: 1 + delta of |Y|^2; None for a continuous input.
        constant: Constant that is added to q.
        radius: Largest rho.
        times: Shortest and longest time for which inputs are held [s].
        is_counterexample: Whether the statement certainly fails at (e, t).
    """

    motion: RelativeMotion
    T: Floats
    image: arb_mat
    M: arb_mat
    scale: arb | None
    constant: arb
    radius: float
    times: Interval
    is_counterexample: Callable[[Vector, float], bool]


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """The end of a search.

    Attributes:
        proven: Whether q < 0 everywhere.
        counterexample: A point at which it certainly fails; None if none was found.
        boxes: Number of boxes searched.
        remark: Reason why the search stopped without a decision; "" otherwise.
    """

    proven: bool
    counterexample: Vector | None
    boxes: int
    remark: str = ""


@dataclass(slots=True)
class _Linear:
    """Bounds at the origin for one interval of times."""

    A: arb_mat
    quadratic: QuadraticPart


@dataclass(slots=True)
class _Ray:
    """A box before gradients: directions and Taylor terms."""

    u: Balls
    point: Balls  # T u
    curvature: Balls  # image of the second coefficient over [0, rho]
    mixed: Balls  # image of d/dt d/drho; zeros where time is one number
    linear: _Linear


@dataclass(slots=True)
class Search:
    """A branch and bound for one statement.

    Attributes:
        statement: Statement to prove.
        deadline: Time at which to stop.
        most_boxes: Number of boxes at which to stop.
    """

    statement: Statement
    deadline: Deadline
    most_boxes: float = math.inf
    _linear: dict[Interval, _Linear] = field(default_factory=dict)
    _stages: dict[tuple[Interval, Algebra], Stages] = field(default_factory=dict)

    def run(self) -> Outcome:
        """Examine boxes until all are proven, one refutes, or time is up.

        Returns:
            The outcome.
        """
        s = self.statement
        margin = self.linear(s.times).quadratic.largest + s.constant
        if s.times[0] == s.times[1] and not margin < 0:
            # No box around the origin can be proven, so give up at once.
            return Outcome(
                proven=False,
                counterexample=None,
                boxes=0,
                remark="the linear part has no margin: the largest quotient of its "
                f"quadratic form is {float(margin.mid()):.3g}",
            )
        stack = list(self._start())
        boxes = 0
        while stack:
            if self.deadline.has_passed or boxes >= self.most_boxes:
                return Outcome(
                    proven=False,
                    counterexample=None,
                    boxes=boxes,
                    remark=f"{len(stack)} boxes left in the queue",
                )
            boxes += 1
            try:
                rest = self.judge(stack.pop())
            except TimeIsUpError:
                rest = Outcome(
                    proven=False,
                    counterexample=None,
                    boxes=boxes,
                    remark=f"{len(stack) + 1} boxes left in the queue",
                )
            if isinstance(rest, Outcome):
                return Outcome(
                    proven=False,
                    counterexample=rest.counterexample,
                    boxes=boxes,
                    remark=rest.remark,
                )
            stack.extend(rest)
        return Outcome(proven=True, counterexample=None, boxes=boxes)

    def _start(self) -> list[Box]:
        s = self.statement
        n = len(s.T)
        boxes = []
        for face in range(n):
            for side in (-1.0, 1.0):
                w = [(-1.0, 1.0)] * n
                w[face] = (side, side)
                boxes.append((s.times, (0.0, s.radius), *w))
        return boxes

    def judge(self, box: Box) -> list[Box] | Outcome:
        """Return the undecided parts of a box.

        Returns:
            An empty list if it is proven; its parts; or an outcome that ends the
            search.
        """
        s = self.statement
        ray = self._ray(box)
        if self._separate_bound(box, ray) < 0:
            return []
        gradient = self._gradient(box, ray)
        face = _face_where_larger(box, gradient)
        centre = [low if low == high else 0.5 * (low + high) for low, high in face]
        value = self.value(centre)
        bound = value
        weights = []
        for (low, high), c, slope in zip(face, centre, gradient, strict=True):
            reach = (arb(high) - arb(c)).max(arb(c) - arb(low))
            weight = slope.abs_upper() * reach if high > low else arb(0)
            bound = bound + weight
            weights.append(weight)
        if bound < 0:
            return []
        if value > 0:
            e = self.point(centre)
            if s.is_counterexample(e, centre[0]):
                return Outcome(proven=False, counterexample=e, boxes=0)
        return self._split(face, weights)

    def _split(self, face: Box, weights: list[arb]) -> list[Box] | Outcome:
        scales = [self.statement.times[1], self.statement.radius]
        best, largest = -1, -1.0
        for i, (low, high) in enumerate(face):
            if not low < 0.5 * (low + high) < high:
                continue
            weight = float(weights[i])
            if not math.isfinite(weight):
                # Without a derivative, the relatively widest side comes first.
                weight = 1e300 * (high - low) / (scales[i] if i < _W else 1.0)
            if weight > largest:
                best, largest = i, weight
        if best < 0:
            e = self.point([low for low, _ in face])
            shown = ", ".join(f"{entry:.6g}" for entry in e)
            return Outcome(
                proven=False,
                counterexample=None,
                boxes=0,
                remark=f"no bound decides the single point e = ({shown})",
            )
        low, high = face[best]
        middle = 0.5 * (low + high)
        return [
            (*face[:best], part, *face[best + 1 :])
            for part in ((low, middle), (middle, high))
        ]

    def point(self, centre: Sequence[float]) -> Vector:
        """Return the state at a point of a box, slightly inside, rounded.

        Args:
            centre: Time, rho and w.

        Returns:
            e, shape (nx,).
        """
        # The radius of the search is slightly larger than the set's.
        rho = centre[_RHO] * (1 - 1e-13)
        norm = math.sqrt(sum(entry * entry for entry in centre[_W:]))
        return tuple(
            rho * sum(a * w for a, w in zip(row, centre[_W:], strict=True)) / norm
            for row in self.statement.T
        )

    def value(self, centre: Sequence[float]) -> arb:
        """The ball of q at one point.

        Args:
            centre: Time, rho and w.

        Returns:
            q.
        """
        s = self.statement
        u = direction(centre[_W:])
        rho, at = centre[_RHO], (centre[0], centre[0])
        if rho == 0.0:
            Y = _times(self.linear(at).A, u)
        else:
            reference = self._reference(VALUES, at)
            e = [VALUES.constant(entry * rho) for entry in _product(s.T, u)]
            duration = VALUES.constant(at[0]) if s.motion.held else None
            moved = [jet.value for jet in s.motion.relative(e, duration, reference)]
            Y = [entry / rho for entry in _times(s.image, moved)]
        return self._of(u, Y) + s.constant

    def _of(self, u: Balls, Y: Balls) -> arb:
        s = self.statement
        reserve = _dot(u, _times(s.M, u))
        if s.scale is None:
            return 2 * _dot(u, Y) + reserve
        return s.scale * _norm2(Y) + reserve

    def linear(self, times: Interval) -> _Linear:
        """A of Y = Au + O(rho) and the quadratic part, over an interval of times.

        Args:
            times: Shortest and longest time [s].

        Returns:
            Both, kept for the next call.
        """
        if times not in self._linear:
            A = self._linear_part(times)
            self._linear[times] = _Linear(A, QuadraticPart(self._form(A)))
        return self._linear[times]

    def quadratic_form(self, times: Interval) -> arb_mat:
        """B of q = u'Bu + O(rho) up to a constant, shape (nx, nx).

        Args:
            times: Shortest and longest time [s].

        Returns:
            B in balls.
        """
        return self._form(self._linear_part(times))

    def _form(self, A: arb_mat) -> arb_mat:
        s = self.statement
        if s.scale is None:
            return A + A.transpose() + s.M
        return A.transpose() * A * s.scale + s.M

    def _linear_part(self, times: Interval) -> arb_mat:
        s = self.statement
        n = len(s.T)
        algebra = Algebra(monomials=n)
        e = [algebra.variable(arb(0), {i + 1: arb(1)}) for i in range(n)]
        duration = algebra.constant(hull(*times)) if s.motion.held else None
        image = s.motion.relative(e, duration, self._reference(algebra, times))
        jacobian = arb_mat([[jet.slope(j + 1) for j in range(n)] for jet in image])
        return s.image * jacobian * arb_mat(s.T)

    def _reference(self, algebra: Algebra, times: Interval) -> Stages:
        key = (times, algebra)
        if key not in self._stages:
            duration = None
            if self.statement.motion.held:
                duration = self._duration(algebra, times)
            self._stages[key] = self.statement.motion.reference_stages(
                algebra, duration
            )
        return self._stages[key]

    def _duration(self, algebra: Algebra, times: Interval) -> Jet:
        """The time as a jet, with its own monomial if it is an interval."""
        last = len(self.statement.T) + 1
        if algebra is RAY_AND_TIME:
            return algebra.variable(hull(*times), {3: arb(1)})
        if algebra.monomials == last and not algebra.pairs:
            return algebra.variable(hull(*times), {last: arb(1)})
        return algebra.constant(hull(*times))

    def _ray(self, box: Box) -> _Ray:
        s = self.statement
        times, (_, radius) = box[0], box[_RHO]
        u = direction_box(box[_W:])
        point = _product(s.T, u)
        timed = times[0] < times[1]
        algebra = RAY_AND_TIME if timed else RAY
        e = [
            algebra.variable(scaled_by(entry, 0.0, radius), {1: entry})
            for entry in point
        ]
        duration = self._duration(algebra, times) if s.motion.held else None
        moved = s.motion.relative(e, duration, self._reference(algebra, times))
        curvature = _times(s.image, [jet.slope(2) for jet in moved])
        mixed = [arb(0)] * len(u)
        if timed:
            mixed = _times(s.image, [jet.slope(4) for jet in moved])
        return _Ray(u, point, curvature, mixed, self.linear(times))

    def _separate_bound(self, box: Box, ray: _Ray) -> arb:
        s = self.statement
        low, high = box[_RHO]
        bound = ray.linear.quadratic.upper(box[_W:], ray.u) + s.constant
        if s.scale is None:
            return bound + scaled_by(2 * _dot(ray.u, ray.curvature), low, high)
        first = 2 * s.scale * _dot(_times(ray.linear.A, ray.u), ray.curvature)
        second = s.scale * _norm2(ray.curvature)
        return bound + scaled_by(first, low, high) + second * arb(high) * arb(high)

    def _gradient(self, box: Box, ray: _Ray) -> Balls:
        """Enclosures of dq/dt, dq/drho, dq/dw_1 ... over a box."""
        s = self.statement
        n = len(s.T)
        times, (low, high) = box[0], box[_RHO]
        timed = times[0] < times[1]
        algebra = Algebra(monomials=n + timed)
        e = [
            algebra.variable(scaled_by(entry, low, high), {i + 1: arb(1)})
            for i, entry in enumerate(ray.point)
        ]
        duration = self._duration(algebra, times) if s.motion.held else None
        moved = s.motion.relative(e, duration, self._reference(algebra, times))

        linear = _times(ray.linear.A, ray.u)
        Y = [
            a + scaled_by(z, low, high)
            for a, z in zip(linear, ray.curvature, strict=True)
        ]
        along, in_time = ray.curvature, ray.mixed
        jacobian = [[jet.slope(j + 1) for j in range(n)] for jet in moved]
        if low > 0.0:
            # Away from the origin the quotients themselves are tighter on small boxes.
            inverse = 1 / hull(low, high)
            image = _times(s.image, [jet.value for jet in moved])
            Y = _meet(Y, _scaled(image, inverse))
            slopes = _times(s.image, [_dot(row, ray.point) for row in jacobian])
            differences = [a - b for a, b in zip(slopes, Y, strict=True)]
            along = _meet(along, _scaled(differences, inverse))
            if timed:
                rates = _times(s.image, [jet.slope(n + 1) for jet in moved])
                in_time = _meet(in_time, _scaled(rates, inverse))
        return self._assembled(box, ray, Y, (jacobian, along, in_time))

    def _assembled(
        self, box: Box, ray: _Ray, Y: Balls, parts: tuple[list[Balls], Balls, Balls]
    ) -> Balls:
        """Return the derivatives of q from those of its parts."""
        s, (jacobian, along, in_time) = self.statement, parts
        n = len(s.T)
        left = ray.u if s.scale is None else [s.scale * entry for entry in Y]
        extra = Y if s.scale is None else [arb(0)] * n
        back = _times(s.image.transpose(), left)
        back = [_dot([row[j] for row in jacobian], back) for j in range(n)]
        pulled = _times(arb_mat(s.T).transpose(), back)
        reserve = _times(s.M, ray.u)
        p = [2 * (a + b + c) for a, b, c in zip(extra, pulled, reserve, strict=True)]
        radial = _dot(ray.u, p)
        norm = _norm(box[_W:])
        across = [(a - b * radial) / norm for a, b in zip(p, ray.u, strict=True)]
        return [2 * _dot(left, in_time), 2 * _dot(left, along), *across]


def _scaled(entries: Balls, factor: arb) -> Balls:
    return [entry * factor for entry in entries]


def _face_where_larger(box: Box, gradient: Balls) -> Box:
    face = []
    for (low, high), slope in zip(box, gradient, strict=True):
        if slope >= 0:
            face.append((high, high))
        elif slope <= 0:
            face.append((low, low))
        else:
            face.append((low, high))
    return tuple(face)


def _norm(w: Sequence[Interval]) -> arb:
    return sum((square(hull(*interval)) for interval in w), arb(0)).sqrt()


def _dot(a: Sequence[arb], b: Sequence[arb]) -> arb:
    total = a[0] * b[0]
    for left, right in zip(a[1:], b[1:], strict=True):
        total = total + left * right
    return total


def _norm2(a: Sequence[arb]) -> arb:
    return sum((square(entry) for entry in a), arb(0))


def _times(matrix: arb_mat, vector: Sequence[arb]) -> Balls:
    column = matrix * arb_mat([[entry] for entry in vector])
    return list(column.entries())


def _product(T: Floats, u: Balls) -> Balls:
    return [_dot([arb(entry) for entry in row], u) for row in T]


def _meet(a: Balls, b: Balls) -> Balls:
    met = []
    for left, right in zip(a, b, strict=True):
        if not left.is_finite():
            met.append(right)
        elif not right.is_finite():
            met.append(left)
        else:
            met.append(left.intersection(right))
    return met
