"""Mean ranks of solvers over scenarios.

In each seed the solvers are ranked by cost: 1 is the cheapest, equal ones share the
mean of their ranks, and infeasible answers are last. A scenario's rank is the mean over
its seeds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.campaign.judging.statistics import bands, resampled

SAME = 1e-6
"""Costs within this relative difference count as equal."""


def with_ties(costs: Array, same: float = SAME) -> Array:
    """Return costs in which practically equal ones are replaced by the same number.

    From the least on, each cost within `same` of the first cost of a group becomes that
    cost.

    Args:
        costs: Any shape; infinite for infeasible answers.
        same: Relative difference.
    """
    flat = costs.ravel()
    order = np.argsort(flat, kind="stable")
    rising = flat[order]
    grouped, number = rising.copy(), 0
    while number < len(rising) and np.isfinite(rising[number]):
        first = rising[number]
        # For costs of one sign, |a - b| <= same max(|a|, |b|), solved for b.
        limit = first + same * abs(first) / (1 - same if first > 0 else 1)
        end = int(np.searchsorted(rising, limit, side="right"))
        grouped[number:end] = first
        number = max(end, number + 1)
    tied = np.empty_like(flat)
    tied[order] = grouped
    return tied.reshape(costs.shape)


def scenario_ranks(costs: Array) -> Array:
    """Return the mean rank of each solver on a scenario.

    Args:
        costs: Shape (solvers, seeds); infinite for infeasible answers.

    Returns:
        Shape (solvers,), from 1 to the number of solvers.
    """
    from scipy.stats import rankdata

    ranks: Array = rankdata(with_ties(costs), axis=0).mean(axis=1)
    return ranks


def mean_ranks(
    ranks: Sequence[Array], *, resamples: int, rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """Return mean ranks over scenarios and their 95 percent bootstrap intervals.

    Args:
        ranks: Ranks on each scenario, shape (solvers,).
        resamples: Number of resamples of the bootstrap over scenarios; 0 means no
            intervals.
        rng: Source of all random numbers.

    Returns:
        Mean, low and high, shape (solvers,) each.
    """
    table = np.array(ranks)
    mean = table.mean(axis=0)
    if not resamples:
        return mean, mean, mean
    weights = resampled(len(table), resamples=resamples, rng=rng)
    return (mean, *bands(weights @ table))
