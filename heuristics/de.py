"""Differential evolution, DE/rand/1/bin.

For each individual x_i, with r1, r2, r3 distinct and none of them i, k a random
coordinate and r uniform in [0, 1),

    v   = x_r1 + F (x_r2 - x_r3)                                     (mutation)
    u_d = v_d if r_d < CR or d = k, else x_id                        (crossover)
    x_i <- u if u is not worse than x_i                              (selection)

All trials of a generation are built from the generation before it (synchronous).

Source: Storn and Price (1997), Differential evolution - a simple and efficient
heuristic for global optimization over continuous spaces, Journal of Global
Optimization 11.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from swarmstart.heuristics.algorithm import (
    Kernels,
    common_fields,
    require,
    require_bounds,
    require_size,
    take_generation,
)
from swarmstart.heuristics.bounds import CODES, Bounds, repair
from swarmstart.heuristics.box import Box
from swarmstart.heuristics.kernel import Array, Count, kernel
from swarmstart.heuristics.order import RunningOrder, better

F_MAX = 2.0
"""Largest weight of the difference (Storn and Price 1997)."""


class DifferentialEvolutionSettings(NamedTuple):
    """What the kernels read; fields as in `DifferentialEvolution`."""

    lower: Array
    upper: Array
    order: RunningOrder
    F: float
    CR: float
    bounds: int


class DifferentialEvolutionState(NamedTuple):
    """State of a `DifferentialEvolution`; first fields as in `State`.

    Attributes:
        population: Individuals, shape (dim, size).
        cost: Their costs, shape (size,).
        violation: Their violations, shape (size,).
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
    settings: DifferentialEvolutionSettings,
    state: DifferentialEvolutionState,
    asked: Array,
) -> None:
    """One trial for each individual: mutation and crossover."""
    asked[:] = state.population
    if state.generation[0] == 0:
        return
    dim, size = asked.shape
    x = state.population
    for i in range(size):
        r1, r2, r3 = draw_three_others(rng, size, i)
        k = draw_index(rng, dim)
        for d in range(dim):
            if rng.random() < settings.CR or d == k:  # crossover
                v = x[d, r1] + settings.F * (x[d, r2] - x[d, r3])  # mutation
                low, high = settings.lower[d], settings.upper[d]
                asked[d, i] = repair(rng, settings.bounds, v, x[d, i], low, high)


@kernel
def accept(
    settings: DifferentialEvolutionSettings,
    state: DifferentialEvolutionState,
    asked: Array,
    cost: Array,
    violation: Array,
) -> None:
    """A trial replaces its parent if it is not worse: selection.

    Before generation 0 the costs are infinite, so that its individuals are taken.
    """
    for i in range(cost.size):
        worse = better(
            settings.order, state.cost[i], state.violation[i], cost[i], violation[i]
        )
        if not worse:
            state.population[:, i] = asked[:, i]
            state.cost[i] = cost[i]
            state.violation[i] = violation[i]
    take_generation(settings.order, state, asked, cost, violation)


@kernel
def draw_three_others(
    rng: np.random.Generator, size: int, i: int
) -> tuple[int, int, int]:
    """Three distinct individuals, none of them i, all triples equally likely."""
    r1 = i
    while r1 == i:
        r1 = draw_index(rng, size)
    r2 = i
    while r2 in (i, r1):
        r2 = draw_index(rng, size)
    r3 = i
    while r3 in (i, r1, r2):
        r3 = draw_index(rng, size)
    return r1, r2, r3


@kernel
def draw_index(rng: np.random.Generator, number: int) -> int:
    """A random index below number."""
    return int(rng.random() * number)


@dataclass(frozen=True, kw_only=True, slots=True)
class DifferentialEvolution:
    """Settings of DE/rand/1/bin.

    Attributes:
        size: Number of individuals NP, at least 4.
        F: Weight of the difference, in (0, 2].
        CR: Probability that a coordinate comes from the mutant, in [0, 1].
        bounds: What happens to a coordinate that leaves the box; see `bounds`.

    Raises:
        InvalidSettingsError: If a value is out of its range.
    """

    size: int = 50
    F: float = 0.5
    CR: float = 0.9
    bounds: Bounds = "midpoint"

    def __post_init__(self) -> None:
        """Check the values."""
        require_size(self.size, at_least=4)
        require("F", self.F, ok=0.0 < self.F <= F_MAX, allowed=f"in (0, {F_MAX}]")
        require("CR", self.CR, ok=0.0 <= self.CR <= 1.0, allowed="in [0, 1]")
        require_bounds(self.bounds)

    @property
    def kernels(self) -> Kernels:
        """The two compiled functions."""
        return Kernels(propose=propose, accept=accept)

    def first_size(self, box: Box, evaluations: int | None) -> int:
        """Number of individuals of every generation."""
        del box, evaluations
        return self.size

    def kernel_settings(
        self, box: Box, order: RunningOrder
    ) -> DifferentialEvolutionSettings:
        """The settings as numbers and arrays."""
        return DifferentialEvolutionSettings(
            lower=box.lower,
            upper=box.upper,
            order=order,
            F=float(self.F),
            CR=float(self.CR),
            bounds=CODES[self.bounds],
        )

    def start(
        self, box: Box, population: Array, *, rng: np.random.Generator
    ) -> DifferentialEvolutionState:
        """The state before generation 0; arguments as in `Algorithm.start`."""
        del box, rng
        return DifferentialEvolutionState(
            *common_fields(population),
            population=population.copy(),
            cost=np.full(self.size, np.inf),
            violation=np.full(self.size, np.inf),
        )
