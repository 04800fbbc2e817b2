"""The inequalities of a certificate as tasks for branch and bound.

f are the rates of the states, L is the stage cost, phi the terminal cost, and V(t, x)
the polynomial of a step, with the derivatives V_t and V_x. Face k of the tube is
d_k x = s_k(t).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np

from swarmstart.terminal_set.checker.evaluation import (
    Program,
    Value,
    as_model,
    plus,
    times,
)
from swarmstart.terminal_set.checker.lower_bound.certificate_file import Step
from swarmstart.terminal_set.checker.lower_bound.controls import Split
from swarmstart.terminal_set.checker.lower_bound.least import (
    Least,
    Term,
    least_over_controls,
)
from swarmstart.terminal_set.checker.lower_bound.polynomials import Expansion
from swarmstart.terminal_set.checker.lower_bound.regions import Region, Tube
from swarmstart.terminal_set.checker.models import ROUNDING, Array, Model
from swarmstart.terminal_set.checker.search import (
    Boxes,
    Flags,
    Judgement,
    cut_by,
    is_empty,
    judgement,
    lowest,
)


@dataclass(frozen=True, eq=False)
class _Hamiltonian:
    """The least value over the controls of first + sum of weights_i f_i, + L if wanted.

    Attributes:
        split: The problem.
        bounds: Lower and upper bounds of all controls.
        with_stage: Whether L counts.
    """

    split: Split
    bounds: tuple[tuple[float, ...], tuple[float, ...]]
    with_stage: bool

    @cached_property
    def _program(self) -> Program:
        split = self.split
        wanted = list(split.drift)
        wanted += [c for column in split.columns for c in column if c is not None]
        if self.with_stage:
            wanted += [split.stage, *(c for c in split.linear if c is not None)]
        return split.program(wanted)

    def least(
        self, first: Model, weights: Sequence[Value], variables: Sequence[Model]
    ) -> Least:
        """Return bounds of the least value over the controls, on boxes of (t, x).

        The value is `first` + the sum of weights_i f_i, with f the rates of the states;
        the stage cost L is added if `with_stage`.
        """
        split, values = self.split, self._program(variables)
        fixed: Value = first
        for weight, number in zip(weights, split.drift, strict=True):
            fixed = plus(fixed, times(weight, values[number]))
        if self.with_stage:
            fixed = plus(fixed, values[split.stage])
        terms = []
        for place, k in enumerate(split.free):
            factor: Value = Fraction(0)
            for weight, entry in zip(weights, split.columns[place], strict=True):
                if entry is not None:
                    factor = plus(factor, times(weight, values[entry]))
            linear = split.linear[place]
            if self.with_stage and linear is not None:
                factor = plus(factor, values[linear])
            q = split.quadratic[place] if self.with_stage else Fraction(0)
            lower, upper = self.bounds[0][k], self.bounds[1][k]
            terms.append(Term(as_model(factor, first), q, lower, upper))
        return least_over_controls(as_model(fixed, first), terms)


@dataclass(frozen=True, eq=False)
class StepTask:
    """The task V_t + L + V_x f >= -slack over a region, for all controls.

    V(t, x) is the polynomial of a step, L the stage cost, and f the rates of the
    states.

    Attributes:
        step: Step with V and its slack.
        region: The region over which the inequality must hold.
    """

    step: Step
    region: Region

    @cached_property
    def _hamiltonian(self) -> _Hamiltonian:
        bounds = self.region.certificate.problem.control_box
        return _Hamiltonian(self.region.split, bounds, with_stage=True)

    def _least(self, boxes: Boxes) -> Least:
        variables = boxes.variables()
        algebra = variables[0].algebra
        expansion = Expansion(self.step, algebra, boxes.middle, boxes.radius)
        n = self.region.certificate.problem.n
        weights = [expansion.derivative(1 + i) for i in range(n)]
        return self._hamiltonian.least(expansion.derivative(0), weights, variables)

    def cut(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop what is outside of the tube."""
        return self.region.cut(boxes)

    def cut_more(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop what is outside of the region."""
        return self.region.cut_more(boxes)

    def judge(self, boxes: Boxes) -> Judgement:
        """Judge the inequality over boxes."""
        least = self._least(boxes)
        proven = lowest(least.below) >= -self.step.slack
        suspect = least.at.middle < -self.step.slack
        return judgement(
            least.below, boxes, proven=proven, suspect=suspect, extra=least.pull
        )

    def refuted(self, points: Boxes) -> Flags:
        """Return a mask of the points that violate the inequality."""
        found = self._least(points).at.upper < -self.step.slack
        if found.any():
            found &= self.region.holds(points)
        return found

    def shown(self, points: Boxes) -> tuple[float, ...]:
        """Return the first point, (t, x)."""
        return _point(points, self.region)


@dataclass(frozen=True, eq=False)
class EndTask:
    """The task V <= phi + end slack over the admissible ends in a region.

    V(t, x) is the polynomial of a step, and phi the terminal cost.

    Attributes:
        step: Step with V and its end slack.
        region: The region. The caller must begin with a box that is restricted to the
            allowed end times.
    """

    step: Step
    region: Region

    def _excess(self, boxes: Boxes) -> Model:
        """Return phi - V."""
        variables, split = boxes.variables(), self.region.split
        algebra = variables[0].algebra
        expansion = Expansion(self.step, algebra, boxes.middle, boxes.radius)
        end = split.program([split.end])(variables)[split.end]
        return as_model(end, variables[0]) - expansion.value()

    def cut(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop what is outside of the tube."""
        return self.region.cut(boxes)

    def cut_more(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop points that are outside of the region or not admissible ends."""
        return self.region.cut_more(boxes, constraints=self.region.split.ends)

    def judge(self, boxes: Boxes) -> Judgement:
        """Judge the inequality over boxes."""
        excess, slack = self._excess(boxes), self.step.end_slack or 0.0
        proven, suspect = lowest(excess) >= -slack, excess.middle < -slack
        return judgement(excess, boxes, proven=proven, suspect=suspect)

    def refuted(self, points: Boxes) -> Flags:
        """Return a mask of the points that violate the inequality."""
        found = self._excess(points).upper < -(self.step.end_slack or 0.0)
        if found.any():
            found &= self.region.holds(points, constraints=self.region.split.ends)
        return found

    def shown(self, points: Boxes) -> tuple[float, ...]:
        """Return the first point, (t, x)."""
        return _point(points, self.region)


@dataclass(frozen=True, eq=False)
class FaceTask:
    """The task s_k' > d_k f on the face d_k x = s_k(t) of the tube, for all controls.

    f are the rates of the states x. On the face, the state with the largest entry of
    d_k follows from the other states; the boxes have 0 in the place of this state.

    Attributes:
        face: Number k of the face.
        region: The tube, the bounds of the states, the path constraints.
    """

    face: int
    region: Region

    @cached_property
    def _hamiltonian(self) -> _Hamiltonian:
        bounds = self.region.certificate.problem.control_box
        return _Hamiltonian(self.region.split, bounds, with_stage=False)

    @cached_property
    def _pivot(self) -> int:
        return int(np.abs(self.region.tube.directions[self.face]).argmax())

    def roots(self, slabs: Sequence[int]) -> Boxes:
        """Return a box for each interval of times whose number is in `slabs`."""
        one, times = self.region.roots(), self.region.tube.times
        numbers = np.array(slabs, dtype=np.int64)
        lower = np.repeat(one.lower, len(slabs), axis=1)
        upper = np.repeat(one.upper, len(slabs), axis=1)
        lower[0] = times[numbers]
        upper[0] = np.minimum(times[numbers + 1], one.upper[0])
        lower[1 + self._pivot] = upper[1 + self._pivot] = 0.0
        return Boxes(lower, upper, numbers)

    def _slope(self, slab: np.ndarray, tube: Tube, face: int | None = None) -> Array:
        k = self.face if face is None else face
        levels, times = tube.levels[:, k], tube.times
        rise = levels[slab + 1] - levels[slab]
        slope: Array = rise / (times[slab + 1] - times[slab])
        return slope

    def _variables(self, boxes: Boxes, tube: Tube) -> list[Model]:
        """Return the coordinates with x_p = (s_k(t) - sum over others of d x) / d_p."""
        variables, direction = boxes.variables(), tube.directions[self.face]
        level = self._level(variables[0], boxes, tube, self.face)
        for i in np.flatnonzero(direction):
            if i != self._pivot:
                level = level - variables[1 + i].scaled(float(direction[i]))
        # Exact here; `times` allows for its rounding to a float.
        scale = Fraction(1) / Fraction(float(direction[self._pivot]))
        variables[1 + self._pivot] = as_model(times(level, scale), level)
        return variables

    def _level(self, time: Model, boxes: Boxes, tube: Tube, face: int) -> Model:
        """Return s_face(t) within the slabs of the boxes."""
        since = time.shifted(-tube.times[boxes.slab])
        # `scaled` allows for more rounding than the slope itself has.
        level = since.scaled(self._slope(boxes.slab, tube, face))
        return level.shifted(tube.levels[boxes.slab, face])

    def _cut_by_faces(
        self, boxes: Boxes, variables: Sequence[Model]
    ) -> tuple[Boxes, Flags]:
        """Drop points beyond another face, both levels taken at the same time.

        The range of x_p alone is not enough: it does not depend on t and x.
        """
        tube, outside = self.region.tube, np.zeros(boxes.count, dtype=bool)
        smaller = boxes
        for face, direction in enumerate(tube.directions):
            if face == self.face:
                continue
            beyond = -self._level(variables[0], boxes, tube, face)
            for i in np.flatnonzero(direction):
                beyond = beyond + variables[1 + int(i)].scaled(float(direction[i]))
            cut, out = cut_by(boxes, beyond)
            outside |= out
            smaller = Boxes(
                np.maximum(smaller.lower, cut.lower),
                np.minimum(smaller.upper, cut.upper),
                boxes.slab,
            )
        return smaller, outside

    def _least(self, boxes: Boxes, tube: Tube) -> Least:
        """Return s_k' - d_k f, least over the controls."""
        variables = self._variables(boxes, tube)
        slope = self._slope(boxes.slab, tube)
        first = variables[0].algebra.constant(slope, ROUNDING * np.abs(slope))
        weights = [-Fraction(float(entry)) for entry in tube.directions[self.face]]
        return self._hamiltonian.least(first, weights, variables)

    def _placed(self, boxes: Boxes, variables: Sequence[Model]) -> Boxes:
        """Return the boxes with the range of the coordinate that follows."""
        lower, upper = boxes.lower.copy(), boxes.upper.copy()
        model = variables[1 + self._pivot]
        lower[1 + self._pivot], upper[1 + self._pivot] = model.lower, model.upper
        return Boxes(lower, upper, boxes.slab)

    def _taken_back(self, boxes: Boxes) -> Boxes:
        lower, upper = boxes.lower.copy(), boxes.upper.copy()
        lower[1 + self._pivot] = upper[1 + self._pivot] = 0.0
        return Boxes(lower, upper, boxes.slab)

    def cut(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop what is outside of the tube or of the bounds of the states."""
        tube, p = self.region.tube, 1 + self._pivot
        variables = self._variables(boxes, tube)
        boxes, beyond = self._cut_by_faces(boxes, variables)
        beyond |= is_empty(boxes)
        # Empty boxes have no models: they stay unchanged until they are dropped.
        placed = self._placed(boxes, variables)
        root = self.region.roots()
        outside = (placed.lower[p] > root.upper[p]) | (placed.upper[p] < root.lower[p])
        smaller, off = self.region.cut(placed)
        # Only this coordinate, which lies on the face, can become empty by rounding.
        return self._taken_back(smaller), outside | off | beyond

    def cut_more(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop what breaks a path constraint."""
        variables = self._variables(boxes, self.region.tube)
        return self.region.cut_more(boxes, variables)

    def judge(self, boxes: Boxes) -> Judgement:
        """Judge the inequality over boxes."""
        least = self._least(boxes, self.region.tube)
        proven, suspect = lowest(least.below) > 0.0, least.at.middle < 0.0
        return judgement(
            least.below, boxes, proven=proven, suspect=suspect, extra=least.pull
        )

    def refuted(self, points: Boxes) -> Flags:
        """Return a mask of the points in the file's tube that break the inequality."""
        stated = self.region.stated
        found = self._least(points, stated).at.upper < 0.0
        if not found.any():
            return found
        variables = self._variables(points, stated)
        placed = self._placed(points, variables)
        p, root = 1 + self._pivot, self.region.roots()
        found &= (placed.lower[p] >= root.lower[p]) & (placed.upper[p] <= root.upper[p])
        held = self.region.holds(placed.points(), variables, but=self.face)
        return found & held

    def shown(self, points: Boxes) -> tuple[float, ...]:
        """Return the first point, (t, x)."""
        variables = self._variables(points, self.region.stated)
        return _point(self._placed(points, variables).points(), self.region)


def _point(points: Boxes, region: Region) -> tuple[float, ...]:
    n = region.certificate.problem.n
    return tuple(map(float, points.lower[: 1 + n, 0]))
