"""Orders of individuals by cost and violation.

Static penalty, with the weight w:

    a better than b  <=>  cost_a + w violation_a < cost_b + w violation_b

Feasibility first (Deb 2000), with feasible meaning violation <= tolerance:

    a better than b  <=>  both feasible and cost_a < cost_b,
                          or a feasible and b not,
                          or both infeasible and violation_a < violation_b

Epsilon level (Takahama and Sakai 2006): feasibility first, with a tolerance that
shrinks to the final one during the search. With v_0 the quantile q of the violations of
the initial population, p the fraction of the budget used, and settings p_c and c,

    epsilon = max(tolerance, v_0 (1 - p / p_c)^c)   for p < p_c,  tolerance after

As published, the level depends on the budget alone. On problems whose feasible points
are easily found, the population then spends most of the budget on a relaxed problem
whose optimum is infeasible. Here the level is also at most the quantile q of the
violations v_g of the last generation evaluated:

    epsilon = max(tolerance, min(v_0 (1 - p / p_c)^c, quantile_q(v_g)))

The effect of this change is measured in docs/measured/orders.md.

An individual whose cost or violation is not finite ranks last under every order.

An `Order` is plain numbers; a search adds the level it has reached. To add a rule, add
a constant, a function that builds it, and a branch in `better` and in `merits`.

Source: Deb (2000), An efficient constraint handling method for genetic algorithms,
Computer Methods in Applied Mechanics and Engineering 186; Takahama and Sakai (2006),
Constrained optimization by the epsilon constrained differential evolution with
gradient-based mutation and feasible elites, IEEE Congress on Evolutionary Computation.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmstart.arguments import FLAG, a_number, checked
from swarmstart.arrays import Array
from swarmstart.errors import InvalidArgumentError
from swarmstart.machine_code import Count, kernel

STATIC_PENALTY = 0
FEASIBILITY_FIRST = 1
EPSILON_LEVEL = 2


class InvalidOrderError(InvalidArgumentError):
    """A parameter of an order is out of its range."""


class Order(NamedTuple):
    """An order of individuals.

    Built by `static_penalty`, `feasibility_first` or `epsilon_level`.

    Attributes:
        rule: STATIC_PENALTY, FEASIBILITY_FIRST or EPSILON_LEVEL.
        weight: Cost per unit of violation; static penalty only.
        tolerance: Largest violation of a feasible individual.
        quantile: Fraction q of a generation whose violations are below the level.
        control: Fraction p_c of the budget, after which the level is the tolerance.
        power: The level's exponent c.
        adaptive: Whether the level follows the violations of the generations.
    """

    rule: int
    weight: float
    tolerance: float
    quantile: float = 0.0
    control: float = 1.0
    power: float = 1.0
    adaptive: bool = False

    def running(self) -> "RunningOrder":
        """Return the order with a level, as it is at the beginning of a search."""
        return RunningOrder(*self, level=np.array([self.tolerance, 0.0]))


class RunningOrder(NamedTuple):
    """An order as kernels take it: the fields of `Order`, and the level reached.

    Attributes:
        level: The largest violation that counts as feasible now, and v_0, from which
            the level falls, shape (2,).
    """

    rule: int
    weight: float
    tolerance: float
    quantile: float
    control: float
    power: float
    adaptive: bool
    level: Array


@checked(InvalidOrderError, weight=a_number(least=0))
def static_penalty(weight: float) -> Order:
    """Order by cost + weight * violation.

    Args:
        weight: Cost per unit of violation, at least 0.

    Returns:
        The order.

    Raises:
        InvalidOrderError: If the weight is negative or not finite.

    Example:
        A weight that is too small gives an infeasible answer, here 0.5 for 1:

        >>> import numpy as np
        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x[0] ** 2, np.maximum(1 - x[0], 0)),  # x >= 1
        ...     bounds=[(-2, 2)],
        ...     budget=2000,
        ...     order=ss.static_penalty(1.0),
        ...     seed=0,
        ... )
        >>> found.x.round(6).tolist()
        [0.5]
    """
    return Order(rule=STATIC_PENALTY, weight=float(weight), tolerance=0.0)


@checked(InvalidOrderError, tolerance=a_number(least=0))
def feasibility_first(tolerance: float = 0.0) -> Order:
    """Order feasible individuals by cost, and after them infeasible ones by violation.

    Args:
        tolerance: Largest violation that counts as feasible, at least 0.

    Returns:
        The order.

    Raises:
        InvalidOrderError: If the tolerance is negative or not finite.

    Source: Deb (2000).

    Example:
        >>> import numpy as np
        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x[0] ** 2, np.maximum(1 - x[0], 0)),  # x >= 1
        ...     bounds=[(-2, 2)],
        ...     budget=2000,
        ...     order=ss.feasibility_first(),
        ...     seed=0,
        ... )
        >>> found.x.round(6).tolist(), found.violation
        ([1.0], 0.0)
    """
    return Order(rule=FEASIBILITY_FIRST, weight=0.0, tolerance=float(tolerance))


@checked(
    InvalidOrderError,
    tolerance=a_number(least=0),
    quantile=a_number(least=0, most=1),
    control=a_number(above=0, most=1),
    power=a_number(least=0),
    adaptive=FLAG,
)
def epsilon_level(
    tolerance: float = 0.0,
    *,
    quantile: float = 0.1,
    control: float = 0.8,
    power: float = 5.0,
    adaptive: bool = True,
) -> Order:
    """Order feasibility first, with a tolerance that shrinks during the search.

    It differs from `feasibility_first` if few points of the first population are
    feasible, for example with equality constraints. In this case the fraction of the
    budget used influences which of two points is better. The result of a search is the
    best point by the final tolerance.

    Args:
        tolerance: Largest violation that counts as feasible in the end, at least 0.
        quantile: Fraction q of the initial population (if adaptive, of every
            generation) whose violation is below the level, in [0, 1]; the paper has
            0.2.
        control: Fraction of the budget after which the level is the tolerance, in
            (0, 1].
        power: Exponent c of the level, at least 0: the larger it is, the faster the
            level falls.
        adaptive: Whether the level is at most the quantile of the last generation. If
            False, it depends on the budget alone, as published.

    Returns:
        The order.

    Raises:
        InvalidOrderError: If a number is out of its range.

    Source: Takahama and Sakai (2006).

    Example:
        An equality constraint, met to 1e-4 in the end:

        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x[0] + x[1], abs(x[0] ** 2 + x[1] ** 2 - 2)),
        ...     bounds=[(-2, 2)] * 2,
        ...     budget=20_000,
        ...     order=ss.epsilon_level(1e-4),
        ...     seed=0,
        ... )
        >>> round(found.cost, 2), found.violation <= 1e-4
        (-2.0, True)
    """
    return Order(
        rule=EPSILON_LEVEL,
        weight=0.0,
        tolerance=float(tolerance),
        quantile=float(quantile),
        control=float(control),
        power=float(power),
        adaptive=bool(adaptive),
    )


@kernel
def begin_level(order: RunningOrder, violation: Array) -> None:
    """Set v_0, from which the level falls, by the initial violations, (size,)."""
    level = quantile_of(violation, order.quantile)
    if level < np.inf:  # Else no violation was finite, and the level stays 0.
        order.level[1] = level


@kernel
def set_level(order: RunningOrder, progress: float, violation: Array) -> None:
    """Update the level after a generation with these violations, (size,)."""
    if order.rule != EPSILON_LEVEL:
        return
    left = 1.0 - progress / order.control
    level = order.level[1] * left**order.power if left > 0.0 else 0.0
    if order.adaptive and level > order.tolerance:
        level = min(level, quantile_of(violation, order.quantile))
    order.level[0] = max(order.tolerance, level)


@kernel
def quantile_of(violation: Array, quantile: float) -> float:
    """Return a quantile of the finite violations; infinity if there are none."""
    known, number = np.empty(violation.size), 0
    for i in range(violation.size):
        if math.isfinite(violation[i]):
            known[number] = violation[i]
            number += 1
    return nth_least(known, number, int(quantile * (number - 1))) if number else np.inf


@kernel
def nth_least(values: Array, number: int, n: int) -> float:
    """Return the n-th least (n from 0) of the first `number` entries of a vector.

    The vector is reordered (quickselect; np.sort takes 2 s to compile).
    """
    low, high = 0, number - 1
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if n <= j:
            high = j
        elif n >= i:
            low = i
        else:
            break
    return float(values[n])


@kernel
def better(
    order: RunningOrder,
    cost_a: float,
    violation_a: float,
    cost_b: float,
    violation_b: float,
) -> bool:
    """Return whether individual a is strictly better than b; False on a tie."""
    return better_at(order, order.level[0], cost_a, violation_a, cost_b, violation_b)


@kernel
def better_at(
    order: RunningOrder,
    level: float,
    cost_a: float,
    violation_a: float,
    cost_b: float,
    violation_b: float,
) -> bool:
    """Return whether a is strictly better; violations up to `level` are feasible."""
    rule, weight = order.rule, order.weight
    return precedes(rule, weight, level, cost_a, violation_a, cost_b, violation_b)


@kernel
def precedes(  # noqa: PLR0913, PLR0917 - numbers only: see the docstring
    rule: int,
    weight: float,
    level: float,
    cost_a: float,
    violation_a: float,
    cost_b: float,
    violation_b: float,
) -> bool:
    """Return whether a is strictly better, as `better_at` does, from plain numbers.

    Call it in loops over individuals, in place of `better_at`: a `RunningOrder` holds
    an array, and compiled code would count the references to it at each call, which
    takes longer than the comparison.
    """
    if not is_finite(cost_a, violation_a):
        return False
    if not is_finite(cost_b, violation_b):
        return True
    if rule == STATIC_PENALTY:
        penalised_a = cost_a + weight * violation_a
        return penalised_a < cost_b + weight * violation_b
    feasible_a = violation_a <= level
    feasible_b = violation_b <= level
    if feasible_a and feasible_b:
        return cost_a < cost_b
    if feasible_a or feasible_b:
        return feasible_a
    return violation_a < violation_b


@kernel
def ranking(order: RunningOrder, cost: Array, violation: Array) -> Count:
    """Return indices from the best to the worst, (size,), by `better` (merge sort).

    Individuals that tie keep their order; those that are not finite come last.
    """
    size = cost.size
    rank = np.arange(size)
    merged = np.empty_like(rank)
    length = 1  # Of the runs that are sorted.
    while length < size:
        for first in range(0, size, 2 * length):
            middle, end = min(first + length, size), min(first + 2 * length, size)
            i, j = first, middle
            for k in range(first, end):
                # One of i and j may be past its run, and past the array.
                a, b = rank[min(i, size - 1)], rank[min(j, size - 1)]
                if j == end or (
                    i < middle  # A tie takes the left one: the order stays.
                    and not better(order, cost[b], violation[b], cost[a], violation[a])
                ):
                    merged[k] = a
                    i += 1
                else:
                    merged[k] = b
                    j += 1
        rank, merged = merged, rank
        length *= 2
    return rank


@kernel
def merits(order: RunningOrder, cost: Array, violation: Array, out: Array) -> None:
    """Fill `out` with one number for each individual; the smaller, the better.

    Static penalty: cost + weight * violation. The other orders give numbers without
    unit: for feasible individuals their place between the least and the largest
    feasible cost, in [0, 1]; for infeasible ones 1 + violation / largest violation.
    Individuals that are not finite get infinity. Rounding may give two individuals the
    same number although one is `better`, but never puts them in the wrong order.

    Deb (2000) adds the violation to the worst feasible cost instead; such a sum depends
    on the units of the cost. All arrays have the shape (size,).
    """
    least, largest, worst = ranges(order, cost, violation)
    span = 0.5 * largest - 0.5 * least  # Halves: the difference may overflow.
    for i in range(cost.size):
        if not is_finite(cost[i], violation[i]):
            out[i] = np.inf
        elif order.rule == STATIC_PENALTY:
            out[i] = cost[i] + order.weight * violation[i]
        elif violation[i] > order.level[0]:
            out[i] = 1.0 + violation[i] / worst
        else:
            out[i] = (0.5 * cost[i] - 0.5 * least) / span if span > 0.0 else 0.0


@kernel
def ranges(
    order: RunningOrder, cost: Array, violation: Array
) -> tuple[float, float, float]:
    """Return least and largest feasible cost, and the largest violation.

    Individuals that are not finite are left out. If no individual is feasible, the
    costs are infinity and minus infinity.
    """
    least, largest, worst = np.inf, -np.inf, 0.0
    for i in range(cost.size):
        if is_finite(cost[i], violation[i]):
            worst = max(worst, violation[i])
            if violation[i] <= order.level[0]:
                least, largest = min(least, cost[i]), max(largest, cost[i])
    return least, largest, worst


@kernel
def best_index(order: RunningOrder, cost: Array, violation: Array) -> int:
    """Index of the first of the best individuals."""
    rule, weight, level, best = order.rule, order.weight, order.level[0], 0
    for i in range(1, cost.size):
        least, least_violation = cost[best], violation[best]
        if precedes(rule, weight, level, cost[i], violation[i], least, least_violation):
            best = i
    return best


@kernel
def worst_index(order: RunningOrder, cost: Array, violation: Array) -> int:
    """Index of the first of the worst individuals."""
    worst = 0
    for i in range(1, cost.size):
        if better(order, cost[worst], violation[worst], cost[i], violation[i]):
            worst = i
    return worst


@kernel
def is_finite(cost: float, violation: float) -> bool:
    """Return whether both numbers are finite."""
    return math.isfinite(cost) and math.isfinite(violation)
