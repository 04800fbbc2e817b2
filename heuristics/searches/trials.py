"""Trials made of differences of individuals, shared by DE, jDE and L-SHADE.

Each individual x_i gets a mutant v and a trial u, made with the individuals numbered b,
l, p and m (`Plan`) and the weight F_i,

    v   = x_b + F_i (x_l - x_b) + F_i (x_p - x_m)                    (mutation)
    u_d = v_d if the crossover takes it from the mutant, else x_id
    x_i <- u if u is not worse than x_i                              (selection)

The random numbers of a generation are drawn first, individual by individual; then the
trials are computed coordinate by coordinate, along the rows of the arrays.

F and the crossover rate CR may come from a memory of successful ones (SHADE, L-SHADE):
trial i draws them around a random slot of this memory; after the generation, the values
of successful trials are averaged into one slot. The equations are in `lshade`.

Source: Storn and Price (1997), Differential evolution - a simple and efficient
heuristic for global optimization over continuous spaces, Journal of Global
Optimization 11; the memory: Tanabe and Fukunaga (2014), Improving the search
performance of SHADE using linear population size reduction, IEEE Congress on
Evolutionary Computation.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import Settings
from swarmstart.heuristics.laws.box import REDRAW, repair
from swarmstart.heuristics.laws.order import (
    STATIC_PENALTY,
    RunningOrder,
    better,
    is_finite,
    precedes,
)
from swarmstart.machine_code import Count, kernel

Mask = NDArray[np.bool_]

FIRST_MEMORY = 0.5
"""M_F and M_CR at the beginning."""

SPREAD = 0.1
"""Scale of the distributions of F and CR around the memory."""

TERMINAL = -1.0
"""Code of the terminal value of M_CR."""

OF_COST, OF_VIOLATION = 0, 1
"""Kinds of improvement: of the cost, or of the violation."""

LARGEST_FLOAT = float(np.finfo(np.float64).max)


class Plan(NamedTuple):
    """The random choices for the trials of a generation.

    The mutant of a trial is x_b + F (x_l - x_b) + F (x_p - x_m), made from the
    individuals x with the indices b, l, p and m.

    Attributes:
        base: Index b of each trial, shape (size,).
        lead: Index l, shape (size,); equal to b if the formula has no l.
        plus: Index p, shape (size,).
        minus: Index m, shape (size,).
        F: Weight of the differences, shape (size,).
        mutated: Whether a coordinate comes from the mutant, shape (dim, size).
    """

    base: Count
    lead: Count
    plus: Count
    minus: Count
    F: Array
    mutated: Mask


@kernel
def new_plan(dim: int, size: int) -> Plan:
    """Return a plan to be filled, in which no coordinate is mutated."""
    return Plan(
        np.empty(size, dtype=np.int64),
        np.empty(size, dtype=np.int64),
        np.empty(size, dtype=np.int64),
        np.empty(size, dtype=np.int64),
        np.empty(size),
        np.zeros((dim, size), dtype=np.bool_),
    )


@kernel
def draw_index(rng: np.random.Generator, number: int) -> int:
    """Draw an index from 0 to `number` - 1."""
    return int(rng.random() * number)


@kernel
def draw_three_others(
    rng: np.random.Generator, size: int, i: int
) -> tuple[int, int, int]:
    """Draw three distinct individuals other than i, all triples equally likely."""
    r1 = i
    while r1 == i:  # Rejection: all triples stay equally likely.
        r1 = draw_index(rng, size)
    r2 = i
    while r2 in (i, r1):
        r2 = draw_index(rng, size)
    r3 = i
    while r3 in (i, r1, r2):
        r3 = draw_index(rng, size)
    return r1, r2, r3


@kernel
def draw_two_others(
    rng: np.random.Generator, size: int, i: int, room: int
) -> tuple[int, int]:
    """Draw two distinct individuals other than i, all pairs equally likely.

    There is no rejection: an index is drawn among those left, then shifted past the
    excluded ones.

    Args:
        rng: Source of randomness.
        size: Upper limit of the first index, exclusive.
        i: An index below size.
        room: Upper limit of the second index, exclusive; at least size.
    """
    r1 = draw_index(rng, size - 1)
    r1 += int(r1 >= i)
    r2 = draw_index(rng, room - 2)
    r2 += int(r2 >= min(i, r1))
    r2 += int(r2 >= max(i, r1))
    return r1, r2


@kernel
def cross_binomially(
    rng: np.random.Generator, CR: float, free: Count, mutated: Mask, i: int
) -> None:
    """Take each coordinate from the mutant with probability CR.

    One coordinate, drawn among those that are not fixed, is taken in any case.

    Args:
        rng: Source of randomness.
        CR: Probability that a coordinate comes from the mutant.
        free: Indices of the variables that are not fixed.
        mutated: Mask of which column i is filled, shape (dim, size).
        i: Index of the trial.
    """
    dim = mutated.shape[0]
    k = free[draw_index(rng, free.size)]  # Else a trial may equal its parent.
    for d in range(dim):
        mutated[d, i] = rng.random() < CR
    mutated[k, i] = True


@kernel
def cross_exponentially(
    rng: np.random.Generator, CR: float, free: Count, mutated: Mask, i: int
) -> None:
    """Take successive coordinates from the mutant, beginning at a random free one.

    After each coordinate, the next one is taken, too, with probability CR; the first
    coordinate follows the last. Column i of `mutated` must be False before; arguments
    as in `cross_binomially`.
    """
    dim = mutated.shape[0]
    d = free[draw_index(rng, free.size)]
    for _ in range(dim):
        mutated[d, i] = True
        d = d + 1 if d + 1 < dim else 0
        if rng.random() >= CR:
            break


@kernel
def fill_trials(
    rng: np.random.Generator,
    settings: Settings,
    x: Array,
    plan: Plan,
    asked: Array,
) -> None:
    """Compute the trials of a generation.

    Args:
        rng: Source of randomness, used only if the settings repair bounds by `redraw`.
        settings: Settings of the algorithm.
        x: Individuals as columns, those with a trial first, shape (dim, any).
        plan: The random choices for the trials.
        asked: Filled with the trials, shape (dim, size).
    """
    dim, size = asked.shape
    base, lead, plus, minus = plan.base, plan.lead, plan.plus, plan.minus
    F, rule = plan.F, settings.bound_handling
    for d in range(dim):
        row, out, mutated = x[d], asked[d], plan.mutated[d]
        low, high = settings.lower[d], settings.upper[d]
        outside = 0
        for i in range(size):
            value = row[base[i]]
            pull = row[lead[i]] - value
            value += F[i] * pull
            value += F[i] * (row[plus[i]] - row[minus[i]])
            value = value if mutated[i] else row[i]
            out[i] = value
            outside += not low <= value <= high
        if outside == 0:  # As a rule: then there is no second pass.
            continue
        for i in range(size):
            if not low <= out[i] <= high and mutated[i]:
                fraction = rng.random() if rule == REDRAW else 0.0
                out[i] = repair(rule, out[i], row[i], low, high, fraction)


@kernel
def select(
    order: RunningOrder,
    parents: tuple[Array, Array, Array],
    asked: Array,
    cost: Array,
    violation: Array,
) -> Mask:
    """Let a trial replace its parent if it is not worse.

    Before generation 0 the costs of the parents are infinite, so that all individuals
    of generation 0 are accepted.

    Args:
        order: The order of individuals.
        parents: Points of the parents, shape (dim, at least size), their costs and
            their violations, each (at least size,); all changed in place.
        asked: Trials, shape (dim, size).
        cost: Costs of the trials, shape (size,).
        violation: Violations of the trials, shape (size,).

    Returns:
        Mask of the parents that were replaced, shape (size,).
    """
    points, parent_cost, parent_violation = parents
    dim, size = asked.shape
    replaced = np.empty(size, dtype=np.bool_)
    rule, weight, level = order.rule, order.weight, order.level[0]
    for i in range(size):
        old, old_violation = parent_cost[i], parent_violation[i]
        replaced[i] = not precedes(
            rule, weight, level, old, old_violation, cost[i], violation[i]
        )
        if replaced[i]:
            parent_cost[i] = cost[i]
            parent_violation[i] = violation[i]
    for d in range(dim):
        row, trial = points[d], asked[d]
        for i in range(size):
            row[i] = trial[i] if replaced[i] else row[i]
    return replaced


class Remembering(Protocol):
    """The part of an algorithm's state that the kernels here read and change."""

    @property
    def cost(self) -> Array:
        """Costs of the parents, shape (at least size,)."""

    @property
    def violation(self) -> Array:
        """Violations of the parents, shape (at least size,)."""

    @property
    def F_memory(self) -> Array:  # noqa: N802 - a field
        """Weights M_F of the memory, shape (H,)."""

    @property
    def CR_memory(self) -> Array:  # noqa: N802 - a field
        """Crossover rates M_CR of the memory, shape (H,)."""

    @property
    def slot(self) -> Count:
        """Index of the slot of the memory that is updated next, int64, shape (1,)."""

    @property
    def F_trial(self) -> Array:  # noqa: N802 - a field
        """Weights of the trials asked last, shape (at least size,)."""

    @property
    def CR_trial(self) -> Array:  # noqa: N802 - a field
        """Crossover rates of the trials asked last, shape (at least size,)."""


@kernel
def draw_parameters(rng: np.random.Generator, state: Remembering, i: int) -> None:
    """Draw F and CR of individual i's trial."""
    slot = draw_index(rng, state.F_memory.size)
    CR = state.CR_memory[slot]
    if CR != TERMINAL:
        CR += SPREAD * rng.standard_normal()
    state.CR_trial[i] = min(max(CR, 0.0), 1.0)
    F = 0.0
    while F <= 0.0:  # As published; only values above 1 are cut.
        cauchy = math.tan(math.pi * (rng.random() - 0.5))
        F = state.F_memory[slot] + SPREAD * cauchy
    state.F_trial[i] = min(F, 1.0)


@kernel
def measure_improvements(
    order: RunningOrder,
    state: Remembering,
    cost: Array,
    violation: Array,
    improvement: Array,
) -> None:
    """Fill in each trial's improvement on its parent, in [0, 1]; 0 for a worse trial.

    Improvements of the cost are divided by the largest of them, and so are those of the
    violation: units do not matter.
    """
    largest = np.zeros(2)
    for i in range(cost.size):
        old, old_violation = state.cost[i], state.violation[i]
        improvement[i] = 0.0
        if is_finite(old, old_violation) and better(
            order, cost[i], violation[i], old, old_violation
        ):
            gain = old - cost[i]
            kind = kind_of(order, violation[i], old_violation)
            if kind == OF_VIOLATION:
                gain = old_violation - violation[i]
            elif order.rule == STATIC_PENALTY:
                penalised = cost[i] + order.weight * violation[i]
                gain = old + order.weight * old_violation - penalised
            improvement[i] = min(gain, LARGEST_FLOAT)  # A difference may overflow.
            largest[kind] = max(largest[kind], improvement[i])
    for i in range(cost.size):
        if improvement[i] > 0.0:
            improvement[i] /= largest[kind_of(order, violation[i], state.violation[i])]


@kernel
def kind_of(order: RunningOrder, violation: float, old_violation: float) -> int:
    """Return the kind of a better trial's improvement: OF_COST or OF_VIOLATION."""
    if order.rule == STATIC_PENALTY or max(violation, old_violation) <= order.level[0]:
        return OF_COST
    return OF_VIOLATION


@kernel
def remember(state: Remembering, improvement: Array) -> None:
    """Update one slot of the memory with the Lehmer means of successful F and CR.

    The weight of a trial is its improvement; without any improvement the memory stays.
    """
    sum_F = sum_FF = sum_CR = sum_CRCR = 0.0
    for i in range(improvement.size):
        F, CR, weight = state.F_trial[i], state.CR_trial[i], improvement[i]
        sum_F += weight * F
        sum_FF += weight * F * F
        sum_CR += weight * CR
        sum_CRCR += weight * CR * CR
    if sum_F == 0.0:  # No trial was better: the memory and its slot stay.
        return
    slot = state.slot[0]
    state.F_memory[slot] = sum_FF / sum_F
    # A slot whose successful rates were all 0 keeps CR = 0 for ever.
    if state.CR_memory[slot] == TERMINAL or sum_CR == 0.0:
        state.CR_memory[slot] = TERMINAL
    else:
        state.CR_memory[slot] = sum_CRCR / sum_CR
    state.slot[0] = (slot + 1) % state.F_memory.size
