"""Piecewise polynomials of one or two arguments as plain CasADi expressions.

    s(x) = sum_i c_i B_i(x),   s(x, y) = sum_ij c_ij B_i(x) B_j(y)

with B-splines B_i on given knots. The piece is selected by comparisons with all knots,
so that a whole population runs through the same machine code:

- degree 1: the increments of all intervals, each up to the position of x,
  s(x) = y_0 + sum_i s_i (min(x, x_i+1) - min(x, x_i)), with y_0 the value at the first
  knot and s_i the slopes; min has a kink, as a knot has;
- other degrees, one argument: the polynomial of the piece that contains x, whose
  coefficients are selected by the comparisons x < knot;
- other degrees, two arguments: the recursion of Cox and de Boor.

Source: de Boor (2001), A Practical Guide to Splines, chapters IX, X and XVII.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array

Flags = NDArray[np.bool_]
Outside = Literal["extrapolate", "hold", "zero"]


_ROUNDING = 2e-15
"""Relative rounding error of a difference of two values."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Spline:
    """A tensor product of B-splines in one or two arguments.

    Attributes:
        knots: Knots of each argument, not decreasing, shape (k,).
        degrees: Degree of the B-splines of each argument.
        coefficients: Factors of the B-splines, shape (k - degree - 1,) in each
            argument.
        outside: Value beyond the first and the last knot: the end pieces are extended,
            the value at the end is held, or the value is zero.
    """

    knots: tuple[Array, ...]
    degrees: tuple[int, ...]
    coefficients: Array
    outside: Outside

    def expression(self, *arguments: ca.SX) -> ca.SX:
        """Return the spline's value at each entry of the arguments; NaN at NaN.

        Args:
            arguments: An expression for each argument of the spline, all of one shape
                or scalar.
        """
        given = [ca.densify(ca.SX(a)) for a in arguments]
        ends = [(float(k[0]), float(k[-1])) for k in self.knots]
        held, is_linear = self.outside == "hold", set(self.degrees) == {1}
        if is_linear:
            value = _piecewise_linear(given, self.knots, self.coefficients, held=held)
        elif held:
            at = zip(given, ends, strict=True)
            value = self._inside([_held(x, *between) for x, between in at])
        else:
            value = self._inside(given)
        if self.outside == "zero":
            for x, (first, last) in zip(given, ends, strict=True):
                value = ca.if_else(ca.logic_or(x < first, x > last), 0, value)
        return value

    def _inside(self, given: Sequence[ca.SX]) -> ca.SX:
        if len(given) == 1:
            return _chosen_piece(given[0], *self._pieces())
        (x, y), (at_x, at_y) = given, self.knots
        of_x = _bases(x, at_x, self.degrees[0])
        of_y = _bases(y, at_y, self.degrees[1])
        return _sum((_product(r, of_y) for r in self.coefficients), of_x)

    def _pieces(self) -> tuple[Array, Array]:
        """Return the start of each piece, and its polynomial there, (degree + 1, n)."""
        from scipy.interpolate import PPoly

        (knots,), (degree,) = self.knots, self.degrees
        found = PPoly.from_spline((knots, self.coefficients, degree))
        # Repeated knots give pieces without length.
        kept = np.diff(found.x) > 0
        return found.x[:-1][kept], found.c[:, kept]


def _held(x: ca.SX, first: float, last: float) -> ca.SX:
    """Return x clipped to its limits; by comparisons, which keep NaN."""
    return ca.if_else(x < first, first, ca.if_else(x > last, last, x))


def _sum(factors: Iterable[ca.SX | float], of: Sequence[ca.SX]) -> ca.SX:
    """Return the sum of products, in the given order."""
    return reduce(add, (f * b for f, b in zip(factors, of, strict=True)))


def _product(numbers: Array, of: Sequence[ca.SX]) -> ca.SX:
    return _sum((float(number) for number in numbers), of)


def _chosen_piece(x: ca.SX, begins: Array, polynomials: Array) -> ca.SX:
    """Return the polynomial of the piece that contains x; the end pieces are extended.

    Its coefficients are selected, not its value, so no derivative needs other pieces.
    """
    below = [ca.SX.zeros(*x.shape), *(x < float(b) for b in begins[1:])]
    below.append(ca.SX.ones(*x.shape))
    here = [after - before for before, after in itertools.pairwise(below)]
    begin, value, *rest = (_product(row, here) for row in (begins, *polynomials))
    for coefficient in rest:
        value = value * (x - begin) + coefficient
    return value


def _bases(x: ca.SX, knots: Array, degree: int) -> list[ca.SX]:
    """Return the B-splines at x, with the end pieces extended beyond the ends."""
    last = len(knots) - degree - 1
    below = [ca.SX.zeros(*x.shape)] * len(knots)
    for i in range(degree + 1, last):
        below[i] = x < knots[i]
    for i in range(last, len(knots)):
        below[i] = ca.SX.ones(*x.shape)
    bases = [below[i + 1] - below[i] for i in range(len(knots) - 1)]
    for p in range(1, degree + 1):
        raised = []
        for i in range(len(bases) - 1):
            value = ca.SX.zeros(*x.shape)
            # For repeated knots 0 / 0 counts as 0.
            if knots[i + p] > knots[i]:
                value += (x - knots[i]) * (1 / (knots[i + p] - knots[i])) * bases[i]
            if knots[i + p + 1] > knots[i + 1]:
                width = knots[i + p + 1] - knots[i + 1]
                value += (knots[i + p + 1] - x) * (1 / width) * bases[i + 1]
            raised.append(value)
        bases = raised
    return bases


def _piecewise_linear(
    given: Sequence[ca.SX], knots: Sequence[Array], values: Array, *, held: bool
) -> ca.SX:
    """Return the (bi)linear interpolation; end pieces are extended unless held."""
    bent = [_bends(k[1:-1], values, axis) for axis, k in enumerate(knots)]
    slopes, pieces = values[np.ix_(*bent)], []
    for axis, (x, known) in enumerate(zip(given, knots, strict=True)):
        at = known[1:-1][bent[axis]]
        widths = np.diff(at).reshape(-1, *[1] * (values.ndim - axis - 1))
        first = slopes.take([0], axis=axis)
        slopes = np.concatenate([first, np.diff(slopes, axis=axis) / widths], axis=axis)
        rows = np.moveaxis(slopes, axis, 0).reshape(at.size, -1)
        counts = np.abs(rows).max(axis=1) > 0
        pieces.append(_passed(x, at, counts, held=held))
    if len(given) == 1:
        return _product(slopes, pieces[0])
    return _sum((_product(row, pieces[1]) for row in slopes), pieces[0])


def _bends(at: Array, values: Array, axis: int) -> Flags:
    """Return the ends, and the points at which the slope changes beyond rounding."""
    rows = np.moveaxis(values, axis, 0).reshape(at.size, -1)
    widths = np.diff(at)[:, None]
    turns = np.abs(np.diff(np.diff(rows, axis=0) / widths, axis=0))
    rounding = _ROUNDING * np.abs(rows).max() / np.minimum(widths[1:], widths[:-1])
    # Values that overflow are refused elsewhere.
    changes = (turns > rounding) | ~np.isfinite(turns)
    return np.concatenate([[True], changes.any(axis=1), [True]])


def _passed(x: ca.SX, at: Array, counts: Flags, *, held: bool) -> list[ca.SX]:
    """Return 1, and the length of each interval that lies before x.

    Args:
        x: The position.
        at: Ends of the intervals, increasing.
        counts: Whether each returned entry is used.
        held: Whether the value is held outside the ends.
    """
    before = [ca.fmin(x, float(k)) for k in at]
    if not held:
        before[0], before[-1] = ca.SX(float(at[0])), x
    # The minimum of NaN and a number is the number: the last used entry keeps NaN.
    last = int(np.flatnonzero(counts)[-1]) if counts[1:].any() else 0
    if 0 < last < at.size - 1 or (last and held):
        before[last] = ca.if_else(x > float(at[last]), float(at[last]), x)
    ones = ca.SX.ones(*x.shape)
    return [ones, *(b - a for a, b in itertools.pairwise(before))]
