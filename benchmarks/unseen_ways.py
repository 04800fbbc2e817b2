"""Upper limits of the share of unseen optima, and known distributions to test them.

Each method takes the number of times that every optimum was found, and returns the
upper end of an interval whose lower end is 0.
"""

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.stats import beta

from swarmstart.arrays import Array
from swarmstart.ocp.lanes.answers import unseen_share

Way = Callable[[Sequence[int]], float]

_SURE, _TWO_SIDED = 1.6449, 1.96
_RESAMPLED = 100


def score(counts: Sequence[int]) -> float:
    """Return the limit of the account."""
    return unseen_share(counts).most


def one_side(counts: Sequence[int]) -> float:
    """Return n1 / n + 1.96 sqrt(n1 + 2 n2) / n, the limit used before."""
    n, once, twice = _found(counts)
    beyond = _TWO_SIDED * math.sqrt(once + 2 * twice) / n if once else 0.0
    return _within(once / n + beyond, n)


def esty(counts: Sequence[int]) -> float:
    """Return the end of Esty's (1983) interval."""
    n, once, _ = _found(counts)
    return _within(once / n + _SURE * _esty_deviation(counts), n)


def chao_jost(counts: Sequence[int]) -> float:
    """Return the same about the estimate of Chao and Jost (2012), eq. 4a."""
    n, once, twice = _found(counts)
    pairs = 2 * twice or 2 / max(once - 1, 1)  # Without any: as if f0 were f1 (f1-1)/2.
    part = (n - 1) * once / ((n - 1) * once + pairs) if once else 0.0
    return _within(once / n * part + _SURE * _esty_deviation(counts), n)


def wilson(counts: Sequence[int]) -> float:
    """Return that of Wilson (1927) as if n1 were binomial."""
    n, once, _ = _found(counts)
    square, g = _SURE**2, once / n
    root = math.sqrt(g * (1 - g) / n + square / (4 * n * n))
    return (g + square / (2 * n) + _SURE * root) / (1 + square / n)


def clopper_pearson(counts: Sequence[int]) -> float:
    """Return that of Clopper and Pearson (1934) as if n1 were binomial."""
    n, once, _ = _found(counts)
    return 1.0 if once >= n else float(beta.ppf(0.95, once + 1, n - once))


def bootstrap(counts: Sequence[int]) -> float:
    """Return that of draws from the optima found and from Chao's number of others."""
    n, once, twice = _found(counts)
    if not once:
        return _within(0.0, n)
    unseen = min(once / n, n / (n + 1))
    others = once**2 / (2 * twice) if twice else once * (once - 1) / 2
    law = np.array(counts) / n * (1 - unseen)
    number = max(1, math.ceil(others))
    law = np.concatenate([law, np.full(number, unseen / number)])
    drawn = np.random.default_rng(0).multinomial(n, law / law.sum(), size=_RESAMPLED)
    errors = (law * (drawn == 0)).sum(axis=1) - (drawn == 1).sum(axis=1) / n
    return _within(once / n + float(np.quantile(errors, 0.95)), n)


WAYS: Mapping[str, Way] = {
    "score": score,
    "n1 + 1.96 sd": one_side,
    "Esty": esty,
    "Wilson": wilson,
    "Clopper-Pearson": clopper_pearson,
    "Chao and Jost": chao_jost,
    "bootstrap": bootstrap,
}


def laws(n: int) -> list[Array]:
    """Return shares of optima: alike, with long tails, and a few rare ones.

    Args:
        n: Number of starts for which the rare ones are rare.
    """
    alike = [np.full(K, 1 / K) for K in (2, 3, 5, 10, 20, 50, 100, 200, 400, 1000)]
    tails = [np.arange(1, 3000) ** -power for power in (0.7, 1.0, 1.3, 1.7, 2.5)]
    falling = [ratio ** np.arange(600.0) for ratio in (0.3, 0.5, 0.7, 0.9, 0.97)]
    rare = [
        np.array([1 - K * times / n, *[times / n] * K])
        for K in (1, 3, 10)
        for times in (0.5, 1.0, 1.7, 2.5, 3.2, 4.0)
        if K * times < n
    ]
    return [law / law.sum() for law in (*alike, *tails, *falling, *rare)]


def least_held(way: Way, n: int, draws: int) -> float:
    """Return the least part of draws in which a way holds, over all laws.

    Args:
        way: One of those that ask for n, n1 and n2 only.
        n: Starts in a draw.
        draws: Of each law.
    """
    stated: dict[tuple[int, int], float] = {}
    least, rng = 1.0, np.random.default_rng(n)
    for law in laws(n):
        held = 0
        for counts in rng.multinomial(n, law, size=draws):
            key = int((counts == 1).sum()), int((counts == 2).sum())
            if key not in stated:
                stated[key] = way(counts[counts > 0].tolist())
            held += law[counts == 0].sum() <= stated[key] + 1e-12
        least = min(least, held / draws)
    return least


def _found(counts: Sequence[int]) -> tuple[int, int, int]:
    """Return n, n1 and n2."""
    return sum(counts), counts.count(1), counts.count(2)


def _esty_deviation(counts: Sequence[int]) -> float:
    n, once, twice = _found(counts)
    return math.sqrt(max(once + 2 * twice - once**2 / n, 0.0)) / n


def _within(most: float, n: int) -> float:
    """Return an end that is at least that of the rule of three, and at most 1."""
    return min(1.0, max(most, 3 / n))
