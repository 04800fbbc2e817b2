"""Statistics of repeated runs: shares, intervals, comparisons, mean ranks.

Functions of SciPy are used if it has them. This module has forms of them for many
comparisons at once, and functions that SciPy lacks (Holm's adjustment, the effect size,
intervals of a change between paired runs, ranks with ties).

Each end of an interval of a change is wrong in 5 percent of the cases. For mean ranks
the solvers are ranked by cost in each seed: 1 is the cheapest, equal ones share the
mean of their ranks, and infeasible answers are last. The rank of a solver on a scenario
is the mean over the seeds.

Source of the intervals: Hodges and Lehmann (1963), Estimates of location based on rank
tests, Annals of Mathematical Statistics 34; Hollander, Wolfe and Chicken (2014),
Nonparametric statistical methods, section 3.3; Agresti and Min (2005), Simple improved
confidence intervals for comparing matched proportions, Statistics in Medicine 24.
"""

from __future__ import annotations

import functools
import itertools
import math
import statistics
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array

LEVEL = 0.05
"""Largest p for which a difference is called shown."""
ENUMERATED = 13
"""Largest number of pairs with ties for which SciPy is exact."""
EXACT = 50
"""Largest number of pairs without ties for which SciPy is exact."""

CHANCE = 0.05
"""Probability that an interval ends short of the change, on either side."""
_MOST_EXACT = 200
"""Largest number of pairs for which the signed-rank distribution is counted."""

SAME = 1e-6
"""Costs within this relative difference count as equal."""


def fewest_pairs(comparisons: float = 1) -> int:
    """Return the least number of pairs with which a difference can be shown.

    The smallest p of a signed-rank test of n pairs is 2^(1 - n), reached if all pairs
    differ in the same way; Holm multiplies it by the number of comparisons.

    Args:
        comparisons: Number of comparisons made together.
    """
    return math.ceil(1 - math.log2(LEVEL / max(comparisons, 1)))


def signed_rank_p(differences: Sequence[float]) -> float:
    """Return p of the two-sided Wilcoxon signed-rank test that the median is 0.

    Args:
        differences: Difference of each pair; if all are 0, p is 1.
    """
    return float(signed_rank_ps([differences])[0])


def signed_rank_ps(differences: ArrayLike) -> Array:
    """Return p of the two-sided Wilcoxon signed-rank test for each row.

    Differences of 0 are dropped before SciPy chooses its method: with zeros it takes a
    normal approximation, which claims too much if few other differences are left.

    Args:
        differences: Differences of the pairs of each test, shape (tests, pairs),
            finite.

    Returns:
        p of each test, shape (tests,); 1 for a row of zeros. It is that of
        `scipy.stats.wilcoxon` for the differences that are not 0: exact up to 50 pairs
        without ties and up to 13 with ties.
    """
    values = np.asarray(differences, dtype=np.float64)
    found = np.ones(len(values))
    kept = values != 0
    counts = kept.sum(axis=1)
    for count in np.unique(counts[counts > 0]):
        rows = np.flatnonzero(counts == count)
        alike = values[rows][kept[rows]].reshape(len(rows), count)
        sizes = np.sort(np.abs(alike), axis=1)
        tied = (np.diff(sizes, axis=1) == 0).any(axis=1)
        for has_ties in (False, True):
            chosen = tied == has_ties
            if chosen.any():
                found[rows[chosen]] = _p_of_rows(alike[chosen], has_ties)
    return found


def _p_of_rows(values: Array, has_ties: bool) -> Array:
    """Return p of rows without zeros, all with ties or all without."""
    from scipy.stats import rankdata, wilcoxon

    count = values.shape[1]
    if has_ties and count <= ENUMERATED:  # SciPy resamples: half a second a row.
        ranks = rankdata(np.abs(values), axis=1)
        signs = np.array(list(itertools.product((0.0, 1.0), repeat=count)))
        sums = np.rint(2 * ranks @ signs.T)  # Twice: middle ranks become whole.
        own = np.rint(2 * (ranks * (values > 0)).sum(axis=1))[:, None]
        tails = np.minimum((sums <= own).mean(axis=1), (sums >= own).mean(axis=1))
        enumerated: Array = np.minimum(1.0, 2 * tails)
        return enumerated
    exact = count <= EXACT and not has_ties
    method = "exact" if exact else "asymptotic"
    p: Array = wilcoxon(values, axis=1, method=method).pvalue
    return p


def sign_ps(first: ArrayLike, second: ArrayLike) -> Array:
    """Return p values of exact two-sided McNemar tests, which are sign tests.

    Args:
        first: Numbers of pairs in which only the first has succeeded, shape (tests,).
        second: Numbers of pairs in which only the second has succeeded, shape (tests,).

    Returns:
        p of each test, shape (tests,); 1 if both numbers of pairs are 0.
    """
    from scipy.stats import binom

    one, other = np.asarray(first), np.asarray(second)
    tail = binom.cdf(np.minimum(one, other), one + other, 0.5)
    p: Array = np.minimum(1.0, 2 * tail)
    return p


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p values adjusted for their number by Holm's method, in the given order.

    Source: Holm (1979), A simple sequentially rejective multiple test procedure,
    Scandinavian Journal of Statistics 6.
    """
    p = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(p, kind="stable")
    # No p is below that of a smaller one: the procedure ends at the first failure.
    stepped = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(1.0, stepped)
    return [float(value) for value in adjusted]


def holm_of_those_that_can(
    p_values: Sequence[float], counts: Sequence[float], share: float = 1.0
) -> list[float]:
    """Return p values adjusted for the number of tests that can show anything.

    A test whose ties leave so few pairs that its p is always above LEVEL does not count
    in the adjustment of others.

    Args:
        p_values: p values of exact tests.
        counts: Number of pairs that differ in each test.
        share: Part of the allowed chance of a false claim that is given to these tests.

    Source: Tarone (1990), A modified Bonferroni method for discrete data, Biometrics
    46.
    """
    can = [k for k, n in enumerate(counts) if n >= fewest_pairs()]
    adjusted = [min(1.0, p / share) for p in p_values]
    for number, p in zip(can, holm([p_values[k] for k in can]), strict=True):
        adjusted[number] = min(1.0, p / share)
    return adjusted


@functools.cache
def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 percent interval of a success rate.

    Source: Wilson (1927), Probable inference, the law of succession, and statistical
    inference, Journal of the American Statistical Association 22.
    """
    from scipy.stats import binomtest

    interval = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def chances_of_less(values: ArrayLike, others: ArrayLike) -> Array:
    """Return for each row the chance that one of `values` is less than one of `others`.

    Ties count half; infinities tie with each other. 0.5 means that neither tends to be
    less.

    Args:
        values: Values of each test, shape (tests, n).
        others: Values to compare with, shape (tests, m).

    Returns:
        Shape (tests,).

    Source: Vargha and Delaney (2000), A critique and improvement of the CL common
    language effect size statistics, Journal of Educational and Behavioral Statistics
    25, their A of (others, values).
    """
    from scipy.stats import rankdata

    own, other = np.asarray(values, dtype=float), np.asarray(others, dtype=float)
    count = own.shape[1]
    ranks = rankdata(np.concatenate([own, other], axis=1), axis=1)[:, :count]
    more = ranks.sum(axis=1) - count * (count + 1) / 2
    chances: Array = 1 - more / (count * other.shape[1])
    return chances


def quantile(values: ArrayLike, share: float) -> float | None:
    """Return a quantile: the least value with at least this share at or below it.

    None if that value is infinite, or if there are no values. P99 of 30 values is the
    largest.
    """
    numbers = np.asarray(values, dtype=np.float64)
    if not len(numbers):
        return None
    found = float(np.quantile(numbers, share, method="inverted_cdf"))
    return found if math.isfinite(found) else None


def median(values: ArrayLike) -> float | None:
    """Return the median; None if it is infinite, or there is no value."""
    numbers = np.sort(np.asarray(values, dtype=np.float64))
    if not len(numbers):
        return None
    low, high = numbers[(len(numbers) - 1) // 2], numbers[len(numbers) // 2]
    if not np.isfinite([low, high]).all():
        return None
    # low + high can be infinite for huge costs.
    return float(low + (high - low) / 2)


def resampled(count: int, *, resamples: int, rng: np.random.Generator) -> Array:
    """Return weights of a bootstrap: each row draws `count` runs with replacement.

    Returns:
        Shape (resamples, count); a row sums to 1, so that `weights @ values` are the
        means of the resamples.
    """
    return rng.multinomial(count, np.full(count, 1 / count), size=resamples) / count


def bands(means: Array) -> tuple[Array, Array]:
    """Return the 95 percent band of resampled means (percentiles).

    Args:
        means: Means of the resamples, shape (resamples, ...).
    """
    # Resamples side by side in memory: three times as fast.
    low, high = np.quantile(np.moveaxis(means, 0, -1).copy(), [0.025, 0.975], axis=-1)
    return low, high


def too_few(count: int, noun: str, needed: int) -> str:
    """Return the number that exists and the number that is needed, in words."""
    have = {0: f"no {noun}", 1: f"one {noun}"}.get(count, f"{count} {noun}s")
    return f"{have}, {needed} are needed"


def spread(values: Sequence[Any], *, digits: int = 4) -> str:
    """Return lowest, median, highest value and the number of undefined ones, in words.

    Args:
        values: Numbers; None if a measure is not defined.
        digits: Significant digits of each number.
    """
    known = [value for value in values if value is not None]
    missing = f", {len(values) - len(known)} never" if len(known) < len(values) else ""
    if not known:
        return "never"
    low, middle, high = min(known), statistics.median(known), max(known)
    if low == high:
        return f"{low:.{digits}g}{missing}"
    shown = " / ".join(f"{value:.{digits}g}" for value in (low, middle, high))
    return shown + missing


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
        values: The values, shape (n,).
    """
    if len(values) == 1:
        return float(values[0]), float(values[0])
    first, second = np.triu_indices(len(values))
    # Means of all pairs, each value also with itself.
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


def with_ties(costs: Array, same: float = SAME) -> Array:
    """Return costs in which practically equal ones are replaced by the same number.

    Costs are grouped in increasing order. A group begins with its least cost, and holds
    all costs within `same` of it; they are replaced by this least cost.

    Args:
        costs: Costs, any shape; infinite for infeasible answers.
        same: Relative difference up to which costs count as equal.
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
        costs: Costs, shape (solvers, seeds); infinite for infeasible answers.

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
        ranks: Ranks of the solvers on each scenario, shape (solvers,) each.
        resamples: Number of resamples of the bootstrap over scenarios; 0 means no
            intervals.
        rng: Source of all random numbers.

    Returns:
        Mean ranks, and lower and upper ends of their intervals, shape (solvers,) each.
    """
    table = np.array(ranks)
    mean = table.mean(axis=0)
    if not resamples:
        return mean, mean, mean
    weights = resampled(len(table), resamples=resamples, rng=rng)
    return (mean, *bands(weights @ table))
