"""Common part of the particle swarms: velocities, positions and memories.

A particle has the position x and the velocity v. With the inertia w, the accelerations
c1 and c2, and r1, r2 uniform in [0, 1), drawn anew for each coordinate of each
particle,

    v <- w v + c1 r1 (p - x) + c2 r2 (g - x),    |v| <= v_max                (2.11)
    x <- x + v

p is the best point that the particle has seen. g is the second point to which the
particle is drawn: the best point that any particle has seen (gbest), or the best p of
the particle itself and of the k nearest particles on a ring, k/2 on each side (lbest).
All particles move before any is evaluated.

Source: chapter 2, eq. (2.11); Shi and Eberhart (1998), A modified particle swarm
optimizer, IEEE International Conference on Evolutionary Computation; the ring is that
of Kennedy (1999), Small worlds and mega-minds, Congress on Evolutionary Computation.
"""

from typing import Protocol

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import (
    Settings,
    State,
    copy_column,
    take_generation,
)
from swarmstart.heuristics.laws.box import REDRAW, clip, repair, turned
from swarmstart.heuristics.laws.order import RunningOrder, better, precedes
from swarmstart.machine_code import kernel


class SwarmSettings(Settings, Protocol):
    """The fields of a swarm's kernel settings that the kernels here read."""

    @property
    def cognitive(self) -> float:
        """Acceleration c1 towards the particle's own best."""

    @property
    def social(self) -> float:
        """Acceleration c2 towards the attractor g."""

    @property
    def velocity_max(self) -> Array:
        """Largest speed v_max of each coordinate, shape (dim,); may be infinite."""


class SwarmState(State, Protocol):
    """The fields that the states of all swarms share."""

    @property
    def position(self) -> Array:
        """Positions x, shape (dim, size)."""

    @property
    def velocity(self) -> Array:
        """Velocities v, shape (dim, size)."""

    @property
    def personal(self) -> Array:
        """Best point p of each particle (personal best), shape (dim, size)."""

    @property
    def personal_cost(self) -> Array:
        """Costs of the personal bests, shape (size,)."""

    @property
    def personal_violation(self) -> Array:
        """Violations of the personal bests, shape (size,)."""


@kernel
def swarm_best(state: SwarmState) -> Array:
    """Return the best point seen as the attractor of each particle, (dim, size)."""
    # A column for each particle, as from `ring_best`: `fly` takes both.
    attractor = np.empty_like(state.position)
    for d in range(attractor.shape[0]):
        attractor[d, :] = state.best[d]
    return attractor


@kernel
def ring_best(order: RunningOrder, state: SwarmState, neighbours: int) -> Array:
    """Return the best personal best nearby on the ring, as attractor of each particle.

    If personal bests tie, the particle's own counts, then that of the lowest index.

    Args:
        order: The order of individuals.
        state: State of the swarm.
        neighbours: Number k of neighbours, even, below the number of particles.

    Returns:
        The attractors, shape (dim, size).
    """
    size = state.position.shape[1]
    cost, violation = state.personal_cost, state.personal_violation
    attractor = np.empty_like(state.position)
    for i in range(size):
        best = i
        for step in range(-(neighbours // 2), neighbours // 2 + 1):
            j = (i + step) % size
            if better(order, cost[j], violation[j], cost[best], violation[best]):
                best = j
        copy_column(state.personal, best, attractor, i)
    return attractor


@kernel
def fly(
    rng: np.random.Generator,
    inertia: float,
    attractor: Array,
    settings: SwarmSettings,
    state: SwarmState,
) -> None:
    """Move every particle by (2.11); `settings.bound_handling` keeps it in the box.

    Args:
        rng: Source of r1 and r2.
        inertia: Inertia weight w.
        attractor: Attractor g of each particle, shape (dim, size).
        settings: Kernel settings of the swarm.
        state: State of the swarm; position and velocity are changed in place.
    """
    dim, size = state.position.shape
    for i in range(size):
        for d in range(dim):
            x = state.position[d, i]
            r1 = rng.random()
            r2 = rng.random()
            v = (  # (2.11)
                inertia * state.velocity[d, i]
                + settings.cognitive * r1 * (state.personal[d, i] - x)
                + settings.social * r2 * (attractor[d, i] - x)
            )
            v = clip(v, -settings.velocity_max[d], settings.velocity_max[d])
            low, high, moved = settings.lower[d], settings.upper[d], x + v
            if not low <= moved <= high:  # Checked here: a call costs ten times more.
                rule = settings.bound_handling
                fraction = rng.random() if rule == REDRAW else 0.0
                moved = repair(rule, x + v, x, low, high, fraction)
                v = turned(rule, v, x + v, low, high)
            state.position[d, i] = moved
            state.velocity[d, i] = v


@kernel
def remember(
    settings: SwarmSettings,
    state: SwarmState,
    asked: Array,
    cost: Array,
    violation: Array,
) -> None:
    """Update the best of each particle and of the swarm: `accept` of every swarm.

    Args:
        settings: Kernel settings of the swarm.
        state: State of the swarm, changed in place.
        asked: Positions that were evaluated, shape (dim, size).
        cost: Costs at these positions, shape (size,).
        violation: Violations at these positions, shape (size,).
    """
    order = settings.order
    rule, weight, level = order.rule, order.weight, order.level[0]
    for i in range(cost.size):
        own, own_violation = state.personal_cost[i], state.personal_violation[i]
        if precedes(rule, weight, level, cost[i], violation[i], own, own_violation):
            copy_column(asked, i, state.personal, i)
            state.personal_cost[i] = cost[i]
            state.personal_violation[i] = violation[i]
    take_generation(settings.order, state, asked, cost, violation)
