"""Performance profiles: share of instances on which a solver is near the fastest.

    rho_s(ratio) = share of instances in which t(s) <= ratio * min over solvers of t

t is the effort of a solver to reach the target, infinite if it never did. An instance
that no solver has reached counts in the total, but for no solver. The order of two
solvers can change if a third one is left out (Gould and Scott 2016); `pairwise_profile`
is the profile of two solvers alone.

Source: Dolan and More (2002), Benchmarking optimization software with performance
profiles, Mathematical Programming 91; Gould and Scott (2016), A note on performance
profiles for benchmarking software, ACM Transactions on Mathematical Software 43.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.cases.campaign.judging.statistics import bands

RATIOS = 41
MOST_RATIO = 1e6
"""Largest ratio of a profile."""


def relative_times(times: ArrayLike) -> Array:
    """Return times divided by the least of each instance; infinite if never reached.

    Args:
        times: Shape (solvers, instances), positive; infinite where never.

    Returns:
        Shape (solvers, instances), at least 1.
    """
    spent = np.asarray(times, dtype=np.float64)
    least = spent.min(axis=0)
    known = np.isfinite(least)
    ratios = np.full(spent.shape, np.inf)
    # A time of 0 belongs to a mark before the first step: take the smallest number.
    floor = np.finfo(np.float64).tiny
    ratios[:, known] = np.maximum(spent[:, known], floor) / np.maximum(
        least[known], floor
    )
    return ratios


def ratios_of(relative: Array) -> Array:
    """Return 41 ratios at which profiles are drawn, equally spaced by logarithm."""
    finite = relative[np.isfinite(relative)]
    most = min(max(2.0, float(finite.max(initial=1.0))), MOST_RATIO)
    ratios: Array = np.geomspace(1.0, most * (1 + 1e-9), RATIOS)
    return ratios


def performance_profile(relative: Array, ratios: ArrayLike) -> Array:
    """Return the share of instances within each ratio of the fastest.

    Args:
        relative: Ratios from `relative_times`, shape (solvers, instances).
        ratios: Shape (ratios,), at least 1.

    Returns:
        Shape (solvers, ratios).
    """
    shares: Array = _within(relative, ratios).mean(axis=1)
    return shares


def _within(relative: Array, ratios: ArrayLike) -> Array:
    """Return 1 if an instance is within a ratio, else 0."""
    within: Array = (relative[:, :, None] <= np.asarray(ratios)).astype(np.float64)
    return within


def pairwise_profile(
    times: ArrayLike, one: int, other: int, ratios: ArrayLike
) -> Array:
    """Return the profile of two solvers alone, shape (2, ratios).

    Args:
        times: Times of all solvers, shape (solvers, instances); infinite if never.
        one: Row of the first solver.
        other: Row of the second solver.
        ratios: Shape (ratios,), at least 1.
    """
    two = np.asarray(times, dtype=np.float64)[[one, other]]
    return performance_profile(relative_times(two), ratios)


def profile_bands(
    relative: Array, ratios: Array, groups: list[Array]
) -> tuple[Array, Array]:
    """Return 95 percent bands of a profile, seeds drawn again within each scenario.

    So they concern other seeds on these scenarios, not other scenarios.

    Args:
        relative: As of `relative_times`, shape (solvers, instances), the instances of a
            scenario side by side.
        ratios: Shape (ratios,).
        groups: For each scenario the weights of its seeds, as of `resampled`, shape
            (resamples, seeds).

    Returns:
        Low and high, shape (solvers, ratios) each.
    """
    weights = np.concatenate([group / len(groups) for group in groups], axis=1)
    means = np.einsum("bi,sir->bsr", weights, _within(relative, ratios), optimize=True)
    return bands(means)
