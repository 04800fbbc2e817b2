"""Problems without a bound, or without a finite one: said so, never a wrong number."""

import time
from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    InvalidProblemError,
    Model,
    OptimalControlProblem,
)
from swarmstart.ocp.lower_bound.answer import BoundKind, LowerBound
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.tests.ocp.lower_bound.known_optimum import Symbols, stated
from swarmstart.tests.ocp.lower_bound.scalar_optima import regulator

SECONDS = 1.0


def is_honest(bound: LowerBound, least: float) -> bool:
    """Return whether a bound is at most the least cost, or there is none for a reason.

    Args:
        bound: The bound.
        least: An infinite one: no finite bound is right.
    """
    if not bound.kind.is_bound:
        return bool(bound.reason) and bool(np.isnan(bound.value))
    return bool(bound.value <= least + 1e-9 * abs(least))


def test_a_cost_without_controls_is_bounded_by_itself() -> None:
    s = Symbols(1, 1)
    problem = stated(s, -s.x, horizon=1.0, controls=(-1, 1), stage=s.x**2)
    least = (1 - np.exp(-2)) / 2
    assert is_honest(lower_bound(problem, [1.0], seconds=SECONDS), least)


def test_a_control_without_bounds_that_earns_has_no_finite_bound() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=10, stage_cost=u
    )
    assert is_honest(lower_bound(problem, [0.0], seconds=SECONDS), -np.inf)


@pytest.mark.parametrize("sense", [1, -1])
def test_a_state_that_escapes_to_infinity_has_no_finite_bound(sense: int) -> None:
    s = Symbols(1)
    problem = stated(
        s, s.x**2 + s.u, horizon=3.0, controls=(-0.1, 1), end=-sense * s.x,
        maximize=sense < 0,
    )  # fmt: skip
    bound = lower_bound(problem, [1.0], seconds=SECONDS)
    assert not bound.kind.is_bound or bound.value == -sense * np.inf


def test_a_problem_without_any_answer_ends_without_an_error() -> None:
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=1.0, controls=(-1, 1), stage=s.u**2, terminal=[s.x - 5]
    )
    assert is_honest(lower_bound(problem, [0.0], seconds=SECONDS), np.inf)


def test_a_start_outside_its_bounds_ends_without_a_wrong_bound() -> None:
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=1.0, controls=(-1, 1), stage=s.x**2 + s.u**2, states=(-1, 1)
    )
    try:
        bound = lower_bound(problem, [2.0], seconds=SECONDS)
    except InvalidProblemError:
        return
    # Of the problem without the bounds, which the start breaks.
    assert is_honest(bound, np.inf)


JUMPS: dict[str, Callable[[ca.SX], ca.SX]] = {
    "sign": ca.sign,
    "floor": ca.floor,
    "if_else": lambda x: ca.if_else(x > 0, -1, 2),
}


@pytest.mark.parametrize("name", JUMPS)
def test_rates_that_jump_have_no_bound_for_a_reason(name: str) -> None:
    s = Symbols(1)
    problem = stated(
        s, JUMPS[name](s.x) + s.u, horizon=1.0, controls=(-1, 1), stage=s.x**2 + s.u**2
    )
    bound = lower_bound(problem, [0.5], seconds=SECONDS)
    assert bound.kind is BoundKind.NONE
    assert bound.reason


@pytest.mark.parametrize("states", [4, 7])
def test_more_than_three_states_have_no_bound_within_a_second(states: int) -> None:
    s = Symbols(states)
    ode = ca.vertcat(s.x[1:], s.u)
    problem = stated(
        s, ode, horizon=1.0, controls=(-1, 1), stage=ca.sumsqr(s.x) + s.u**2
    )
    begin = time.perf_counter()
    bound = lower_bound(problem, np.ones(states), seconds=60.0)
    assert time.perf_counter() - begin < 1.0
    assert bound.kind is BoundKind.NONE
    assert "3 states" in bound.reason or "three states" in bound.reason
    assert np.isnan(bound.value)
    assert np.isnan(bound.gap(1.0))


@pytest.mark.parametrize(
    "x0", [[np.nan], [np.inf], [1.0, 2.0], []], ids=["NaN", "inf", "two", "empty"]
)
def test_an_initial_state_that_is_none_is_refused(x0: list[float]) -> None:
    with pytest.raises(InvalidProblemError):
        lower_bound(regulator().problem, x0, seconds=SECONDS)


def test_what_is_no_problem_is_refused() -> None:
    with pytest.raises(InvalidProblemError):
        lower_bound("regulator", [1.0], seconds=SECONDS)  # type: ignore[arg-type]


@pytest.mark.parametrize("sense", [1, -1])
def test_a_bound_of_a_zero_cost_is_no_more_than_zero(sense: int) -> None:
    s = Symbols(1)
    problem = stated(s, s.u, horizon=1.0, controls=(-1, 1), maximize=sense < 0)
    bound = lower_bound(problem, [0.3], seconds=SECONDS, answer=0.0)
    assert not bound.kind.is_bound or sense * bound.value <= 0.0
