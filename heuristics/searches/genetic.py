"""Real-coded genetic algorithm, the one that chapter 5 compares with.

Parents are drawn by roulette on w_i = J_max - J_i, with J the merits of `order` and
J_max the largest. With the probability p_c, each pair a, b has the children

    alpha a + (1 - alpha) b   and   (1 - alpha) a + alpha b       (arithmetic crossover)

with one alpha uniform in [0, 1), else copies of the parents as children. Then each
coordinate is, with the probability p_m, drawn anew over the box (uniform mutation).

Source: chapter 5, section 5.2.4 (real valued, size 20, p_c = 0.8, p_m = 1/n); the
operators, which the chapter does not name, are those of Michalewicz (1996), Genetic
algorithms + data structures = evolution programs.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from swarmstart.arguments import FLAG, a_count, a_number, checked, optional
from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import (
    InvalidSettingsError,
    Kernels,
    OfFixedSize,
    common_fields,
    copy_points,
    copy_values,
    fill_column,
    take_column,
    take_generation,
)
from swarmstart.heuristics.laws.box import Box, between
from swarmstart.heuristics.laws.order import (
    RunningOrder,
    best_index,
    better,
    merits,
    worst_index,
)
from swarmstart.machine_code import Count, kernel


class GeneticAlgorithmSettings(NamedTuple):
    """Settings for the kernels; fields as in `GeneticAlgorithm`."""

    lower: Array
    upper: Array
    order: RunningOrder
    crossover: float
    mutation: float
    elitism: bool


class GeneticAlgorithmState(NamedTuple):
    """State of a `GeneticAlgorithm`; first fields as in `State`.

    Attributes:
        population: Parents of the next generation, shape (dim, size).
        cost: Costs of the parents, shape (size,).
        violation: Violations of the parents, shape (size,).
    """

    generation: Count
    progress: Array
    best: Array
    best_cost: Array
    best_violation: Array
    nonfinite: Count
    size: Count
    evaluations: Count
    improved: Count
    population: Array
    cost: Array
    violation: Array


@kernel
def propose(
    rng: np.random.Generator,
    settings: GeneticAlgorithmSettings,
    state: GeneticAlgorithmState,
    asked: Array,
) -> None:
    """Draw pairs of parents, and make two children of each pair.

    If the size is odd, the last pair has one child.
    """
    copy_points(state.population, asked)
    if state.generation[0] == 0:
        return
    size = asked.shape[1]
    weight = np.empty(size)
    roulette_weights(settings.order, state.cost, state.violation, weight)
    for i in range(0, size, 2):
        a = state.population[:, spin(rng, weight)]
        b = state.population[:, spin(rng, weight)]
        # With alpha = 1 the children are copies of their parents.
        alpha = rng.random() if rng.random() < settings.crossover else 1.0
        breed(rng, settings, alpha, (a, b), asked[:, i])
        if i + 1 < size:
            breed(rng, settings, alpha, (b, a), asked[:, i + 1])


@kernel
def breed(
    rng: np.random.Generator,
    settings: GeneticAlgorithmSettings,
    alpha: float,
    parents: tuple[Array, Array],
    child: Array,
) -> None:
    """Fill child, shape (dim,), with alpha a + (1 - alpha) b, then mutate it."""
    a, b = parents
    for d in range(child.size):
        low, high = settings.lower[d], settings.upper[d]
        if rng.random() < settings.mutation:
            child[d] = between(low, high, rng.random())
        else:
            child[d] = blend(a[d], b[d], alpha)


@kernel
def blend(a: float, b: float, alpha: float) -> float:
    """The point alpha a + (1 - alpha) b, never outside of [a, b] by rounding."""
    value = alpha * a + (1.0 - alpha) * b
    return min(max(value, min(a, b)), max(a, b))


@kernel
def accept(
    settings: GeneticAlgorithmSettings,
    state: GeneticAlgorithmState,
    asked: Array,
    cost: Array,
    violation: Array,
) -> None:
    """Replace the parents by the children; the best parent may replace the worst child.

    Before generation 0 the costs of the parents are infinite, so that none of these
    parents is kept.
    """
    elite = best_index(settings.order, state.cost, state.violation)
    elite_point = np.empty(asked.shape[0])  # A copy: its column is overwritten.
    take_column(state.population, elite, elite_point)
    elite_cost, elite_violation = state.cost[elite], state.violation[elite]
    copy_points(asked, state.population)
    copy_values(cost, state.cost)
    copy_values(violation, state.violation)
    worst = worst_index(settings.order, cost, violation)
    if settings.elitism and better(
        settings.order, elite_cost, elite_violation, cost[worst], violation[worst]
    ):
        fill_column(elite_point, state.population, worst)
        state.cost[worst] = elite_cost
        state.violation[worst] = elite_violation
    take_generation(settings.order, state, asked, cost, violation)


@kernel
def roulette_weights(
    order: RunningOrder, cost: Array, violation: Array, weight: Array
) -> None:
    """Weights J_max - J_i, scaled to at most 1; 0 for individuals that are not finite.

    If all finite merits are equal, they get equal weights; if no merit is finite, all
    individuals do.

    Args:
        order: The order whose merits J are used.
        cost: Costs, shape (size,).
        violation: Violations, shape (size,).
        weight: Filled with the weights, shape (size,).
    """
    merit = np.empty(cost.size)
    merits(order, cost, violation, merit)
    least, largest = finite_range(merit)
    for i in range(cost.size):
        if largest > least:  # J_max - J_i; halves: the difference may overflow.
            span = 0.5 * largest - 0.5 * least
            weight[i] = max((0.5 * largest - 0.5 * merit[i]) / span, 0.0)
        elif largest == least:
            weight[i] = 1.0 if merit[i] == largest else 0.0
        else:
            weight[i] = 1.0


@kernel
def finite_range(merit: Array) -> tuple[float, float]:
    """The least and the largest finite merit; (inf, -inf) if none is finite."""
    least, largest = np.inf, -np.inf
    for i in range(merit.size):
        if np.isfinite(merit[i]):
            least = min(least, merit[i])
            largest = max(largest, merit[i])
    return least, largest


@kernel
def spin(rng: np.random.Generator, weight: Array) -> int:
    """Draw an index with probability proportional to its weight.

    Args:
        rng: Source of randomness; one number is drawn.
        weight: Weights, at least 0 and not all 0, shape (size,).

    Returns:
        The index; never one of weight 0.
    """
    total = 0.0
    for i in range(weight.size):
        total += weight[i]
    mark = rng.random() * total
    reached = 0.0
    for i in range(weight.size):
        reached += weight[i]
        if mark < reached:
            return i
    return weight.size - 1  # Never: mark < total, summed in the same order.


@checked(
    InvalidSettingsError,
    size=a_count(least=2),
    crossover=a_number(least=0, most=1),
    mutation=optional(a_number(least=0, most=1)),
    elitism=FLAG,
)
@dataclass(frozen=True, kw_only=True, slots=True)
class GeneticAlgorithm(OfFixedSize):
    """Settings of the genetic algorithm.

    Attributes:
        size: Number of individuals, at least 2.
        crossover: Probability p_c that a pair is crossed, in [0, 1].
        mutation: Probability p_m that a coordinate is drawn anew, in [0, 1]; None means
            1 / n for the n variables that are not fixed.
        elitism: Whether the best parent replaces the worst child if the parent is
            better. If False, no parent survives. The best point ever seen is reported
            either way.

    Raises:
        InvalidSettingsError: If a value is out of its range.

    Example:
        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x**2).sum(axis=0),
        ...     bounds=[(-1, 2)] * 3,
        ...     algorithm=ss.GeneticAlgorithm(size=40),
        ...     budget=5000,
        ...     seed=0,
        ... )
        >>> bool(found.cost < 0.05)
        True
    """

    kernels: ClassVar[Kernels] = Kernels(propose=propose, accept=accept)
    size: int = 20
    crossover: float = 0.8
    mutation: float | None = None
    elitism: bool = True

    def kernel_settings(
        self, box: Box, order: RunningOrder
    ) -> GeneticAlgorithmSettings:
        """The settings as numbers and arrays."""
        return GeneticAlgorithmSettings(
            lower=box.lower,
            upper=box.upper,
            order=order,
            crossover=float(self.crossover),
            mutation=float(
                1.0 / box.free.size if self.mutation is None else self.mutation
            ),
            elitism=self.elitism,
        )

    def start(
        self, box: Box, population: Array, *, rng: np.random.Generator
    ) -> GeneticAlgorithmState:
        """The state before generation 0; arguments as in `Algorithm.start`."""
        del box, rng
        return GeneticAlgorithmState(
            *common_fields(population),
            population=population.copy(),
            cost=np.full(self.size, np.inf),
            violation=np.full(self.size, np.inf),
        )
