"""Branch and bound over boxes, in batches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from swarmstart.ocp.lower_bound.checker.boxes import Boxes, Flags, is_empty, joined
from swarmstart.ocp.lower_bound.checker.models import Array
from swarmstart.terminal_set.checker import Deadline

BATCH = 1024  # boxes; few enough that their models stay in the cache


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of a proof.

    Attributes:
        proven: Whether the inequality holds everywhere.
        boxes: Number of boxes it took.
        counterexample: Point (t, x) at which it certainly fails; None if none was
            found.
        remark: Reason why the proof is open; empty otherwise.
    """

    proven: bool
    boxes: int
    counterexample: tuple[float, ...] | None = None
    remark: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Judgement:
    """A batch of boxes, judged.

    Attributes:
        proven: Mask of boxes over which the inequality holds, (N,).
        suspect: Mask of boxes whose middle may be a counterexample, (N,).
        pull: Loss of the bound by variable, shape (d, N).
    """

    proven: Flags
    suspect: Flags
    pull: Array


class Task(Protocol):
    """An inequality over a set."""

    def cut(self, boxes: Boxes) -> tuple[Boxes, Flags]:
        """Drop points outside of the set by a cheap test; return which boxes are."""
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
        """Return the first point, (t, x)."""
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
            if deadline.has_passed:
                return Outcome(False, count, remark="time was up")
            boxes = _filtered(*task.cut(_next_batch(stack)))
            if not boxes.count:
                continue
            count += boxes.count
            judged = task.judge(boxes)
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
    wanted = np.where(np.isfinite(pull), pull, boxes.upper - boxes.lower)
    unknown = ~np.isfinite(pull).all(axis=0)
    wanted = np.where(unknown, boxes.upper - boxes.lower, wanted)
    halves, _ = boxes.halves(np.where(apart, wanted, -1.0).argmax(axis=0))
    return halves, None
