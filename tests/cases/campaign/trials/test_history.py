"""The any-time history: marks, order, budgets, and its final value."""

from __future__ import annotations

import math

import numpy as np
import pytest

from swarmstart.cases.campaign.trials.history import PER_DECADE, Meter
from swarmstart.machine_code.clocks import stopwatch
from swarmstart.ocp.nlp.watching import UNWATCHED, Ratios, Relay, Work

NOWHERE = np.zeros((1, 1)), np.zeros(1)


def meter(evaluations: int | None = None, value: float = 1.0) -> Meter:
    with stopwatch() as watch:
        return Meter(
            watch,
            value_of=lambda u, x: (value, 0.0),
            tolerance=1e-6,
            evaluations=evaluations,
        )


def generations(found: Meter, values: list[tuple[float, float]], size: int) -> None:
    for cost, violation in values:
        costs, broken = np.full(size, cost), np.full(size, violation)
        found.evaluated(np.zeros((1, size)), (costs, broken), lambda x: NOWHERE)


def test_a_feasible_answer_comes_before_any_that_is_not() -> None:
    found = meter()
    generations(found, [(1.0, 0.5), (0.5, 0.2), (7.0, 0.0), (0.1, 0.3), (6.0, 0.0)], 9)
    assert found.value == (6.0, 0.0)
    history = found.history()
    told = list(zip(history["cost"], history["violation"], strict=True))
    assert list(dict.fromkeys(told)) == [(1.0, 0.5), (0.5, 0.2), (7.0, 0.0), (6.0, 0.0)]


def test_marks_are_ten_to_a_decade() -> None:
    found = meter()
    generations(found, [(1.0 / k, 0.0) for k in range(1, 5001)], 1)
    evaluations = found.history()["evaluations"]
    inner = [m for m in evaluations if 100 <= m < 1000]
    assert len(inner) == PER_DECADE
    steps = np.diff(np.log10(inner))
    np.testing.assert_allclose(steps, 0.1, atol=0.005)
    assert evaluations[-1] == 5000
    # At each mark that which was there then, not what came later.
    assert found.history()["cost"] == [1.0 / m for m in evaluations]


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_never_the_best(bad: float) -> None:
    found = meter()
    generations(found, [(bad, 0.0), (1.0, math.nan)], 3)
    assert found.best is None
    assert found.history()["cost"] == [None]
    generations(found, [(3.0, 0.0), (bad, 0.0)], 3)
    assert found.value == (3.0, 0.0)
    assert found.history()["cost"][-1] == 3.0
    # Nor does it hide the others of its generation.
    among = np.array([bad, 2.0, bad]), np.array([0.0, 0.0, math.nan])
    found.evaluated(np.zeros((1, 3)), among, lambda x: NOWHERE)
    assert found.value == (2.0, 0.0)


def test_what_was_not_answered_does_not_count_as_better() -> None:
    """A search by penalty can answer with a point that is worse in this order."""
    found = meter()
    generations(found, [(5.0, 0.0), (2.0, 0.0)], 10)
    history = found.history(final=(3.0, 0.0))
    assert history["cost"][-1] == 3.0 and min(history["cost"]) == 3.0


def test_evaluations_spent_are_over_and_stay_so() -> None:
    found = meter(evaluations=20)
    generations(found, [(1.0, 0.0)], 19)
    assert not found.is_over
    found.solved(Work(1, 0, 0), Ratios(3.0, 5.0))
    assert found.is_over and found.stopped == "evaluations"


def test_iterates_are_looked_at_once_a_mark() -> None:
    looked = []
    found = meter(evaluations=1000)

    def answer() -> tuple[np.ndarray, np.ndarray]:
        looked.append(1)
        return NOWHERE

    stops = [found.iterated(float(k), answer) for k in range(1, 1001)]
    assert stops == [True] * 999 + [False]
    assert len(looked) <= 3 * PER_DECADE + 1


def test_a_relay_tells_one_meter_after_another() -> None:
    relay, first, second = Relay(), meter(), meter()
    for one in (first, second):
        with relay.to(one):
            relay.counted(3.0)
    relay.counted(5.0)
    assert relay.watch is UNWATCHED
    assert first.evaluations == second.evaluations == 3.0
