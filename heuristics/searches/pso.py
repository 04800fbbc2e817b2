"""Particle swarm with constant coefficients, with a global best or on a ring.

A particle has the position x and the velocity v. With the inertia w, the accelerations
c1 and c2, and r1, r2 uniform in [0, 1), drawn anew for each coordinate of each
particle,

    v <- w v + c1 r1 (p - x) + c2 r2 (g - x),    |v| <= v_max                (2.11)
    x <- x + v

with p the particle's best point, and g the best point of its neighbourhood (see
`swarm`). w, c1 and c2 may also follow from a constriction (Clerc and Kennedy), which is
the same update with a single number phi > 4,

    v <- chi (v + phi/2 r1 (p - x) + phi/2 r2 (g - x))
    chi = 2 / (phi - 2 + sqrt(phi^2 - 4 phi)),    w = chi,  c1 = c2 = chi phi / 2

The defaults, w = 0.7298 and c1 = c2 = 1.496, are those of phi = 4.1, rounded. Particles
start with half the way to another random point as velocity (Clerc, Standard PSO 2007).

Source: Clerc and Kennedy (2002), The particle swarm - explosion, stability, and
convergence in a multidimensional complex space, IEEE Transactions on Evolutionary
Computation 6(1), type 1'' with kappa = 1.
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
    OfFixedSize,
    common_fields,
    copy_points,
    require,
)
from swarmstart.heuristics.laws.box import CODES, BoundHandling, Box
from swarmstart.heuristics.laws.initial import sample_uniform
from swarmstart.heuristics.laws.order import RunningOrder
from swarmstart.heuristics.searches.swarm import (
    fly,
    remember,
    ring_best,
    swarm_best,
)
from swarmstart.machine_code import Count, kernel

PHI_LEAST = 4.0
"""Sum of accelerations at which constriction begins (Clerc and Kennedy 2002)."""


class ParticleSwarmSettings(NamedTuple):
    """Settings for the kernels; fields as in `ParticleSwarm` and `SwarmSettings`."""

    lower: Array
    upper: Array
    order: RunningOrder
    inertia: float
    cognitive: float
    social: float
    velocity_max: Array
    bound_handling: int
    neighbours: int


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
    """Move all particles by (2.11), except in generation 0."""
    if state.generation[0] > 0:
        if settings.neighbours > 0:
            attractor = ring_best(settings.order, state, settings.neighbours)
        else:
            attractor = swarm_best(state)
        fly(rng, settings.inertia, attractor, settings, state)
    copy_points(state.position, asked)


@checked(
    InvalidSettingsError,
    size=a_count(least=1),
    inertia=a_number(least=0, most=1),
    cognitive=a_number(least=0),
    social=a_number(least=0),
    neighbours=optional(a_count(least=2)),
    velocity_max=optional(a_number(above=0)),
    bound_handling=BOUND_HANDLING,
)
@dataclass(frozen=True, kw_only=True, slots=True)
class ParticleSwarm(OfFixedSize, BoundHandled):
    """Settings of a particle swarm.

    Attributes:
        size: Number of particles, at least 1.
        inertia: Inertia weight w, in [0, 1].
        cognitive: Acceleration c1 towards the particle's own best, at least 0.
        social: Acceleration c2 towards the neighbourhood's best, at least 0.
        neighbours: Number of others on the ring that a particle looks at, half of them
            on each side: even, at least 2, below size. None means the whole swarm
            (gbest).
        velocity_max: Largest speed in each coordinate, as a fraction of the width of
            the box (that of `ChaoticPSO` is in the units of the variables); None means
            no limit.
        bound_handling: What happens to a particle that would leave the box; see the
            module `box`.

    Raises:
        InvalidSettingsError: If a value is out of its range.

    Example:
        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x**2).sum(axis=0),
        ...     bounds=[(-1, 2)] * 3,
        ...     algorithm=ss.ParticleSwarm(size=30, neighbours=2),
        ...     budget=5000,
        ...     seed=0,
        ... )
        >>> bool(found.cost < 1e-3)
        True
    """

    kernels: ClassVar[Kernels] = Kernels(propose=propose, accept=remember)
    size: int = 20
    inertia: float = 0.7298
    cognitive: float = 1.496
    social: float = 1.496
    neighbours: int | None = None
    velocity_max: float | None = None
    bound_handling: BoundHandling = "reflect"

    def __post_init__(self) -> None:
        """Check the values."""
        k = self.neighbours
        ok = k is None or (k % 2 == 0 and k < self.size)
        allowed = f"None or even, at least 2 and below size = {self.size}"
        require("neighbours", k, ok=ok, allowed=allowed)

    @classmethod
    @checked(InvalidSettingsError, phi=a_number(above=PHI_LEAST))
    def constricted(cls, phi: float = 4.1) -> "ParticleSwarm":
        """The settings with the coefficients that constriction gives.

        Args:
            phi: Sum of the two accelerations before constriction, above 4.

        Returns:
            Settings with w = chi and c1 = c2 = chi phi / 2. All others have their
            defaults, which `dataclasses.replace` can change.

        Raises:
            InvalidSettingsError: If phi is not finite and above 4.

        Source: Clerc and Kennedy (2002).
        """
        chi = 2.0 / (phi - 2.0 + math.sqrt(phi * phi - 4.0 * phi))
        each = 0.5 * chi * phi
        return cls(inertia=chi, cognitive=each, social=each)

    def kernel_settings(self, box: Box, order: RunningOrder) -> ParticleSwarmSettings:
        """The settings as numbers and arrays."""
        velocity_max = np.full(box.dim, np.inf)
        if self.velocity_max is not None:
            velocity_max = self.velocity_max * box.width
        return ParticleSwarmSettings(
            lower=box.lower,
            upper=box.upper,
            order=order,
            inertia=float(self.inertia),
            cognitive=float(self.cognitive),
            social=float(self.social),
            velocity_max=velocity_max,
            bound_handling=CODES[self.bound_handling],
            neighbours=self.neighbours or 0,  # 0: the whole swarm.
        )

    def start(
        self, box: Box, population: Array, *, rng: np.random.Generator
    ) -> ParticleSwarmState:
        """The state before generation 0; arguments as in `Algorithm.start`."""
        elsewhere = sample_uniform(box, self.size, rng=rng)
        return ParticleSwarmState(
            *common_fields(population),
            position=population.copy(),
            velocity=0.5 * (elsewhere - population),  # SPSO 2007
            personal=population.copy(),
            personal_cost=np.full(self.size, np.inf),
            personal_violation=np.full(self.size, np.inf),
        )
