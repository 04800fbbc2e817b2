"""The set of trajectories that may be cheaper than the known cost, and what limits it.

The limits are the tube, the bounds of the states, the constraints and the prunings. The
tube of the file is { x : d_k x <= s_k(t) }, with s_k linear between the times.

On each face, d_k f < s_k' must hold for the rates f; then no admissible trajectory
leaves the tube. For a proof, take the last time up to which a trajectory stayed inside.
A face that it touches at this time has d_k f < s_k' there for all controls. As f is
continuous and the controls' box is compact, the inequality also holds for some time
after, in which the trajectory does not cross the face. The inequality is strict: if a
face rises just as fast as the fastest trajectory, the check stays open, since rounding
cannot decide it. A face with s_k >= the largest d_k x over the bounds of the states is
not crossed by an admissible trajectory, for any f.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from swarmstart.terminal_set.checker.evaluation import (
    as_model,
    rounded,
)
from swarmstart.terminal_set.checker.lower_bound.certificate_file import (
    Certificate,
    Step,
)
from swarmstart.terminal_set.checker.lower_bound.controls import Split
from swarmstart.terminal_set.checker.lower_bound.polynomials import (
    Expansion,
    exact_value,
)
from swarmstart.terminal_set.checker.models import (
    ROUNDING,
    TINY,
    Array,
    Model,
)
from swarmstart.terminal_set.checker.search import Boxes, Flags, cut_by, is_empty


@dataclass(frozen=True, eq=False)
class Tube:
    """A polytope that moves: d_k x <= s_k(t) for each of its faces k.

    Attributes:
        directions: Directions d_k of the faces, shape (K, n).
        times: Times at which the levels are given, shape (M + 1,).
        levels: Levels s_k at these times, shape (M + 1, K).
    """

    directions: Array
    times: Array
    levels: Array

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.directions.shape[1])

    @cached_property
    def _largest(self) -> list[Array]:
        """Largest levels of 2^l times from the i-th on, for each l."""
        table = [self.levels]
        while 2 ** len(table) <= len(self.times):
            step = 2 ** (len(table) - 1)
            table.append(np.maximum(table[-1][:-step], table[-1][step:]))
        return table

    def level_at(self, t: Array) -> tuple[Array, Array]:
        """Return the levels at N times, and bounds of their rounding, each (K, N)."""
        last = len(self.times) - 2
        i = np.clip(np.searchsorted(self.times, t, side="right") - 1, 0, last)
        before, after = self.times[i], self.times[i + 1]
        share = np.clip((t - before) / (after - before), 0.0, 1.0)
        low, high = self.levels[i].T, self.levels[i + 1].T
        level = low + (high - low) * share
        return level, ROUNDING * (np.abs(low) + np.abs(high)) + TINY

    def highest(self, start: Array, stop: Array) -> Array:
        """Return upper bounds of the levels between times, shape (K, N)."""
        first, rounding = self.level_at(start)
        last, its = self.level_at(stop)
        most = np.maximum(first + rounding, last + its)
        i = np.searchsorted(self.times, start, side="right")
        j = np.searchsorted(self.times, stop, side="left")  # i, ..., j - 1 lie between
        # Two runs of 2^power times, which may overlap, hold i, ..., j - 1.
        for power, table in enumerate(self._largest):
            which = np.flatnonzero((j - i >= 2**power) & (j - i < 2 ** (power + 1)))
            if which.size:
                a, b = table[i[which]], table[j[which] - 2**power]
                most[:, which] = np.maximum(most[:, which], np.maximum(a, b).T)
        return most

    def cut(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop what is outside of the tube.

        Returns:
            Smaller boxes; a mask of the boxes that lie outside altogether.
        """
        n = self.n
        most = self.highest(boxes.lower[0], boxes.upper[0])
        lower, upper = boxes.lower.copy(), boxes.upper.copy()
        up, dn = np.maximum(self.directions, 0.0), np.minimum(self.directions, 0.0)
        x = slice(1, 1 + n)
        least = up @ lower[x] + dn @ upper[x]
        size = np.abs(self.directions) @ np.maximum(np.abs(lower[x]), np.abs(upper[x]))
        # More than all roundings, also of the new ends: each is a part of `size`.
        reserve = ROUNDING * (size + np.abs(most)) + TINY
        room = most - least + reserve  # of d_k x, above its least value
        outside = np.asarray((room < 0.0).any(axis=0), dtype=np.bool_)
        for k, direction in enumerate(self.directions):
            for i in np.flatnonzero(direction):
                reach, a = room[k] / direction[i], 1 + i
                if direction[i] > 0.0:
                    upper[a] = np.fmin(upper[a], boxes.lower[a] + reach)
                else:
                    lower[a] = np.fmax(lower[a], boxes.upper[a] + reach)
        return Boxes(lower, upper, boxes.slab), outside

    def holds(self, boxes: Boxes, *, but: int | None = None) -> Flags:
        """Return which points are certainly inside the tube.

        Args:
            boxes: Boxes without width.
            but: Number of a face that is ignored.
        """
        x = boxes.lower[1 : 1 + self.n]
        level, rounding = self.level_at(boxes.lower[0])
        rounding += ROUNDING * (np.abs(self.directions) @ np.abs(x)) + TINY
        inside = self.directions @ x + rounding <= level
        if but is not None:
            inside[but] = True
        return np.asarray(inside.all(axis=0), dtype=np.bool_)

    def holds_exactly(self, x: tuple[float, ...]) -> int | None:
        """Return the number of a face beyond which x lies at time 0, without rounding.

        None if x lies in the tube at time 0.
        """
        for k, direction in enumerate(self.directions):
            pairs = zip(direction, x, strict=True)
            value = Fraction()
            for entry, state in pairs:
                value += Fraction(float(entry)) * Fraction(state)
            if value > Fraction(float(self.levels[0, k])):
                return k
        return None


def stated_tube(certificate: Certificate) -> Tube:
    """Return the tube of the file."""
    return Tube(
        directions=np.array(certificate.directions),
        times=np.array(certificate.times),
        levels=np.array(certificate.levels),
    )


def is_cut_off(
    direction: Array, levels: tuple[float, float], certificate: Certificate
) -> bool:
    """Return whether the bounds of the states alone imply d x <= levels.

    Args:
        direction: d, shape (n,).
        levels: Levels at the beginning and at the end of an interval of times.
        certificate: Certificate with the bounds.
    """
    lower, upper = certificate.problem.state_box
    most = Fraction()
    for entry, low, high in zip(direction, lower, upper, strict=True):
        end = high if entry > 0.0 else low
        if entry and end is None:
            return False
        if entry and end is not None:
            most += Fraction(float(entry)) * Fraction(end)
    return most <= Fraction(float(min(levels)))


@dataclass(frozen=True, slots=True, eq=False)
class Pruned:
    """The condition of a pruning, which removes the points (t, x) that violate it.

    With the `Step` C for the cost from the start to (t, x), and the `Step` G for the
    cost from there to the end, the condition is

        C(0, x0) - C + G - slack_C t - slack_G (latest - t) - end slack - known <= 0

    with the slacks of the two steps, the latest end time and the known cost.

    Attributes:
        come: Step with C.
        go: Step with G.
        constant: All terms that depend on neither t nor x.
        slope: slack_G - slack_C.
    """

    come: Step
    go: Step
    constant: Fraction
    slope: Fraction

    def excess(self, variables: Sequence[Model], boxes: Boxes) -> Model:
        """Return the left side of the condition over boxes."""
        middle, radius = boxes.middle, boxes.radius
        algebra = variables[0].algebra
        come = Expansion(self.come, algebra, middle, radius).value()
        go = Expansion(self.go, algebra, middle, radius).value()
        losses = variables[0].scaled(*rounded(self.slope))
        return (go - come + losses).shifted(*rounded(self.constant))


def pruned_by(certificate: Certificate, come: Step, go: Step) -> Pruned:
    """Return the condition of one pruning.

    Args:
        certificate: Certificate with x0, the horizon and the known cost.
        come: Step with C.
        go: Step with G, which has an end slack.
    """
    problem = certificate.problem
    start = exact_value(come, (0.0, *problem.x0))
    latest = Fraction(problem.horizon[1])
    # The reader refuses a file with prunings that has no known cost.
    known = Fraction(certificate.known if certificate.known is not None else math.nan)
    lost = Fraction(go.slack) * latest + Fraction(go.end_slack or 0.0)
    return Pruned(
        come, go, start - lost - known, Fraction(go.slack) - Fraction(come.slack)
    )


@dataclass(frozen=True, eq=False)
class Region:
    """Points (t, x) of admissible trajectories that are cheaper than the known cost.

    Attributes:
        certificate: Certificate with the bounds and the horizon.
        split: The problem as polynomials in the controls.
        tube: Tube of the file, which is proven to hold admissible trajectories.
        stated: Tube of the file again, in which counterexamples must lie.
        prunings: The proven prunings.
    """

    certificate: Certificate
    split: Split
    tube: Tube
    stated: Tube
    prunings: tuple[Pruned, ...] = ()

    def roots(self, earliest: float = 0.0) -> Boxes:
        """Return one box that holds all points of the region with t >= `earliest`."""
        problem = self.certificate.problem
        # The reader has checked that the first 2n faces are the axes.
        upper = self.tube.levels[:, 0 : 2 * problem.n : 2].max(axis=0)
        lower = -self.tube.levels[:, 1 : 2 * problem.n : 2].max(axis=0)
        for i, (low, high) in enumerate(zip(*problem.state_box, strict=True)):
            lower[i] = lower[i] if low is None else max(lower[i], low)
            upper[i] = upper[i] if high is None else min(upper[i], high)
        boxed = list(self.split.boxed)
        controls = np.array(problem.control_box).reshape(2, -1)[:, boxed]
        lowest = np.concatenate([[earliest], lower, controls[0]])
        highest = np.concatenate([[problem.horizon[1]], upper, controls[1]])
        return Boxes(lowest[:, None], highest[:, None], np.zeros(1, dtype=np.int64))

    def cut(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop what is outside of the tube."""
        return self.tube.cut(boxes)

    def cut_more(
        self,
        boxes: Boxes,
        variables: Sequence[Model] | None = None,
        constraints: Sequence[int] = (),
    ) -> tuple[Boxes, Flags]:
        """Drop points that violate a constraint or cost more than the known cost.

        Args:
            boxes: Boxes of the coordinates.
            variables: Models of the coordinates over the boxes; None means those that
                `boxes.variables()` returns.
            constraints: Indices of further values that must be at most 0.
        """
        used = boxes.variables() if variables is None else variables
        numbers = (*self.split.path, *constraints)
        outside = np.zeros(boxes.count, dtype=bool)
        if not numbers and not self.prunings:
            return boxes, outside
        values = self.split.program(numbers)(used) if boxes.count else {}
        models = [as_model(values[number], used[0]) for number in numbers if values]
        if boxes.count:
            models += [pruning.excess(used, boxes) for pruning in self.prunings]
        smaller = boxes
        for model in models:
            # Each was evaluated over the boxes before cutting; the cuts are combined.
            cut, out = cut_by(boxes, model)
            lower = np.maximum(smaller.lower, cut.lower)
            smaller = Boxes(lower, np.minimum(smaller.upper, cut.upper), boxes.slab)
            outside |= out
        outside |= is_empty(smaller)
        return smaller, outside

    def holds(
        self,
        points: Boxes,
        variables: Sequence[Model] | None = None,
        *,
        constraints: Sequence[int] = (),
        but: int | None = None,
    ) -> Flags:
        """Return which points are certainly in the region, by the file's own tube.

        Args:
            points: Boxes without width, within the bounds of the states.
            variables: Models of the coordinates; None means those that
                `points.variables()` returns.
            constraints: Indices of further values that must be at most 0.
            but: Number of a face of the tube that is ignored.
        """
        used = points.variables() if variables is None else variables
        held = self.stated.holds(points, but=but)
        numbers = (*self.split.path, *constraints)
        values = self.split.program(numbers)(used)
        for number in numbers:
            held &= as_model(values[number], used[0]).upper <= 0.0
        for pruning in self.prunings:
            held &= pruning.excess(used, points).upper <= 0.0
        return held
