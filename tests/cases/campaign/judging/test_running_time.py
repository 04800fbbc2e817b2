"""Running times from histories, against loops and fractions by hand."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmstart.cases.campaign.judging.running_time import (
    TARGETS,
    costs_at,
    courses_of,
    expected_running_time,
    marks_up_to,
    reached,
    shares_reached,
    targets_between,
)

INF = np.inf


def history(*found: tuple[float, float, float]) -> dict[str, Any]:
    """Return a history of (evaluations, cost, violation)."""
    spent, cost, violation = zip(*found, strict=True)
    return {
        "evaluations": list(spent),
        "seconds": [s / 100 for s in spent],
        "cost": list(cost),
        "violation": list(violation),
    }


THREE = courses_of(
    [
        history((1, 5.0, 1.0), (10, 9.0, 0.0), (50, 4.0, 0.0), (80, 2.0, 0.0)),
        history((1, 8.0, 0.0), (20, 6.0, 0.0)),
        None,
    ],
    "evaluations",
    ends=[100, 90, 70],
    final=[2.0, 6.0, INF],
)


def test_the_expected_running_time_counts_what_failed_runs_have_spent() -> None:
    """To 6: after 50 and 20 evaluations; the third run failed and had spent 70."""
    spent = reached(THREE, [6.0, 2.0, 1.0])
    times = [expected_running_time(column, THREE.ends) for column in spent.T]
    assert times[0] == float(Fraction(50 + 20 + 70, 2))
    assert times[1] == float(Fraction(80 + 90 + 70, 1))
    assert times[2] is None


def test_every_budget_is_a_later_cut() -> None:
    """At 40 the first run has not come to 6 yet, and has spent 40."""
    spent = reached(THREE, [6.0])[:, 0]
    found = expected_running_time(spent, THREE.ends, budget=40)
    assert found == float(Fraction(40 + 20 + 40, 1))
    assert expected_running_time(spent, THREE.ends, budget=19) is None


def test_an_infeasible_cost_reaches_no_target() -> None:
    """The first run's 5 of the first evaluation breaks a constraint."""
    assert reached(THREE, [5.0])[0, 0] == 50


def test_a_solvers_word_counts_only_as_far_as_its_answer_bears_it_out() -> None:
    own = history((1, 8.0, 0.0), (20, 1.0, 0.0))
    courses = courses_of([own, own], "evaluations", ends=[30, 30], final=[3.0, INF])
    np.testing.assert_array_equal(reached(courses, [3.0, 2.0]), [[20, INF], [INF, INF]])


def test_an_answer_better_than_the_history_says_is_reached_at_the_end() -> None:
    own = history((1, 8.0, 0.0))
    courses = courses_of([own], "evaluations", ends=[30], final=[3.0])
    assert reached(courses, [3.0])[0, 0] == 30


def test_seconds_have_marks_of_their_own() -> None:
    own = history((10, 8.0, 0.0), (20, 3.0, 0.0))
    courses = courses_of([own], "seconds", ends=[0.5], final=[3.0])
    assert reached(courses, [3.0])[0, 0] == 0.2


runs = st.lists(
    st.lists(
        st.tuples(st.integers(1, 9), st.integers(0, 9), st.sampled_from([0.0, 1.0])),
        max_size=5,
    ),
    min_size=1,
    max_size=4,
)


@given(runs=runs)
def test_distributions_are_those_of_loops(
    runs: list[list[tuple[int, int, float]]],
) -> None:
    """Share of (run, target) pairs whose target was met at a mark; all by loops."""
    ordered = [sorted(own) for own in runs]
    final = [min((c for _, c, v in own if v == 0), default=INF) for own in ordered]
    histories = [history(*own) if own else None for own in ordered]
    courses = courses_of(
        histories, "evaluations", ends=[10] * len(runs), final=np.array(final, float)
    )
    targets, marks = np.array([0.0, 2.5, 5.0, 9.0]), np.array([1.0, 3.0, 9.0, 10.0])
    shares = shares_reached(reached(courses, targets), marks).mean(axis=0)
    for mark, share in zip(marks, shares, strict=True):
        met = sum(
            any(s <= mark and c <= target and v == 0 for s, c, v in own)
            for own in ordered
            for target in targets
        )
        assert share == pytest.approx(met / (len(runs) * len(targets)), abs=1e-12)
    known = costs_at(courses, np.array([1.0, 3.0, 9.0]))
    for own, row in zip(ordered, known, strict=True):
        for mark, cost in zip((1, 3, 9), row, strict=True):
            seen = [c for s, c, v in own if s <= mark and v == 0]
            assert cost == min(seen, default=INF)


def test_after_its_end_a_run_has_its_verified_cost() -> None:
    assert costs_at(THREE, np.array([89.0, 90.0, 100.0])).tolist() == [
        [2.0, 2.0, 2.0],
        [6.0, 6.0, 6.0],
        [INF, INF, INF],
    ]
    costlier = courses_of(
        [history((1, 3.0, 0.0))], "evaluations", ends=[30], final=[3.5]
    )
    assert costs_at(costlier, np.array([29.0, 30.0])).tolist() == [[3.0, 3.5]]


def test_targets_are_in_equal_ratios_of_their_distance_from_the_best() -> None:
    found = targets_between(-5.0, 95.0, 0.01)
    assert len(found) == TARGETS
    ratios = (found[1:] + 5) / (found[:-1] + 5)
    np.testing.assert_allclose(ratios, 10 ** (4 / 50), rtol=1e-9)
    assert found[-1] == pytest.approx(95.0)
    np.testing.assert_allclose(targets_between(1.0, 1.0, 0.1), 1.1)


def test_marks_are_ten_a_decade_and_the_end() -> None:
    found = marks_up_to(4000.0)
    assert (found[0], found[10], found[-1]) == (1.0, pytest.approx(10.0), 4000.0)
    assert np.all(np.diff(found) > 0)
    assert marks_up_to(1.0).tolist() == [1.0]
