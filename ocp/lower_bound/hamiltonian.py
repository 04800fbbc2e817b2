"""The Hamilton-Jacobi-Bellman inequality h >= -slack, with h = V_t + L + V_x f.

V(t, x) is the polynomial of the step (`stated/answer.py`), f(t, x, u) the right-hand
side and L(t, x, u) the stage cost; t, x and u are time, states and controls. h is
bounded from below over boxes by interval arithmetic. Let f be affine in u, and L
separable and quadratic: f = f0 + sum B_k u_k, L = L0 + sum (c_k u_k + q_k u_k^2), with
f0, B_k and L0 functions of (t, x). Then the least h over all u is

    h = a + sum over k of p_k(b_k),    a = V_t + L0 + V_x f0,    b_k = V_x B_k + c_k,
    p_k(b) = min over u in [low, high] of b u + q_k u^2

p_k is concave, and its slope is the minimiser u(b), which decreases by at most
1 / (2 q_k) per unit of b. So with b_m the value of b in the middle of a box and
u = u(b_m)

    p_k(b) >= p_k(b_m) + u (b - b_m) - (b - b_m)^2 / (4 q_k)

with the last term only if u(b) is not the same bound over the whole box. If q_k = 0,
p_k is the minimum of two lines. Over a box in which b may change sign, p_k lies above
the chord between its values at the ends. For all other problems u is a coordinate of
the boxes, and h is a function of (t, x, u).

At points (`Stage`), h, the costs and the best control are plain floats. These numbers
are not rigorous: they make rows of linear programs and find points at which a
polynomial violates the inequality. The proof depends on the intervals alone.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.basis import Basis
from swarmstart.ocp.lower_bound.stated.statement import Affine, Statement
from swarmstart.ocp.lower_bound.taylor_form import (
    Expansion,
    TaylorForm,
    least_quadratic,
)
from swarmstart.terminal_set.interval_arithmetic import PADDING

GRID = 9
MOST_CANDIDATES = 729


class Bounds(NamedTuple):
    """Lower bounds of a function over m boxes.

    Attributes:
        low: Lower bound over each box, shape (m,); -inf if nothing is known.
        spread: Variation of the function along each coordinate, shape (d, m).
    """

    low: Array
    spread: Array


class Inequality:
    """Lower bounds, over boxes, of h = V_t + L + V_x f, for any V of a given degree.

    V(t, x) is a polynomial, f the right-hand side, and L the stage cost.
    """

    def __init__(
        self, statement: Statement, affine: Affine | None, basis: Basis
    ) -> None:
        """Form the derivatives of h; `affine` is the problem in that form, if any.

        Raises:
            UnknownIntervalOperationError: If an operation has no interval form, or its
                derivatives jump.
        """
        self._statement, self._affine = statement, affine
        parameters = ca.SX.sym("parameters", basis.parameters)
        point = statement.point
        slope = ca.gradient(basis.expression(point, parameters), point)
        if affine is None:
            h = slope[0] + statement.stage + ca.dot(slope[1:, 0], statement.rate)
            parts, point = [h], ca.vertcat(point, statement.controls)
        else:
            a = slope[0] + affine.stage + ca.dot(slope[1:, 0], affine.drift)
            parts = [a] + [
                ca.dot(slope[1:, 0], column) + float(c)
                for column, c in zip(affine.columns, affine.linear, strict=True)
            ]
        self._form = TaylorForm(parts, point, parameters)

    @property
    def with_controls(self) -> bool:
        """True if boxes have the coordinates (t, x, u); False if they have (t, x)."""
        return self._affine is None

    def bounds(self, parameters: Array, lower: Array, upper: Array) -> Bounds:
        """Return lower bounds of h over boxes.

        Args:
            parameters: Parameters of the polynomial, from `packed`.
            lower: Lower corners of boxes of (t, x), or of (t, x, u); shape (d, m).
            upper: Upper corners, same shape.
        """
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            expansion = self._form.expanded(lower, upper, parameters)
            return self._bounded(expansion)

    def _bounded(self, at: Expansion) -> Bounds:
        pairs = self._form.pairs
        constant = at.value[0] - at.value_radius[0]
        slope, bend = at.slope[0].copy(), at.bend[0].copy()
        rest, pull = at.rest[0].copy(), at.pull[0].copy()
        for k in range(1, len(at.value)):
            line = self._line(at, k, pairs)
            constant += line.constant
            slope += line.u * at.slope[k]
            bend += line.u * at.bend[k]
            for number, (i, j) in enumerate(pairs):
                # (b - b_m)^2 / (4 q), with b - b_m about g'd, is a part of d'Hd / 2.
                bend[number] -= line.curved * at.slope[k, i] * at.slope[k, j]
            rest += np.abs(line.u) * at.rest[k] + line.rest
            pull += np.abs(line.u) * at.pull[k] + line.pull
        return settled(Quadratic(at.reach, constant, slope, bend, rest, pull), pairs)

    def _line(self, at: Expansion, k: int, pairs: list[tuple[int, int]]) -> _Line:
        """Return a lower bound of p_k over boxes; k counts from 1."""
        affine = self._affine
        q = 0.0 if affine is None else float(affine.quadratic[k - 1])
        low, high = (float(ends[k - 1]) for ends in self._statement.control_box)
        value, off = at.value[k], at.value_radius[k]
        reach = (np.abs(at.slope[k]) * at.reach).sum(axis=0)
        bent = at.rest[k].copy()
        for number, (i, j) in enumerate(pairs):
            area = at.reach[i] * at.reach[j] * (0.5 if i == j else 1.0)
            bent += np.abs(at.bend[k, number]) * area
        apart = (reach + bent + off) * (1 + PADDING) + PADDING * np.abs(value)
        largest = max(abs(low), abs(high))
        if q > 0:
            line = _of_square(q, (low, high), (value, apart))
            # (g'd + v)^2 / (4 q) with |v| <= beyond: what the square alone leaves out.
            beyond = bent + off
            rest = line.curved * (reach * beyond + beyond * beyond / 2)
            # d'Hd / 2 of the square, whose rounding is that of its size.
            rest += PADDING * line.curved * reach * reach
            line = line._replace(rest=rest, pull=np.zeros_like(at.reach))
        else:
            line = _of_kink((low, high), (value, apart))
            line = line._replace(pull=line.pull * np.abs(at.slope[k]) * at.reach)
        size = np.abs(line.constant)
        lost = largest * off + PADDING * (size + largest * apart)
        return line._replace(constant=line.constant - lost)


class _Line(NamedTuple):
    """A lower bound of p(b): constant + u (b - b_m) - curved (g'd)^2 / 2 - rest.

    d is the deviation from the middle of a box, b_m and g are b and its gradient there.
    """

    u: Array
    constant: Array
    curved: Array
    rest: Array
    pull: Array


def _of_square(q: float, box: tuple[float, float], about: tuple[Array, Array]) -> _Line:
    """Return the line below min over u in box of b u + q u^2, for q > 0.

    It touches at b = b_m, with u = -b / (2 q) clipped to the box. If no b clips it,
    it is -b^2 / (4 q), which falls by (b - b_m)^2 / (4 q) below the line.

    Args:
        q: Of the control's square in the cost.
        box: Lower and upper bound of the control.
        about: Middle b_m and largest distance of b from it.
    """
    (low, high), (value, apart) = box, about
    least, most = value - apart, value + apart
    largest = max(abs(low), abs(high))
    u = np.clip(-value / (2 * q), low, high)
    # Rounding must not make an unclipped box look clipped.
    same = -most / (2 * q) > high + PADDING * largest
    same |= -least / (2 * q) < low - PADDING * largest
    none = np.zeros_like(value)
    return _Line(
        u=u,
        constant=value * u + q * u * u,
        curved=np.where(same, 0.0, 1 / (2 * q)),
        rest=none,
        pull=none,
    )


def _of_kink(box: tuple[float, float], about: tuple[Array, Array]) -> _Line:
    """Return the line below min over u in box of b u: low b or high b.

    The minimum is concave, with a kink at b = 0. Over a range of b that holds the kink,
    the chord through its ends is below it. `pull` is by how much the bound would rise
    if the range of b were halved, per unit of b.

    Args:
        box: Lower and upper bound of the control.
        about: Middle b_m and largest distance of b from it.
    """
    (low, high), (value, apart) = box, about
    least, most = value - apart, value + apart
    at_least, at_most = (np.minimum(low * b, high * b) for b in (least, most))
    crosses = (least < 0) & (most > 0)
    chord = (at_most - at_least) / np.where(crosses, most - least, 1.0)
    u = np.where(crosses, chord, np.where(least >= 0, low, high))
    return _Line(
        u=u,
        # The chord through the ends of [least, most], at b = value.
        constant=np.where(crosses, at_least + u * (value - least), u * value),
        curved=np.zeros_like(value),
        rest=PADDING * (high - low) * apart,
        pull=np.where(crosses, (high - low) / 4, 0.0),
    )


class Quadratic(NamedTuple):
    """Lower bounds constant + g'd + d'Hd / 2 - rest of functions over m boxes.

    In this formula d is the deviation from the middle of a box, a vector; in the
    shapes d is its length.

    Attributes:
        reach: Half widths of the boxes, shape (d, m).
        constant: Shape (m,).
        slope: g, shape (d, m).
        bend: H for each pair of coordinates, shape (pairs, m).
        rest: Shape (m,).
        pull: For each coordinate, the part of `rest` that shrinks if boxes are cut
            along it, shape (d, m).
    """

    reach: Array
    constant: Array
    slope: Array
    bend: Array
    rest: Array
    pull: Array


def settled(at: Quadratic, pairs: list[tuple[int, int]]) -> Bounds:
    """Return the least values of quadratic bounds over their boxes, rounded down."""
    least, spread = least_quadratic(at.slope, at.bend, at.reach, pairs)
    size = np.abs(at.constant) + spread.sum(axis=0) + at.rest
    low = at.constant + least - at.rest - PADDING * size
    spread = spread + at.pull
    lost = ~np.isfinite(low)
    low[lost] = -np.inf
    # If nothing is known, the longest side is cut.
    known = np.isfinite(spread).all(axis=0) & ~lost
    return Bounds(low, np.where(known, spread, at.reach))


class Margin:
    """Lower bounds, over boxes, of an expression that has a polynomial's parameters."""

    def __init__(self, expression: ca.SX, point: ca.SX, parameters: ca.SX) -> None:
        """Form the derivatives of the expression.

        Args:
            expression: Scalar in the point and the parameters.
            point: Symbols of the point, shape (d, 1).
            parameters: Parameters, shape (p, 1).

        Raises:
            UnknownIntervalOperationError: See TaylorForm.
        """
        self._form = TaylorForm([expression], point, parameters)

    def bounds(self, parameters: Array, lower: Array, upper: Array) -> Bounds:
        """Return lower bounds over m boxes, whose corners have the shape (d, m)."""
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            at = self._form.expanded(lower, upper, parameters)
            return settled(
                Quadratic(
                    reach=at.reach,
                    constant=at.value[0] - at.value_radius[0],
                    slope=at.slope[0],
                    bend=at.bend[0],
                    rest=at.rest[0],
                    pull=at.pull[0],
                ),
                self._form.pairs,
            )


class Stage:
    """Rates and costs of a problem at points."""

    def __init__(self, statement: Statement, affine: Affine | None) -> None:
        """Compile rates and costs; `affine` is the problem in that form, if any."""
        self._statement, self._affine = statement, affine
        point, u = statement.point, statement.controls
        rates = ca.densify(ca.vertcat(statement.rate, statement.stage))
        self._rates = ca.Function("rates", [point, u], [rates])
        self._end = ca.Function("end", [point], [ca.densify(statement.end)])
        if affine is not None:
            columns = ca.densify(ca.vertcat(*affine.columns, ca.SX(0, 1)))
            self._columns = ca.Function("columns", [point], [columns])

    def rates(self, points: Array, u: Array) -> tuple[Array, Array]:
        """Return rates f (n, N) and stage costs L (N,).

        Args:
            points: Points (t, x), shape (1 + n, N).
            u: Controls, shape (m, N).
        """
        found = np.array(self._rates(points, u))
        return found[:-1], found[-1]

    def end(self, points: Array) -> Array:
        """Return the terminal cost at points (t, x), (1 + n, N); shape (N,)."""
        return np.array(self._end(points)).ravel()

    def hamiltonian(
        self, slopes: Array, points: Array, u: Array | None = None
    ) -> tuple[Array, Array]:
        """Return h = V_t + L + V_x f at points, and the controls used.

        Args:
            slopes: Derivatives of V, shape (1 + n, N).
            points: Points (t, x), shape (1 + n, N).
            u: Controls, shape (m, N); None means those that minimise h.

        Returns:
            h, shape (N,), not finite at points at which the problem is not finite;
            controls, (m, N).
        """
        if u is None:
            u = self._best(slopes, points)
        f, L = self.rates(points, u)
        return slopes[0] + L + (slopes[1:] * f).sum(axis=0), u

    def _best(self, slopes: Array, points: Array) -> Array:
        low, high = (limit[:, None] for limit in self._statement.control_box)
        m, count = self._statement.m, points.shape[1]
        if self._affine is not None:
            columns = np.array(self._columns(points)).reshape(m, -1, count)
            b = (columns * slopes[None, 1:]).sum(axis=1)
            b += self._affine.linear[:, None]
            q = self._affine.quadratic[:, None]
            # Both branches below are computed: none may divide by 0.
            curved = np.where(q > 0, q, 1.0)
            smooth = np.clip(-b / (2 * curved), low, high)
            return np.where(q > 0, smooth, np.where(b > 0, low, high))
        found, best = None, np.full(count, np.inf)
        for candidate in self._candidates():
            u = np.repeat(candidate[:, None], count, axis=1)
            h, _ = self.hamiltonian(slopes, points, u)
            # False for NaN, so a control at which h is not finite is not chosen.
            better = h < best
            best = np.where(better, h, best)
            found = u if found is None else np.where(better, u, found)
        if found is None:
            return np.zeros((0, count))
        return self._refined(slopes, points, found, best)

    def _candidates(self) -> Array:
        m = self._statement.m
        each = GRID
        # Both ends are kept: a control in which h is linear is best there.
        while each > 2 and each**m > MOST_CANDIDATES:  # noqa: PLR2004
            each -= 1
        axes = [
            np.linspace(low, high, each)
            for low, high in zip(*self._statement.control_box, strict=True)
        ]
        return np.array(list(itertools.product(*axes))).reshape(-1, m)

    def _refined(self, slopes: Array, points: Array, u: Array, h: Array) -> Array:
        """Return controls of lower h, by shrinking steps along each control."""
        low, high = (limit[:, None] for limit in self._statement.control_box)
        step = (high - low) / (GRID - 1)
        for _ in range(6):
            step = step / 2
            for k in range(len(u)):
                for sign in (1.0, -1.0):
                    tried = u.copy()
                    tried[k] = np.clip(u[k] + sign * step[k], low[k], high[k])
                    other, _ = self.hamiltonian(slopes, points, tried)
                    better = other < h
                    u, h = np.where(better, tried, u), np.where(better, other, h)
        return u


@dataclass(frozen=True, eq=False)
class Setting:
    """A problem in all forms that the steps of a proof need.

    Attributes:
        statement: The problem.
        affine: The problem in affine form, if it has one.
        stage: Rates and costs of the problem at points.
        size: Size of the problem's costs, > 0.
    """

    statement: Statement
    affine: Affine | None
    stage: Stage
    size: float


class Forms:
    """The inequalities, derived once for all polynomials of a degree."""

    def __init__(self, setting: Setting, degree: int) -> None:
        """Form the derivatives; see Inequality."""
        statement = setting.statement
        self.basis = Basis(1 + statement.n, degree)
        self.inequality = Inequality(statement, setting.affine, self.basis)
        parameters = ca.SX.sym("parameters", self.basis.parameters)
        point = statement.point
        V = self.basis.expression(point, parameters)
        self.end = Margin(statement.end - V, point, parameters)
