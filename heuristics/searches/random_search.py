"""Random search: every generation is drawn uniformly in the box.

It is the baseline that every other algorithm must beat.
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from swarmstart.arguments import a_count, checked
from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import (
    InvalidSettingsError,
    Kernels,
    OfFixedSize,
    common_fields,
    copy_points,
    take_generation,
)
from swarmstart.heuristics.laws.box import Box, between
from swarmstart.heuristics.laws.order import RunningOrder
from swarmstart.machine_code import Count, kernel


class RandomSearchSettings(NamedTuple):
    """Settings for the kernels."""

    lower: Array
    upper: Array
    order: RunningOrder


class RandomSearchState(NamedTuple):
    """State of a `RandomSearch`; first fields as in `State`.

    Attributes:
        population: Initial population, shape (dim, size).
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


@kernel
def propose(
    rng: np.random.Generator,
    settings: RandomSearchSettings,
    state: RandomSearchState,
    asked: Array,
) -> None:
    """Draw a population uniformly in the box, except in generation 0."""
    copy_points(state.population, asked)
    if state.generation[0] == 0:
        return
    dim, size = asked.shape
    for i in range(size):
        for d in range(dim):
            asked[d, i] = between(settings.lower[d], settings.upper[d], rng.random())


@kernel
def accept(
    settings: RandomSearchSettings,
    state: RandomSearchState,
    asked: Array,
    cost: Array,
    violation: Array,
) -> None:
    """Keep the best point."""
    take_generation(settings.order, state, asked, cost, violation)


@checked(InvalidSettingsError, size=a_count(least=1))
@dataclass(frozen=True, kw_only=True, slots=True)
class RandomSearch(OfFixedSize):
    """Settings of random search.

    Attributes:
        size: Number of points of a generation, at least 1.

    Raises:
        InvalidSettingsError: If the size is out of its range.

    Example:
        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x**2).sum(axis=0),
        ...     bounds=[(-1, 2)] * 2,
        ...     algorithm=ss.RandomSearch(size=50),
        ...     budget=2000,
        ...     seed=0,
        ... )
        >>> found.evaluations, bool(found.cost < 0.05)
        (2000, True)
    """

    kernels: ClassVar[Kernels] = Kernels(propose=propose, accept=accept)
    size: int = 20

    def kernel_settings(self, box: Box, order: RunningOrder) -> RandomSearchSettings:
        """The settings as numbers and arrays."""
        return RandomSearchSettings(lower=box.lower, upper=box.upper, order=order)

    def start(
        self, box: Box, population: Array, *, rng: np.random.Generator
    ) -> RandomSearchState:
        """The state before generation 0; arguments as in `Algorithm.start`."""
        del box, rng
        return RandomSearchState(
            *common_fields(population), population=population.copy()
        )
