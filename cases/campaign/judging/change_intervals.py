"""Intervals of a change between paired runs, each end wrong in 5 percent.

Source: Hodges and Lehmann (1963), Estimates of location based on rank tests, Annals of
Mathematical Statistics 34; Hollander, Wolfe and Chicken (2014), Nonparametric
statistical methods, section 3.3; Agresti and Min (2005), Simple improved confidence
intervals for comparing matched proportions, Statistics in Medicine 24.
"""

import math
from functools import cache

import numpy as np

from swarmstart.arrays import Array

CHANCE = 0.05
"""Probability that an interval ends short of the change, on either side."""
_MOST_EXACT = 200
"""Largest number of pairs for which the signed-rank distribution is counted."""


def share_interval(gained: int, lost: int, pairs: int) -> tuple[float, float]:
    """Return the 90 percent interval of the difference of two paired shares.

    Args:
        gained: Number of pairs in which only the second has succeeded.
        lost: Number of pairs in which only the first has succeeded.
        pairs: Number of all pairs.

    Returns:
        The interval of the second share minus the first.
    """
    from scipy.stats import norm

    # Half a pair is added to each of the four kinds.
    total, up, down = pairs + 2, gained + 0.5, lost + 0.5
    middle = (up - down) / total
    width = math.sqrt(up + down - (up - down) ** 2 / total) / total
    reach = float(norm.ppf(1 - CHANCE)) * width
    return max(-1.0, middle - reach), min(1.0, middle + reach)


def median_interval(values: Array) -> tuple[float, float]:
    """Return the 90 percent interval of the median of symmetric values.

    The ends are order statistics of the means of all pairs (Walsh averages), as in the
    signed-rank test. For one value the interval is that value.

    Args:
        values: Shape (n,).
    """
    if len(values) == 1:
        return float(values[0]), float(values[0])
    first, second = np.triu_indices(len(values))
    walsh = np.sort((values[first] + values[second]) / 2)
    end = _end(len(values))
    if not end:
        return -math.inf, math.inf
    return float(walsh[end - 1]), float(walsh[len(walsh) - end])


@cache
def _end(count: int) -> int:
    """Return the rank, from either side, of the Walsh average that ends an interval.

    0 means that no interval of this probability is finite.
    """
    if count > _MOST_EXACT:
        from scipy.stats import norm

        mean = count * (count + 1) / 4
        deviation = math.sqrt(count * (count + 1) * (2 * count + 1) / 24)
        return int(mean + float(norm.ppf(CHANCE)) * deviation + 0.5)
    # Share of the sets of ranks 1 to n that have each sum.
    shares = np.zeros(count * (count + 1) // 2 + 1)
    shares[0] = 1.0
    for rank in range(1, count + 1):
        moved = np.concatenate([np.zeros(rank), shares[:-rank]])
        shares = (shares + moved) / 2
    below = np.cumsum(shares)
    return int((below <= CHANCE).sum())
