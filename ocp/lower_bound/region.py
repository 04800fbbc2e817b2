"""The set S of answer.py, which holds every trajectory that may be optimal.

All admissible trajectories are in the tube (tubes/tube.py) and keep the bounds of the
states and the path constraints. The prunings exclude only points through which no
trajectory costs less than the known cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.basis import Box, basis_of, packed, values_of
from swarmstart.ocp.lower_bound.hamiltonian import Margin
from swarmstart.ocp.lower_bound.proving import halved
from swarmstart.ocp.lower_bound.stated.answer import Polynomial, Pruning, Tube
from swarmstart.ocp.lower_bound.stated.statement import Statement
from swarmstart.ocp.lower_bound.tubes import tube_set as tubes
from swarmstart.terminal_set.interval_arithmetic import PADDING, interval_function

Mask = NDArray[np.bool_]
LAST = 5
"""Number of samples for which one more is drawn at the last time."""
PAVING = 3000
"""Approximate number of boxes of a paving."""


@dataclass(frozen=True, eq=False)
class Region:
    """Set S of the points (t, x) that optimal trajectories may pass through.

    Attributes:
        statement: The problem.
        tube: Tube that holds every admissible trajectory.
        filters: Test of each pruning that excludes points from the set.
    """

    statement: Statement
    tube: Tube
    filters: tuple[Filter, ...] = ()

    def pruned(self, pruning: Pruning, known: float) -> Region:
        """Return the part of the set that a pruning leaves."""
        more = Filter(self.statement, pruning, known)
        return Region(self.statement, self.tube, (*self.filters, more))

    def outside(self, lower: Array, upper: Array) -> Mask:
        """Return which boxes certainly have no point of the set, shape (m,).

        Args:
            lower: Lower corners of boxes of (t, x), shape (1 + n, m); further
                coordinates are ignored.
            upper: Upper corners, same shape.
        """
        n = self.statement.n
        lower, upper = lower[: 1 + n], upper[: 1 + n]
        low, high = (limit[:, None] for limit in self.statement.state_box)
        out = ((lower[1:] > high) | (upper[1:] < low)).any(axis=0)
        out |= tubes.outside(self.tube, lower, upper)
        # The slowest tests come last: each sees only the boxes that are left.
        tests = [one.excludes for one in self.filters]
        if self.statement.path:
            tests.insert(0, self._path.broken)
        for test in tests:
            left = np.flatnonzero(~out)
            if left.size:
                out[left] = test(lower[:, left], upper[:, left])
        return out

    def inside(self, points: Array) -> Mask:
        """Return which points are in the set, shape (N,); points: (1 + n, N)."""
        points = points[: 1 + self.statement.n]
        low, high = (limit[:, None] for limit in self.statement.state_box)
        within = ((points[1:] >= low) & (points[1:] <= high)).all(axis=0)
        within &= tubes.inside(self.tube, points)
        tests = [one.keeps for one in self.filters]
        if self.statement.path:
            tests.insert(0, self._path.kept)
        for test in tests:
            left = np.flatnonzero(within)
            if left.size:
                within[left] = test(points[:, left])
        return within

    @cached_property
    def _path(self) -> Rows:
        return Rows(self.statement.path, self.statement.point)

    @cached_property
    def paving(self) -> tuple[Array, Array]:
        """Lower and upper corners of boxes that cover the set, each (1 + n, m).

        There are about PAVING boxes.
        """
        lower, upper = tubes.starting_boxes(self.tube)
        low, high = (limit[:, None] for limit in self.statement.state_box)
        lower[1:], upper[1:] = np.maximum(lower[1:], low), np.minimum(upper[1:], high)
        fits = (lower <= upper).all(axis=0)
        lower, upper = lower[:, fits], upper[:, fits]
        kept = ~self.outside(lower, upper)
        lower, upper = lower[:, kept], upper[:, kept]
        # Boxes may drop out as fast as they are halved, so the rounds are limited.
        for _ in range(12):
            if not 0 < lower.shape[1] < PAVING / 2:
                break
            size = np.maximum(upper.max(axis=1) - lower.min(axis=1), 1e-300)
            # The slabs already cut the time.
            share = (upper - lower) / size[:, None]
            lower, upper = halved(lower, upper, share)
            kept = ~self.outside(lower, upper)
            lower, upper = lower[:, kept], upper[:, kept]
        return lower, upper

    @cached_property
    def box(self) -> Box:
        """The box around the paving."""
        lower, upper = self.paving
        return Box.around(lower.min(axis=1), upper.max(axis=1))

    def sampled(self, rng: np.random.Generator, count: int) -> Array:
        """Return points of the set, (1 + n, <= count), almost uniform in volume."""
        lower, upper = self.paving
        volume = np.prod(np.maximum(upper - lower, 1e-300), axis=0)
        # Small boxes count too: early times have little volume but matter much.
        weight = 0.7 * volume / volume.sum() + 0.3 / volume.size
        chosen = rng.choice(volume.size, size=count, p=weight)
        low, high = lower[:, chosen], upper[:, chosen]
        # One coordinate in six lies at an end of its box.
        part = np.clip(1.2 * rng.random(low.shape) - 0.1, 0.0, 1.0)
        points = low + part * (high - low)
        # A polynomial fails first at the ends of the set, above all at the last time.
        last = np.flatnonzero(upper[0] >= upper[0].max())
        chosen = rng.choice(last, size=count // LAST)
        part = rng.random((len(lower), chosen.size))
        part[0] = 1.0
        at_end = lower[:, chosen] + part * (upper - lower)[:, chosen]
        points = np.hstack([points, at_end])
        return points[:, self.inside(points)]

    def end_boxes(self) -> tuple[Array, Array]:
        """Return lower and upper corners of boxes that cover the admissible ends."""
        earliest, latest = self.statement.horizon
        lower, upper = self.paving
        reaches = upper[0] >= earliest
        lower, upper = lower[:, reaches].copy(), upper[:, reaches].copy()
        lower[0] = np.maximum(lower[0], earliest)
        if earliest == latest:
            lower[0] = upper[0] = latest
        return self._ends.narrowed(lower, upper)

    @cached_property
    def _ends(self) -> EndSet:
        return EndSet(self.statement)

    def outside_ends(self, lower: Array, upper: Array) -> Mask:
        """Return which boxes certainly have no admissible end."""
        out = self._ends.outside(lower, upper)
        left = np.flatnonzero(~out)
        if left.size:
            out[left] = self.outside(lower[:, left], upper[:, left])
        return out

    def inside_ends(self, points: Array) -> Mask:
        """Return which points are admissible ends, shape (N,); points: (1 + n, N)."""
        within = self._ends.inside(points)
        left = np.flatnonzero(within)
        if left.size:
            within[left] = self.inside(points[:, left])
        return within


class Rows:
    """Expressions that must be at most 0; tested over boxes or at points."""

    def __init__(self, expressions: Sequence[ca.SX], point: ca.SX) -> None:
        """Compile the expressions, at least one."""
        self.column = ca.densify(ca.vertcat(*expressions))
        self._function = ca.Function("rows", [point], [self.column])
        self._intervals = interval_function(self._function)

    def broken(self, lower: Array, upper: Array) -> Mask:
        """Return which boxes have a row that is certainly above 0 everywhere, (m,)."""
        least, _ = self._intervals(lower, upper)
        return np.asarray((least > 0).any(axis=0))

    def kept(self, points: Array) -> Mask:
        """Return the points at which all rows are at most 0, as a mask (N,)."""
        return np.asarray((np.array(self._function(points)) <= 0).all(axis=0))


class EndSet:
    """End times and states (T, x) that terminal constraints and horizon allow."""

    def __init__(self, statement: Statement) -> None:
        """Compile the constraints."""
        self._statement = statement
        self._rows: Rows | None = None
        self._linear: list[tuple[int, float, float]] = []
        if statement.ends:
            self._rows = Rows(statement.ends, statement.point)
            self._linear = _of_one_coordinate(self._rows.column, statement.point)

    def outside(self, lower: Array, upper: Array) -> Mask:
        """Return which boxes certainly have no point of this set, shape (m,)."""
        earliest, latest = self._statement.horizon
        out = (upper[0] < earliest) | (lower[0] > latest)
        if self._rows is not None:
            out |= self._rows.broken(lower, upper)
        return np.asarray(out)

    def inside(self, points: Array) -> Mask:
        """Return which points are in this set, shape (N,)."""
        earliest, latest = self._statement.horizon
        within = (points[0] >= earliest) & (points[0] <= latest)
        if self._rows is not None:
            within &= self._rows.kept(points)
        return np.asarray(within)

    def narrowed(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Return smaller boxes that lose no point of this set from the given boxes.

        A constraint of a single coordinate, linear in it, cuts a box exactly.
        """
        lower, upper = lower.copy(), upper.copy()
        for axis, slope, constant in self._linear:
            at = -constant / slope
            # The quotient is rounded, and no admissible end may be cut off.
            at_pad = (1 + abs(at)) * PADDING
            if slope > 0:
                upper[axis] = np.minimum(upper[axis], at + at_pad)
            else:
                lower[axis] = np.maximum(lower[axis], at - at_pad)
        fits = (lower <= upper).all(axis=0)
        return lower[:, fits], upper[:, fits]


def _of_one_coordinate(column: ca.SX, point: ca.SX) -> list[tuple[int, float, float]]:
    """Return coordinate, slope and constant of rows linear in a single coordinate."""
    slopes = ca.jacobian(column, point)
    zero = ca.Function("zero", [point], [column])(ca.DM.zeros(point.shape))
    found = []
    for row in range(column.numel()):
        entries = [j for j in range(point.numel()) if slopes.sparsity().has_nz(row, j)]
        if len(entries) == 1 and slopes[row, entries[0]].is_constant():
            slope = float(slopes[row, entries[0]])
            if slope:
                found.append((entries[0], slope, float(zero[row])))
    return found


class Filter:
    """The points of a set that a pruning leaves."""

    def __init__(self, statement: Statement, pruning: Pruning, known: float) -> None:
        """Form the derivatives of the cost through a point."""
        come, go = pruning.come, pruning.go
        self._pruning = pruning
        bases = [basis_of(step.polynomial) for step in (come, go)]
        sizes = [basis.parameters for basis in bases]
        parameters = ca.SX.sym("parameters", sum(sizes) + 3)
        point = statement.point
        C = bases[0].expression(point, parameters[: sizes[0], 0])
        G = bases[1].expression(point, parameters[sizes[0] : sum(sizes), 0])
        least, slope_come, slope_go = ca.vertsplit(parameters[sum(sizes) :, 0])
        latest = statement.horizon[1]
        through = least - C + G - slope_come * point[0] - slope_go * (latest - point[0])
        self._margin = Margin(through, point, parameters)
        start = np.concatenate([[0.0], statement.x0])
        least_start, _ = value_interval(come.polynomial, start)
        end_slack = go.end_slack or 0.0
        numbers = [least_start - end_slack - known, come.slack, go.slack]
        # The rounding of the sum; with a smaller constant a pruning excludes less.
        numbers[0] -= PADDING * (abs(least_start) + abs(end_slack) + abs(known))
        self._parameters = np.concatenate(
            [packed(come.polynomial), packed(go.polynomial), numbers]
        )
        self._latest = latest

    def excludes(self, lower: Array, upper: Array) -> Mask:
        """Return which boxes no trajectory below the known cost can enter, (m,)."""
        return self._margin.bounds(self._parameters, lower, upper).low > 0

    def keeps(self, points: Array) -> Mask:
        """Return which points the pruning leaves, shape (N,); points: (1 + n, N)."""
        C = values_of(self._pruning.come.polynomial, points)
        G = values_of(self._pruning.go.polynomial, points)
        constant, come, go = self._parameters[-3:]
        through = constant - C + G - come * points[0] - go * (self._latest - points[0])
        return np.asarray(through <= 0)


def value_interval(polynomial: Polynomial, point: Array) -> tuple[float, float]:
    """Return bounds of a polynomial's value at a point, rounding included."""
    basis = basis_of(polynomial)
    y = ca.SX.sym("y", basis.variables)
    parameters = ca.SX.sym("parameters", basis.parameters)
    function = ca.Function(
        "value", [ca.vertcat(y, parameters)], [basis.expression(y, parameters)]
    )
    at = np.concatenate([point, packed(polynomial)])[:, None]
    low, high = interval_function(function)(at, at)
    return float(low[0, 0]), float(high[0, 0])
