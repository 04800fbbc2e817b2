"""Verdicts of several runs on a claim."""

from __future__ import annotations

import math

import pytest

from swarmstart.cases.campaign.studies.verdicts import (
    Verdict,
    median_of,
    of_assumption,
    of_guarantee,
    paired_verdict,
    ratio,
    verdict_of_parts,
    verdict_of_seeds,
)
from swarmstart.cases.format.kind import NEVER


@pytest.mark.parametrize(
    ("values", "share", "verdict", "said"),
    [
        ([1.0, 2.0], 1.0, Verdict.HOLDS, ""),
        ([1.0, 4.0], 1.0, Verdict.IN_PART, "1 of 2 runs"),
        ([1.0, 1.0, 1.0, 1.0, 4.0], 0.8, Verdict.HOLDS, "4 of 5 runs"),
        ([4.0, None], 1.0, Verdict.FAILS, ""),
    ],
)
def test_every_seed_counts_or_the_share_that_is_asked_for(
    values: list[float | None], share: float, verdict: Verdict, said: str
) -> None:
    found = verdict_of_seeds(values, "<=", 3.0, share=share, reason=NEVER)
    assert found == (verdict, said)
    if share == 1:
        assert verdict_of_seeds(values, "<=", 3.0, reason=NEVER) == found


def test_never_is_a_bound_too() -> None:
    found = verdict_of_seeds([None, 58.0], "==", None, reason=NEVER)
    assert found == (Verdict.IN_PART, "1 of 2 runs")


def test_one_run_without_the_measure_is_enough_to_judge_nothing() -> None:
    found = verdict_of_seeds([1.0, None], "<=", 3.0, reason="there is no obstacle")
    assert found == (Verdict.NOT_JUDGED, "not defined: there is no obstacle")


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (2.0, 4.0, 0.5),
        (-1.0, -20.0, 0.05),
        (4.0, None, 0.0),
        (None, 4.0, math.inf),
        (None, None, 1.0),
        (0.0, 0.0, 1.0),
        (-3.0, 0.0, -math.inf),
    ],
)
def test_a_ratio_is_the_run_by_the_one_it_is_compared_with(
    first: float | None, second: float | None, expected: float
) -> None:
    assert ratio(first, second, reason=NEVER) == expected


def test_there_is_no_ratio_of_what_is_not_defined_nor_of_lists() -> None:
    assert ratio(None, 4.0, reason="there is no obstacle") is None
    assert ratio(5.0, 4.0, reason="there is no obstacle") == 1.25
    assert ratio([1.0], [2.0], reason="") is None


def test_flights_refute_a_guarantee_and_do_not_show_it() -> None:
    assert of_guarantee(Verdict.HOLDS, "")[0] is Verdict.NOT_SHOWN
    refuted = of_guarantee(Verdict.IN_PART, "2 of 3 runs")
    assert refuted == (Verdict.FAILS, "one exception refutes a guarantee; 2 of 3 runs")
    for verdict in (Verdict.FAILS, Verdict.NOT_JUDGED):
        assert of_guarantee(verdict, "so") == (verdict, "so")


def test_an_assumption_is_met_or_not_and_no_claim() -> None:
    assert of_assumption(Verdict.HOLDS) is Verdict.MET
    assert of_assumption(Verdict.IN_PART) is of_assumption(Verdict.FAILS)
    assert of_assumption(Verdict.FAILS) is Verdict.UNMET
    assert of_assumption(Verdict.NOT_JUDGED) is Verdict.NOT_JUDGED


@pytest.mark.parametrize(
    ("ratios", "verdict", "test"),
    [
        ([0.8] * 5, Verdict.NOT_JUDGED, "5 pairs, 6 are needed"),
        (
            [0.8, 0.81, 0.79, 0.82, 0.78, 0.83],
            Verdict.HOLDS,
            "6 pairs, Wilcoxon p = 0.031",
        ),
        (
            [0.95, 0.96, 0.97, 0.94, 0.93, 0.98],
            Verdict.FAILS,
            "6 pairs, Wilcoxon p = 0.031",
        ),
        (
            # Their median is above the bound, though the least is below.
            [0.5, 0.95, 0.96, 0.97, 0.94, 0.93, 0.98],
            Verdict.FAILS,
            "7 pairs, Wilcoxon p = 0.016",
        ),
        (
            # And here below it, though the largest is above.
            [0.5, 0.51, 0.52, 0.53, 0.54, 0.55, 0.98],
            Verdict.HOLDS,
            "7 pairs, Wilcoxon p = 0.016",
        ),
        (
            [0.8, 1.25, 0.9, 1.22, 0.85, 1.11],
            Verdict.NO_DIFFERENCE,
            "6 pairs, Wilcoxon p = 1",
        ),
    ],
)
def test_a_ratio_counts_once_a_difference_is_shown(
    ratios: list[float], verdict: Verdict, test: str
) -> None:
    assert paired_verdict(ratios, "<=", 0.9) == (verdict, test)


def test_half_and_double_weigh_the_same() -> None:
    ratios = [0.30, 0.31, 0.32, 0.33, 0.34, 0.35, 0.36, 2.0, 2.1]
    inverse = [1 / ratio for ratio in ratios]
    (_, one), (_, other) = (
        paired_verdict(values, "<=", 1.0) for values in (ratios, inverse)
    )
    assert one == other


def test_nothing_and_infinity_weigh_the_same() -> None:
    """Half and double do, too: a pair of each is a tie."""
    ratios = [0.0, math.inf, 0.5, 0.6, 0.7, 0.8, 0.9]
    inverse = [math.inf, 0.0, *[1 / ratio for ratio in ratios[2:]]]
    (_, one), (_, other) = (
        paired_verdict(values, "<=", 1.0) for values in (ratios, inverse)
    )
    assert one == other


@pytest.mark.parametrize(
    ("ratios", "verdict"),
    [
        ([-0.5, 0.5, 0.55, 0.6, 0.7, 0.8], Verdict.HOLDS),
        # One that is 1.5 below 1, and five that are less above it.
        ([-0.5, 1.5, 1.6, 1.7, 1.8, 1.9], Verdict.NO_DIFFERENCE),
        ([-0.5, 2.6, 2.7, 2.8, 2.9, 3.0, 3.1, 3.2], Verdict.FAILS),
    ],
)
def test_ratios_of_both_signs_count_by_their_distance_from_1(
    ratios: list[float], verdict: Verdict
) -> None:
    assert paired_verdict(ratios, "<=", 0.9)[0] is verdict


def test_a_run_that_never_settles_counts_as_far_worse() -> None:
    never = float("inf")
    assert paired_verdict([never] * 6, "<", 1.0)[0] is Verdict.FAILS
    assert paired_verdict([0.0] * 6, "<", 1.0)[0] is Verdict.HOLDS
    mixed = [0.9, 0.95, 0.92, never, never, never]
    assert paired_verdict(mixed, "<", 1.0)[0] is Verdict.NO_DIFFERENCE


@pytest.mark.parametrize(
    ("parts", "verdict"),
    [
        ([Verdict.HOLDS, Verdict.HOLDS], Verdict.HOLDS),
        ([Verdict.HOLDS, Verdict.FAILS], Verdict.IN_PART),
        ([Verdict.HOLDS, Verdict.NO_DIFFERENCE], Verdict.IN_PART),
        ([Verdict.FAILS, Verdict.NO_DIFFERENCE], Verdict.FAILS),
        ([Verdict.HOLDS, Verdict.NOT_JUDGED], Verdict.NOT_JUDGED),
        ([Verdict.NOT_SHOWN], Verdict.NOT_SHOWN),
        ([Verdict.HOLDS, Verdict.BESIDE], Verdict.HOLDS),
        ([Verdict.BESIDE], Verdict.NOT_JUDGED),
        ([Verdict.NOT_SHOWN, Verdict.NO_DIFFERENCE], Verdict.NO_DIFFERENCE),
    ],
)
def test_parts_make_a_claim(parts: list[Verdict], verdict: Verdict) -> None:
    assert verdict_of_parts(parts) is verdict


def test_what_never_comes_counts_as_latest_in_a_median() -> None:
    assert median_of([1.0, None, 3], reason=NEVER) == 3
    assert median_of([1.0, None, None], reason=NEVER) == math.inf
    assert median_of([1.0, None, 3], reason="there is no obstacle") is None
    assert median_of([1.0, [2.0], 3], reason=NEVER) is None
