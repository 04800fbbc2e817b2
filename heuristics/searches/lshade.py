"""L-SHADE: differential evolution with a memory of successful parameters.

It has an archive of replaced parents and a population that shrinks.

The memory has H slots, each with a weight M_F,h and a crossover rate M_CR,h. Trial u of
each of the N individuals x_i, with h a random slot, k a random coordinate and r_d
uniform in [0, 1):

    CR_i = N(M_CR,h, 0.1) cut to [0, 1]; 0 if M_CR,h is terminal
    F_i  = Cauchy(M_F,h, 0.1), drawn again while <= 0; 1 if above 1
    v    = x_i + F_i (x_pbest - x_i) + F_i (x_r1 - x_r2)      (current-to-pbest/1)
    u_d  = v_d if r_d < CR_i or d = k, else x_id              (bin)

x_pbest is one of the max(2, round(p N)) best, r1 an individual other than i, r2 one of
the population or of the archive other than i and r1. A trial that is not worse replaces
its parent. A parent that lost to a better trial goes to the archive, and F_i and CR_i
of that trial go to the lists S_F and S_CR. The archive holds at most round(r_arc N)
members; surplus ones are deleted at random. After a generation with S_F not empty, let
D_k be the improvement by the k-th entry of the lists, and w_k = D_k / sum D. The next
slot h of the memory, in turn, becomes

    M_F,h  = sum w_k F_k^2 / sum w_k F_k                      (weighted Lehmer mean)
    M_CR,h = sum w_k CR_k^2 / sum w_k CR_k; terminal, for ever, once max S_CR = 0

The population loses its worst individuals, down to

    N = round(N_0 + (N_min - N_0) E / E_max)

with E the evaluations so far, E_max those of the budget, and N_0 and N_min the sizes at
the start and at the end. Published: H = 6, M_F = M_CR = 0.5 at first, p = 0.11,
r_arc = 2.6, N_0 = 18 dim, N_min = 4.

Differences from the paper, and points on which it is silent:
E_max    is not known to the kernels. They know the fraction of the budget used before a
         generation, (E - n) / (E_max - n) with n its size and E_max cut to whole
         generations, and solve it for E_max. Generation 0 has fraction 0 and never
         shrinks. For a budget in seconds, E_max is extrapolated from the speed so far.
D_k      is |cost(u) - cost(x)| if both count as feasible, else the difference of the
         violations; each divided by the largest of its kind in the generation, so that
         units do not matter. Under a static penalty it is the difference of the
         penalised costs. A constant added to the cost changes none of them.
x_i      whose cost was not finite goes neither to the archive nor into the means.
N_0      is by default clip(E_max / 80, 40, 200), chosen here: 18 dim is too large for
         small budgets.

Source: Tanabe and Fukunaga (2014), Improving the search performance of SHADE using
linear population size reduction, IEEE Congress on Evolutionary Computation.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from swarmstart.arguments import a_count, a_number, checked, optional
from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import (
    BOUND_HANDLING,
    BoundHandled,
    InvalidSettingsError,
    Kernels,
    common_fields,
    copy_column,
    copy_points,
    require,
    take_generation,
)
from swarmstart.heuristics.laws.box import CODES, BoundHandling, Box
from swarmstart.heuristics.laws.order import RunningOrder, better, worst_index
from swarmstart.heuristics.searches.trials import (
    FIRST_MEMORY,
    cross_binomially,
    draw_index,
    draw_parameters,
    draw_two_others,
    fill_trials,
    measure_improvements,
    new_plan,
    remember,
    select,
)
from swarmstart.machine_code import Count, kernel

LEAST_SIZE = 4
"""Least size of a population: a trial needs two others and two leaders."""

EVALUATIONS_EACH = 80
SMALLEST_FIRST, LARGEST_FIRST, FIRST_OF_UNKNOWN_BUDGET = 40, 200, 100
"""N_0 = clip(E_max / 80, 40, 200); 100 where E_max is not known."""

PUBLISHED_SIZE = 18
"""N_0 per dimension in the paper."""


class LSHADESettings(NamedTuple):
    """Settings for the kernels; fields as in `LSHADE`."""

    lower: Array
    upper: Array
    order: RunningOrder
    smallest: int
    archive: float
    greediness: float
    bound_handling: int
    free: Count


class LSHADEState(NamedTuple):
    """State of an `LSHADE`; first fields as in `State`.

    Attributes:
        pool: The first `size` columns are the individuals; the columns from N_0 on are
            the archive. Shape (dim, N_0 + room of the archive).
        cost: Costs of the individuals, shape (N_0,).
        violation: Violations of the individuals, shape (N_0,).
        archived: Number of columns in the archive, int64, shape (1,).
        F_memory: Weights M_F of the memory, shape (H,).
        CR_memory: Crossover rates M_CR of the memory, shape (H,).
        slot: Index of the slot of the memory that is updated next, int64, shape (1,).
        F_trial: Weights of the trials asked last, shape (N_0,).
        CR_trial: Crossover rates of the trials asked last, shape (N_0,).
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
    pool: Array
    cost: Array
    violation: Array
    archived: Count
    F_memory: Array
    CR_memory: Array
    slot: Count
    F_trial: Array
    CR_trial: Array


@kernel
def propose(
    rng: np.random.Generator,
    settings: LSHADESettings,
    state: LSHADEState,
    asked: Array,
) -> None:
    """Make one trial for each individual, with parameters drawn around the memory."""
    dim, size = asked.shape
    if state.generation[0] == 0:
        copy_points(state.pool, asked)
        return
    # After `accept` has added losers and shrunk the population; it has no generator.
    trim_archive(rng, settings, state)
    plan = new_plan(dim, size)
    leaders = np.empty(max(2, rounded(settings.greediness * size)), dtype=np.int64)
    find_leaders(settings.order, state, leaders)
    for i in range(size):
        draw_parameters(rng, state, i)
        plan.base[i] = i  # current-to-pbest/1
        plan.lead[i] = leaders[draw_index(rng, leaders.size)]
        r1, r2 = draw_two_others(rng, size, i, size + state.archived[0])
        plan.plus[i] = r1
        # From `size` on they are those of the archive, whose columns begin at N_0.
        plan.minus[i] = r2 if r2 < size else r2 - size + state.cost.size
        plan.F[i] = state.F_trial[i]
        cross_binomially(rng, state.CR_trial[i], settings.free, plan.mutated, i)
    fill_trials(rng, settings, state.pool, plan, asked)


@kernel
def find_leaders(order: RunningOrder, state: LSHADEState, leaders: Count) -> None:
    """Fill leaders with the indices of the best individuals, the best first."""
    cost, violation = state.cost, state.violation
    last = leaders.size - 1
    for i in range(state.size[0]):  # By insertion, since leaders are few.
        k = min(i, last + 1)
        while k > 0:
            j = leaders[k - 1]
            if not better(order, cost[i], violation[i], cost[j], violation[j]):
                break
            if k <= last:
                leaders[k] = j
            k -= 1
        if k <= last:
            leaders[k] = i


@kernel
def trim_archive(
    rng: np.random.Generator, settings: LSHADESettings, state: LSHADEState
) -> None:
    """Delete random members until the archive is not above its size."""
    room = rounded(settings.archive * state.size[0])
    first = state.cost.size
    while state.archived[0] > room:
        k = draw_index(rng, state.archived[0])
        state.archived[0] -= 1
        copy_column(state.pool, first + state.archived[0], state.pool, first + k)


@kernel
def accept(
    settings: LSHADESettings,
    state: LSHADEState,
    asked: Array,
    cost: Array,
    violation: Array,
) -> None:
    """Select, and update archive, memory and the size of the next generation."""
    # All of these compare with the parents, which `select` replaces.
    improvement = np.empty(cost.size)
    measure_improvements(settings.order, state, cost, violation, improvement)
    remember(state, improvement)
    keep_losers(state, improvement)
    parents = (state.pool, state.cost, state.violation)
    select(settings.order, parents, asked, cost, violation)
    before = state.evaluations[0]  # `take_generation` counts on.
    take_generation(settings.order, state, asked, cost, violation)
    fraction = fraction_after(state.progress[0], before, cost.size)
    first = state.cost.size  # N_0: the arrays never shrink.
    size = rounded(first + (settings.smallest - first) * fraction)
    remove_worst(settings.order, state, max(size, settings.smallest))


@kernel
def keep_losers(state: LSHADEState, improvement: Array) -> None:
    """Append to the archive all parents that lost against their trials."""
    begin = state.cost.size + state.archived[0]
    for d in range(state.pool.shape[0]):
        row, k = state.pool[d], begin
        for i in range(improvement.size):
            if improvement[i] > 0.0:
                row[k] = row[i]
                k += 1
    for i in range(improvement.size):
        state.archived[0] += improvement[i] > 0.0


@kernel
def fraction_after(progress: float, before: int, size: int) -> float:
    """Fraction of the budget used after a generation, in [0, 1].

    Args:
        progress: Fraction before the generation; 0 if it is not known.
        before: Evaluations before the generation.
        size: Number of individuals of the generation.
    """
    if progress <= 0.0 or before <= 0:
        return 0.0
    return min((before + size) / (before / progress + size), 1.0)


@kernel
def remove_worst(order: RunningOrder, state: LSHADEState, size: int) -> None:
    """Remove the worst individuals until there are at most `size`."""
    while state.size[0] > size:
        n = state.size[0]
        worst = worst_index(order, state.cost[:n], state.violation[:n])
        state.size[0] = last = n - 1
        copy_column(state.pool, last, state.pool, worst)
        state.cost[worst] = state.cost[last]
        state.violation[worst] = state.violation[last]


@kernel
def rounded(value: float) -> int:
    """Return the integer nearest to a number above 0; halves are rounded up."""
    return math.floor(value + 0.5)


@checked(
    InvalidSettingsError,
    size=optional(a_count(least=LEAST_SIZE)),
    smallest=a_count(least=LEAST_SIZE),
    memory=a_count(least=1),
    archive=a_number(least=0),
    greediness=a_number(above=0, most=1),
    bound_handling=BOUND_HANDLING,
)
@dataclass(frozen=True, kw_only=True, slots=True)
class LSHADE(BoundHandled):
    """Settings of L-SHADE.

    Attributes:
        size: Number of individuals N_0 of the first generation, at least `smallest`.
            None means the budget's evaluations / 80, at least 40 and at most 200; 100
            if the budget has no evaluations.
        smallest: Number of individuals N_min at the end, at least 4.
        memory: Number of slots H of the memory, at least 1.
        archive: Size r_arc of the archive relative to the population, at least 0.
        greediness: Fraction p of the population from which x_pbest is drawn, in (0, 1].
        bound_handling: What happens to a coordinate that leaves the box; see the
            module `box`.

    Raises:
        InvalidSettingsError: If a value is out of its range.

    Example:
        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x**2).sum(axis=0),
        ...     bounds=[(-1, 2)] * 3,
        ...     algorithm=ss.LSHADE(size=40),
        ...     budget=5000,
        ...     seed=0,
        ... )
        >>> bool(found.cost < 1e-6)
        True
    """

    kernels: ClassVar[Kernels] = Kernels(propose=propose, accept=accept)
    size: int | None = None
    smallest: int = LEAST_SIZE
    memory: int = 6
    archive: float = 2.6
    greediness: float = 0.11
    bound_handling: BoundHandling = "midpoint"

    def __post_init__(self) -> None:
        """Check the values."""
        ok = self.size is None or self.size >= self.smallest
        allowed = f"None or an integer of at least {self.smallest}"
        require("size", self.size, ok=ok, allowed=allowed)

    @classmethod
    @checked(InvalidSettingsError, dim=a_count(least=1))
    def as_published(cls, dim: int) -> "LSHADE":
        """The settings of the paper, for a box of `dim` dimensions."""
        return cls(size=PUBLISHED_SIZE * dim)

    def first_size(self, box: Box, evaluations: int | None) -> int:
        """Number of individuals N_0 of the first generation; see `size`."""
        del box
        if self.size is not None:
            return self.size
        size = FIRST_OF_UNKNOWN_BUDGET
        if evaluations is not None:
            size = evaluations // EVALUATIONS_EACH
        return max(self.smallest, min(max(size, SMALLEST_FIRST), LARGEST_FIRST))

    def kernel_settings(self, box: Box, order: RunningOrder) -> LSHADESettings:
        """The settings as numbers and arrays."""
        return LSHADESettings(
            lower=box.lower,
            upper=box.upper,
            order=order,
            smallest=self.smallest,
            archive=float(self.archive),
            greediness=float(self.greediness),
            bound_handling=CODES[self.bound_handling],
            free=box.free,
        )

    def start(
        self, box: Box, population: Array, *, rng: np.random.Generator
    ) -> LSHADEState:
        """The state before generation 0; arguments as in `Algorithm.start`."""
        del rng
        first = population.shape[1]
        # Population, archive, and the losers of a generation before it is trimmed.
        pool = np.zeros((box.dim, 2 * first + rounded(self.archive * first)))
        pool[:, :first] = population
        return LSHADEState(
            *common_fields(population),
            pool=pool,
            cost=np.full(first, np.inf),
            violation=np.full(first, np.inf),
            archived=np.zeros(1, dtype=np.int64),
            F_memory=np.full(self.memory, FIRST_MEMORY),
            CR_memory=np.full(self.memory, FIRST_MEMORY),
            slot=np.zeros(1, dtype=np.int64),
            F_trial=np.zeros(first),
            CR_trial=np.zeros(first),
        )
