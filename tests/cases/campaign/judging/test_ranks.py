"""Mean ranks by hand."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from swarmstart.cases.campaign.judging.statistics import (
    SAME,
    mean_ranks,
    scenario_ranks,
    with_ties,
)

INF = np.inf


def test_ranks_are_means_over_seeds_with_what_failed_last() -> None:
    """Seed 0: 1, 2, 3; seed 1: the first two tie, the third failed; seed 2: two did."""
    costs = np.array([[1.0, 5.0, INF], [2.0, 5.0, 7.0], [3.0, INF, INF]])
    np.testing.assert_allclose(
        scenario_ranks(costs),
        [(1 + 1.5 + 2.5) / 3, (2 + 1.5 + 1) / 3, (3 + 3 + 2.5) / 3],
    )


@given(
    costs=st.lists(
        st.floats(-1e6, 1e6).map(lambda x: round(x, 3)), min_size=1, max_size=6
    )
)
def test_costs_that_are_as_good_as_equal_tie_and_no_others(costs: list[float]) -> None:
    near = np.array([[c for c in costs], [c * (1 + 0.4 * SAME) for c in costs]])
    tied = with_ties(near)
    off = np.abs(near - tied) - SAME * np.maximum(np.abs(near), np.abs(tied))
    assert np.all(off <= 1e-9 * SAME * np.abs(near))
    single = with_ties(np.array(costs))
    for a, x in zip(costs, single, strict=True):
        for b, y in zip(costs, single, strict=True):
            if abs(a - b) > 2 * SAME * max(abs(a), abs(b)):
                assert (x < y) == (a < b)


def test_a_tie_ends_at_a_millionth() -> None:
    assert SAME == 1e-6
    for sign in (1.0, -1.0):
        near, far = sign * (1 + 0.9 * SAME), sign * (1 + 1.2 * SAME)
        assert len(set(with_ties(np.array([sign, near])))) == 1
        assert len(set(with_ties(np.array([sign, far])))) == 2
    ranks = scenario_ranks(np.array([[1.0], [1.0 + 1e-9], [2.0]]))
    np.testing.assert_allclose(ranks, [1.5, 1.5, 3.0])


def test_a_tie_ends_at_a_part_of_the_larger_cost() -> None:
    """A fifth: from 0.5 up to 0.625, from -1 up to -0.8; beside 0 there is nothing."""
    for first, last in ((0.5, 0.625), (8.0, 10.0), (-1.0, -0.8), (-0.1, -0.08)):
        for off, alike in ((-1e-9, True), (1e-9, False)):
            tied = with_ties(np.array([last + off, first]), same=0.2)
            assert (tied[0] == tied[1]) == alike
    assert with_ties(np.array([0.0, 1e-300]), same=0.2).tolist() == [0.0, 1e-300]


def test_infinities_stay() -> None:
    assert with_ties(np.array([INF, 1.0, INF])).tolist() == [INF, 1.0, INF]


def test_intervals_hold_the_mean_and_are_those_of_the_rng() -> None:
    ranks = [np.array([1.0, 2.0]), np.array([1.2, 1.8]), np.array([2.0, 1.0])]
    mean, low, high = mean_ranks(ranks, resamples=400, rng=np.random.default_rng(0))
    np.testing.assert_allclose(mean, [1.4, 1.6])
    assert np.all(low < mean) and np.all(mean < high)
    again = mean_ranks(ranks, resamples=400, rng=np.random.default_rng(0))
    np.testing.assert_array_equal(np.array([mean, low, high]), np.array(again))
