"""How long solvers take to a target, from what their runs had found when.

    ERT(target) = what all runs spent until they reached it, or ended / those that did

so that what failed runs have spent is counted. A history holds the best so far at marks
of what was spent; every budget and every target is a cut made later. A solver's word
counts only as far as its verified answer bears it out: a run has reached a target if
its verified cost has; when, is the first mark of its history that says so, or its end.

Source: Hansen, Auger, Ros, Mersmann, Tusar and Brockhoff (2021), COCO: a platform for
comparing continuous optimizers in a black-box setting, Optimization Methods and
Software 36.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
TARGETS = 51
A_DECADE = 10
"""Marks, as in the histories."""
FEASIBLE = 1e-6
"""A violation up to this counts as none: the tolerance of a problem without one."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Courses:
    """Courses of the runs of one solver.

    Attributes:
        spent: At each mark, not falling, shape (runs, marks).
        cost: The best so far there, not rising, infinite before a feasible one, shape
            (runs, marks).
        ends: What each had spent in all, shape (runs,).
        final: Verified costs; infinite if there is no feasible answer, shape (runs,).
    """

    spent: Array
    cost: Array
    ends: Array
    final: Array

    def first_costs(self) -> Array:
        """Return the first feasible cost of each run that has one, shape (n,)."""
        if not self.cost.size:
            return np.empty(0)
        first = np.isfinite(self.cost).argmax(axis=1)
        costs = np.take_along_axis(self.cost, first[:, None], axis=1)[:, 0]
        known: Array = costs[np.isfinite(costs)]
        return known


def courses_of(
    histories: Sequence[Mapping[str, Any] | None],
    quantity: str,
    *,
    ends: ArrayLike,
    final: ArrayLike,
    tolerance: float = FEASIBLE,
) -> Courses:
    """Return the courses of a solver's runs.

    Args:
        histories: Of each; None: nothing is known before its end.
        quantity: "evaluations" or "seconds".
        ends: What each had spent in all.
        final: Its verified cost; infinite if it is not feasible.
        tolerance: Violation up to which a mark is feasible.
    """
    last, costs = np.asarray(ends, dtype=float), np.asarray(final, dtype=float)
    rows = [_marks(history, quantity, tolerance) for history in histories]
    longest = 1 + max((len(spent) for spent, _ in rows), default=0)
    spent = np.repeat(last[:, None], longest, axis=1)
    cost = np.full((len(rows), longest), np.inf)
    for number, (own, found) in enumerate(rows):
        spent[number, : len(own)] = own
        cost[number, : len(own)] = found
    if rows:
        cost = np.minimum.accumulate(cost, axis=1)
        spent = np.maximum.accumulate(spent, axis=1)
    return Courses(spent=spent, cost=cost, ends=last, final=costs)


def _marks(
    history: Mapping[str, Any] | None, quantity: str, tolerance: float
) -> tuple[Array, Array]:
    """Return what was spent at the marks, and the best feasible cost there."""
    if not history or not history.get(quantity):
        return np.empty(0), np.empty(0)
    columns = [history[name] for name in (quantity, "cost", "violation")]
    marks = list(zip(*columns, strict=False))
    spent, cost, violation = np.array(marks, dtype=np.float64).T  # None becomes NaN.
    good = (violation <= tolerance) & np.isfinite(cost)
    return spent, np.where(good, cost, np.inf)


def reached(courses: Courses, targets: ArrayLike) -> Array:
    """Return what each run had spent when it reached each target; infinite if never.

    Args:
        courses: Of the runs.
        targets: Costs, shape (targets,).

    Returns:
        Shape (runs, targets).
    """
    goals = np.asarray(targets, dtype=np.float64)
    met = courses.cost[:, :, None] <= goals
    at = np.take_along_axis(courses.spent, met.argmax(axis=1), axis=1)
    known = np.where(met.any(axis=1), at, courses.ends[:, None])
    ended: Array = np.where(
        courses.final[:, None] <= goals,
        np.minimum(known, courses.ends[:, None]),
        np.inf,
    )
    return ended


def expected_running_time(
    spent: ArrayLike, ends: ArrayLike, budget: float = np.inf
) -> float | None:
    """Return the expected running time to a target; None if no run has reached it.

    Args:
        spent: When each run reached the target, infinite if never, shape (runs,).
        ends: What each had spent in all, shape (runs,).
        budget: What each is cut at.
    """
    when, last = np.asarray(spent, dtype=float), np.asarray(ends, dtype=float)
    succeeded = when <= budget
    succeeded &= np.isfinite(when)
    total = np.where(succeeded, when, np.minimum(last, budget)).sum()
    return float(total / succeeded.sum()) if succeeded.any() else None


def targets_between(best: float, worst: float, nearest: float) -> Array:
    """Return 51 costs: the distances from the best are in equal ratios.

    Args:
        best: The best known.
        worst: The worst first value of a run.
        nearest: The distance of the first target from the best; above 0.

    Returns:
        Shape (51,), rising; all the same if no first value is as far off as that.
    """
    farthest = max(worst - best, nearest)
    return best + np.geomspace(nearest, farthest, TARGETS)


def marks_up_to(end: float, start: float = 1.0) -> Array:
    """Return marks in equal ratios, ten a decade, from `start` to the end."""
    if not end > start:
        return np.array([end])
    steps = int(np.ceil(A_DECADE * np.log10(end / start)))
    return np.append(start * 10.0 ** (np.arange(steps) / A_DECADE), end)


def shares_reached(spent: Array, marks: Array) -> Array:
    """Return the share of targets that each run had reached at each mark.

    Args:
        spent: As of `reached`, shape (runs, targets).
        marks: Shape (marks,), rising.

    Returns:
        Shape (runs, marks); its mean over the runs is the empirical distribution over
        (seed, target) pairs.
    """
    shares: Array = (spent[:, :, None] <= marks).mean(axis=1)
    return shares


def costs_at(courses: Courses, marks: Array) -> Array:
    """Return the best cost that each run had at each mark, by its own word.

    A run that has ended keeps its verified cost.

    Returns:
        Shape (runs, marks); infinite before a feasible one.
    """
    number = (courses.spent[:, :, None] <= marks).sum(axis=1) - 1
    known = np.take_along_axis(courses.cost, np.maximum(number, 0), axis=1)
    running = np.where(number < 0, np.inf, known)
    ended = marks >= courses.ends[:, None]
    found: Array = np.where(ended, courses.final[:, None], running)
    return found
