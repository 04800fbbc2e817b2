"""Every status is a sentence that says whether the answer holds; growth by hand."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Free,
    Known,
    Model,
    OptimalControlProblem,
    SolutionStatus,
)
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.ocp.rollout.status import (
    MOST_GROWTH,
    Found,
    Growth,
    advice_for,
    exponential,
    growth_along,
)

X, U, RATE = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("rate")


def test_every_status_is_another_sentence() -> None:
    sentences = [status.value for status in SolutionStatus]
    assert len(set(sentences)) == len(sentences)
    assert all(len(sentence.split()) >= 5 for sentence in sentences)


def test_words_of_a_status_agree_with_whether_it_is_confirmed() -> None:
    for status in SolutionStatus:
        said = "confirmed on" in status.value
        assert said == status.is_confirmed
        refused = status.value.startswith("no")
        assert refused != status.is_confirmed


SCALAR = Shooting(
    OptimalControlProblem(
        Model(states=X[0], controls=U, signals=RATE, ode=RATE * X[0] + U),
        horizon=3.0,
        intervals=6,
        checks=2,
    )
)
"""x' = s x + u with a signal s, over six intervals of 0.5 s."""


def grown(rates: list[float], states: Array | None = None) -> Growth:
    """Return the growth of the scalar model with a rate for each interval."""
    signals = np.repeat([*rates, 0.0], 2)[None, :-1]
    signals[:, 1::2] = 77.0  # Between the intervals' beginnings no slope is taken.
    x = np.ones((1, 6)) if states is None else states
    return growth_along(SCALAR, x, np.zeros((1, 6)), Known(signals=signals), np.ones(1))


@given(rates=st.lists(st.integers(-8, 8), min_size=6, max_size=6))
@settings(max_examples=40, deadline=None)
def test_growth_is_the_largest_sum_of_rates_over_any_intervals_in_a_row(
    rates: list[int],
) -> None:
    """exp of the integral of s; the brute force over both ends."""
    found = grown([float(rate) for rate in rates])
    sums = {(i, j): 0.5 * sum(rates[i:j]) for i in range(6) for j in range(i + 1, 7)}
    most = max(0.0, *sums.values())
    assert found.log == pytest.approx(most, abs=1e-9)
    if most > 0.0:
        i, j = round(2 * found.begin), round(2 * found.end)
        assert (found.begin, found.end) == (i / 2, j / 2)
        assert sums[i, j] == pytest.approx(most)
    else:
        assert (found.begin, found.end) == (0.0, 0.0)
    fastest = max(0, *rates)
    assert found.rate == pytest.approx(fastest)
    assert found.time == (rates.index(fastest) / 2 if fastest else 0.0)


def test_growth_ends_where_the_states_are_not_finite() -> None:
    states = np.ones((1, 6))
    for end in (0, 2, 5):
        states[0, end:] = np.nan
        expected = (0.5 * 3.0 * end, 0.0, 0.5 * end, 3.0 if end else 0.0, 0.0)
        assert grown([3.0] * 6, states) == pytest.approx(expected)
        states[:] = 1.0


def test_growth_ends_where_one_state_alone_is_not_finite() -> None:
    """x' = 3 x beside a state that is lost after 1 s."""
    problem = OptimalControlProblem(
        Model(states=X, controls=U, ode=ca.vertcat(3 * X[0], U)),
        horizon=2.0,
        intervals=4,
    )
    states = np.ones((2, 4))
    states[1, 2:] = np.inf
    found = growth_along(
        Shooting(problem), states, np.zeros((1, 4)), Known(), np.ones(2)
    )
    assert found == pytest.approx((3.0, 0.0, 1.0, 3.0, 0.0))


def test_growth_ends_at_a_slope_that_is_not_finite() -> None:
    """x' = 2 sqrt(x) has the slope 1 / sqrt(x)."""
    problem = OptimalControlProblem(
        Model(states=X[0], controls=U, ode=2 * ca.sqrt(X[0])), horizon=4.0, intervals=4
    )
    states = np.array([[1.0, 0.25, 0.0, 1.0]])
    found = growth_along(
        Shooting(problem), states, np.zeros((1, 4)), Known(), np.ones(1)
    )
    assert found == pytest.approx((1.0 + 2.0, 0.0, 2.0, 2.0, 1.0))


def test_one_interval_counts_for_a_growth_that_is_still_a_number() -> None:
    """e^300 is exponentiated, e^1000 is not: it is called as large."""
    assert grown([500.0, *[-1.0] * 5]).log == pytest.approx(250.0)
    assert grown([2000.0, *[-1.0] * 5]).log == pytest.approx(300.0)


def test_growth_is_counted_in_the_sizes_of_the_states() -> None:
    """x' = 3 y, y' = 0 over 2 s: [[1, c], [0, 1]], c = 6 size_y / size_x."""
    problem = OptimalControlProblem(
        Model(states=X, controls=U, ode=ca.vertcat(3 * X[1], U)),
        horizon=2.0,
        intervals=4,
    )
    for sizes in ([1.0, 1.0], [2.0, 10.0], [10.0, 2.0]):
        found = growth_along(
            Shooting(problem), np.ones((2, 4)), np.zeros((1, 4)), Known(),
            np.array(sizes),
        )  # fmt: skip
        c = 6.0 * sizes[1] / sizes[0]
        root = np.sqrt(c**2 / 4 + 1)  # Singular values root + c / 2, root - c / 2.
        assert found.log == pytest.approx(np.log(root + c / 2))
        assert (found.begin, found.end, found.rate) == (0.0, 2.0, 0.0)


def test_growth_with_a_free_end_time_is_told_in_seconds() -> None:
    """x' = 5 x over 4 s, which a start of the core's state for the end time says."""
    problem = OptimalControlProblem(
        Model(states=X[0], controls=U, ode=5 * X[0] + U),
        horizon=Free(1.0, 9.0),
        intervals=4,
    )
    shooting = Shooting(problem)
    start = np.array([1.0, 4.0])
    assert shooting.lowered.end_time(start) == 4.0
    states = np.repeat(start[:, None], 4, axis=1)
    found = growth_along(shooting, states, np.zeros((1, 4)), Known(), np.ones(2))
    assert found.rate == pytest.approx(5.0)
    assert (found.begin, found.end, found.time) == (0.0, 4.0, 0.0)
    # The end time is a state as well: its own deviation, of size 1, moves x by 5.
    assert found.log == pytest.approx(20.0, rel=0.1)


def test_growth_is_large_beyond_1e8_and_told_as_a_number() -> None:
    def of(log: float) -> Growth:
        return Growth(log, 1.0, 2.5, 8.0, 1.5)

    assert pytest.approx(np.log(1e8)) == MOST_GROWTH
    assert not of(MOST_GROWTH).is_large
    assert of(MOST_GROWTH + 1e-9).is_large
    assert of(np.nan).is_large
    assert str(of(np.log(2.5e5))) == (
        "a deviation grows 2.5e+05-fold from 1 s to 2.5 s (fastest by 8 per second at "
        "1.5 s)"
    )
    assert "grows 1e+299-fold" in str(of(299 * np.log(10)))
    assert "grows 1e400-fold" in str(of(400 * np.log(10)))


def test_advice_is_that_of_the_growth_only_if_it_is_large() -> None:
    problem = SCALAR.problem
    large, small = (Growth(log, 0.0, 3.0, 8.0, 1.0) for log in (30.0, 10.0))
    lost = Found(SolutionStatus.MISMATCH, "")
    held = Found(SolutionStatus.CONVERGED, "")
    assert "with more intervals (12)" in advice_for(problem, lost, None, large)
    assert "feedback" in advice_for(problem, held, None, large)
    for found in (lost, held):
        assert advice_for(problem, found, None, small) == advice_for(
            problem, found, None
        )


def test_broken_constraint_without_its_excess_is_told_of_more_checks() -> None:
    found = Found(SolutionStatus.BROKEN, "")
    assert advice_for(SCALAR.problem, found, None) == "checks=4"


@pytest.mark.parametrize("norm", [0.0, 1e-9, 0.3, 0.5, 1.0, 7.0, 90.0])
@pytest.mark.parametrize("n", [1, 2, 5])
def test_the_exponential_is_scipys(n: int, norm: float) -> None:
    A = np.random.default_rng(n).standard_normal((n, n))
    A *= norm / np.linalg.norm(A)
    expected = expm(A)
    off = np.abs(exponential(A) - expected).max() / np.abs(expected).max()
    assert off < 1e-14 * max(10.0, 10 * norm)
