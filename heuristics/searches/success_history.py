"""The memory of successful parameters, of SHADE and L-SHADE.

Trial i draws its weight F and its crossover rate CR around a random slot of the memory;
after the generation those of the successful trials are averaged into one slot. The
equations are in `lshade`.

Source: Tanabe and Fukunaga (2014), Improving the search performance of SHADE using
linear population size reduction, IEEE Congress on Evolutionary Computation.
"""

import math
from typing import Protocol

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics.laws.order import (
    STATIC_PENALTY,
    RunningOrder,
    better,
    is_finite,
)
from swarmstart.heuristics.searches.trials import draw_index
from swarmstart.machine_code import Count, kernel

FIRST_MEMORY = 0.5
"""M_F and M_CR at the beginning."""

SPREAD = 0.1
"""Scale of the distributions of F and CR around the memory."""

TERMINAL = -1.0
"""Code of the terminal value of M_CR."""

OF_COST, OF_VIOLATION = 0, 1
"""Kinds of improvement: of the cost, or of the violation."""

LARGEST_FLOAT = float(np.finfo(np.float64).max)


class Remembering(Protocol):
    """The part of an algorithm's state that the kernels here read and change."""

    @property
    def cost(self) -> Array:
        """Costs of the parents, shape (at least size,)."""

    @property
    def violation(self) -> Array:
        """Their violations, same shape."""

    @property
    def F_memory(self) -> Array:  # noqa: N802 - a field
        """M_F, shape (H,)."""

    @property
    def CR_memory(self) -> Array:  # noqa: N802 - a field
        """M_CR, shape (H,)."""

    @property
    def slot(self) -> Count:
        """The slot of the memory that is next, int64, shape (1,)."""

    @property
    def F_trial(self) -> Array:  # noqa: N802 - a field
        """Weights of the trials asked last, shape (at least size,)."""

    @property
    def CR_trial(self) -> Array:  # noqa: N802 - a field
        """Their crossover rates, same shape."""


@kernel
def draw_parameters(rng: np.random.Generator, state: Remembering, i: int) -> None:
    """Draw F and CR of individual i's trial."""
    slot = draw_index(rng, state.F_memory.size)
    CR = state.CR_memory[slot]
    if CR != TERMINAL:
        CR += SPREAD * rng.standard_normal()
    state.CR_trial[i] = min(max(CR, 0.0), 1.0)
    F = 0.0
    while F <= 0.0:
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
    """Fill in the improvement of each trial on its parent, in [0, 1]; 0 if it is worse.

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
            improvement[i] = min(gain, LARGEST_FLOAT)
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
    """Update one slot of the memory with the weighted Lehmer means."""
    sum_F = sum_FF = sum_CR = sum_CRCR = 0.0
    for i in range(improvement.size):
        F, CR, weight = state.F_trial[i], state.CR_trial[i], improvement[i]
        sum_F += weight * F
        sum_FF += weight * F * F
        sum_CR += weight * CR
        sum_CRCR += weight * CR * CR
    if sum_F == 0.0:
        return
    slot = state.slot[0]
    state.F_memory[slot] = sum_FF / sum_F
    if state.CR_memory[slot] == TERMINAL or sum_CR == 0.0:
        state.CR_memory[slot] = TERMINAL
    else:
        state.CR_memory[slot] = sum_CRCR / sum_CR
    state.slot[0] = (slot + 1) % state.F_memory.size
