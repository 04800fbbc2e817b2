"""Branch and bound over boxes, in batches.

The coordinates of a box are the time, the states and some controls (`lower_bound`), or
those of an ellipsoid (`ellipsoid_search.py`).

A box, one column of a batch, holds all points with lower <= y <= upper. Cutting drops
points that are proven to be outside a set {c <= 0}; every bound is moved outwards by
more than its rounding.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swarmstart.terminal_set.checker.findings import (
    Deadline,
    Finding,
    TimeIsUpError,
    Verdict,
)
from swarmstart.terminal_set.checker.models import (
    GROWTH,
    Array,
    Model,
    algebra_of,
    down,
)

Flags = NDArray[np.bool_]

BATCH = 1024  # boxes; few enough that their models stay in the cache


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """A batch of boxes.

    Attributes:
        lower: Lower corners, shape (d, N).
        upper: Upper corners, shape (d, N).
        slab: A number that the task gives to each box, (N,): on faces of a tube the
            number of the interval of times; on an ellipsoid as `DecreaseTask` says.
    """

    lower: Array
    upper: Array
    slab: NDArray[np.int64]

    @property
    def count(self) -> int:
        """Number of boxes."""
        return int(self.lower.shape[1])

    @property
    def middle(self) -> Array:
        """Points near the middles, as floats, shape (d, N)."""
        return np.clip(0.5 * self.lower + 0.5 * self.upper, self.lower, self.upper)

    @property
    def radius(self) -> Array:
        """Distances from the middles to the farther ends, rounded up, shape (d, N)."""
        middle = self.middle
        reach = np.maximum(self.upper - middle, middle - self.lower)
        return np.where(reach > 0.0, np.nextafter(reach, np.inf), 0.0)

    def variables(self) -> list[Model]:
        """Return the coordinates as Taylor models."""
        algebra = algebra_of(len(self.lower))
        middle, radius = self.middle, self.radius
        return [
            algebra.variable(a, middle[a], radius[a]) for a in range(len(self.lower))
        ]

    def points(self) -> Boxes:
        """Return the middles as boxes without width."""
        middle = self.middle
        return Boxes(middle, middle, self.slab)

    def only(self, which: Flags | NDArray[np.int64] | slice) -> Boxes:
        """Return some of the boxes."""
        return Boxes(self.lower[:, which], self.upper[:, which], self.slab[which])

    def halves(self, axes: NDArray[np.int64]) -> Boxes:
        """Return the halves of all boxes; box i is cut along axis axes[i]."""
        each = np.arange(self.count)
        below, above = self.upper.copy(), self.lower.copy()
        below[axes, each] = above[axes, each] = self.middle[axes, each]
        return joined(
            [Boxes(self.lower, below, self.slab), Boxes(above, self.upper, self.slab)]
        )


def joined(batches: list[Boxes]) -> Boxes:
    """Return all boxes of several batches, in order."""
    return Boxes(
        np.concatenate([batch.lower for batch in batches], axis=1),
        np.concatenate([batch.upper for batch in batches], axis=1),
        np.concatenate([batch.slab for batch in batches]),
    )


def is_empty(boxes: Boxes) -> Flags:
    """Return which boxes hold no point, (N,)."""
    return np.asarray((boxes.lower > boxes.upper).any(axis=0), dtype=np.bool_)


@np.errstate(all="ignore")
def cut_by(boxes: Boxes, constraint: Model) -> tuple[Boxes, Flags]:
    """Drop points with c > 0, for a function c enclosed by the model `constraint`.

    With the number c_0 and the slopes g_a of the model of c in its variables s_a in
    [-1, 1], c >= c_0 + sum of g_a s_a - rest over the box; `rest` is a bound of all
    other terms and of the error. So c <= 0 needs, for each a,
    g_a s_a <= rest + sum of |g| - c_0 - |g_a|.

    Returns:
        Smaller boxes; a mask of boxes without any point with c <= 0.
    """
    slopes = constraint.coefficients[1 : 1 + len(boxes.lower)]
    sizes, middle, radius = np.abs(slopes), boxes.middle, boxes.radius
    # The reserve of `spread` is above the roundings up to `at`: a cut that matters has
    # |c_0| <= spread and reach <= 1. One float farther covers that of the last sum.
    at = ((constraint.spread - constraint.middle) / sizes - 1.0) * radius
    last, first = np.nextafter(middle + at, np.inf), np.nextafter(middle - at, -np.inf)
    # Not known is NaN, which `fmin` and `fmax` leave out.
    upper = np.where(slopes > 0.0, np.fmin(boxes.upper, last), boxes.upper)
    lower = np.where(slopes < 0.0, np.fmax(boxes.lower, first), boxes.lower)
    return Boxes(lower, upper, boxes.slab), constraint.lower > 0.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a proof.

    Attributes:
        proven: Whether the inequality holds everywhere.
        boxes: Number of boxes that were examined.
        counterexample: Point (t, x), or state e of an ellipsoid, at which the
            inequality certainly fails; None if none was found.
        remark: Reason why the inequality is neither proven nor refuted; else empty.
    """

    proven: bool
    boxes: int
    counterexample: tuple[float, ...] | None = None
    remark: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """The verdicts on a batch of boxes.

    Attributes:
        proven: Mask of boxes over which the inequality holds, (N,).
        suspect: Mask of boxes whose middle may be a counterexample, (N,).
        pull: Estimate of how much worse the bound is because of the width of the box in
            each variable, shape (d, N); a box is cut along the variable of the largest
            estimate.
    """

    proven: Flags
    suspect: Flags
    pull: Array


def lowest(model: Model) -> Array:
    """Return lower bounds over boxes; terms in s_a and s_a^2 are bounded together.

    Returns:
        Shape (N,); NaN if nothing is known.
    """
    d, c = model.algebra.d, model.coefficients
    total = c[0] - model.error
    others = np.ones(len(c), dtype=bool)
    others[: 1 + d] = False
    for a in range(d):
        place = _square_place(model, a)
        others[place] = False
        g, h = np.abs(c[1 + a]), c[place]
        with np.errstate(all="ignore"):
            inner = -(g * g) / (4.0 * h)
        total = total + np.where(g < 2.0 * h, inner, h - g)
    rest = np.abs(c[others]).sum(axis=0) * GROWTH
    return down(total - rest, model.size, model.error)


def pulls(model: Model) -> Array:
    """Return the variation of a model along each variable, shape (d, N)."""
    sizes = np.abs(model.coefficients)
    weights = model.algebra.monomials.T.astype(np.float64)
    found: Array = weights @ sizes
    return found


def _square_place(model: Model, a: int) -> int:
    exponents = [0] * model.algebra.d
    exponents[a] = 2
    return model.algebra.numbers[tuple(exponents)]


def judgement(
    below: Model,
    boxes: Boxes,
    *,
    proven: Flags,
    suspect: Flags,
    extra: Array | float = 0.0,
) -> Judgement:
    """Return the verdicts on boxes, and estimates of what their widths cost the bound.

    The error of `below`, which belongs to no single variable, is divided among the
    variables in proportion to the widths of the box.

    Args:
        below: The function that is bounded from below.
        boxes: The boxes.
        proven: Boxes over which the inequality holds.
        suspect: Boxes whose middle may be a counterexample.
        extra: Further losses of the bound by variable, shape (d, N).
    """
    width = boxes.upper - boxes.lower
    shares = width / np.maximum(width.sum(axis=0), 1e-300)  # A point has no width.
    return Judgement(proven, suspect, pulls(below) + extra + below.error * shares)


class Task(Protocol):
    """An inequality over a set."""

    def cut(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop points outside of the set by a cheap test; say which boxes are empty."""
        ...

    def cut_more(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop points outside of the set by all tests."""
        ...

    def judge(self, boxes: Boxes) -> Judgement:
        """Judge the inequality over boxes."""
        ...

    def refuted(self, points: Boxes) -> Flags:
        """Return which points certainly lie in the set and violate the inequality."""
        ...

    def shown(self, points: Boxes) -> tuple[float, ...]:
        """Return the first point as reports show it: (t, x), or e of an ellipsoid."""
        ...


def prove(task: Task, roots: Boxes, deadline: Deadline) -> Outcome:
    """Prove an inequality over the points of boxes that are in a set.

    Args:
        task: The inequality and the set.
        roots: Boxes that hold the set.
        deadline: Time at which to stop.

    Returns:
        The outcome: proven, refuted by a point, or open.
    """
    stack, count = [roots], 0
    with np.errstate(all="ignore"):
        while stack:
            left_over = sum(batch.count for batch in stack)
            late = Outcome(False, count, remark=f"{left_over} boxes left in the queue")
            if deadline.has_passed:
                return late
            boxes = _filtered(*task.cut(_next_batch(stack)))
            if not boxes.count:
                continue
            count += boxes.count
            try:
                judged = task.judge(boxes)
            except TimeIsUpError:
                return late
            # The slower cut is made only for boxes that are left.
            left = boxes.only(~judged.proven)
            cut, outside = task.cut_more(left)
            kept = ~(outside | is_empty(cut))
            left = cut.only(kept)
            suspects = left.only(judged.suspect[~judged.proven][kept])
            found = _counterexample(task, suspects)
            if found is not None:
                return Outcome(False, count, found)
            pull = judged.pull[:, ~judged.proven][:, kept]
            halves, stuck = _halved(left, pull)
            if stuck is not None:
                at = ", ".join(f"{value:.6g}" for value in stuck)
                return Outcome(False, count, remark=f"floats end at ({at})")
            stack.append(halves)
    return Outcome(True, count)


def _next_batch(stack: list[Boxes]) -> Boxes:
    # Small batches are joined: a call of NumPy costs as much for one box as for many.
    batches = [stack.pop()]
    while stack and sum(batch.count for batch in batches) < BATCH:
        batches.append(stack.pop())
    boxes = joined(batches)
    if boxes.count > BATCH:
        stack.append(boxes.only(slice(BATCH, None)))
        boxes = boxes.only(slice(BATCH))
    return boxes


def _filtered(boxes: Boxes, outside: Flags) -> Boxes:
    return boxes.only(~(outside | is_empty(boxes)))


def _counterexample(task: Task, suspects: Boxes) -> tuple[float, ...] | None:
    if not suspects.count:
        return None
    points = suspects.points()
    refuted = task.refuted(points)
    if not refuted.any():
        return None
    return task.shown(points.only(np.flatnonzero(refuted)[:1]))


def _halved(boxes: Boxes, pull: Array) -> tuple[Boxes, tuple[float, ...] | None]:
    """Halve each box along its largest pull; return a point if one is too thin."""
    if not boxes.count:
        return boxes, None
    middle = boxes.middle
    apart = (boxes.lower < middle) & (middle < boxes.upper)
    stuck = ~apart.any(axis=0)
    if stuck.any():
        return boxes, tuple(map(float, middle[:, np.flatnonzero(stuck)[0]]))
    # If a loss is not known, the widest side is cut.
    known = np.isfinite(pull).all(axis=0)
    wanted = np.where(known, pull, boxes.upper - boxes.lower)
    return boxes.halves(np.where(apart, wanted, -1.0).argmax(axis=0)), None


def finding_of(outcome: Outcome, text: str, start: float, point: str) -> Finding:
    """Return the finding of a statement that was searched.

    Args:
        outcome: The outcome of the search.
        text: The statement.
        start: Time at which the search began, of `time.monotonic` [s].
        point: Name of a counterexample in the text, such as "e".
    """
    effort = f"{outcome.boxes} boxes, {time.monotonic() - start:.2f} s"
    if outcome.proven:
        return Finding(Verdict.PROVED, f"{text} ({effort})")
    if outcome.counterexample is not None:
        at = ", ".join(f"{entry:.9g}" for entry in outcome.counterexample)
        return Finding(Verdict.REFUSED, f"it is false that {text}: {point} = ({at})")
    return Finding(Verdict.UNDECIDED, f"{text} ({effort}; {outcome.remark})")
