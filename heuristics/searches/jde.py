"""Differential evolution that adapts its own parameters, jDE.

Each individual carries its own weight F_i and crossover rate CR_i. Before its trial is
made, with r1 ... r4 uniform in [0, 1),

    F_i'  = F_l + r1 F_u  if r2 < tau_1, else F_i
    CR_i' = r3            if r4 < tau_2, else CR_i

with F_l = 0.1, F_u = 0.9 and tau_1 = tau_2 = 0.1. The trial is that of DE/rand/1/bin
(`de`) with F_i' and CR_i'. If the trial replaces its parent, F_i' and CR_i' replace F_i
and CR_i. All individuals begin with F = 0.5 and CR = 0.9.

Source: Brest, Greiner, Boskovic, Mernik and Zumer (2006), Self-adapting control
parameters in differential evolution: a comparative study on numerical benchmark
problems, IEEE Transactions on Evolutionary Computation 10(6).
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from swarmstart.arguments import a_count, checked
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
from swarmstart.heuristics.laws.order import RunningOrder
from swarmstart.heuristics.searches.trials import (
    cross_binomially,
    draw_three_others,
    fill_trials,
    new_plan,
    select,
)
from swarmstart.machine_code import Count, kernel

F_LOWER, F_WIDTH = 0.1, 0.9
"""F_l and F_u: F is drawn in [F_l, F_l + F_u)."""

TAU_1, TAU_2 = 0.1, 0.1
"""Probabilities of a new F and of a new CR."""

FIRST_F, FIRST_CR = 0.5, 0.9


class SelfAdaptiveDESettings(NamedTuple):
    """Settings for the kernels; fields as in `SelfAdaptiveDE`."""

    lower: Array
    upper: Array
    order: RunningOrder
    bound_handling: int
    free: Count


class SelfAdaptiveDEState(NamedTuple):
    """State of a `SelfAdaptiveDE`; first fields as in `State`.

    Attributes:
        population: Individuals, shape (dim, size).
        cost: Costs of the individuals, shape (size,).
        violation: Violations of the individuals, shape (size,).
        F: Weights of the individuals, shape (size,).
        CR: Crossover rates of the individuals, shape (size,).
        F_trial: Weights of the trials asked last, shape (size,).
        CR_trial: Crossover rates of the trials asked last, shape (size,).
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
    F: Array
    CR: Array
    F_trial: Array
    CR_trial: Array


@kernel
def propose(
    rng: np.random.Generator,
    settings: SelfAdaptiveDESettings,
    state: SelfAdaptiveDEState,
    asked: Array,
) -> None:
    """Make one trial for each individual, with parameters of its own."""
    if state.generation[0] == 0:
        copy_points(state.population, asked)
        return
    dim, size = asked.shape
    plan = new_plan(dim, size)
    for i in range(size):
        state.F_trial[i], state.CR_trial[i] = state.F[i], state.CR[i]
        if rng.random() < TAU_1:
            state.F_trial[i] = F_LOWER + F_WIDTH * rng.random()
        if rng.random() < TAU_2:
            state.CR_trial[i] = rng.random()
        # Without a leader, base and lead are one: their difference is 0.
        r1, r2, r3 = draw_three_others(rng, size, i)
        plan.base[i], plan.lead[i], plan.plus[i], plan.minus[i] = r1, r1, r2, r3
        plan.F[i] = state.F_trial[i]
        cross_binomially(rng, state.CR_trial[i], settings.free, plan.mutated, i)
    fill_trials(rng, settings, state.population, plan, asked)


@kernel
def accept(
    settings: SelfAdaptiveDESettings,
    state: SelfAdaptiveDEState,
    asked: Array,
    cost: Array,
    violation: Array,
) -> None:
    """Replace each parent whose trial is not worse, with the trial's parameters."""
    parents = (state.population, state.cost, state.violation)
    replaced = select(settings.order, parents, asked, cost, violation)
    for i in range(cost.size):
        if replaced[i]:
            state.F[i], state.CR[i] = state.F_trial[i], state.CR_trial[i]
    take_generation(settings.order, state, asked, cost, violation)


@checked(
    InvalidSettingsError,
    size=a_count(least=4),  # Each and three others.
    bound_handling=BOUND_HANDLING,
)
@dataclass(frozen=True, kw_only=True, slots=True)
class SelfAdaptiveDE(OfFixedSize, BoundHandled):
    """Settings of jDE.

    Attributes:
        size: Number of individuals NP, at least 4.
        bound_handling: What happens to a coordinate that leaves the box; see the
            module `box`.

    Raises:
        InvalidSettingsError: If a value is out of its range.

    Example:
        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x**2).sum(axis=0),
        ...     bounds=[(-1, 2)] * 3,
        ...     algorithm=ss.SelfAdaptiveDE(size=20),
        ...     budget=5000,
        ...     seed=0,
        ... )
        >>> bool(found.cost < 1e-6)
        True
    """

    kernels: ClassVar[Kernels] = Kernels(propose=propose, accept=accept)
    size: int = 50
    bound_handling: BoundHandling = "midpoint"

    def kernel_settings(self, box: Box, order: RunningOrder) -> SelfAdaptiveDESettings:
        """The settings as numbers and arrays."""
        return SelfAdaptiveDESettings(
            lower=box.lower,
            upper=box.upper,
            order=order,
            bound_handling=CODES[self.bound_handling],
            free=box.free,
        )

    def start(
        self, box: Box, population: Array, *, rng: np.random.Generator
    ) -> SelfAdaptiveDEState:
        """The state before generation 0; arguments as in `Algorithm.start`."""
        del box, rng
        return SelfAdaptiveDEState(
            *common_fields(population),
            population=population.copy(),
            cost=np.full(self.size, np.inf),
            violation=np.full(self.size, np.inf),
            F=np.full(self.size, FIRST_F),
            CR=np.full(self.size, FIRST_CR),
            # Every individual of generation 0 takes these over.
            F_trial=np.full(self.size, FIRST_F),
            CR_trial=np.full(self.size, FIRST_CR),
        )
