"""Chaotic particle swarm of chapter 5 (Duan and Liu 2010).

This is the swarm of (2.11) (see `swarm`), with ps particles at p_i, an inertia w that
falls during the run,

    w = w_max - iter_k (w_max - w_min) / iter_max                            (5.19)

and reseeding: as soon as the particles have come together,

    D(iter_k) = 1 / (ps L) sum_i |p_i - P| < eps,    P the mean of the p_i   (5.18)

(eps a threshold, L the length of the search space) the worse half is placed anew by
numbers Z_n of the logistic map

    Z_{n+1} = mu Z_n (1 - Z_n),    mu = 4                                    (5.17)

The numbers of this map follow the arcsine law, Beta(1/2, 1/2): they crowd at 0 and 1.
The map runs in float64; in float32 its orbits soon fall into the fixed point 0.

Source: chapter 5 of the book (docs/chapter), section 5.2.3.3, eq. (5.17)-(5.19), steps
4 to 8; Duan and Liu (2010); the map: May (1976), Nature 261. The docstring of
`ChaoticPSO` says how gaps of the text are filled.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from swarmstart.arguments import a_count, a_number, checked, choice, optional, reals
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
from swarmstart.heuristics.laws.box import CODES, BoundHandling, Box, between
from swarmstart.heuristics.laws.initial import smooth_in
from swarmstart.heuristics.laws.order import RunningOrder, better
from swarmstart.heuristics.searches.swarm import (
    fly,
    remember,
    swarm_best,
)
from swarmstart.machine_code import Count, kernel

Reseed = Literal["logistic", "uniform", "none"]
InitialVelocity = Literal["independent", "smooth"]

SPEED = 0.4
"""Default of the largest speed, as a fraction of the width of the box."""

NONE, UNIFORM, LOGISTIC = 0, 1, 2
RESEED_CODES: dict[str, int] = {"none": NONE, "uniform": UNIFORM, "logistic": LOGISTIC}

MU = 4.0
TRAPS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Fixed points of the map and the points that lead to one; no seeds (5.17)."""


class ChaoticPSOSettings(NamedTuple):
    """Settings for the kernels; fields as in `ChaoticPSO` and `SwarmSettings`."""

    lower: Array
    upper: Array
    order: RunningOrder
    inertia_max: float
    inertia_min: float
    cognitive: float
    social: float
    velocity_max: Array
    bound_handling: int
    reseed: int
    diversity_threshold: float
    search_length: float
    scale: Array


class ChaoticPSOState(NamedTuple):
    """State of a `ChaoticPSO`; fields as in `SwarmState`, and two of its own.

    Attributes:
        chaos: Logistic number of each coordinate of each particle, shape (dim, size).
        reseeds: Number of times the worse half was placed anew, int64, shape (1,).
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
    position: Array
    velocity: Array
    personal: Array
    personal_cost: Array
    personal_violation: Array
    chaos: Array
    reseeds: Count


@kernel
def propose(
    rng: np.random.Generator,
    settings: ChaoticPSOSettings,
    state: ChaoticPSOState,
    asked: Array,
) -> None:
    """Place the worse half anew if the swarm has converged, then move all particles.

    Equations (5.18), (5.17), (5.19), (2.11); steps 6, 7, 5. In generation 0 nothing
    moves.
    """
    if state.generation[0] > 0:
        if settings.reseed != NONE and has_converged(settings, state):  # step 6
            place_worse_half(rng, settings, state)  # step 7
        fly(rng, inertia(settings, state), swarm_best(state), settings, state)  # step 5
    copy_points(state.position, asked)


@kernel
def inertia(settings: ChaoticPSOSettings, state: ChaoticPSOState) -> float:
    """Inertia weight w (5.19)."""
    span = settings.inertia_max - settings.inertia_min
    return settings.inertia_max - float(state.progress[0]) * span


@kernel
def has_converged(settings: ChaoticPSOSettings, state: ChaoticPSOState) -> bool:
    """Return whether the particles have come together: D < eps (5.18)."""
    distance = mean_distance(state.position, settings.scale)
    diversity = distance / settings.search_length
    return bool(diversity < settings.diversity_threshold)


@kernel
def mean_distance(position: Array, scale: Array) -> float:
    """Mean distance of the particles from their mean: L D(iter_k) of (5.18).

    Args:
        position: Positions, shape (dim, size).
        scale: Factor by which each coordinate is multiplied first, shape (dim,).

    Returns:
        The distance; if `scale` is 1, in the units of the variables.
    """
    dim, size = position.shape
    squares = np.zeros(size)
    for d in range(dim):
        mean = 0.0  # P_d
        for i in range(size):
            mean += position[d, i] / size
        for i in range(size):
            offset = (position[d, i] - mean) * scale[d]
            squares[i] += offset * offset
    total = 0.0
    for i in range(size):
        total += math.sqrt(squares[i])
    return float(total / size)


@kernel
def place_worse_half(
    rng: np.random.Generator,
    settings: ChaoticPSOSettings,
    state: ChaoticPSOState,
) -> None:
    """Place the worse half anew, over the whole box (step 7).

    Particles are compared by their personal bests; of two that tie, the later one is
    the worse. Only positions change: personal bests and velocities are kept. Every
    orbit takes one step of (5.17), whether its particle is placed or not.
    """
    dim, size = state.position.shape
    if settings.reseed == LOGISTIC:
        logistic(state.chaos)  # (5.17)
        leave_traps(rng, state.chaos)
    for i in range(size):
        if number_ahead(settings.order, state, i) < size - size // 2:
            continue
        for d in range(dim):
            z = state.chaos[d, i] if settings.reseed == LOGISTIC else rng.random()
            state.position[d, i] = between(settings.lower[d], settings.upper[d], z)
    state.reseeds[0] += 1


@kernel
def number_ahead(order: RunningOrder, state: ChaoticPSOState, i: int) -> int:
    """Count personal bests better than that of i, or as good and of a lower index."""
    cost, violation = state.personal_cost, state.personal_violation
    ahead = 0
    for j in range(cost.size):
        if better(order, cost[j], violation[j], cost[i], violation[i]):
            ahead += 1
        elif j < i and not better(order, cost[i], violation[i], cost[j], violation[j]):
            ahead += 1
    return ahead


@checked(
    InvalidSettingsError,
    size=a_count(least=2),
    inertia_max=a_number(least=0),
    inertia_min=a_number(least=0),
    cognitive=a_number(least=0),
    social=a_number(least=0),
    velocity_max=optional(reals()),
    initial_velocity=choice(("independent", "smooth")),
    reseed=choice(RESEED_CODES),
    diversity_threshold=a_number(least=0, finite=False),
    search_length=optional(a_number(above=0)),
    bound_handling=BOUND_HANDLING,
)
@dataclass(frozen=True, kw_only=True, slots=True)
class ChaoticPSO(OfFixedSize, BoundHandled):
    """Settings of the chaotic particle swarm; the defaults are those of the text.

    The one exception is `bound_handling`: the text uses clip. For problems other than
    the text's, c1 = c2 = 1.496 is recommended.

    velocity_max and search_length are in the units of the variables, as in the text.
    With None for both, nothing depends on those units.

    The text leaves some points open. Here:

    - Velocities start uniform in [-velocity_max, velocity_max]: independent of each
      other, or smooth in time (`initial`). The choice matters if velocity_max is large
      compared with the box: while the inertia is above 1, each coordinate stays for
      dozens of generations at the bound that its first velocity points to.
    - (5.18) is measured on the positions that were evaluated last, before they move,
      on raw coordinates. A swarm whose particles all start at one point (the shifted
      last plan) has D = 0 and reseeds at once; this reseeding spreads half of the
      particles.
    - Reseeded particles then move like all others. Personal bests and velocities are
      kept.
    - Step 7 ends "go to Step 4", which would initialise the swarm for ever; here Step 5
      follows.
    - Particles are kept in the box by `reflect`. The text uses `clip`, under which they
      keep their velocities.
    - iter_k / iter_max of (5.19) is the fraction of the evaluation budget used.

    Attributes:
        size: Number of particles ps, at least 2.
        inertia_max: Inertia weight w_max at the start of the run.
        inertia_min: Inertia weight w_min at its end, in [0, inertia_max].
        cognitive: Acceleration c1 towards the particle's own best, at least 0.
        social: Acceleration c2 towards the swarm's best, at least 0.
        velocity_max: Largest speed, above 0, in the units of the variables (as in the
            text; that of `ParticleSwarm` is a fraction of the box): one number, or one
            for each variable, shape (dim,) (kept as a tuple). None means 0.4 of the
            width of the box in each variable, the text's ratio to search_length.
        initial_velocity: First velocities: "independent", or "smooth" in time, which
            needs a box whose variables are a sequence (`Box.per_step`).
        reseed: Source of the numbers that place particles: "logistic" (5.17),
            "uniform" (uniform random numbers instead), or "none" (no reseeding).
        diversity_threshold: Threshold eps of (5.18), at least 0; the swarm reseeds when
            D < eps.
        search_length: Length L of (5.18), above 0, in the units of the variables; None
            means that each variable is measured in widths of the box, and L = 1.
        bound_handling: What happens to a particle that would leave the box; see the
            module `box`.

    Raises:
        InvalidSettingsError: If a value is out of its range.

    Source: chapter 5, section 5.2.4 (parameters).

    Example:
        Lengths taken from the box, so that nothing depends on the units:

        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x**2).sum(axis=0),
        ...     bounds=[(-1, 2)] * 3,
        ...     algorithm=ss.ChaoticPSO(velocity_max=None, search_length=None),
        ...     budget=5000,
        ...     seed=0,
        ... )
        >>> bool(found.cost < 1e-3)
        True
    """

    kernels: ClassVar[Kernels] = Kernels(propose=propose, accept=remember)
    size: int = 20
    inertia_max: float = 1.2
    inertia_min: float = 0.1
    cognitive: float = 0.5
    social: float = 0.5
    velocity_max: float | Sequence[float] | Array | None = 4.0
    initial_velocity: InitialVelocity = "independent"
    reseed: Reseed = "logistic"
    diversity_threshold: float = 0.01
    search_length: float | None = 10.0
    bound_handling: BoundHandling = "reflect"

    def __post_init__(self) -> None:
        """Check the values."""
        ok = self.inertia_min <= self.inertia_max
        allowed = f"at most inertia_max = {self.inertia_max}"
        require("inertia_min", self.inertia_min, ok=ok, allowed=allowed)
        if self.velocity_max is not None:
            self._keep_velocity_max()

    def _keep_velocity_max(self) -> None:
        """Check the largest speed; keep a vector as a tuple."""
        velocity_max = np.asarray(self.velocity_max, dtype=np.float64)
        positive = (velocity_max > 0.0) & (velocity_max < np.inf)
        ok = velocity_max.ndim <= 1 and bool(np.all(positive))
        allowed = "None or finite and above 0: a number, or a vector of numbers"
        require("velocity_max", self.velocity_max, ok=ok, allowed=allowed)
        if velocity_max.ndim == 1:
            object.__setattr__(self, "velocity_max", tuple(velocity_max.tolist()))

    def kernel_settings(self, box: Box, order: RunningOrder) -> ChaoticPSOSettings:
        """The settings as numbers and arrays.

        Raises:
            InvalidSettingsError: If velocity_max is a vector of another length.
        """
        scale = np.ones(box.dim)
        if self.search_length is None:
            scale /= np.where(box.width > 0.0, box.width, 1.0)
        return ChaoticPSOSettings(
            lower=box.lower,
            upper=box.upper,
            order=order,
            inertia_max=float(self.inertia_max),
            inertia_min=float(self.inertia_min),
            cognitive=float(self.cognitive),
            social=float(self.social),
            velocity_max=self._velocity_max(box),
            bound_handling=CODES[self.bound_handling],
            reseed=RESEED_CODES[self.reseed],
            diversity_threshold=float(self.diversity_threshold),
            search_length=float(self.search_length or 1.0),
            scale=scale,
        )

    def start(
        self, box: Box, population: Array, *, rng: np.random.Generator
    ) -> ChaoticPSOState:
        """The state before generation 0; arguments as in `Algorithm.start`.

        Raises:
            InvalidSettingsError: If smooth velocities are asked for in a box whose
                variables are no sequence.
        """
        velocity_max = self._velocity_max(box)[:, None]
        fractions = self._velocity_fractions(box, population.shape, rng)
        return ChaoticPSOState(
            *common_fields(population),
            position=population.copy(),
            velocity=velocity_max * (2.0 * fractions - 1.0),
            personal=population.copy(),
            personal_cost=np.full(self.size, np.inf),
            personal_violation=np.full(self.size, np.inf),
            chaos=draw_seeds((box.dim, self.size), rng=rng),
            reseeds=np.zeros(1, dtype=np.int64),
        )

    def _velocity_fractions(
        self, box: Box, shape: tuple[int, ...], rng: np.random.Generator
    ) -> Array:
        """Draw the first velocities as fractions, uniform in (0, 1), of this shape."""
        if self.initial_velocity == "independent":
            return rng.random(shape)
        if box.per_step is None:
            allowed = "independent, in a box without per_step"
            raise InvalidSettingsError("initial_velocity", "smooth", allowed)
        return smooth_in(box, self.size, rng=rng)

    def _velocity_max(self, box: Box) -> Array:
        """Largest speed of each variable, shape (dim,), a new array."""
        if self.velocity_max is None:
            return SPEED * box.width
        velocity_max = np.asarray(self.velocity_max, dtype=np.float64)
        if velocity_max.ndim == 1 and velocity_max.size != box.dim:
            allowed = f"a number or a vector of {box.dim}, one for each variable"
            raise InvalidSettingsError("velocity_max", self.velocity_max, allowed)
        return np.full(box.dim, velocity_max)


@kernel
def logistic(z: Array) -> None:
    """Advance every orbit by one step of the map (5.17).

    Args:
        z: Chaotic numbers in (0, 1), shape (dim, size), changed in place.
    """
    dim, size = z.shape
    for d in range(dim):
        for i in range(size):
            z[d, i] = MU * z[d, i] * (1.0 - z[d, i])  # (5.17)


@kernel
def leave_traps(rng: np.random.Generator, z: Array) -> None:
    """Give every orbit that stands on a trap a new seed.

    Traps are the fixed points of the map and the points that lead to one (`TRAPS`).
    Rounding leads an orbit onto a trap about once in 2e8 steps (a number within 2^-28
    of 1/2 is mapped to 1), and there it would stay.

    Args:
        rng: Source of the seeds; used only if an orbit is trapped.
        z: Chaotic numbers, shape (dim, size), changed in place.
    """
    dim, size = z.shape
    for d in range(dim):
        for i in range(size):
            while z[d, i] in TRAPS:
                z[d, i] = rng.random()


def draw_seeds(shape: tuple[int, int], *, rng: np.random.Generator) -> Array:
    """Draw seeds of the logistic map, uniform in (0, 1).

    No seed is a fixed point of the map, or a point that leads to one (`TRAPS`).

    Args:
        shape: Shape of the array to draw, (dim, size).
        rng: Source of randomness.

    Returns:
        The seeds, a new array of that shape.
    """
    z = np.zeros(shape)  # Every entry a trap.
    leave_traps(rng, z)
    return z
