"""Criteria for restarting a CMA-ES.

With n variables that are not fixed, lambda individuals, g generations since the last
start, the step size sigma_0 of that start, and the other symbols as in `cma`:

max iterations  g >= 100 + 50 (n + 3)^2 / sqrt(lambda)
TolHistFun      the best values of the last 10 + ceil(30 n / lambda) generations lie
                within 1e-14 times the largest of them, in absolute value
EqualFunVals    in more than a third of the last n generations the best value and the
                one of rank 1 + ceil(0.1 + lambda / 4) were equal
TolX            |p_c| and sqrt(C_dd), times sigma / sigma_0, all < 1e-12
Stagnation      over the last max(g / 5, 120 + 30 n / lambda) generations, the median of
                the last 30 % is not better than that of the first 30 %: neither of the
                best values nor of the median values
TolXUp          sigma max D > 1e4 sigma_0
ConditionCov    condition number of C > 1e14
NoEffectAxis    the mean stays the same when 0.1 sigma times an axis is added to it
NoEffectCoord   one entry of the mean stays the same when 0.2 sigma sqrt(C_dd) is added

A value is a cost with its violation, compared by the order; values lie within a range
if their costs and their violations do. A constant added to the cost changes nothing but
roundings. The unit of the cost changes nothing: Hansen's TolHistFun is 1e-12 in that
unit, here it is equality up to roundings.

Source: Hansen (2009), Benchmarking a BI-population CMA-ES on the BBOB-2009 function
testbed, GECCO workshop, section 2; TolXUp as in Hansen's pycma, in place of TolUpSigma.
Hansen's history for Stagnation, of at most 20 000 generations, is shorter here:
`record_length`.
"""

import math
from typing import Protocol

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import State
from swarmstart.heuristics.laws.order import RunningOrder, better, ranking
from swarmstart.machine_code import Count, kernel

TOL_FUN = 1e-14
TOL_X = 1e-12
TOL_X_UP = 1e4
CONDITION_MAX = 1e14
STAGNATION_LOOKS = 16
"""Number of generations between two checks for Stagnation, which need sorting."""

BEST, MEDIAN = 0, 2
"""Rows of the record: a cost, below it the violation."""
EQUAL = 4
"""Row of the record: 1 if the best and another value were equal."""


class Distribution(State, Protocol):
    """The fields of CMA-ES's state that the restart criteria read.

    The n variables are those that are not fixed.
    """

    @property
    def mean(self) -> Array:
        """Mean m in the unit box, shape (n,)."""

    @property
    def sigma(self) -> Array:
        """Step size, a fraction of the widths of the box, shape (1,)."""

    @property
    def covariance(self) -> Array:
        """Covariance C without the step size, shape (n, n)."""

    @property
    def axes(self) -> Array:
        """Eigenvectors of C as columns B, shape (n, n)."""

    @property
    def lengths(self) -> Array:
        """Square roots D of the eigenvalues of C, shape (n,)."""

    @property
    def path_c(self) -> Array:
        """Path of the covariance p_c, shape (n,)."""

    @property
    def age(self) -> Count:
        """Number of generations since the last start, int64, shape (1,)."""

    @property
    def record(self) -> Array:
        """Values of the last generations, a ring buffer of shape (5, length).

        The rows: best cost and its violation, median cost and its violation, whether
        the two values of EqualFunVals were equal.
        """


def record_length(dim: int) -> int:
    """Return the length of the record: the most generations that a criterion reads."""
    return 600 + 8 * dim


@kernel
def write_record(
    state: Distribution, rank: Count, cost: Array, violation: Array
) -> None:
    """Record a ranked generation; its number is the age of the state."""
    size = cost.size
    column = state.age[0] % state.record.shape[1]  # A ring buffer.
    for row, place in ((BEST, 0), (MEDIAN, size // 2)):
        state.record[row, column] = cost[rank[place]]
        state.record[row + 1, column] = violation[rank[place]]
    one, other = rank[0], rank[min(math.ceil(0.1 + 0.25 * size), size - 1)]
    equal = cost[one] == cost[other] and violation[one] == violation[other]
    state.record[EQUAL, column] = 1.0 if equal else 0.0


@kernel
def has_ended(
    order: RunningOrder, state: Distribution, size: int, sigma_0: float
) -> bool:
    """Return whether any criterion for a restart holds.

    Args:
        order: The order of individuals; only the criterion Stagnation uses it.
        state: State of the algorithm; its age is that of the last column written.
        size: Number of individuals lambda of this generation.
        sigma_0: Step size at the last start.
    """
    dim, age = state.mean.size, state.age[0]
    if age >= 100.0 + 50.0 * (dim + 3.0) ** 2 / math.sqrt(size):
        return True
    return (
        has_flat_record(state, 10 + math.ceil(30.0 * dim / size))
        or has_equal_values(state, dim)
        or has_small_steps(state, sigma_0)
        or (age % STAGNATION_LOOKS == 0 and is_stagnant(order, state, size))
        or bool(state.sigma[0] * np.max(state.lengths) > TOL_X_UP * sigma_0)
        or has_no_effect(state)
    )


@kernel
def has_flat_record(state: Distribution, window: int) -> bool:
    """TolHistFun: the best values of `window` generations are equal up to roundings."""
    age, length = state.age[0], state.record.shape[1]
    if age < window:
        return False
    for row in (BEST, BEST + 1):
        least, largest = np.inf, -np.inf
        for k in range(age - window + 1, age + 1):
            value = state.record[row, k % length]
            least, largest = min(least, value), max(largest, value)
        # Not flat either if values are infinite, whose difference is NaN.
        if not largest - least <= TOL_FUN * max(abs(least), abs(largest)):
            return False
    return True


@kernel
def has_equal_values(state: Distribution, window: int) -> bool:
    """EqualFunVals: in over a third of `window` generations two values were equal."""
    age, length = state.age[0], state.record.shape[1]
    if age < window:
        return False
    equal = 0.0
    for k in range(age - window + 1, age + 1):
        equal += state.record[EQUAL, k % length]
    return 3.0 * equal > window


@kernel
def has_small_steps(state: Distribution, sigma_0: float) -> bool:
    """TolX: all steps are below 1e-12 times the step size sigma_0 of the last start."""
    for d in range(state.mean.size):
        deviation = math.sqrt(max(state.covariance[d, d], 0.0))
        step = max(abs(state.path_c[d]), deviation) * state.sigma[0] / sigma_0
        if not step < TOL_X:
            return False
    return True


@kernel
def is_stagnant(order: RunningOrder, state: Distribution, size: int) -> bool:
    """Stagnation: neither best nor median values have improved for a long time."""
    age, length = state.age[0], state.record.shape[1]
    window = max(age // 5, math.ceil(120.0 + 30.0 * state.mean.size / size))
    window = min(window, length)  # Older generations are overwritten.
    if age < window:
        return False
    part = math.ceil(0.3 * window)
    for row in (BEST, MEDIAN):
        old_cost, old_violation = median_of(order, state, row, age - window + 1, part)
        new_cost, new_violation = median_of(order, state, row, age - part + 1, part)
        if better(order, new_cost, new_violation, old_cost, old_violation):
            return False
    return True


@kernel
def median_of(
    order: RunningOrder, state: Distribution, row: int, first: int, number: int
) -> tuple[float, float]:
    """Return the median of a recorded cost, with its violation, over generations.

    Args:
        order: The order of individuals.
        state: State of the algorithm.
        row: Row of the cost in the record: BEST or MEDIAN.
        first: Number of the first generation.
        number: Number of generations.
    """
    cost, violation = np.empty(number), np.empty(number)
    for k in range(number):
        column = (first + k) % state.record.shape[1]
        cost[k] = state.record[row, column]
        violation[k] = state.record[row + 1, column]
    middle = ranking(order, cost, violation)[number // 2]
    return cost[middle], violation[middle]


@kernel
def has_no_effect(state: Distribution) -> bool:
    """Return whether ConditionCov, NoEffectAxis or NoEffectCoord holds.

    That is: C is ill-conditioned, or a small step along an axis of C or along a
    coordinate leaves the mean unchanged by rounding.
    """
    dim, sigma = state.mean.size, state.sigma[0]
    largest, least = np.max(state.lengths), np.min(state.lengths)
    # The lengths are the roots of the eigenvalues of C.
    if largest * largest > CONDITION_MAX * least * least:
        return True
    axis, moved = state.age[0] % dim, False  # One axis a generation, in turn.
    for d in range(dim):
        m = state.mean[d]
        if m == m + 0.2 * sigma * math.sqrt(max(state.covariance[d, d], 0.0)):
            return True
        if m != m + 0.1 * sigma * state.lengths[axis] * state.axes[d, axis]:
            moved = True
    return not moved
