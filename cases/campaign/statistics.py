"""Statistics of repeated runs: shares, intervals, comparisons."""

import math
import statistics
from collections.abc import Sequence
from typing import Any

import numpy as np

LEVEL = 0.05
"""A difference is called shown where p is at most this."""


def fewest_pairs(comparisons: int = 1) -> int:
    """Return with how many pairs a difference can be shown at all.

    The smallest p of a signed-rank test is 2^(1 - n), times the number of comparisons
    (Holm) where all differ alike.

    Args:
        comparisons: How many are made together.
    """
    return math.ceil(1 - math.log2(LEVEL / max(comparisons, 1)))


def signed_rank_p(differences: Sequence[float]) -> float:
    """Return p of the two-sided Wilcoxon signed-rank test that the median is 0.

    Args:
        differences: Of pairs; where all are 0, p is 1.
    """
    from scipy.stats import wilcoxon

    values = np.asarray(differences, dtype=np.float64)
    return 1.0 if not values.any() else float(wilcoxon(values).pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p values adjusted for their number, step down, in the given order.

    Source: Holm (1979), A simple sequentially rejective multiple test procedure,
    Scandinavian Journal of Statistics 6.
    """
    order = np.argsort(p_values)
    count, least, adjusted = len(p_values), 0.0, np.empty(len(p_values))
    for rank, number in enumerate(order):
        least = max(least, min(1.0, (count - rank) * p_values[number]))
        adjusted[number] = least
    return [float(p) for p in adjusted]


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the 95 percent interval of a success rate.

    Source: Wilson (1927), Probable inference, the law of succession, and statistical
    inference, Journal of the American Statistical Association 22.
    """
    from scipy.stats import binomtest

    interval = binomtest(successes, trials).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def too_few(count: int, noun: str, needed: int) -> str:
    """Return how many there are and how many are needed, in words."""
    have = {0: f"no {noun}", 1: f"one {noun}"}.get(count, f"{count} {noun}s")
    return f"{have}, {needed} are needed"


def spread(values: Sequence[Any], *, digits: int = 4) -> str:
    """Return lowest, median and highest in words, and how many are not defined.

    Args:
        values: Numbers; None where a measure is not defined.
        digits: Of each number.
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
