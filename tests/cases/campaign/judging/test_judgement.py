"""Claims about pairs of solvers, and missing ones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import wilcoxon

from swarmstart.cases.campaign.judging.judgement import (
    ALL_PAIRS_FROM,
    Results,
    compared_pairs,
    fewest_seeds,
    judged,
)
from swarmstart.cases.campaign.judging.statistics import LEVEL
from swarmstart.cases.campaign.trials.solver_names import NULL_HYPOTHESIS

INF = np.inf


def results(*costs: Any, sure: tuple[bool, ...] = (), **more: Any) -> Results:
    table = np.array(costs, dtype=float)
    best = table.min()
    return Results(
        names=tuple(f"s{k}" for k in range(len(table))),
        deterministic=sure or (False,) * len(table),
        costs=table,
        near=np.isfinite(table) & (table <= best * 1.01),
        **more,
    )


TEN = np.arange(10.0)


def test_one_family_holds_costs_and_successes() -> None:
    """2^-9 times two tests that can show anything, in four fifths of the chance."""
    (pair,) = judged(results(10 + 0.001 * TEN, 20 + TEN))
    assert pair.cost.verdict == "costlier" and pair.success.verdict == "fewer"
    assert pair.cost.p == pytest.approx(2**-9 * 2 / 0.8)
    assert pair.success.words == (
        "within 1 % of the best known: in fewer seeds (0 against 10 of 10, p = 0.0049)"
    )
    assert pair.effect == 0.0
    assert pair.shift == pytest.approx(
        np.median((10 + 0.999 * TEN) / (10 + 0.001 * TEN))
    )


def test_a_test_without_seeds_that_differ_costs_the_others_nothing() -> None:
    """Only one answer is near the best: one pair differs, which shows nothing."""
    (pair,) = judged(results(20 + TEN, 40 + TEN))
    assert pair.cost.p == pytest.approx(2**-9 / 0.8)
    assert pair.success.verdict == "no difference shown"


@pytest.mark.parametrize("seeds", [1, 3, 5, 6])
def test_too_few_seeds_are_not_compared(seeds: int) -> None:
    (pair,) = judged(results(10 + TEN[:seeds], 20 + TEN[:seeds]))
    count = "one seed" if seeds == 1 else f"{seeds} seeds"
    assert pair.cost.words == f"not compared: {count}, 7 are needed"
    assert pair.cost.verdict == pair.success.verdict == "not compared"
    assert pair.cost.p is None


@pytest.mark.parametrize("pairs", [1, 2, 5, 11, 21])
def test_with_the_fewest_seeds_a_difference_can_be_shown(pairs: int) -> None:
    """All tests agree at the smallest p there is: the last of Holm's must hold."""
    seeds = fewest_seeds(pairs)
    assert 2.0 ** (1 - seeds) * 2 * pairs / 0.8 <= LEVEL
    assert 2.0 ** (2 - seeds) * 2 * pairs / 0.8 > LEVEL or seeds == 6


def test_infeasible_is_costlier_than_any_cost_and_equal_to_itself() -> None:
    first = [10.0 + k for k in range(10)]
    (pair,) = judged(results(first, [INF] * 10))
    assert pair.cost.verdict == "costlier" and pair.shift is None
    (pair,) = judged(results([INF] * 10, [INF] * 10))
    assert pair.cost.words == (
        "no difference shown (cheaper in 0, costlier in 0 of 10 seeds, p = 1)"
    )
    assert pair.effect == 0.5 and pair.shift is None


def test_one_infeasible_answer_weighs_more_than_any_difference() -> None:
    """Cheaper by 1, ..., 9 in nine seeds, and nothing in the tenth: rank 10 of 10."""
    first = np.full(10, 100.0)
    (pair,) = judged(results(first, [*(100.0 - np.arange(1, 10)), INF]))
    expected = wilcoxon([*-np.arange(1.0, 10.0), 99.0]).pvalue
    assert pair.cost.p_alone == pytest.approx(expected)


def test_units_of_the_cost_change_nothing() -> None:
    rng = np.random.default_rng(0)
    costs = rng.exponential(size=(3, 12))
    costs[1, 3] = costs[2, 5] = INF
    found = [judged(results(*(scale * costs))) for scale in (1.0, 1e-9, 1e9)]
    assert found[0] == found[0]
    for other in found[1:]:
        for a, b in zip(found[0], other, strict=True):
            assert (a.cost, a.success) == (b.cost, b.success)
            assert a.shift == pytest.approx(b.shift)


def test_two_deterministic_solvers_are_compared_without_a_test() -> None:
    """One run each for any number of seeds: thirty copies are not thirty pairs."""
    (pair,) = judged(results([10.0] * 30, [12.0] * 30, sure=(True, True)))
    assert (pair.cost.verdict, pair.cost.p) == ("costlier", None)
    assert pair.cost.words == "costlier (both deterministic, one run each)"
    assert pair.success.verdict == "fewer"
    (pair,) = judged(results([10.0] * 3, [10.0 + 1e-9] * 3, sure=(True, True)))
    assert pair.cost.verdict == "no difference shown"
    (pair,) = judged(results([INF] * 3, [INF] * 3, sure=(True, True)))
    assert pair.cost.words.startswith("both are not feasible")


def test_one_run_counts_for_each_seed_of_a_solver_with_chance() -> None:
    (pair,) = judged(results(10 + TEN, [30.0] * 10, sure=(False, True)))
    assert pair.cost.words.startswith(
        "costlier (cheaper in 0, costlier in 10 of 10 seeds"
    )


def test_what_is_said_of_costs_does_not_depend_on_seconds() -> None:
    rng = np.random.default_rng(1)
    own = results(*rng.exponential(size=(3, 12)))
    clock = np.array([TEN[:1] + 1.0] * 3) * np.ones((3, 12)) * [[1.0], [9.0], [1.0]]
    timed = judged(replace(own, seconds=clock + 0.001 * np.arange(12)))
    for plain, other in zip(judged(own), timed, strict=True):
        assert plain.seconds is None and other.seconds is not None
        assert (plain.cost, plain.success) == (other.cost, other.success)
    assert timed[0].seconds is not None and timed[0].seconds.verdict == "slower"
    # 2^(1 - 12): the one test that can show anything, in a fifth of the chance.
    assert timed[0].seconds.p == pytest.approx(2.0**-11 / 0.2)


def test_one_deterministic_time_is_not_thirty() -> None:
    own = results(10 + TEN, [30.0] * 10, sure=(False, True), seconds=np.ones((2, 10)))
    (pair,) = judged(own)
    assert pair.seconds is None


def test_a_maximiser_reads_of_better_and_worse() -> None:
    (pair,) = judged(results(-20 - TEN, -10 - TEN, sense=-1))
    assert pair.cost.words.startswith("worse (better in 0, worse in 10 of 10 seeds")
    assert pair.cost.verdict == "costlier"


def test_the_word_is_that_of_the_signed_ranks() -> None:
    """Many small gains and few great losses: the ranks decide, not the mean."""
    first = np.full(14, 10.0)
    other = first - np.linspace(0.1, 0.2, 14)
    other[0] = 1000.0
    (pair,) = judged(results(first, other))
    assert pair.cost.verdict == "cheaper"


def test_all_pairs_are_compared_with_many_seeds_else_those_with_two() -> None:
    names = ["a", "b", NULL_HYPOTHESIS, "c"]
    few = compared_pairs(names, ALL_PAIRS_FROM - 1)
    assert few == [(1, 0), (2, 0), (3, 0), (1, 2), (3, 2)]
    every = compared_pairs(names, ALL_PAIRS_FROM)
    assert len(every) == 6 and every[:5] == few
    assert compared_pairs(["a"], 30) == []
    assert judged(results([1.0, 2.0])) == []
