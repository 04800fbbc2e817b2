"""The initial population of a search: drawn, or given with or without its costs.

Methods of drawing points:

uniform          independent in every variable
latin_hypercube  each n-th of every range holds one of n points (McKay et al. 1979)
smooth           correlated in time
half_smooth      the first half smooth, the rest uniform

Smooth in time: if the variables are a sequence in time, independent draws jitter; a
sequence that turns one way all the time, for example, hardly occurs among them. Smooth
draws have the same distribution in each variable (uniform), and are correlated in time
by a first-order autoregressive process,

    z_0 = n_0,  z_k = r z_k-1 + sqrt(1 - r^2) n_k,  r = exp(-1 / steps),  u_k = Phi(z_k)

with n_k standard normal, Phi the normal distribution function, `steps` the number of
time steps, and u_k the value at step k as a share of the range: correlated over the
whole sequence.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import checked, optional, reals
from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import InvalidSettingsError, require
from swarmstart.heuristics.laws.box import Box, InvalidPointsError
from swarmstart.machine_code import kernel

Sampling = Literal["uniform", "latin_hypercube", "smooth", "half_smooth"]
Values = tuple[Array, Array]
"""Costs and violations, each (k,)."""


@checked(
    InvalidSettingsError,
    points=optional(reals()),
    cost=optional(reals()),
    violation=optional(reals()),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Initial:
    """Options of an initial population.

    Attributes:
        sampling: Method of drawing points: "uniform", "latin_hypercube", "smooth" in
            time or "half_smooth". None means "half_smooth" if the variables are a
            sequence (`Box.per_step`), else "uniform".
        points: Points in the box that become the first columns of the population, shape
            (dim, k); None means that all points are drawn.
        cost: Known costs of these points, shape (k,), which are then not evaluated
            again. None means that they are not known.
        violation: Known violations of these points, shape (k,). None means that all are
            0 if costs are given.

    Raises:
        InvalidSettingsError: If the sampling is unknown, or there are violations
            without costs, or costs without points.

    Example:
        Start from a guess; the other points are drawn as a Latin hypercube:

        >>> import swarmstart as ss
        >>> found = ss.minimize(
        ...     lambda x: (x**2).sum(axis=0),
        ...     bounds=[(-1, 2)] * 2,
        ...     budget=100,
        ...     initial=ss.Initial(sampling="latin_hypercube", points=[[0.1], [0.0]]),
        ...     seed=0,
        ... )
        >>> bool(found.cost <= 0.1**2)
        True
    """

    sampling: Sampling | None = None
    points: ArrayLike | None = None
    cost: ArrayLike | None = None
    violation: ArrayLike | None = None

    def __post_init__(self) -> None:
        """Validate all that does not depend on the box."""
        names = get_args(Sampling)
        ok = self.sampling is None or (
            isinstance(self.sampling, str) and self.sampling in names
        )
        require("sampling", self.sampling, ok=ok, allowed=f"None or one of {names}")
        ok = self.cost is None or self.points is not None
        require("cost", self.cost, ok=ok, allowed="None without points")
        ok = self.violation is None or self.cost is not None
        require("violation", self.violation, ok=ok, allowed="None without cost")


def initial_population(
    box: Box, size: int, initial: Initial, *, rng: np.random.Generator
) -> tuple[Array, Values | None]:
    """Return the population, shape (dim, size), and the known values of its points.

    These are costs and violations of the first columns; None if no costs are known.

    Raises:
        InvalidPointsError: If given points do not fit, costs or violations have another
            length, or a violation is negative.
        InvalidSettingsError: If smooth points are requested in a box without per_step.
    """
    sampling = initial.sampling
    if sampling is None:
        sampling = "uniform" if box.per_step is None else "half_smooth"
    ok = box.per_step is not None or "smooth" not in sampling  # Nor "half_smooth".
    allowed = "uniform or latin_hypercube in a box without per_step"
    require("sampling", sampling, ok=ok, allowed=allowed)
    # Drawn in full, so that the other columns do not depend on the points given.
    population = sample(box, size, sampling=sampling, rng=rng)
    if initial.points is None:
        return population, None
    points = _points(box, size, initial.points)
    population[:, : points.shape[1]] = points
    return population, _values(initial, points.shape[1])


def _points(box: Box, size: int, given: ArrayLike) -> Array:
    """Return given points as an array, if they fit the box and the population."""
    try:  # Without a copy: the population takes one.
        points = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError) as error:
        problem = f"initial must be an array of numbers, shape ({box.dim}, k): {error}"
        raise InvalidPointsError(problem, shape=()) from error
    if points.ndim != 2 or points.shape[0] != box.dim:  # noqa: PLR2004
        problem = f"initial must have shape ({box.dim}, k), got {points.shape}"
        raise InvalidPointsError(problem, shape=points.shape)
    if points.shape[1] > size:
        raise InvalidPointsError(
            f"initial has {points.shape[1]} points, the population only {size}",
            shape=points.shape,
        )
    outside = np.flatnonzero(~box.contains(points))
    if outside.size:
        raise InvalidPointsError(
            f"initial must lie in the box, columns {outside.tolist()} do not",
            shape=points.shape,
        )
    return points


def _values(initial: Initial, count: int) -> Values | None:
    """Return copies of the known costs and violations; None if they are unknown."""
    if initial.cost is None:
        return None
    cost = np.array(initial.cost, dtype=np.float64)
    violation = np.zeros(count)
    if initial.violation is not None:
        violation = np.array(initial.violation, dtype=np.float64)
    for name, values in (("cost", cost), ("violation", violation)):
        if values.shape != (count,):
            problem = f"{name} must have shape ({count},), got {values.shape}"
            raise InvalidPointsError(problem, shape=values.shape)
    if np.any(violation < 0.0):
        problem = f"violation must be at least 0, got {np.nanmin(violation)}"
        raise InvalidPointsError(problem, shape=violation.shape)
    return cost, violation


def sample_uniform(box: Box, size: int, *, rng: np.random.Generator) -> Array:
    """Draw points uniformly in the box; columns of a new array, shape (dim, size)."""
    points = box.lower[:, None] + box.width[:, None] * rng.random((box.dim, size))
    return np.minimum(points, box.upper[:, None])  # Rounding may step over.


def sample(
    box: Box, size: int, *, sampling: Sampling, rng: np.random.Generator
) -> Array:
    """Draw an initial population.

    Returns:
        The points as columns, shape (dim, size), a new array.
    """
    if sampling == "uniform":
        return sample_uniform(box, size, rng=rng)
    if sampling == "latin_hypercube":
        fractions = latin_hypercube((box.dim, size), rng=rng)
    else:
        smooth = size if sampling == "smooth" else size // 2
        fractions = smooth_in(box, smooth, rng=rng)
    points = box.lower[:, None] + box.width[:, None] * fractions
    points = np.minimum(points, box.upper[:, None])  # Rounding may step over.
    rest = sample_uniform(box, size - points.shape[1], rng=rng)
    return np.concatenate([points, rest], axis=1)


def latin_hypercube(shape: tuple[int, int], *, rng: np.random.Generator) -> Array:
    """Draw points of a Latin hypercube in (0, 1).

    Args:
        shape: (dim, size), the shape of the result.
        rng: Source of randomness.
    """
    dim, size = shape
    strata = np.tile(np.arange(size), (dim, 1))
    points: Array = (rng.permuted(strata, axis=1) + rng.random(shape)) / size
    return points


def smooth_fractions(
    shape: tuple[int, int], *, per_step: int, rng: np.random.Generator
) -> Array:
    """Draw numbers uniform in (0, 1), each column correlated over its steps.

    Args:
        shape: (dim, size), the shape of the result.
        per_step: Number of variables of one time step; it divides dim.
        rng: Source of randomness.

    Returns:
        The numbers, a new array. Different columns are independent, and so are the
        variables of one step.
    """
    fractions = np.empty(shape)
    correlate(rng, per_step, fractions)
    return fractions


def smooth_in(box: Box, size: int, *, rng: np.random.Generator) -> Array:
    """Draw numbers uniform in (0, 1), smooth over the steps, shape (box.dim, size).

    Variables that belong to no step are independent.
    """
    per_step = box.per_step or box.in_sequence
    smooth = smooth_fractions((box.in_sequence, size), per_step=per_step, rng=rng)
    if not box.constant:
        return smooth
    return np.concatenate([smooth, rng.random((box.constant, size))])


@kernel
def correlate(rng: np.random.Generator, per_step: int, fractions: Array) -> None:
    """Fill an array (dim, size) with numbers in (0, 1) that are correlated in time.

    Each variable of each column follows a first-order autoregressive process over the
    time steps; its values are uniform.

    Args:
        rng: Source of randomness.
        per_step: Number of variables of one time step; it divides dim.
        fractions: The array.
    """
    dim, size = fractions.shape
    r = math.exp(-per_step / dim)
    spread = math.sqrt(1.0 - r * r)
    for i in range(size):
        for variable in range(per_step):
            z = rng.standard_normal()
            for d in range(variable, dim, per_step):
                if d != variable:  # z_0 is n_0.
                    z = r * z + spread * rng.standard_normal()
                fractions[d, i] = 0.5 * (1.0 + math.erf(z / math.sqrt(2.0)))
