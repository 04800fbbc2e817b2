"""What the adapters share: counting, penalising, and the best point by our order.

A peer minimises one number, cost + weight * violation, so the order must be a static
penalty. What it finds is noted here, evaluation by evaluation, as our own searches do.
"""

import time
from dataclasses import dataclass

import numpy as np

from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.box import Box
from swarmstart.heuristics.budget import Budget, InvalidBudgetError
from swarmstart.heuristics.minimize import Objective, values_of
from swarmstart.heuristics.order import STATIC_PENALTY, Order, better, merits
from swarmstart.kernel import Array

WORST = 1e300
"""Merit of what is not finite: peers compute with it, so it is finite itself."""


class MissingPeerError(SwarmstartError, ImportError):
    """A library of the extra `peers` is not installed."""

    def __init__(self, library: str) -> None:
        """Say what to install."""
        super().__init__(
            f"{library} is not installed: pip install swarmstart[peers]", name=library
        )


class UnsupportedOrderError(SwarmstartError, ValueError):
    """A peer cannot order individuals as asked."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PeerResult:
    """What a peer found; arrays are read-only.

    Attributes:
        x: Best point, shape (dim,), in the units of the variables.
        cost: Its cost; infinity if no individual was finite.
        violation: Its violation; 0 = feasible.
        evaluations: Individuals evaluated.
        seconds: Wall time in s.
    """

    x: Array
    cost: float
    violation: float
    evaluations: int
    seconds: float


class Evaluator:
    """An objective as a peer sees it: one number for each individual.

    Attributes:
        evaluations: Individuals evaluated so far.
    """

    def __init__(self, objective: Objective, box: Box, order: Order) -> None:
        """Begin to count, and the clock.

        Raises:
            UnsupportedOrderError: If the order is no static penalty.
        """
        if order.rule != STATIC_PENALTY:
            raise UnsupportedOrderError(
                "order must be a static_penalty: this peer minimises one number and "
                "does not know feasibility"
            )
        self.evaluations = 0
        self._objective = objective
        self._order = order.running()
        self._best = (0.5 * (box.lower + box.upper), np.inf, np.inf)
        self._begin = time.perf_counter()

    def __deepcopy__(self, memo: dict[int, object]) -> "Evaluator":
        """Return itself: peers copy their problem, and there is one count."""
        return self

    def merits(self, population: Array) -> Array:
        """Evaluate individuals, shape (dim, size); return cost + weight * violation."""
        population = np.array(population, dtype=np.float64, order="C")
        population.setflags(write=False)
        returned = values_of(self._objective(population), population.shape[1])
        cost, violation = (np.array(values, dtype=np.float64) for values in returned)
        for i in range(cost.size):
            _, best_cost, best_violation = self._best
            if better(self._order, cost[i], violation[i], best_cost, best_violation):
                point = population[:, i].copy()
                self._best = point, float(cost[i]), float(violation[i])
        self.evaluations += cost.size
        values = np.empty(cost.size)
        merits(self._order, cost, violation, values)
        return np.minimum(values, WORST)

    def result(self) -> PeerResult:
        """Return the best point so far."""
        x, cost, violation = self._best
        x.setflags(write=False)
        return PeerResult(
            x=x,
            cost=cost,
            violation=violation,
            evaluations=self.evaluations,
            seconds=time.perf_counter() - self._begin,
        )


def generations_of(budget: Budget, size: int) -> int:
    """Number of generations of a size that fit into a budget, the first included.

    Raises:
        InvalidBudgetError: If the budget is not one of evaluations only, or not one
            generation fits.
    """
    others = (budget.seconds, budget.target, budget.stagnation)
    if budget.evaluations is None or others != (None, None, None):
        raise InvalidBudgetError("a peer's budget is evaluations only", budget)
    if budget.evaluations < size:
        message = f"evaluations must be at least {size}, got {budget.evaluations}"
        raise InvalidBudgetError(message, budget)
    return budget.evaluations // size
