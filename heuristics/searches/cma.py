"""CMA-ES with a population that doubles at each restart (IPOP).

In coordinates scaled to the unit box, without those that are fixed, the n variables
have the mean m, the step size sigma and the covariance C, whose axes are the columns of
B, with the lengths D. p_sigma and p_c are the paths of step size and covariance, and
w_i weights, of which the first mu are positive. With x_i:lambda the i-th best of lambda
individuals,

    x_i = m + sigma B D z_i,    z_i standard normal,  C = B D^2 B'        (38)-(40)
    y_i = (x_i:lambda - m) / sigma,    y_w = sum_{i <= mu} w_i y_i            (41)
    m       <- m + sigma y_w                                             (42), (54)
    p_sigma <- (1 - c_sigma) p_sigma
               + sqrt(c_sigma (2 - c_sigma) mu_eff) C^(-1/2) y_w              (43)
    sigma   <- sigma exp(c_sigma / d_sigma (|p_sigma| / E|N(0, I)| - 1))      (44)
    p_c     <- (1 - c_c) p_c + h_sigma sqrt(c_c (2 - c_c) mu_eff) y_w         (45)
    w_i'    = w_i,  or  w_i n / |C^(-1/2) y_i|^2  if w_i < 0                  (46)
    C       <- (1 + c_1 delta(h_sigma) - c_1 - c_mu sum w) C
               + c_1 p_c p_c' + c_mu sum_i w_i' y_i y_i'                      (47)

h_sigma is 0 after a long p_sigma, else 1, and delta(h) = (1 - h) c_c (2 - c_c). The
constants are those of `cma_constants`. Numbers such as (38) are equations of Hansen
(2016). The search begins with the initial population, whose best individual is the
first mean; after a restart (`cma_restarts`) the mean is drawn uniformly in the box. The
best point seen is kept through all restarts.

An individual that leaves the box is evaluated where `bound_handling` brings it back,
and enters the update as it was sampled. So the method is CMA-ES without bounds for the
function f(repair(x)). For `reflect`, this is f continued beyond the box by its mirror
images, and m may lie in one of them. An update with the repaired points instead would
end far from an optimum on a bound: steps near the bound look shorter than they were,
and sigma falls too soon.

Source: Hansen (2016), The CMA evolution strategy: a tutorial, arXiv:1604.00772v1;
Auger and Hansen (2005), A restart CMA evolution strategy with increasing population
size, IEEE Congress on Evolutionary Computation.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from swarmstart.arguments import FLAG, a_count, a_number, checked, optional
from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import (
    BOUND_HANDLING,
    BoundHandled,
    InvalidSettingsError,
    Kernels,
    common_fields,
    copy_points,
    fill_column,
    take_generation,
)
from swarmstart.heuristics.laws.box import (
    CODES,
    REDRAW,
    BoundHandling,
    Box,
    clip,
    repair,
)
from swarmstart.heuristics.laws.order import RunningOrder, ranking
from swarmstart.heuristics.searches.cma_constants import (
    Constants,
    constants_of,
    default_size,
    weights_of,
)
from swarmstart.heuristics.searches.cma_restarts import (
    has_ended,
    record_length,
    write_record,
)
from swarmstart.machine_code import Count, kernel

SIZE_MAX = 2**16
"""Number of individuals above which a restart no longer adds any."""
LENGTH_LEAST = 1e-150
"""Square root that replaces that of an eigenvalue which is negative by rounding."""


class CMAESSettings(NamedTuple):
    """Settings for the kernels; fields as in `CMAES`."""

    lower: Array
    upper: Array
    order: RunningOrder
    sigma: float
    restarts: bool
    increase: int
    bound_handling: int
    free: Count


class CMAESState(NamedTuple):
    """State of a `CMAES`; first fields as in `State`, others as in `Distribution`.

    Attributes:
        sampled: Individuals as they were sampled, in coordinates of the unit box; at
            first the initial population. Shape (dim, room), of which the first n rows
            are used, n the number of variables that are not fixed. `Search` enlarges
            it.
        path_sigma: Path of the step size p_sigma, shape (n,).
        decomposed: Value of `age` when `axes` and `lengths` were last computed, int64,
            shape (1,).
        ended: 1 if a criterion of `cma_restarts` holds, int64, shape (1,).
        restarts: Number of restarts so far, int64, shape (1,).
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
    sampled: Array
    mean: Array
    sigma: Array
    covariance: Array
    axes: Array
    lengths: Array
    path_sigma: Array
    path_c: Array
    age: Count
    decomposed: Count
    ended: Count
    restarts: Count
    record: Array


@kernel
def propose(
    rng: np.random.Generator,
    settings: CMAESSettings,
    state: CMAESState,
    asked: Array,
) -> None:
    """Restart if that is due, then sample and repair the next generation."""
    if state.generation[0] == 0:
        copy_points(state.sampled, asked)
        return
    if settings.restarts and state.ended[0] == 1:
        for d in range(state.mean.size):
            state.mean[d] = rng.random()
        begin(settings, state)
        state.restarts[0] += 1
    sample(rng, state, asked.shape[1])
    for i in range(asked.shape[1]):
        fill_column(settings.lower, asked, i)
        for k, d in enumerate(settings.free):
            low, high = settings.lower[d], settings.upper[d]
            x = low + (high - low) * state.sampled[k, i]
            # The mean may lie in a mirror image of the box.
            origin = clip(low + (high - low) * state.mean[k], low, high)
            if not low <= x <= high:
                fraction = rng.random() if settings.bound_handling == REDRAW else 0.0
                x = repair(settings.bound_handling, x, origin, low, high, fraction)
            asked[d, i] = x


@kernel
def sample(rng: np.random.Generator, state: CMAESState, size: int) -> None:
    """Sample `size` individuals by (38)-(40) into `sampled`."""
    dim = state.mean.size
    z = np.empty(dim)
    for i in range(size):
        for k in range(dim):
            z[k] = state.sigma[0] * state.lengths[k] * rng.standard_normal()
        for d in range(dim):
            u = state.mean[d]
            for k in range(dim):
                u += state.axes[d, k] * z[k]
            state.sampled[d, i] = u


@kernel
def accept(
    settings: CMAESSettings,
    state: CMAESState,
    asked: Array,
    cost: Array,
    violation: Array,
) -> None:
    """Update the distribution, and request a restart if a criterion says so.

    If the setting `restarts` is off, the distribution no longer changes once a
    criterion is met.
    """
    rank = ranking(settings.order, cost, violation)
    size = cost.size
    if state.generation[0] == 0:
        for k, d in enumerate(settings.free):
            low, high = settings.lower[d], settings.upper[d]
            if high > low:  # Else all are fixed, and any mean will do.
                state.mean[k] = (asked[d, rank[0]] - low) / (high - low)
        begin(settings, state)
    elif state.ended[0] == 0:
        update(state, rank)
        write_record(state, rank, cost, violation)
        if has_ended(settings.order, state, size, settings.sigma):
            state.ended[0] = 1
            if settings.restarts:
                # A population that began above the limit keeps its size.
                state.size[0] = max(min(size * settings.increase, SIZE_MAX), size)
    take_generation(settings.order, state, asked, cost, violation)


@kernel
def begin(settings: CMAESSettings, state: CMAESState) -> None:
    """Reset everything but the mean to its initial value."""
    state.sigma[0] = settings.sigma
    state.covariance[:] = 0.0
    state.axes[:] = 0.0
    for d in range(state.mean.size):
        state.covariance[d, d] = state.axes[d, d] = 1.0
    state.lengths[:] = 1.0
    state.path_sigma[:] = 0.0
    state.path_c[:] = 0.0
    state.age[0] = state.decomposed[0] = state.ended[0] = 0


@kernel
def update(state: CMAESState, rank: Count) -> None:
    """Update mean, paths, step size and covariance by (41)-(47)."""
    dim, size = state.mean.size, rank.size
    constants = constants_of(dim, size)
    weights = weights_of(dim, size, constants)
    y, squares = steps(state, rank)
    y_w = np.zeros(dim)
    for i in range(size // 2):  # (41)
        for d in range(dim):
            y_w[d] += weights[i] * y[i, d]
    for d in range(dim):  # (42), (54)
        state.mean[d] += state.sigma[0] * y_w[d]
    state.age[0] += 1
    h_sigma = follow(state, constants, y_w)
    total = 0.0
    for i in range(size):
        total += weights[i]
        if weights[i] < 0.0:  # (46)
            # A point may be sampled at the mean, where the square is 0.
            weights[i] *= dim / max(squares[i], LENGTH_LEAST)
    adapt(state, constants, h_sigma, total, weights, y)
    # A decomposition takes of the order of n^3 operations, so it is postponed.
    gap = int(1.0 / (10.0 * dim * (constants.c_1 + constants.c_mu)))  # B.2
    if state.age[0] - state.decomposed[0] >= gap:
        decompose(state)


@kernel
def steps(state: CMAESState, rank: Count) -> tuple[Array, Array]:
    """Steps y_i = (x_i - m) / sigma and |C^(-1/2) y_i|^2, the best individual first.

    The shapes are (size, dim) and (size,).
    """
    dim, size = state.mean.size, rank.size
    y, squares, z = np.empty((size, dim)), np.empty(size), np.empty(dim)
    for i in range(size):
        for d in range(dim):
            y[i, d] = (state.sampled[d, rank[i]] - state.mean[d]) / state.sigma[0]
        whiten(state, y[i], z)
        squares[i] = 0.0
        for k in range(dim):
            squares[i] += z[k] * z[k]
    return y, squares


@kernel
def whiten(state: CMAESState, y: Array, z: Array) -> None:
    """Fill z with D^-1 B' y, which is as long as C^(-1/2) y; C = B D^2 B'.

    Both vectors have the shape (dim,).
    """
    z[:] = 0.0
    for d in range(y.size):
        for k in range(y.size):
            z[k] += state.axes[d, k] * y[d]
    for k in range(y.size):
        z[k] /= state.lengths[k]


@kernel
def follow(state: CMAESState, constants: Constants, y_w: Array) -> float:
    """Update the paths and the step size by (43)-(45); return h_sigma (p. 28)."""
    dim = y_w.size
    c, mu_eff = constants.c_sigma, constants.mu_eff
    z = np.empty(dim)
    whiten(state, y_w, z)
    rate = math.sqrt(c * (2.0 - c) * mu_eff)
    square = 0.0
    for d in range(dim):  # (43)
        step = 0.0
        for k in range(dim):
            step += state.axes[d, k] * z[k]
        state.path_sigma[d] = (1.0 - c) * state.path_sigma[d] + rate * step
        square += state.path_sigma[d] ** 2
    length = math.sqrt(square)
    growth = c / constants.d_sigma * (length / constants.chi - 1.0)
    state.sigma[0] *= math.exp(growth)  # (44)
    expected = math.sqrt(1.0 - (1.0 - c) ** (2.0 * state.age[0])) * constants.chi
    h_sigma = 1.0 if length < (1.4 + 2.0 / (dim + 1.0)) * expected else 0.0
    c = constants.c_c
    rate = h_sigma * math.sqrt(c * (2.0 - c) * mu_eff)
    for d in range(dim):  # (45)
        state.path_c[d] = (1.0 - c) * state.path_c[d] + rate * y_w[d]
    return h_sigma


@kernel
def adapt(
    state: CMAESState,
    constants: Constants,
    h_sigma: float,
    total: float,
    weights: Array,
    y: Array,
) -> None:
    """Update the covariance by (47), with the weights w' of (46) and the total of w."""
    size, dim = y.shape
    C, p = state.covariance, state.path_c
    c_1, c_mu, c_c = constants.c_1, constants.c_mu, constants.c_c
    kept = 1.0 - c_1 - c_mu * total + c_1 * (1.0 - h_sigma) * c_c * (2.0 - c_c)
    # One triangle, which is mirrored at the end: C stays symmetric to the last bit.
    for d in range(dim):
        for e in range(d + 1):
            C[d, e] = kept * C[d, e] + c_1 * p[d] * p[e]
    for i in range(size):
        for d in range(dim):
            factor = c_mu * weights[i] * y[i, d]
            for e in range(d + 1):
                C[d, e] += factor * y[i, e]
    for d in range(dim):
        for e in range(d):
            C[e, d] = C[d, e]


@kernel
def decompose(state: CMAESState) -> None:
    """Compute B and D of C = B D^2 B'."""
    eigenvalues, eigenvectors = np.linalg.eigh(state.covariance)
    for k in range(eigenvalues.size):
        state.lengths[k] = math.sqrt(max(eigenvalues[k], LENGTH_LEAST**2))
    copy_points(eigenvectors, state.axes)
    state.decomposed[0] = state.age[0]


@checked(
    InvalidSettingsError,
    size=optional(a_count(least=4)),
    sigma=a_number(above=0, most=1),
    restarts=FLAG,
    increase=a_count(least=1),
    bound_handling=BOUND_HANDLING,
)
@dataclass(frozen=True, kw_only=True, slots=True)
class CMAES(BoundHandled):
    """Settings of CMA-ES with restarts.

    Attributes:
        size: Number of individuals lambda until the first restart, at least 4; None
            means 4 + floor(3 ln n) for n variables that are not fixed.
        sigma: Step size at the beginning, a fraction of the widths of the box, in
            (0, 1].
        restarts: Whether the search restarts when a criterion of `cma_restarts` holds.
            If False, the distribution stays as it is from then on.
        increase: Factor by which the population grows at each restart, at least 1.
        bound_handling: What happens to a coordinate that leaves the box; see the
            module `box`.

    Raises:
        InvalidSettingsError: If a value is out of its range.

    Example:
        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x[0] - 1) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2,
        ...     bounds=[(-2, 2), (-2, 2)],
        ...     algorithm=ss.CMAES(sigma=0.2, restarts=False),
        ...     budget=3000,
        ...     seed=0,
        ... )
        >>> found.x.round(4).tolist()
        [1.0, 1.0]
    """

    kernels: ClassVar[Kernels] = Kernels(propose=propose, accept=accept)
    size: int | None = None
    sigma: float = 0.3
    restarts: bool = True
    increase: int = 2
    bound_handling: BoundHandling = "reflect"

    def first_size(self, box: Box, evaluations: int | None) -> int:
        """Number of individuals until the first restart."""
        del evaluations
        return default_size(box.free.size) if self.size is None else self.size

    def kernel_settings(self, box: Box, order: RunningOrder) -> CMAESSettings:
        """The settings as numbers and arrays."""
        return CMAESSettings(
            lower=box.lower,
            upper=box.upper,
            order=order,
            sigma=float(self.sigma),
            restarts=self.restarts,
            increase=self.increase,
            bound_handling=CODES[self.bound_handling],
            free=box.free,
        )

    def start(
        self, box: Box, population: Array, *, rng: np.random.Generator
    ) -> CMAESState:
        """The state before generation 0; arguments as in `Algorithm.start`."""
        del rng
        dim = box.free.size
        return CMAESState(
            *common_fields(population),
            sampled=population.copy(),
            mean=np.full(dim, 0.5),  # Until the first costs are known.
            sigma=np.full(1, float(self.sigma)),
            covariance=np.eye(dim),
            axes=np.eye(dim),
            lengths=np.ones(dim),
            path_sigma=np.zeros(dim),
            path_c=np.zeros(dim),
            age=np.zeros(1, dtype=np.int64),
            decomposed=np.zeros(1, dtype=np.int64),
            ended=np.zeros(1, dtype=np.int64),
            restarts=np.zeros(1, dtype=np.int64),
            record=np.zeros((5, record_length(dim))),
        )
