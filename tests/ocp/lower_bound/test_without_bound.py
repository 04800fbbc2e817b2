"""Problems without a bound, or without a finite one: said so, never a wrong number."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    InvalidProblemError,
    Model,
    OptimalControlProblem,
    PathConstraint,
    solve,
)
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.ocp.lower_bound.stated.answer import BoundKind, LowerBound
from swarmstart.tests.ocp.lower_bound.known_optimum import Symbols, stated
from swarmstart.tests.ocp.lower_bound.scalar_optima import regulator

WORK = 0.5


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
    assert is_honest(lower_bound(problem, [1.0], work=WORK), least)


def test_a_control_without_bounds_that_earns_has_no_finite_bound() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=10, stage_cost=u
    )
    assert is_honest(lower_bound(problem, [0.0], work=WORK), -np.inf)


@pytest.mark.parametrize("sense", [1, -1])
def test_a_state_that_escapes_to_infinity_has_no_finite_bound(sense: int) -> None:
    s = Symbols(1)
    problem = stated(
        s, s.x**2 + s.u, horizon=3.0, controls=(-0.1, 1), end=-sense * s.x,
        maximize=sense < 0,
    )  # fmt: skip
    bound = lower_bound(problem, [1.0], work=WORK)
    assert not bound.kind.is_bound or bound.value == -sense * np.inf


def test_a_problem_without_any_answer_ends_without_an_error() -> None:
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=1.0, controls=(-1, 1), stage=s.u**2, terminal=[s.x - 5]
    )
    assert is_honest(lower_bound(problem, [0.0], work=WORK), np.inf)


def test_a_start_outside_its_bounds_ends_without_a_wrong_bound() -> None:
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=1.0, controls=(-1, 1), stage=s.x**2 + s.u**2, states=(-1, 1)
    )
    try:
        bound = lower_bound(problem, [2.0], work=WORK)
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
def test_of_rates_that_jump_nothing_is_proven_for_a_reason(name: str) -> None:
    s = Symbols(1)
    problem = stated(
        s, JUMPS[name](s.x) + s.u, horizon=1.0, controls=(-1, 1), stage=s.x**2 + s.u**2
    )
    bound = lower_bound(problem, [0.5], work=WORK, answer=1.0)
    assert bound.kind in (BoundKind.NONE, BoundKind.TRIVIAL)
    assert "jumps" in bound.reason
    assert is_honest(bound, 0.0)


@pytest.mark.parametrize("states", [4, 7])
def test_more_than_three_states_have_no_bound_and_no_work_is_done(states: int) -> None:
    s = Symbols(states)
    ode = ca.vertcat(s.x[1:], s.u)
    problem = stated(
        s, ode, horizon=1.0, controls=(-1, 1), stage=ca.sumsqr(s.x) + s.u**2
    )
    told = list[tuple[int, int, str]]()
    bound = lower_bound(
        problem, np.ones(states), work=60.0, progress=lambda *one: told.append(one)
    )
    assert told == []
    assert bound.kind is BoundKind.NONE
    assert f"{states} states" in bound.reason
    assert np.isnan(bound.value)
    assert np.isnan(bound.gap(1.0))


@pytest.mark.parametrize("x0", [[1.0, 2.0], []], ids=["two", "empty"])
def test_an_initial_state_of_another_shape_is_refused(x0: list[float]) -> None:
    with pytest.raises(InvalidProblemError):
        lower_bound(regulator().problem, x0, work=WORK)


@pytest.mark.parametrize("start", [np.nan, np.inf])
def test_an_initial_state_that_is_no_number_has_no_bound(start: float) -> None:
    bound = lower_bound(regulator().problem, [start], work=WORK)
    assert bound.kind is BoundKind.NONE
    assert "initial state" in bound.reason


@pytest.mark.parametrize("role", ["seconds", "work"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, True, "3"])
def test_budget_that_is_none_is_refused(role: str, value: object) -> None:
    with pytest.raises(InvalidProblemError, match=f"{role} must be"):
        lower_bound(regulator().problem, [1.0], **{role: value})  # type: ignore[arg-type]


@pytest.mark.parametrize("answer", [np.nan, np.inf, -np.inf, -1e300, 1e300, 0.0])
def test_an_answer_that_cannot_be_makes_no_bound_too_high(answer: float) -> None:
    known = regulator()
    bound = lower_bound(known.problem, known.x0, work=0.3, answer=answer)
    assert is_honest(bound, known.optimum)


def test_an_answer_that_is_no_cost_is_refused() -> None:
    with pytest.raises(InvalidProblemError, match="answer must be"):
        lower_bound(regulator().problem, [1.0], answer="best")  # type: ignore[arg-type]


KINKS: dict[str, Callable[[ca.SX], ca.SX]] = {
    "fabs": ca.fabs,
    "fmax": lambda x: ca.fmax(x, -x),
    "sqrt": lambda x: ca.sqrt(x**2),
    "conditional": lambda x: ca.if_else(x > 0, x, -x),
}


@pytest.mark.parametrize("name", KINKS)
def test_a_kink_makes_no_bound_too_high(name: str) -> None:
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=1.0, controls=(-1, 1), stage=KINKS[name](s.x) + s.u**2
    )
    # x stays above zero: u = -(1 - t) / 2.
    least = 0.3 - 1 / 4 + 1 / 12 + 1 / 12
    assert is_honest(lower_bound(problem, [0.3], work=0.5, answer=least), least)


@pytest.mark.parametrize("weight", [0.1, 10.0])
def test_a_soft_constraint_makes_no_bound_too_high(weight: float) -> None:
    s = Symbols(1)
    soft = PathConstraint(expression=s.x, lower=0.5, weight=weight)
    problem = stated(s, s.u, horizon=1.0, controls=(-2, 2), stage=s.u**2, path=[soft])
    answer = solve(problem, [0.0], search=None, lanes=0, backend="casadi", seed=0)
    bound = lower_bound(problem, [0.0], work=0.5, answer=answer)
    assert is_honest(bound, answer.cost)


def test_what_is_no_problem_is_refused() -> None:
    with pytest.raises(InvalidProblemError):
        lower_bound("regulator", [1.0], work=WORK)  # type: ignore[arg-type]


@pytest.mark.parametrize("sense", [1, -1])
def test_a_bound_of_a_zero_cost_is_no_more_than_zero(sense: int) -> None:
    s = Symbols(1)
    problem = stated(s, s.u, horizon=1.0, controls=(-1, 1), maximize=sense < 0)
    bound = lower_bound(problem, [0.3], work=WORK, answer=0.0)
    assert not bound.kind.is_bound or sense * bound.value <= 0.0
