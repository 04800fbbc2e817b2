"""Tests and intervals against published and hand-made numbers."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmstart.cases.campaign.statistics import (
    LEVEL,
    fewest_pairs,
    holm,
    signed_rank_p,
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
