"""Criteria for the end of a search, judged by both loops after each generation.

target      the best point is feasible and its cost at most the target
stagnation  a number of generations without a better point; generations in which the
            level of the order was above its tolerance do not count; a constant added to
            the cost changes nothing
"""

from typing import NamedTuple

import numpy as np

from swarmstart.heuristics.laws.algorithm import State
from swarmstart.heuristics.laws.order import RunningOrder
from swarmstart.machine_code import kernel

GOES_ON, AT_TARGET, STAGNANT = 0, 1, 2
UNLIMITED = np.iinfo(np.int64).max


class Limits(NamedTuple):
    """Limits of a search, as plain numbers.

    Attributes:
        evaluations: Largest number of individuals.
        target: Cost at which the search ends; minus infinity for none.
        stagnation: Generations without a better point after which it ends; 0 for none.
    """

    evaluations: int
    target: float
    stagnation: int


@kernel
def finished(order: RunningOrder, state: State, limits: Limits) -> int:
    """Return whether and why a search ends now: GOES_ON, AT_TARGET or STAGNANT."""
    feasible = state.best_violation[0] <= order.tolerance
    if feasible and state.best_cost[0] <= limits.target:
        return AT_TARGET
    idle = state.generation[0] - state.improved[0]
    if limits.stagnation > 0 and idle >= limits.stagnation:
        return STAGNANT
    return GOES_ON


@kernel
def progress_of(evaluations: int, size: int, budget: int) -> float:
    """Fraction of the budget used before a generation, in [0, 1].

    It is 0 for the initial population and 1 for the last generation that fits; with
    generations of one size it is iter_k / iter_max of (5.19). If sizes change, the
    remaining generations are assumed to have the present size, so that a growing
    population may end the search before 1.

    Args:
        evaluations: Individuals evaluated so far.
        size: Individuals of the generation.
        budget: Individuals that may be evaluated.
    """
    left = (budget - evaluations) // size
    before_last = evaluations + (left - 1) * size
    return min(evaluations / before_last, 1.0) if before_last > 0 else 0.0
