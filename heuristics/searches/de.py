"""Differential evolution: DE/rand/1, DE/best/1, DE/current-to-best/1; bin and exp.

Each individual x_i gets a mutant v, with the weight F, indices r1, r2, r3 that are
distinct and none of them i, and x_best the best of the population,

    v = x_r1   + F (x_r2 - x_r3)                                     (rand/1)
    v = x_best + F (x_r1 - x_r2)                                     (best/1)
    v = x_i    + F (x_best - x_i) + F (x_r1 - x_r2)                  (current-to-best/1)

Crossover makes the trial u, with k a random coordinate that is not fixed, and r and r_d
uniform in [0, 1), drawn anew each time:

    u_d = v_d if r_d < CR or d = k, else x_id                        (bin)
    u_d = v_d for d = k, k + 1, ... as long as r < CR, at most once round, else x_id
                                                                     (exp)
Selection:

    x_i <- u if u is not worse than x_i

All trials of a generation are built from the generation before it (synchronous).

Source: Storn and Price (1997), Differential evolution - a simple and efficient
heuristic for global optimization over continuous spaces, Journal of Global
Optimization 11.
"""

from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple, get_args

import numpy as np

from swarmstart.arguments import a_count, a_number, checked, choice
from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import (
    BOUND_HANDLING,
    BoundHandled,
    InvalidSettingsError,
    Kernels,
    OfFixedSize,
    common_fields,
    copy_points,
    take_generation,
)
from swarmstart.heuristics.laws.box import CODES, BoundHandling, Box
from swarmstart.heuristics.laws.order import RunningOrder, best_index
from swarmstart.heuristics.searches.trials import (
    cross_binomially,
    cross_exponentially,
    draw_three_others,
    draw_two_others,
    fill_trials,
    new_plan,
    select,
)
from swarmstart.machine_code import Count, kernel

Strategy = Literal["rand/1", "best/1", "current-to-best/1"]
Crossover = Literal["bin", "exp"]
STRATEGIES: tuple[str, ...] = get_args(Strategy)
CROSSOVERS: tuple[str, ...] = get_args(Crossover)
RAND, BEST, CURRENT_TO_BEST = range(3)
BIN, EXP = range(2)

F_MAX = 2.0
"""Largest weight of the difference (Storn and Price 1997)."""


class DifferentialEvolutionSettings(NamedTuple):
    """Settings for the kernels; fields as in `DifferentialEvolution`."""

    lower: Array
    upper: Array
    order: RunningOrder
    F: float
    CR: float
    strategy: int
    crossover: int
    bound_handling: int
    free: Count


class DifferentialEvolutionState(NamedTuple):
    """State of a `DifferentialEvolution`; first fields as in `State`.

    Attributes:
        population: Individuals, shape (dim, size).
        cost: Costs of the individuals, shape (size,).
        violation: Violations of the individuals, shape (size,).
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
    """Make one trial for each individual: mutation and crossover."""
    if state.generation[0] == 0:
        copy_points(state.population, asked)
        return
    dim, size = asked.shape
    plan = new_plan(dim, size)
    best = 0  # Not used by rand/1.
    if settings.strategy != RAND:
        best = best_index(settings.order, state.cost, state.violation)
    for i in range(size):
        if settings.strategy == RAND:
            # Without a leader, base and lead are one: their difference is 0.
            r1, r2, r3 = draw_three_others(rng, size, i)
            plan.base[i], plan.lead[i], plan.plus[i], plan.minus[i] = r1, r1, r2, r3
        else:
            plan.plus[i], plan.minus[i] = draw_two_others(rng, size, i, size)
            plan.base[i] = best if settings.strategy == BEST else i
            plan.lead[i] = best
        plan.F[i] = settings.F
        if settings.crossover == BIN:
            cross_binomially(rng, settings.CR, settings.free, plan.mutated, i)
        else:
            cross_exponentially(rng, settings.CR, settings.free, plan.mutated, i)
    fill_trials(rng, settings, state.population, plan, asked)


@kernel
def accept(
    settings: DifferentialEvolutionSettings,
    state: DifferentialEvolutionState,
    asked: Array,
    cost: Array,
    violation: Array,
) -> None:
    """Replace each parent whose trial is not worse: selection."""
    parents = (state.population, state.cost, state.violation)
    select(settings.order, parents, asked, cost, violation)
    take_generation(settings.order, state, asked, cost, violation)


@checked(
    InvalidSettingsError,
    size=a_count(least=4),  # Each and three others.
    F=a_number(above=0, most=F_MAX),
    CR=a_number(least=0, most=1),
    strategy=choice(STRATEGIES),
    crossover=choice(CROSSOVERS),
    bound_handling=BOUND_HANDLING,
)
@dataclass(frozen=True, kw_only=True, slots=True)
class DifferentialEvolution(OfFixedSize, BoundHandled):
    """Settings of differential evolution.

    Attributes:
        size: Number of individuals NP, at least 4.
        F: Weight of the difference, in (0, 2].
        CR: Probability that a coordinate comes from the mutant (bin), or that the run
            of coordinates from the mutant goes on (exp), in [0, 1].
        strategy: Formula of the mutant: "rand/1", "best/1" or "current-to-best/1".
        crossover: Rule for the coordinates that the trial takes from the mutant: "bin"
            or "exp".
        bound_handling: What happens to a coordinate that leaves the box; see the
            module `box`.

    Raises:
        InvalidSettingsError: If a value is out of its range.

    Example:
        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x**2).sum(axis=0),
        ...     bounds=[(-1, 2)] * 3,
        ...     algorithm=ss.DifferentialEvolution(size=20, strategy="best/1"),
        ...     budget=5000,
        ...     seed=0,
        ... )
        >>> bool(found.cost < 1e-6)
        True
    """

    kernels: ClassVar[Kernels] = Kernels(propose=propose, accept=accept)
    size: int = 50
    F: float = 0.5
    CR: float = 0.9
    strategy: Strategy = "rand/1"
    crossover: Crossover = "bin"
    bound_handling: BoundHandling = "midpoint"

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
            strategy=STRATEGIES.index(self.strategy),
            crossover=CROSSOVERS.index(self.crossover),
            bound_handling=CODES[self.bound_handling],
            free=box.free,
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
