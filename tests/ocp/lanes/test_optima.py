"""Distinct optima, counted, and how much has not been seen."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binomtest

from swarmstart.ocp.lanes.answers import (
    LaneAnswers,
    distinct_optima,
    optimum_of,
    unseen_share,
)


def answers(
    paths: list[float], costs: list[float], violation: float = 0
) -> LaneAnswers:
    """Return answers whose one state stays at a number."""
    n = len(paths)
    return LaneAnswers(
        controls=np.zeros((1, 4, n)),
        starts=np.zeros((0, n)),
        states=np.ones((1, 5, n)) * np.array(paths),
        cost=np.array(costs),
        violation=np.full(n, violation),
        iterations=np.zeros(n, dtype=np.int64),
    )


def test_mirror_images_of_one_cost_are_two_optima() -> None:
    found = distinct_optima(answers([1.0, -1.0, 1.01, -1.02], [2.0, 2.0, 2.0, 2.0]))
    assert [one.count for one in found] == [2, 2]


def test_cheapest_comes_first_and_stands_for_its_optimum() -> None:
    found = distinct_optima(answers([0.0, 1.0, 1.02], [3.0, 1.1, 1.0]))
    assert [(one.lane, one.cost, one.count) for one in found] == [
        (2, 1.0, 2),
        (0, 3.0, 1),
    ]


def test_answer_that_breaks_a_limit_is_none() -> None:
    assert distinct_optima(answers([0.0], [1.0], violation=2e-6)) == []


def test_answer_without_a_cost_is_none() -> None:
    found = optimum_of(answers([0.0, 0.0, 1.0], [np.nan, 1.0, np.inf]))
    np.testing.assert_array_equal(found, [-1, 0, -1])


def test_each_answer_has_the_number_of_its_optimum() -> None:
    """In a chain each belongs to the nearest of the first ones."""
    costs = [3.0, 1.0, 2.0, 4.0]
    given = answers([1.0, 1.12, 1.05, 1.085], costs)
    np.testing.assert_array_equal(optimum_of(given), [1, 0, 0, 0])
    assert [one.count for one in distinct_optima(given)] == [3, 1]


def test_share_not_seen_is_that_of_the_optima_found_once() -> None:
    found = unseen_share([5, 1, 1, 2, 1])
    assert found.share == pytest.approx(0.3)
    assert found.answers == 10
    assert unseen_share([7, 3]).most == pytest.approx(0.3)  # The rule of three.
    assert unseen_share([]).share == unseen_share([]).most == 1.0
    assert unseen_share([1]).most == unseen_share([1, 1]).most == 1.0


@pytest.mark.parametrize(("once", "n"), [(1, 16), (4, 40), (30, 256), (255, 256)])
def test_without_pairs_the_end_is_that_of_wilsons_interval(once: int, n: int) -> None:
    found = unseen_share([1] * once + [n - once] * (n - once > 2))
    exact = binomtest(once, n).proportion_ci(confidence_level=0.9, method="wilson")
    if n - once > 2:
        assert found.most == pytest.approx(exact.high, rel=1e-6)
    else:
        assert found.most >= 0.99


def test_end_is_as_far_as_the_variance_of_the_optima_found_once() -> None:
    """At it n1 is 1.645 standard deviations from what is expected (Esty 1983)."""
    once, twice, n = 12, 5, 64
    most = unseen_share([1] * once + [2] * twice + [n - once - 2 * twice]).most
    variance = n * most * (1 - most) + 2 * twice
    assert (n * most - once) / np.sqrt(variance) == pytest.approx(1.6448536, rel=1e-6)


def rare(number: int, share: float) -> NDArray[np.float64]:
    """Return the law of one frequent and some rare optima."""
    return np.array([1 - number * share, *[share] * number])


def held(law: NDArray[np.float64], n: int, draws: int = 2000) -> float:
    """Return in which part of all draws the interval holds what has not been seen."""
    counts = np.random.default_rng(n).multinomial(n, law, size=draws)
    holds = [
        law[one == 0].sum() <= unseen_share(one[one > 0].tolist()).most
        for one in counts
    ]
    return float(np.mean(holds))


@pytest.mark.parametrize("n", [16, 40, 64, 256])
def test_interval_holds_the_true_share_as_often_as_it_says(n: int) -> None:
    """Without pairs 0.83 (100 alike, 256); n1 + 1.96 sd holds 0.85 (5 alike, 16)."""
    zipf = 1 / np.arange(1, 3000.0)
    laws = [
        *(np.full(K, 1 / K) for K in (2, 5, 20, 100, 400, 1000)),
        *(rare(K, r / n) for K in (1, 3) for r in (1.0, 1.7, 2.5, 3.2)),
        rare(10, 0.08),
        zipf / zipf.sum(),
        np.array([0.4, 0.3, 0.15, 0.08, 0.04, 0.02, 0.006, 0.004]),
    ]
    assert min(held(law, n) for law in laws) >= 0.92


def test_interval_is_not_wider_than_it_says() -> None:
    """With many rare optima, nearly normal, it holds for 95 % of the draws, not all."""
    assert held(np.full(400, 1 / 400), 256) == pytest.approx(0.95, abs=0.015)


def test_optimum_counts_only_with_an_answer_that_is_shown_to_be_one() -> None:
    """The cheapest of these, though a cheaper answer of the same basin is not shown."""
    ends = replace(
        answers([0.0, 0.01, 0.02, 1.0], [1.0, 1.2, 1.1, 2.0]),
        optimal=np.array([False, True, True, False]),
    )
    found = distinct_optima(ends, shown=True)
    assert [(one.lane, one.cost, one.count) for one in found] == [(2, 1.1, 3)]
    assert len(distinct_optima(ends)) == 2
