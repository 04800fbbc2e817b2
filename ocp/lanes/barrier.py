"""Bounds and rows with limits, as an interior-point method takes them.

A part of a problem (an interval, the end or the start) has rows c with limits, which
depend on state and controls, and variables with bounds. A row with a limit has a slack
s between its limits, and elastic variables p, n >= 0 that let it be broken, at the
price rho:

    c - s + p - n = 0        (s is the limit itself if both limits are equal)

so that any start is a point inside, and linearised rows always have a solution. Every
bound of a variable v has a distance d = +-(v - bound) > 0 and a dual z > 0, with
d z = mu on the central path with the parameter mu. In Newton's step slacks, elastic
variables and duals are eliminated, row by row: the multiplier of a row after the step
is

    m+ = w (c' dy + o),    1 / w = 1/S_s + 1/S_p + 1/S_n,    S_v = z / d + delta
    o = (c - s + p - n) + g_s / S_s - g_p / S_p + g_n / S_n

with dy the step of state and controls, c' the derivative of the row by them, g_v the
derivative of barrier and price by v, and delta >= 0 a number that makes the step one of
descent (interior_kernels.py). Terms of variables that a row does not have are left out.

Source: Nocedal and Wright (2006), Numerical Optimization, 19.3 and 18.5 (penalties);
Wächter and Biegler (2006), On the implementation of an interior-point filter
line-search algorithm.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from swarmstart.arrays import Array

RELAXED = 1e-8
"""Widening of every limit, relative to its size or to 1, so that there is a point
strictly inside."""
PUSHED = 1e-2
"""Least distance of a start to a bound, relative to the bound's size or to 1, and to
the width of the bounds."""
_MOST_DUAL = 1e10
"""Largest ratio between a dual and mu / d."""


def smallest(of: Iterable[ca.SX], most: ca.SX) -> ca.SX:
    """Return the smallest of some numbers and the number `most`."""
    for one in of:
        most = ca.fmin(most, one)
    return most


def largest(of: Iterable[ca.SX], least: ca.SX) -> ca.SX:
    """Return the largest of some numbers and the number `least`."""
    for one in of:
        least = ca.fmax(least, one)
    return least


@dataclass(frozen=True, eq=False)
class Pairs:
    """Bounds of some entries of a column of variables.

    Attributes:
        of: Index of the entry of each bound.
        sign: 1 for a lower bound, -1 for an upper one.
        limit: The bounds, a column.
        size: Number of entries of the column.
    """

    of: list[int]
    sign: list[float]
    limit: ca.SX
    size: int

    @property
    def count(self) -> int:
        """Number of bounds."""
        return len(self.of)

    @cached_property
    def _signs(self) -> ca.SX:
        return ca.SX(ca.DM(self.sign)) if self.sign else ca.SX(0, 1)

    def of_pairs(self, v: ca.SX) -> ca.SX:
        """Return the change of the distances for a change v of the variables."""
        return self._signs * picked(v, self.of)

    def distances(self, v: ca.SX) -> ca.SX:
        """Return the distances to the bounds, a column."""
        return self.of_pairs(v) - self._signs * self.limit

    def summed(self, each: ca.SX) -> ca.SX:
        """Return, for each variable, the sum over its bounds."""
        total = ca.SX.zeros(self.size, 1)
        for number, entry in enumerate(self.of):
            total[entry] += each[number]
        return total

    def curvature(self, v: ca.SX, z: ca.SX) -> ca.SX:
        """Return for each variable the sum of dual z / distance d over its bounds."""
        return self.summed(z / self.distances(v))

    def slope(self, v: ca.SX, mu: ca.SX) -> ca.SX:
        """Return the gradient of the barrier -mu sum(log(d)), d the distances."""
        return self.pushed(-mu / self.distances(v))

    def pushed(self, z: ca.SX) -> ca.SX:
        """Return for each variable the sum of sign * z over its bounds, z the duals."""
        return self.summed(self._signs * z)

    def dual_step(self, v: ca.SX, z: ca.SX, mu: ca.SX, step: ca.SX) -> ca.SX:
        """Return the step of the duals that goes with a step of the variables."""
        d = self.distances(v)
        return mu / d - z - z / d * self.of_pairs(step)

    def logs(self, v: ca.SX) -> ca.SX:
        """Return -sum(log(d)), d the distances; not finite outside the bounds."""
        total = ca.SX(0)
        for d in ca.vertsplit(self.distances(v)) if self.of else ():
            total -= ca.log(d)
        return total

    def limited(self, v: ca.SX, z: ca.SX, mu: ca.SX) -> ca.SX:
        """Return the duals z, limited to a range around mu / d, d the distances."""
        centre = mu / self.distances(v)
        return ca.fmax(ca.fmin(z, _MOST_DUAL * centre), centre / _MOST_DUAL)


def most_of(d: ca.SX, change: ca.SX, part: ca.SX, most: ca.SX) -> ca.SX:
    """Return the longest step at which numbers lose no more than a part of themselves.

    Args:
        d: The numbers, positive.
        change: Changes of the numbers with a full step.
        part: Largest share of itself that a number may lose.
        most: Upper bound of the step.
    """
    one = ca.SX(1)
    return smallest(
        (
            ca.if_else(c < 0, part * a / ca.if_else(c < 0, -c, one), one)
            for a, c in zip(_entries(d), _entries(change), strict=True)
        ),
        most,
    )


def picked(column: ca.SX, entries: Sequence[int]) -> ca.SX:
    """Return some entries of a column as a column."""
    # With one index CasADi would take the shape of the index for a column of one entry.
    return column[list(entries), 0] if entries else ca.SX(0, 1)


def _entries(column: ca.SX) -> list[ca.SX]:
    return ca.vertsplit(column) if column.numel() else []


class Kinds(NamedTuple):
    """Kinds of rows, known when code is made.

    Attributes:
        equal: Rows whose limits are equal.
        slack: The other rows.
        lower: Rows of `slack` with a lower limit.
        upper: Rows of `slack` with an upper limit.
        less: Rows with an elastic variable p, so that they can fall below a limit.
        more: Rows with an elastic variable n, so that they can exceed a limit.
    """

    equal: list[int]
    slack: list[int]
    lower: list[int]
    upper: list[int]
    less: list[int]
    more: list[int]


def kinds_of(lower: Array, upper: Array) -> Kinds:
    """Return the kinds of rows with these limits."""
    equal = lower == upper
    low, high = (np.isfinite(side) & ~equal for side in (lower, upper))
    columns = equal, ~equal, low, high, equal | low, equal | high
    return Kinds(*(np.flatnonzero(one).tolist() for one in columns))


class Eliminated(NamedTuple):
    """Rows with their slacks and elastic variables eliminated.

    Attributes:
        weight: Weights w of the rows: if a step of state and controls changes a row by
            c, its multiplier after the step is w c plus the force.
        force: w o, the multipliers if state and controls do not move.
    """

    weight: ca.SX
    force: ca.SX


@dataclass(frozen=True, eq=False)
class Walls:
    """The bounds and rows of a part of a problem: an interval, the end or the start.

    The variables v with bounds are, in order: the part's own ones, slacks, elastic
    variables p, elastic variables n.

    Attributes:
        rows: The rows c, a column.
        lower: Lower limits of the rows, widened a little, except in `kinds.equal`.
        upper: Upper limits of the rows, widened in the same way.
        kinds: The kinds of the rows.
        own: Bounds of the part's own variables.
    """

    rows: ca.SX
    lower: ca.SX
    upper: ca.SX
    kinds: Kinds
    own: Pairs

    @property
    def height(self) -> int:
        """Number of rows."""
        return int(self.rows.numel())

    @property
    def inner(self) -> int:
        """Number of slacks and elastic variables."""
        return sum(map(len, (self.kinds.slack, self.kinds.less, self.kinds.more)))

    @cached_property
    def elastic(self) -> list[int]:
        """Indices of the elastic variables in v."""
        first = self.own.size + len(self.kinds.slack)
        return list(range(first, self.own.size + self.inner))

    @cached_property
    def pairs(self) -> Pairs:
        """All bounds."""
        kinds, own = self.kinds, self.own
        place = {row: own.size + i for i, row in enumerate(kinds.slack)}
        low, high = ([place[row] for row in one] for one in (kinds.lower, kinds.upper))
        elastic = self.elastic
        limit = ca.vertcat(
            own.limit,
            picked(self.lower, kinds.lower),
            picked(self.upper, kinds.upper),
            ca.SX.zeros(len(elastic), 1),
        )
        sign = [
            *own.sign,
            *[1.0] * len(low),
            *[-1.0] * len(high),
            *[1.0] * len(elastic),
        ]
        return Pairs(
            [*own.of, *low, *high, *elastic], sign, limit, own.size + self.inner
        )

    def excess(self, v: ca.SX, rows: ca.SX) -> ca.SX:
        """Return c - s + p - n: rows c, slacks s, and elastic variables p and n."""
        found = ca.SX(rows)
        slacks, less, more = self._parts(v)
        for row, s in zip(self.kinds.slack, slacks, strict=True):
            found[row] -= s
        for row in self.kinds.equal:
            found[row] -= self.lower[row]
        for row, p in zip(self.kinds.less, less, strict=True):
            found[row] += p
        for row, n in zip(self.kinds.more, more, strict=True):
            found[row] -= n
        return found

    def _parts(self, v: ca.SX) -> tuple[list[ca.SX], list[ca.SX], list[ca.SX]]:
        """Return slacks, p and n of a column of the variables."""
        entries = _entries(v)[self.own.size :]
        s, p = len(self.kinds.slack), len(self.kinds.less)
        return entries[:s], entries[s : s + p], entries[s + p :]

    def pressure(self, m: ca.SX) -> ca.SX:
        """Return the derivative of m' (-s + p - n) by the variables v with bounds.

        s are slacks, p and n elastic variables, and m multipliers of the rows.
        """
        none = ca.SX.zeros(self.own.size, 1)
        columns = [
            sign * picked(m, rows)
            for sign, rows in (
                (-1, self.kinds.slack), (1, self.kinds.less), (-1, self.kinds.more),
            )
        ]  # fmt: skip
        return ca.vertcat(none, *columns)

    def price(self, rho: ca.SX) -> ca.SX:
        """Return the derivative of the price of broken rows by the variables v."""
        price = ca.SX.zeros(self.own.size + self.inner, 1)
        for i in self.elastic:
            price[i] = rho
        return price

    def eliminated(self, S: ca.SX, slope: ca.SX, excess: ca.SX) -> Eliminated:
        """Eliminate slacks and elastic variables from Newton's step.

        Args:
            S: Of each variable, the sum of z / d over its bounds (z: dual, d: distance
                to the bound), plus delta.
            slope: Gradient of barrier and price by each variable.
            excess: The residuals c - s + p - n of the rows.
        """
        inverse, off = ca.SX.zeros(self.height, 1), ca.SX(excess)
        parts, slopes = self._parts(S), self._parts(slope)
        for sign, rows, one, g in zip(
            (1, -1, 1),
            (self.kinds.slack, self.kinds.less, self.kinds.more),
            parts,
            slopes,
            strict=True,
        ):
            for row, stiff, grad in zip(rows, one, g, strict=True):
                inverse[row] += 1 / stiff
                off[row] += sign * grad / stiff
        weight = 1 / inverse if self.height else inverse
        return Eliminated(weight, weight * off)

    def steps(self, S: ca.SX, slope: ca.SX, m: ca.SX) -> ca.SX:
        """Return the steps of slacks and elastic variables.

        Args:
            S: As in `eliminated`.
            slope: As in `eliminated`.
            m: Multipliers of the rows after the step.
        """
        columns = self._parts(S), self._parts(slope), self._parts(self.pressure(m))
        found = [
            -(g + force) / stiff
            for three in zip(*columns, strict=True)
            for stiff, g, force in zip(*three, strict=True)
        ]
        return ca.vertcat(ca.SX(0, 1), *found)

    def begun(self, rows: ca.SX, mu: ca.SX, rho: ca.SX) -> ca.SX:
        """Return slacks and elastic variables at which no row has an excess."""
        alone = mu / rho
        slacks, less, more = [], [], []
        for row in range(self.height):
            low, high = (
                side[row] if row in known else None
                for side, known in (
                    (self.lower, self.kinds.lower), (self.upper, self.kinds.upper),
                )
            )  # fmt: skip
            # An elastic variable alone takes what is left.
            apart = (0 if high is not None else 1) - (0 if low is not None else 1)
            s = self.lower[row]
            if row in self.kinds.slack:
                s = inside(rows[row], low, high) + apart * alone
                slacks.append(s)
            p, n = _elastic(rows[row] - s, mu, rho)
            has_p, has_n = row in self.kinds.less, row in self.kinds.more
            # Where `alone` is below the rounding of a row, the difference may be 0.
            less += [p if has_n else ca.fmax(s - rows[row], alone)] if has_p else []
            more += [n if has_p else ca.fmax(rows[row] - s, alone)] if has_n else []
        return ca.vertcat(ca.SX(0, 1), *slacks, *less, *more)


def _elastic(r: ca.SX, mu: ca.SX, rho: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return p, n on the central path: n - p = r, mu / p + mu / n = 2 rho."""
    half, size = mu / (2 * rho), ca.fabs(r) / 2
    least = half + half**2 / (ca.sqrt(half**2 + size**2) + size)
    most = least + 2 * size
    return ca.if_else(r > 0, least, most), ca.if_else(r > 0, most, least)


def inside(v: ca.SX, low: ca.SX | None, high: ca.SX | None) -> ca.SX:
    """Return a number moved inside its limits, away from them."""
    width = None if low is None or high is None else high - low

    def margin(limit: ca.SX) -> ca.SX:
        own = PUSHED * ca.fmax(1, ca.fabs(limit))
        return own if width is None else ca.fmin(own, PUSHED * width)

    if low is not None:
        v = ca.fmax(v, low + margin(low))
    if high is not None:
        v = ca.fmin(v, high - margin(high))
    return v


def bounded(size: int, sides: Sequence[tuple[float, Sequence[int], ca.SX]]) -> Pairs:
    """Return the bounds of some entries of a column.

    Args:
        size: Number of entries of the column.
        sides: For lower and upper bounds each: the sign (1 or -1), the entries that
            have such a bound, and a column with the bounds of all entries.
    """
    of = [i for _, entries, _ in sides for i in entries]
    sign = [s for s, entries, _ in sides for _ in entries]
    limits = [limit[i] for _, entries, limit in sides for i in entries]
    return Pairs(of, sign, ca.vertcat(ca.SX(0, 1), *limits), size)
