"""A problem keeps what a call of `solve` made, and a later call makes nothing."""

import copy
import gc
import threading
import weakref
from collections.abc import Callable
from unittest.mock import Mock

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    PolishStatus,
)
from swarmstart.ocp.answer import kept
from swarmstart.ocp.answer.kept import kept_planner
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.answer.solution import Solution
from swarmstart.ocp.answer.solving import solve

Swing = Callable[..., OptimalControlProblem]
SYMBOLIC = ("cse", "jacobian", "hessian", "gradient", "nlpsol", "Function")


def solved(problem: OptimalControlProblem, seed: int = 0) -> Solution:
    """Return an answer that needs no repair."""
    return solve(problem, [0, 0], budget=300, lanes=8, seed=seed)


def lent(problem: OptimalControlProblem, lanes: int = 0) -> Planner:
    """Return the planner that a call would use."""
    with kept_planner(
        problem,
        search=None,
        polish=IpoptOptions(),
        backend=None,
        lanes=lanes,
        threads=1,
    ) as planner:
        return planner


def test_the_second_solve_does_no_symbolic_work_and_finds_the_same_bits(
    swing_up: Swing, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = swing_up(20, 4)
    first, calls = solved(problem), list[str]()
    for name in SYMBOLIC:
        made = getattr(ca, name)

        def counted(*given: object, _made: object = made, _name: str = name) -> object:
            calls.append(_name)
            return _made(*given)  # type: ignore[operator]

        monkeypatch.setattr(ca, name, counted)
    second = solved(problem)
    assert calls == []
    assert solved(swing_up(20, 4)).cost == first.cost  # A new one makes all of it.
    assert {"cse", "jacobian", "nlpsol", "Function"} <= set(calls)
    assert second.cost == first.cost
    np.testing.assert_array_equal(second.controls, first.controls)


def test_a_prepared_planner_builds_nothing_at_its_first_plan(
    swing_up: Swing, monkeypatch: pytest.MonkeyPatch
) -> None:
    planner = Planner(swing_up(20, 4), search=None, polish=IpoptOptions())
    planner.prepare()
    for name in SYMBOLIC:
        monkeypatch.setattr(ca, name, Mock(side_effect=AssertionError(name)))
    plan = planner.plan([0, 0], rng=np.random.default_rng(0))
    assert plan.feasible


def test_a_start_far_from_zero_finds_what_an_earlier_call_made() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        stage_cost=u**2, terminal=[(x, 1e9 + 1)], bounds=Bounds(controls=(-2, 2)),
    )  # fmt: skip
    first = solve(problem, [1e9], search=None, lanes=0, seed=0)
    near = problem.kept["near"]
    assert len(near.kept["planners"]) == 1
    second = solve(problem, [1e9 - 0.5], search=None, lanes=0, seed=0)
    assert problem.kept["near"] is near and len(near.kept["planners"]) == 1
    assert first.problem is near and second.cost > 2 * first.cost
    solve(problem, [1e9 - 20], search=None, lanes=0, seed=0)
    assert problem.kept["near"] is not near


def test_other_settings_have_a_planner_of_their_own(swing_up: Swing) -> None:
    problem = swing_up(5, 1)
    one = lent(problem)
    assert lent(problem) is one
    assert lent(problem, lanes=2) is not one
    assert lent(problem) is one


def test_options_that_were_changed_in_place_count(swing_up: Swing) -> None:
    problem, options = swing_up(20, 4), {"max_iter": 1}
    polish = IpoptOptions(options=options)
    found = []
    for most in (1, 200):
        options["max_iter"] = most
        answer = solve(problem, [0, 0], search=None, lanes=0, polish=polish, seed=0)
        found.append(answer.plan.polish_status)
    assert found == [PolishStatus.ITERATION_LIMIT, PolishStatus.CONVERGED]


def test_a_planner_in_use_is_lent_to_nobody_else(swing_up: Swing) -> None:
    problem = swing_up(20, 4)
    expected, found = solved(problem, seed=3).cost, list[float]()
    threads = [
        threading.Thread(target=lambda: found.append(solved(problem, seed=3).cost))
        for _ in range(2)
    ]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert found == [expected, expected]


def test_a_planner_whose_use_fails_is_not_kept(swing_up: Swing) -> None:
    problem = swing_up(5, 1)
    with (
        pytest.raises(ZeroDivisionError),
        kept_planner(
            problem,
            search=None,
            polish=IpoptOptions(),
            backend=None,
            lanes=0,
            threads=1,
        ),
    ):
        raise ZeroDivisionError
    assert problem.kept["planners"] == []


def test_the_backend_of_the_environment_counts(
    swing_up: Swing, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = swing_up(5, 1)
    monkeypatch.setenv("SWARMSTART_BACKEND", "casadi")
    assert lent(problem).fitness.backend == "casadi"
    monkeypatch.setenv("SWARMSTART_BACKEND", "llvm")
    assert lent(problem).fitness.backend == "llvm"


def test_only_the_latest_planners_are_kept(swing_up: Swing) -> None:
    problem = swing_up(5, 1)
    planners = [lent(problem, lanes=lanes) for lanes in range(1, kept._MOST + 3)]
    assert len(problem.kept["planners"]) == kept._MOST
    assert lent(problem, lanes=kept._MOST + 2) is planners[-1]
    assert lent(problem, lanes=1) is not planners[0]


def test_copies_have_nothing_and_a_problem_that_is_gone_takes_all_along(
    swing_up: Swing,
) -> None:
    problem = swing_up(5, 1)
    reference = weakref.ref(lent(problem))
    assert copy.copy(problem).kept == {} and problem.kept["planners"]
    del problem
    gc.collect()
    assert reference() is None
