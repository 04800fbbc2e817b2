"""`solve(bound=SECONDS)`: the bound is computed after the answer, which is kept."""

from __future__ import annotations

import signal
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    Known,
    Model,
    OptimalControlProblem,
    Solution,
    SolveError,
    SolveInterrupted,
    solve,
)
from swarmstart.ocp.lower_bound.stated.answer import LowerBound
from swarmstart.tests.ocp.bounds import NONE, PROVEN, SAMPLED, TRIVIAL, Found

QUICK: dict[str, Any] = {"search": None, "lanes": 0, "seed": 0}


def linear(*, maximize: bool = False) -> OptimalControlProblem:
    """Drive x' = u from p to 0 in one second: the integral of u^2 is p^2."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("p")
    model = Model(states=x, controls=u, ode=u * p, parameters=p)
    sign = -1.0 if maximize else 1.0
    return OptimalControlProblem(
        model, horizon=1.0, intervals=4, stage_cost=sign * u**2, terminal=[x],
        bounds=Bounds(controls=(-5, 5)), maximize=maximize,
    )  # fmt: skip


def answered(bound: float | None = 9.0, **given: Any) -> Solution:
    one = Known(parameters=[1.0])
    return solve(linear(**given), [1.5], known=one, bound=bound, **QUICK)


def test_the_bound_is_sought_of_the_problem_as_it_was_given(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = Found().instead(monkeypatch)
    solution = answered(12.5)
    (call,) = found.calls
    assert call["problem"] is solution.problem
    np.testing.assert_array_equal(call["x0"], [1.5])
    np.testing.assert_array_equal(call["known"].parameters, [1.0])
    assert call["work"] == 12.5
    assert call["answer"].verified_cost == solution.verified_cost
    assert solution.bound is PROVEN
    assert solution.gap is not None
    # The optimum is 1.5^2 = 2.25, the bound 1.
    assert solution.gap.gap == pytest.approx(1.25 / 2.25, rel=1e-6)


def test_no_bound_is_sought_unless_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = Found().instead(monkeypatch)
    solution = answered(None)
    assert not found.calls and solution.bound is None and solution.gap is None
    assert "bound  " not in repr(solution)


def test_a_bound_changes_nothing_of_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    Found().instead(monkeypatch)
    with_bound, without = answered(1.0), answered(None)
    assert with_bound.controls.tobytes() == without.controls.tobytes()
    assert with_bound.verified_cost == without.verified_cost


@pytest.mark.parametrize(
    ("bound", "line"),
    [
        (PROVEN, "1 proven; the optimum is at most 56 % below the answer"),
        (TRIVIAL, "0 trivial (the least stage cost); the optimum is at most"),
        (SAMPLED, "sampled estimate 1.5 (no bound)"),
        (NONE, "none: 5 states, at most 3 are possible"),
    ],
)
def test_the_summary_always_says_the_kind(
    monkeypatch: pytest.MonkeyPatch, bound: LowerBound, line: str
) -> None:
    Found(bound).instead(monkeypatch)
    lines = repr(answered()).splitlines()
    assert lines[4].startswith(f"  bound       {line}")


def test_of_a_maximised_cost_the_optimum_is_above(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The largest value of minus the integral of u^2 is -2.25."""
    Found(replace(PROVEN, value=-2.0, sense=-1.0)).instead(monkeypatch)
    solution = answered(maximize=True)
    assert solution.verified_cost == pytest.approx(-2.25, rel=1e-6)
    assert "at most 12 % above the answer" in repr(solution)


def test_an_answer_that_is_not_confirmed_is_not_compared(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    Found().instead(monkeypatch)
    far = solve(linear(), [50.0], known=Known(parameters=[1.0]), bound=1.0, **QUICK)
    assert not far.status.is_confirmed
    assert "1 proven; there is no confirmed answer" in repr(far)


def test_crossing_within_the_tolerance_is_said_to_be_that(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    Found(replace(PROVEN, value=2.2501)).instead(monkeypatch)
    assert "below the bound by 0.0001: within its tolerance" in repr(answered())
    Found(replace(PROVEN, value=2.5)).instead(monkeypatch)
    assert "one of the two is wrong" in repr(answered())


def test_interrupted_the_answer_and_the_best_bound_are_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    Found(sent=signal.SIGINT).instead(monkeypatch)
    with pytest.raises(SolveInterrupted) as stopped:
        answered()
    assert stopped.value.partial.bound is PROVEN
    assert stopped.value.partial.status.is_confirmed


def test_interrupted_before_there_is_a_bound_the_answer_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    Found(raises=KeyboardInterrupt()).instead(monkeypatch)
    with pytest.raises(SolveInterrupted) as stopped:
        answered()
    assert stopped.value.partial.bound is None
    assert stopped.value.partial.status.is_confirmed


def test_an_error_of_the_bound_is_its_reason_not_that_of_the_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    Found(raises=SolveError("no LP solver")).instead(monkeypatch)
    assert "  bound       none: no LP solver" in repr(answered())


@pytest.mark.parametrize(
    "bound", [0, 0.0, -1.0, float("nan"), float("inf"), "60", "60s", True, [60.0], b"1"]
)
def test_other_than_seconds_is_refused_before_anything_is_solved(bound: Any) -> None:
    with pytest.raises(
        InvalidProblemError, match=r"^bound must be a positive number of seconds, got"
    ):
        answered(bound)


def test_numbers_of_numpy_are_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    found = Found().instead(monkeypatch)
    answered(np.float64(3.0))
    answered(np.int64(3))  # type: ignore[arg-type]
    assert [call["work"] for call in found.calls] == [3.0, 3.0]
