"""How two individuals are ordered by cost and violation.

Static penalty, with the weight w:

    a better than b  <=>  cost_a + w violation_a < cost_b + w violation_b

Feasibility first (Deb 2000), with feasible meaning violation <= tolerance:

    a better than b  <=>  both feasible and cost_a < cost_b,
                          or a feasible and b not,
                          or both infeasible and violation_a < violation_b

An individual whose cost or violation is not finite ranks last under every order.

An `Order` is plain numbers, so that compiled code takes it. A new rule is one more
constant, one function that builds it, and one branch in `better` and in `merits`. An
epsilon level is `feasibility_first` with a tolerance that shrinks during the search.

Source: Deb (2000), An efficient constraint handling method for genetic algorithms,
Computer Methods in Applied Mechanics and Engineering 186.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.kernel import Array, kernel

STATIC_PENALTY = 0
FEASIBILITY_FIRST = 1


class InvalidOrderError(SwarmstartError, ValueError):
    """A parameter of an order is not a finite number of at least 0.

    Attributes:
        name: The parameter.
        value: What was given.
    """

    def __init__(self, name: str, value: float) -> None:
        """Keep name and value beside the message."""
        super().__init__(f"{name} must be finite and at least 0, got {value}")
        self.name = name
        self.value = value


class Order(NamedTuple):
    """How individuals are ordered; built by `static_penalty`, `feasibility_first`.

    Attributes:
        rule: STATIC_PENALTY or FEASIBILITY_FIRST.
        weight: Cost per unit of violation; static penalty only.
        tolerance: Largest violation of a feasible individual; feasibility first only.
    """

    rule: int
    weight: float
    tolerance: float


def static_penalty(weight: float) -> Order:
    """Order by cost + weight * violation.

    Args:
        weight: Cost per unit of violation, at least 0.

    Returns:
        The order.

    Raises:
        InvalidOrderError: If the weight is negative or not finite.
    """
    _require_nonnegative("weight", weight)
    return Order(rule=STATIC_PENALTY, weight=float(weight), tolerance=0.0)


def feasibility_first(tolerance: float = 0.0) -> Order:
    """Order feasible before infeasible, the former by cost, the latter by violation.

    Args:
        tolerance: Largest violation that counts as feasible, at least 0.

    Returns:
        The order.

    Raises:
        InvalidOrderError: If the tolerance is negative or not finite.

    Source: Deb (2000).
    """
    _require_nonnegative("tolerance", tolerance)
    return Order(rule=FEASIBILITY_FIRST, weight=0.0, tolerance=float(tolerance))


@kernel
def better(
    order: Order,
    cost_a: float,
    violation_a: float,
    cost_b: float,
    violation_b: float,
) -> bool:
    """Whether individual a is strictly better than individual b.

    Args:
        order: The order.
        cost_a: Cost of a.
        violation_a: Violation of a, at least 0.
        cost_b: Cost of b.
        violation_b: Violation of b, at least 0.

    Returns:
        True if a is strictly better; False on a tie.
    """
    if not is_finite(cost_a, violation_a):
        return False
    if not is_finite(cost_b, violation_b):
        return True
    if order.rule == STATIC_PENALTY:
        penalised_a = cost_a + order.weight * violation_a
        return penalised_a < cost_b + order.weight * violation_b
    feasible_a = violation_a <= order.tolerance
    feasible_b = violation_b <= order.tolerance
    if feasible_a and feasible_b:
        return cost_a < cost_b
    if feasible_a or feasible_b:
        return feasible_a
    return violation_a < violation_b


@kernel
def merits(order: Order, cost: Array, violation: Array, out: Array) -> None:
    """One number for each individual of a population; the smaller, the better.

    Static penalty: cost + weight * violation. Feasibility first: the cost of a feasible
    individual; the worst feasible cost (0 if there is none) + violation of an
    infeasible one. Not finite: infinity. Individuals that `better` tells apart may tie
    by rounding; they never change places.

    Args:
        order: The order.
        cost: Costs, shape (size,).
        violation: Violations, shape (size,).
        out: Filled with the merits, shape (size,).

    Source: Deb (2000).
    """
    worst = worst_feasible_cost(order, cost, violation)
    for i in range(cost.size):
        if not is_finite(cost[i], violation[i]):
            out[i] = np.inf
        elif order.rule == STATIC_PENALTY:
            out[i] = cost[i] + order.weight * violation[i]
        elif violation[i] <= order.tolerance:
            out[i] = cost[i]
        else:
            out[i] = worst + violation[i]


@kernel
def worst_feasible_cost(order: Order, cost: Array, violation: Array) -> float:
    """The largest finite cost with violation <= tolerance; 0 if there is none."""
    worst = -np.inf
    for i in range(cost.size):
        if is_finite(cost[i], violation[i]) and violation[i] <= order.tolerance:
            worst = max(worst, cost[i])
    return worst if worst > -np.inf else 0.0


@kernel
def is_finite(cost: float, violation: float) -> bool:
    """Whether both numbers are finite."""
    return math.isfinite(cost) and math.isfinite(violation)


def _require_nonnegative(name: str, value: float) -> None:
    if not 0.0 <= value < math.inf:
        raise InvalidOrderError(name, value)
