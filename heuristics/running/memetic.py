"""A population search whose best distinct members are improved by local solves.

Local solves run between generations, whenever all of them have used less than their
share of the evaluations so far. They start from the best distinct basins that were not
improved yet (`archive`). Their results take the places of as many individuals of the
next generation, are evaluated like all individuals, and survive by the same selection.
So the population receives local optima, and searches between and beyond them.

The budget also pays for the local solves: each reports its cost in evaluations.

Source: Moscato (1989), On evolution, search, optimization, genetic algorithms and
martial arts: towards memetic algorithms, Caltech C3P report 826; Hart (1994), Adaptive
global optimization with local search (which members to improve, and how often).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics.running.budget import Budget, budget_of
from swarmstart.heuristics.running.interrupts import heeded
from swarmstart.heuristics.running.minimize import (
    Objective,
    Running,
    require_one_generation,
    until_stopped,
)
from swarmstart.heuristics.running.result import SearchResult, StopReason
from swarmstart.heuristics.running.search import Individual, Search
from swarmstart.machine_code import Stopwatch

GENERATIONS = 10
"""Generations between two checks whether local solves are due; fixed, so that one seed
gives one answer."""


class Improved(NamedTuple):
    """The points that local solves returned.

    Attributes:
        points: Points in the box as columns, shape (dim, k), with any k.
        evaluations: Cost of finding them, in evaluations.
    """

    points: Array
    evaluations: int


Improve = Callable[[Array], Improved]
"""Members, shape (dim, k) -> better points."""


@dataclass(frozen=True, kw_only=True, slots=True)
class LocalSolves:
    """Local solves, with limits of their number and cost.

    Attributes:
        improve: Function that improves members: points, shape (dim, k) -> `Improved`.
        each: Expected cost of a local solve before any has run, in evaluations.
        members: Largest number of members improved at a time.
        share: Fraction of all evaluations that local solves may use, in (0, 1).
    """

    improve: Improve
    each: float
    members: int
    share: float


def run_memetic(
    search: Search,
    objective: Objective,
    local: LocalSolves,
    *,
    budget: Budget | int,
    on_advance: Callable[[int], None] | None = None,
    on_best: Callable[[int, Callable[[], Individual]], None] | None = None,
) -> SearchResult:
    """Run a search and local solves until the budget of both is used up.

    Args:
        search: A new search that keeps basins, from which the members are chosen.
        objective: As in `minimize`.
        local: The function that improves members, and its limits.
        budget: Budget of both. A local solve that has begun is not cut short.
        on_advance: As in `minimize`.
        on_best: As in `minimize`.

    Returns:
        The best point found; its evaluations count the local solves.

    Raises:
        InvalidBudgetError: If the budget is too small for one generation.
        InvalidPointsError: If an improved point is not in the box.
        SearchInterrupted: On Ctrl-C, once a generation is finished.
    """
    budget = budget_of(budget)
    require_one_generation(search, budget)
    running = Running(search, objective, budget, None, chunk=GENERATIONS)
    members = _Members(search, local)

    def advance(watch: Stopwatch) -> StopReason | None:
        suggested = members.improved(running, budget)
        return running(watch.seconds, suggested)

    return until_stopped(search, running, advance, on_advance, on_best)


@dataclass(kw_only=True, slots=True)
class _Known:
    """Improved members, their results and their cost."""

    points: list[Array] = field(default_factory=list)
    solves: int = 0


class _Members:
    """The members of a search that are not improved yet."""

    def __init__(self, search: Search, local: LocalSolves) -> None:
        self._search, self._local, self._known = search, local, _Known()

    def improved(self, running: Running, budget: Budget) -> Array | None:
        """Run local solves if they are due; return the points found, or None."""
        local, known, spent = self._local, self._known, running.spent
        if not self._search.generations:  # No member is known yet.
            return None
        if spent > local.share * (self._search.evaluations + spent):
            return None
        # The mean of those so far, as soon as there is one.
        each = spent / known.solves if known.solves else local.each
        count = local.members
        if budget.evaluations is not None:
            left = local.share * budget.evaluations - spent
            count = min(count, int(left / max(each, 1.0)))
        fresh = [x for x in (one.x for one in self._search.basins) if self._is_new(x)]
        chosen = fresh[: max(count, 0)]
        if not chosen:
            return None
        with heeded():
            found = local.improve(np.stack(chosen, axis=1))
        running.spent += found.evaluations
        known.solves += len(chosen)
        # A solve from a point that was found would not leave it.
        known.points += [*chosen, *found.points.T]
        return found.points if found.points.shape[1] else None

    def _is_new(self, x: Array) -> bool:
        return not any(np.array_equal(x, other) for other in self._known.points)
