"""Tests and intervals against published and hand-made numbers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, bootstrap, wilcoxon

from swarmstart.cases.campaign.judging.statistics import (
    LEVEL,
    bands,
    chances_of_less,
    fewest_pairs,
    holm,
    holm_of_those_that_can,
    median,
    quantile,
    resampled,
    sign_ps,
    signed_rank_p,
    signed_rank_ps,
    spread,
    too_few,
    wilson_interval,
)

probabilities = st.lists(st.floats(0, 1), min_size=1, max_size=8)


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(27, 30, 0.744, 0.965), (30, 30, 0.886, 1.0), (0, 10, 0.0, 0.278)],
)
def test_wilsons_interval_by_its_formula(
    successes: int, trials: int, low: float, high: float
) -> None:
    """(p + z^2/2n -+ z sqrt(p(1 - p)/n + z^2/4n^2)) / (1 + z^2/n), z = 1.96."""
    z, n, p = 1.959963985, trials, successes / trials
    centre, root = p + z**2 / (2 * n), np.sqrt(p * (1 - p) / n + (z / (2 * n)) ** 2)
    found = wilson_interval(successes, trials)
    expected = [(centre + sign * z * root) / (1 + z**2 / n) for sign in (-1, 1)]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    np.testing.assert_allclose(found, (low, high), atol=6e-4)


def test_holm_of_a_worked_example() -> None:
    """Sorted 0.005, 0.01, 0.03, 0.04: times 4, 3, 2, 1, never falling."""
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


@given(p=probabilities)
def test_holm_lies_between_no_adjustment_and_bonferroni(p: list[float]) -> None:
    adjusted = holm(p)
    for raw, found in zip(p, adjusted, strict=True):
        assert raw <= found <= min(1.0, len(p) * raw) or found == max(
            a for r, a in zip(p, adjusted, strict=True) if r <= raw
        )
    order = np.argsort(p, kind="stable")
    assert np.all(np.diff(np.array(adjusted)[order]) >= 0)


def test_the_fewest_pairs_are_those_with_which_a_difference_can_be_shown() -> None:
    """All of one sign: p is the share of the two extreme sign patterns, 2^(1 - n)."""
    for n in range(2, 9):
        patterns = list(itertools.product((-1, 1), repeat=n))
        ranks = range(1, n + 1)
        sums = [
            sum(r for r, s in zip(ranks, p, strict=True) if s > 0) for p in patterns
        ]
        extreme = sum(total in (0, sum(ranks)) for total in sums) / len(sums)
        assert signed_rank_p([0.1 * rank for rank in ranks]) == pytest.approx(extreme)
        assert (extreme <= LEVEL) == (n >= fewest_pairs())


@pytest.mark.parametrize(("comparisons", "pairs"), [(1, 6), (2, 7), (5, 8)])
def test_more_comparisons_take_more_pairs(comparisons: int, pairs: int) -> None:
    assert fewest_pairs(comparisons) == pairs
    smallest = [holm([2.0 ** (1 - n)] * comparisons)[0] for n in (pairs - 1, pairs)]
    assert smallest[0] > LEVEL >= smallest[1]


def test_pairs_without_a_difference_show_none() -> None:
    assert signed_rank_p([0.0] * 8) == 1.0


def test_a_spread_says_what_is_not_defined() -> None:
    assert spread([3.0, 1.0, None, 2.0]) == "1 / 2 / 3, 1 never"
    assert spread([None]) == "never"
    assert spread([1.23456, 1.23456]) == "1.235"


def test_too_few_is_said_in_words() -> None:
    assert too_few(1, "pair", 6) == "one pair, 6 are needed"
    assert too_few(3, "run", 5) == "3 runs, 5 are needed"


@given(
    rows=st.lists(
        st.lists(st.integers(-4, 4), min_size=7, max_size=7), min_size=1, max_size=4
    )
)
def test_the_signed_rank_test_is_that_of_all_signs(rows: list[list[int]]) -> None:
    """Every one of the 2^n patterns of signs is as likely; ties share middle ranks."""
    for row, found in zip(rows, signed_rank_ps(rows), strict=True):
        left = [d for d in row if d]
        sizes = [abs(d) for d in left]
        ranks = [
            (sum(s < size for s in sizes) + sum(s <= size for s in sizes) + 1) / 2
            for size in sizes
        ]
        own = sum(r for r, d in zip(ranks, left, strict=True) if d > 0)
        sums = [
            sum(r for r, s in zip(ranks, signs, strict=True) if s)
            for signs in itertools.product((False, True), repeat=len(left))
        ]
        below = sum(total <= own for total in sums) / len(sums)
        above = sum(total >= own for total in sums) / len(sums)
        assert found == pytest.approx(min(1.0, 2 * min(below, above)), abs=1e-12)


@pytest.mark.parametrize("pairs", [30, 50, 51, 90])
@pytest.mark.parametrize("ties", [False, True])
def test_the_signed_rank_test_is_scipys_in_all_rows_at_once(
    ties: bool, pairs: int
) -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(0.3, 1.0, (12, pairs))
    values = np.round(values, 1) if ties else values
    for row, found in zip(values, signed_rank_ps(values), strict=True):
        assert found == pytest.approx(wilcoxon(row[row != 0]).pvalue, rel=1e-9)


def test_zeros_do_not_make_few_pairs_many() -> None:
    """SciPy alone takes a normal approximation here, and 0.043 for 2^(1 - 5)."""
    assert signed_rank_p([0.1, 0.2, 0.3, 0.4, 0.5, *[0.0] * 25]) == 2**-4


@given(a=st.integers(0, 40), b=st.integers(0, 40))
def test_mcnemars_test_is_the_binomial_of_the_pairs_that_differ(a: int, b: int) -> None:
    expected = binomtest(a, a + b).pvalue if a + b else 1.0
    assert sign_ps([a], [b])[0] == pytest.approx(expected, abs=1e-9)


def test_holm_agrees_with_statsmodels() -> None:
    oracle = pytest.importorskip("statsmodels.stats.multitest")
    rng = np.random.default_rng(5)
    for count in range(1, 20):
        p = np.round(rng.random(count) ** 3, 2)  # Some are equal.
        expected = oracle.multipletests(p, method="holm")[1]
        np.testing.assert_allclose(holm(list(p)), expected, atol=1e-6)


def test_wilsons_interval_agrees_with_statsmodels() -> None:
    oracle = pytest.importorskip("statsmodels.stats.proportion")
    for trials in (1, 6, 30):
        for count in range(trials + 1):
            expected = oracle.proportion_confint(count, trials, method="wilson")
            np.testing.assert_allclose(
                wilson_interval(count, trials), expected, atol=1e-6
            )


def test_tests_that_can_show_nothing_cost_the_others_nothing() -> None:
    """Five pairs have a p of 2^-4 at least, whatever they say."""
    assert holm_of_those_that_can([0.02, 0.5], [30, 5]) == [0.02, 0.5]
    assert holm_of_those_that_can([0.02, 0.5], [30, 6]) == [0.04, 0.5]
    assert holm_of_those_that_can([0.02, 0.5], [30, 5], share=0.5) == [0.04, 1.0]
    assert holm_of_those_that_can([0.9, 0.9], [30, 5], share=0.5) == [1.0, 1.0]


@given(
    one=st.lists(st.integers(0, 5), min_size=1, max_size=6),
    other=st.lists(st.integers(0, 5), min_size=1, max_size=6),
)
def test_the_effect_size_is_that_of_a_double_loop(
    one: list[int], other: list[int]
) -> None:
    pairs = [(a < b) + 0.5 * (a == b) for a in one for b in other]
    expected = sum(pairs) / len(pairs)
    assert chances_of_less([one], [other])[0] == pytest.approx(expected, abs=1e-12)


def test_infinite_costs_tie_in_the_effect_size() -> None:
    inf = np.inf
    assert chances_of_less([[1.0, inf]], [[inf, inf]])[0] == 0.75
    assert chances_of_less([[inf, inf]], [[inf, inf]])[0] == 0.5


def test_p99_of_thirty_is_the_largest_and_none_if_one_never_ended() -> None:
    values = [float(k) for k in range(1, 31)]
    assert (quantile(values, 0.5), quantile(values, 0.99)) == (15.0, 30.0)
    assert quantile([*values[1:], np.inf], 0.99) is None
    assert quantile([*values[1:], np.inf], 0.5) == 16.0
    assert quantile([], 0.5) is None


def test_the_median_counts_what_is_infinite() -> None:
    inf = np.inf
    assert median([3.0, 1.0, inf]) == 3.0
    assert median([4.0, 1.0, 2.0, inf]) == 3.0
    assert median([3.0, 1.0, inf, inf]) is None
    assert median([1e308, 1e308]) == 1e308
    assert median([]) is None


def test_bands_are_scipys_bootstrap() -> None:
    """Both are percentiles of resampled means; 4,000 leave a few percent of noise."""
    values = np.random.default_rng(2).exponential(size=30)
    weights = resampled(30, resamples=4000, rng=np.random.default_rng(3))
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    low, high = bands(weights @ values)
    oracle = bootstrap(
        (values,), np.mean, method="percentile", n_resamples=4000, vectorized=True,
        rng=np.random.default_rng(4),
    ).confidence_interval  # fmt: skip
    width = oracle.high - oracle.low
    np.testing.assert_allclose([low, high], [oracle.low, oracle.high], atol=width / 20)
