"""The line on a bound states no more than is proven."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from swarmstart.ocp.answer.optimality_gap import OptimalityGap
from swarmstart.ocp.lower_bound.stated.answer import BoundKind, LowerBound

PROVEN = OptimalityGap(
    kind=BoundKind.PROVEN, value=2.8661, reason="of degree 5", cost=2.86726
)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({}, "2.8661 proven; the optimum is at most 0.041 % below the answer"),
        (
            {"sense": -1.0, "value": 2.9},
            "2.9 proven; the optimum is at most 1.2 % above the answer",
        ),
        ({"cost": 2.8661}, "2.8661 proven; the answer is at the bound"),
        (
            {"cost": None},
            "2.8661 proven; there is no confirmed answer to compare with it",
        ),
        (
            {"cost": 2.8660, "tolerance": 1e-3},
            "2.8661 proven; the answer is below the bound by 0.0001: within its "
            "tolerance",
        ),
        (
            {"cost": 2.5, "tolerance": 1e-3},
            "2.8661 proven; the answer is below the bound by 0.37, more than its "
            "tolerance: one of the two is wrong",
        ),
        (
            {"kind": BoundKind.TRIVIAL, "value": 0.0, "cost": 2.0},
            "0 trivial (the least stage cost); the optimum is at most 100 % below the "
            "answer",
        ),
        (
            {"value": -4.0, "cost": 2.0},
            "-4 proven; the optimum is at most 6 below the answer",
        ),
        (
            {"value": -4.0, "cost": 0.0},
            "-4 proven; the optimum is at most 4 below the answer",
        ),
        (
            {"kind": BoundKind.TRIVIAL, "value": -1e-299, "cost": 2.0},
            "0 trivial (the least stage cost); the optimum is at most 100 % below the "
            "answer",
        ),
        ({"kind": BoundKind.SAMPLED}, "sampled estimate 2.8661 (no bound)"),
        (
            {"kind": BoundKind.NONE, "value": None, "reason": "5 states, at most 3"},
            "none: 5 states, at most 3",
        ),
    ],
)
def test_the_words_are_those_of_the_kind(
    changed: dict[str, object], words: str
) -> None:
    assert replace(PROVEN, **changed).words == words  # type: ignore[arg-type]


def test_numbers_are_rounded_so_that_they_claim_less() -> None:
    """2.866127 is not proven if 2.8661268 is; 0.04 % is less than 0.0413 %."""
    rng = np.random.default_rng(0)
    for value, apart in rng.uniform(0.1, 10.0, (200, 2)) ** 3:
        for sense in (1.0, -1.0):
            cost = value + sense * 0.01 * apart
            words = replace(PROVEN, value=value, cost=cost, sense=sense).words
            shown, rest = words.split(" proven; the optimum is at most ")
            assert sense * (float(shown) - value) <= 0
            far, unit = rest.split()[:2]
            said = float(far) * (abs(cost) / 100 if unit == "%" else 1.0)
            assert said >= sense * (cost - value)
            assert said <= 1.11 * sense * (cost - value)


def test_the_gap_is_that_of_the_bound() -> None:
    for sense, value in ((1.0, 1.5), (-1.0, 4.0), (1.0, -3.0)):
        bound = LowerBound(kind=BoundKind.PROVEN, value=value, reason="", sense=sense)
        beside = OptimalityGap.of(bound, 2.0)
        assert beside.gap == pytest.approx(bound.gap(2.0), rel=1e-15)


@pytest.mark.parametrize("kind", [BoundKind.SAMPLED, BoundKind.NONE])
def test_what_is_no_bound_has_no_gap(kind: BoundKind) -> None:
    beside = replace(PROVEN, kind=kind)
    assert beside.gap is None and beside.apart is None
    assert "at most" not in beside.words


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_value_that_is_not_finite_is_no_bound(value: float) -> None:
    bound = LowerBound(kind=BoundKind.PROVEN, value=value, reason="it overflows")
    assert OptimalityGap.of(bound, 2.0).words == "none: it overflows"
    assert OptimalityGap.of(bound, 2.0).gap is None


def test_a_cost_that_is_not_finite_is_no_answer() -> None:
    bound = LowerBound(kind=BoundKind.PROVEN, value=1.0, reason="")
    assert "no confirmed answer" in OptimalityGap.of(bound, float("nan")).words
