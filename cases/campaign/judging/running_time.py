"""Expected running time of solvers to a target, from the histories of their runs.

    ERT(target) = effort of all runs until they reach the target or end
                  / number of runs that reach it

so that the effort of failed runs counts. A history has the best answer so far at marks
of the effort, so that any budget and any target can be chosen afterwards. A solver's
own values count only if its verified answer supports them: a run has reached a target
if its verified cost has reached it. The effort counted is that of the first mark at
which the run's history has reached the target, too; if there is no such mark, it is
that of the whole run.

Source: Hansen, Auger, Ros, Mersmann, Tusar and Brockhoff (2021), COCO: a platform for
comparing continuous optimizers in a black-box setting, Optimization Methods and
Software 36.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array

TARGETS = 51
A_DECADE = 10
"""Number of marks in a decade, as in the histories."""
FEASIBLE = 1e-6
"""Largest violation of a feasible answer, for a problem without a tolerance."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Courses:
    """Best cost over effort of the runs of one solver.

    Attributes:
        spent: Effort of each run at each mark, not decreasing, shape (runs, marks).
        cost: Best cost so far, not increasing, infinite before a feasible answer, shape
            (runs, marks).
        ends: Total effort of each run, shape (runs,).
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
        # Runs without a feasible cost give 0 here, and are dropped below.
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
        histories: History of each run; None if nothing is known before its end.
        quantity: "evaluations" or "seconds".
        ends: Total effort of each run.
        final: Verified cost of each run; infinite if infeasible.
        tolerance: Violation up to which a mark is feasible.
    """
    last, costs = np.asarray(ends, dtype=float), np.asarray(final, dtype=float)
    rows = [_marks(history, quantity, tolerance) for history in histories]
    # One mark more than the longest history has: the end of the run.
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
    """Return the effort at the marks, and the best feasible cost there."""
    if not history or not history.get(quantity):
        return np.empty(0), np.empty(0)
    columns = [history[name] for name in (quantity, "cost", "violation")]
    marks = list(zip(*columns, strict=False))
    spent, cost, violation = np.array(marks, dtype=np.float64).T  # None becomes NaN.
    good = (violation <= tolerance) & np.isfinite(cost)
    return spent, np.where(good, cost, np.inf)


def reached(courses: Courses, targets: ArrayLike) -> Array:
    """Return the effort of each run to reach each target; infinite if never.

    Args:
        courses: Courses of the runs.
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
        spent: Effort of each run to reach the target, infinite if never, shape (runs,).
        ends: Total effort of each run, shape (runs,).
        budget: Effort after which each run is taken as ended.
    """
    when, last = np.asarray(spent, dtype=float), np.asarray(ends, dtype=float)
    succeeded = when <= budget
    # Without a budget, "never" would be within it.
    succeeded &= np.isfinite(when)
    total = np.where(succeeded, when, np.minimum(last, budget)).sum()
    return float(total / succeeded.sum()) if succeeded.any() else None


def targets_between(best: float, worst: float, nearest: float) -> Array:
    """Return 51 costs whose distances from the best are in equal ratios.

    Args:
        best: The best known cost.
        worst: The highest of the first feasible costs of the runs.
        nearest: The distance of the first target from `best`; above 0.

    Returns:
        Targets, shape (51,), increasing; all equal if `worst` is not farther than
        `nearest` from `best`.
    """
    farthest = max(worst - best, nearest)
    return best + np.geomspace(nearest, farthest, TARGETS)


def marks_up_to(end: float) -> Array:
    """Return marks of the effort in equal ratios, ten a decade, from 1 to `end`."""
    if not end > 1.0:
        return np.array([end])
    steps = int(np.ceil(A_DECADE * np.log10(end)))
    return np.append(10.0 ** (np.arange(steps) / A_DECADE), end)


def shares_reached(spent: Array, marks: Array) -> Array:
    """Return the share of targets that each run had reached at each mark.

    Args:
        spent: Efforts from `reached`, shape (runs, targets).
        marks: Marks of the effort, shape (marks,), rising.

    Returns:
        Shape (runs, marks); its mean over the runs is the empirical distribution over
        (seed, target) pairs.
    """
    shares: Array = (spent[:, :, None] <= marks).mean(axis=1)
    return shares


def costs_at(courses: Courses, marks: Array) -> Array:
    """Return the best cost that each run reported until each mark.

    After the end of a run its cost is the verified one.

    Returns:
        Costs, shape (runs, marks); infinite before the first feasible answer.
    """
    # -1 before the first mark of the history.
    number = (courses.spent[:, :, None] <= marks).sum(axis=1) - 1
    known = np.take_along_axis(courses.cost, np.maximum(number, 0), axis=1)
    running = np.where(number < 0, np.inf, known)
    ended = marks >= courses.ends[:, None]
    found: Array = np.where(ended, courses.final[:, None], running)
    return found
