"""Particle swarm with one neighbourhood (gbest) and constant inertia.

Equation (2.11) (see `swarm`) with w = 0.7298 and c1 = c2 = 1.496, the constriction of
Clerc and Kennedy (2002), IEEE Transactions on Evolutionary Computation 6(1). Particles
start with half the way to another random point as velocity (Clerc, Standard PSO 2007).
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
)
from swarmstart.heuristics.bounds import CODES, Bounds
from swarmstart.heuristics.box import Box
from swarmstart.heuristics.kernel import Array, Count, kernel
from swarmstart.heuristics.order import RunningOrder
from swarmstart.heuristics.sampling import sample_uniform
from swarmstart.heuristics.swarm import fly, remember, require_accelerations


class ParticleSwarmSettings(NamedTuple):
    """What the kernels read; fields as in `ParticleSwarm` and `SwarmSettings`."""

    lower: Array
    upper: Array
    order: RunningOrder
    inertia: float
    cognitive: float
    social: float
    velocity_max: Array
    bounds: int


class ParticleSwarmState(NamedTuple):
    """State of a `ParticleSwarm`; fields as in `SwarmState`."""

    generation: Count
    progress: Array
    best: Array
    best_cost: Array
    best_violation: Array
    nonfinite: Count
    size: Count
    evaluations: Count
    improved: Count
    position: Array
    velocity: Array
    personal: Array
    personal_cost: Array
    personal_violation: Array


@kernel
def propose(
    rng: np.random.Generator,
    settings: ParticleSwarmSettings,
    state: ParticleSwarmState,
    asked: Array,
) -> None:
    """Fly by (2.11), except in generation 0."""
    if state.generation[0] > 0:
        fly(rng, settings.inertia, settings, state)
    asked[:] = state.position


@dataclass(frozen=True, kw_only=True, slots=True)
class ParticleSwarm:
    """Settings of a particle swarm.

    Attributes:
        size: Number of particles, at least 1.
        inertia: Inertia weight w, in [0, 1].
        cognitive: Acceleration c1 towards the particle's own best, at least 0.
        social: Acceleration c2 towards the swarm's best, at least 0.
        velocity_max: Largest speed in each coordinate, as a fraction of the width of
            the box; None means no limit.
        bounds: What happens to a particle that would leave the box; see `bounds`.

    Raises:
        InvalidSettingsError: If a value is out of its range.
    """

    size: int = 20
    inertia: float = 0.7298
    cognitive: float = 1.496
    social: float = 1.496
    velocity_max: float | None = None
    bounds: Bounds = "reflect"

    def __post_init__(self) -> None:
        """Check the values."""
        require_size(self.size, at_least=1)
        ok = 0.0 <= self.inertia <= 1.0
        require("inertia", self.inertia, ok=ok, allowed="in [0, 1]")
        require_accelerations(self.cognitive, self.social)
        ok = self.velocity_max is None or 0.0 < self.velocity_max < np.inf
        allowed = "None or finite and above 0"
        require("velocity_max", self.velocity_max, ok=ok, allowed=allowed)
        require_bounds(self.bounds)

    @property
    def kernels(self) -> Kernels:
        """The two compiled functions."""
        return Kernels(propose=propose, accept=remember)

    def first_size(self, box: Box, evaluations: int | None) -> int:
        """Number of individuals of every generation."""
        del box, evaluations
        return self.size

    def kernel_settings(self, box: Box, order: RunningOrder) -> ParticleSwarmSettings:
        """The settings as numbers and arrays."""
        fraction = np.inf if self.velocity_max is None else self.velocity_max
        return ParticleSwarmSettings(
            lower=box.lower,
            upper=box.upper,
            order=order,
            inertia=float(self.inertia),
            cognitive=float(self.cognitive),
            social=float(self.social),
            velocity_max=fraction * box.width,
            bounds=CODES[self.bounds],
        )

    def start(
        self, box: Box, population: Array, *, rng: np.random.Generator
    ) -> ParticleSwarmState:
        """The state before generation 0; arguments as in `Algorithm.start`."""
        elsewhere = sample_uniform(box, self.size, rng=rng)
        return ParticleSwarmState(
            *common_fields(population),
            position=population.copy(),
            velocity=0.5 * (elsewhere - population),
            personal=population.copy(),
            personal_cost=np.full(self.size, np.inf),
            personal_violation=np.full(self.size, np.inf),
        )
