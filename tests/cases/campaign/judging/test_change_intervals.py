"""Intervals of a change, against all signs and by their coverage."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from swarmstart.cases.campaign.judging.statistics import (
    median_interval,
    share_interval,
)


def test_the_interval_of_the_median_is_that_of_the_signed_rank_test() -> None:
    """A shift lies within it if no more than 5 percent of signs are as extreme."""
    values = np.array([-1.3, 0.2, 0.7, 1.1, 2.9, 3.1, 4.4])
    low, high = median_interval(values)

    def tails(shift: float) -> tuple[float, float]:
        moved = values - shift
        ranks = np.argsort(np.argsort(np.abs(moved))) + 1
        own = ranks[moved > 0].sum()
        sums = [np.dot(ranks, signs) for signs in itertools.product((0, 1), repeat=7)]
        return float(np.mean(np.array(sums) >= own)), float(
            np.mean(np.array(sums) <= own)
        )

    assert tails(low - 1e-6)[0] <= 0.05 < tails(low + 1e-6)[0]
    assert tails(high + 1e-6)[1] <= 0.05 < tails(high - 1e-6)[1]


def test_many_pairs_take_the_normal_approximation() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(size=201)
    exact, normal = median_interval(values[:200]), median_interval(values)
    np.testing.assert_allclose(exact, normal, atol=0.02)


def end_of_interval(count: int) -> int:
    """Return the rank of the Walsh average at which an interval begins."""
    values = np.random.default_rng(count).normal(size=count)
    low, high = median_interval(values)
    first, second = np.triu_indices(count)
    walsh = np.sort((values[first] + values[second]) / 2)
    end = int(np.searchsorted(walsh, low)) + 1
    assert high == walsh[-end]
    return end


@pytest.mark.parametrize("count", [5, 6, 17, 150, 200, 201, 300, 420])
def test_an_interval_ends_at_the_quantile_of_all_signs(count: int) -> None:
    """Numbers of sets of the ranks 1 to n with each sum, as whole numbers."""
    sums = [1]
    for rank in range(1, count + 1):
        moved = [0] * rank + sums
        sums = [a + b for a, b in zip(sums + [0] * rank, moved, strict=True)]
    below, exact = sums[0], 0
    while below * 20 <= 2**count:
        exact += 1
        below += sums[exact]
    assert abs(end_of_interval(count) - exact) <= (count > 200)


def test_an_interval_of_shares_is_that_of_the_score_with_half_a_pair_more() -> None:
    """With d = b - c: d / n -+ 1.645 sqrt(b + c - d^2 / n) / n, cut at -1 and 1."""
    for gained, lost, pairs in ((3, 9, 40), (9, 3, 40), (0, 0, 5), (20, 1, 25)):
        b, c, n = gained + 0.5, lost + 0.5, pairs + 2.0
        reach = 1.6448536 * np.sqrt(b + c - (b - c) ** 2 / n) / n
        expected = np.clip([(b - c) / n - reach, (b - c) / n + reach], -1, 1)
        np.testing.assert_allclose(
            share_interval(gained, lost, pairs), expected, rtol=1e-6
        )
    assert share_interval(0, 30, 30)[0] == -1.0
    assert share_interval(30, 0, 30)[1] == 1.0


def test_the_interval_of_shares_covers_nine_times_in_ten() -> None:
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(1000):
        one, other = rng.random(30) < 0.7, rng.random(30) < 0.5
        gained, lost = int((one & ~other).sum()), int((other & ~one).sum())
        low, high = share_interval(gained, lost, 30)
        inside += low <= 0.2 <= high
    assert 870 <= inside <= 940  # 900 +- 3 sqrt(90), and a little more: it is careful.
    assert share_interval(0, 0, 30)[1] < 0.1 < share_interval(0, 0, 10)[1]


def test_few_values_have_no_interval_and_one_is_its_own() -> None:
    assert median_interval(np.array([0.3])) == (0.3, 0.3)
    assert median_interval(np.arange(4.0)) == (-np.inf, np.inf)
    assert median_interval(np.arange(5.0)) == (0.0, 4.0)
