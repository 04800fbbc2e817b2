"""What several runs say of a claim."""

from __future__ import annotations

import pytest

from swarmstart.cases.verdicts import (
    Verdict,
    paired_verdict,
    verdict_of_parts,
    verdict_of_seeds,
)


@pytest.mark.parametrize(
    ("values", "share", "verdict"),
    [
        ([1.0, 2.0], 1.0, Verdict.HOLDS),
        ([1.0, 4.0], 1.0, Verdict.IN_PART),
        ([1.0, 1.0, 1.0, 1.0, 4.0], 0.8, Verdict.HOLDS),
        ([4.0, None], 1.0, Verdict.FAILS),
    ],
)
def test_every_seed_counts_or_the_share_that_is_asked_for(
    values: list[float | None], share: float, verdict: Verdict
) -> None:
    assert verdict_of_seeds(values, "<=", 3.0, share=share) is verdict


def test_never_is_a_bound_too() -> None:
    assert verdict_of_seeds([None, 58.0], "==", None) is Verdict.IN_PART


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
        ([Verdict.NOT_SHOWN, Verdict.NO_DIFFERENCE], Verdict.NO_DIFFERENCE),
    ],
)
def test_parts_make_a_claim(parts: list[Verdict], verdict: Verdict) -> None:
    assert verdict_of_parts(parts) is verdict
