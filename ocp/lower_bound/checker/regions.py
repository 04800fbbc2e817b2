"""The set of the remaining trajectories: tube, bounds, constraints, prunings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from swarmstart.ocp.lower_bound.checker.boxes import Boxes, Flags, cut_by, is_empty
from swarmstart.ocp.lower_bound.checker.certificate_file import Certificate, Step
from swarmstart.ocp.lower_bound.checker.controls import Split
from swarmstart.ocp.lower_bound.checker.evaluation import (
    Program,
    as_model,
    rounded,
)
from swarmstart.ocp.lower_bound.checker.models import Model
from swarmstart.ocp.lower_bound.checker.polynomials import Expansion, exact_value
from swarmstart.ocp.lower_bound.checker.tube import Tube


@dataclass(frozen=True, slots=True, eq=False)
class Pruned:
    """C(0, x0) - C + G - slack_C t - slack_G (latest - t) - end slack - known <= 0.

    Attributes:
        come: C.
        go: G.
        constant: All terms that depend on neither t nor x.
        slope: slack_G - slack_C.
    """

    come: Step
    go: Step
    constant: Fraction
    slope: Fraction

    def excess(self, variables: Sequence[Model], boxes: Boxes) -> Model:
        """Return the left side over boxes."""
        middle, radius = boxes.middle, boxes.radius
        algebra = variables[0].algebra
        come = Expansion(self.come, algebra, middle, radius).value()
        go = Expansion(self.go, algebra, middle, radius).value()
        slope, off = rounded(self.slope)
        time = variables[0]
        losses = time.scaled(slope).widened((time.size + time.error) * off)
        return (go - come + losses).shifted(*rounded(self.constant))


def pruned_by(certificate: Certificate, come: Step, go: Step) -> Pruned:
    """Return the condition of one pruning.

    Args:
        certificate: Certificate with x0, the horizon and the known cost.
        come: C.
        go: G, with an end slack.
    """
    problem = certificate.problem
    start = exact_value(come, (0.0, *problem.x0))
    latest = Fraction(problem.horizon[1])
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
        split: The problem.
        tube: Tube of the file, which is proven to hold admissible trajectories.
        stated: Tube in which counterexamples must lie: the same one.
        prunings: The proven prunings.
    """

    certificate: Certificate
    split: Split
    tube: Tube
    stated: Tube
    prunings: tuple[Pruned, ...] = ()

    def roots(self, earliest: float = 0.0) -> Boxes:
        """Return one box that holds the region from a time on.

        Args:
            earliest: The time.
        """
        problem = self.certificate.problem
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
            boxes: Boxes.
            variables: The coordinates over them; None means those of the boxes.
            constraints: Numbers of further values that are at most 0.
        """
        used = boxes.variables() if variables is None else variables
        numbers = (*self.split.path, *constraints)
        outside = np.zeros(boxes.count, dtype=bool)
        if not numbers and not self.prunings:
            return boxes, outside
        values = Program(self.split.nodes, numbers)(used) if boxes.count else {}
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
            variables: The coordinates; None means those of the boxes.
            constraints: Numbers of further values that must be at most 0.
            but: Number of a face of the tube that is ignored.
        """
        used = points.variables() if variables is None else variables
        held = self.stated.holds(points, but=but)
        numbers = (*self.split.path, *constraints)
        values = Program(self.split.nodes, numbers)(used)
        for number in numbers:
            held &= as_model(values[number], used[0]).upper <= 0.0
        for pruning in self.prunings:
            held &= pruning.excess(used, points).upper <= 0.0
        return held
