"""The initial population of a search: drawn, or given with or without its costs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import require
from swarmstart.heuristics.laws.box import Box, InvalidPointsError
from swarmstart.heuristics.laws.sampling import Sampling, sample


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Initial:
    """Options of an initial population.

    Attributes:
        sampling: Method of drawing points, see `sampling`. None means "half_smooth" if
            the variables are a sequence (`Box.per_step`), else "uniform".
        points: First columns of the population, shape (dim, k), in the box; None means
            that all points are drawn.
        cost: Known costs of these points, shape (k,), which are then not evaluated
            again. None means that they are not known.
        violation: Their violations, shape (k,); None with costs means all are 0.

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
        ok = self.sampling is None or self.sampling in names
        require("sampling", self.sampling, ok=ok, allowed=f"None or one of {names}")
        ok = self.cost is None or self.points is not None
        require("cost", self.cost, ok=ok, allowed="None without points")
        ok = self.violation is None or self.cost is not None
        require("violation", self.violation, ok=ok, allowed="None without cost")


Values = tuple[Array, Array]
"""Costs and violations, each (k,)."""


def initial_population(
    box: Box, size: int, initial: Initial, *, rng: np.random.Generator
) -> tuple[Array, Values | None]:
    """Return the population, shape (dim, size), and the values of its first columns.

    Args:
        box: The box.
        size: Number of individuals.
        initial: Options of the population.
        rng: Source of randomness.

    Raises:
        InvalidPointsError: If given points do not fit, costs or violations have another
            length, or a violation is negative.
        InvalidSettingsError: If smooth points are requested in a box without per_step.
    """
    sampling = initial.sampling
    if sampling is None:
        sampling = "uniform" if box.per_step is None else "half_smooth"
    ok = box.per_step is not None or "smooth" not in sampling
    allowed = "uniform or latin_hypercube in a box without per_step"
    require("sampling", sampling, ok=ok, allowed=allowed)
    population = sample(box, size, sampling=sampling, rng=rng)
    if initial.points is None:
        return population, None
    points = _points(box, size, initial.points)
    population[:, : points.shape[1]] = points
    return population, _values(initial, points.shape[1])


def _points(box: Box, size: int, given: ArrayLike) -> Array:
    """Return given points as an array, if they fit the box and the population."""
    try:
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
