"""Perturbed starts lead down from a saddle, and nowhere from a flat minimum."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Plan,
    Planner,
    SolutionStatus,
    Source,
    solve,
)
from swarmstart.ocp.answer import improving
from swarmstart.ocp.answer.improving import STARTS, settled
from swarmstart.ocp.nlp.optimality import Curvature, curvature
from swarmstart.ocp.rollout.fitness import NOTHING

X, U = ca.SX.sym("x"), ca.SX.sym("u")


def scalar(cost: ca.SX, end: ca.SX) -> OptimalControlProblem:
    """x' = u over 1 s, |u| <= 2."""
    return OptimalControlProblem(
        Model(states=X, controls=U, ode=U),
        horizon=1.0,
        intervals=3,
        stage_cost=cost,
        terminal_cost=end,
        bounds=Bounds(controls=(-2, 2)),
    )


def planned(problem: OptimalControlProblem) -> tuple[Planner, Plan]:
    """Return the plan at which the polish from zero controls ends, from 0."""
    planner = Planner(problem, search=None, polish=IpoptOptions(), backend="casadi")
    return planner, planner.plan([0.0], rng=np.random.default_rng(0))


def looked_at(problem: OptimalControlProblem, seed: int = 0) -> tuple[Plan, Plan, bool]:
    planner, plan = planned(problem)
    rng = np.random.default_rng(seed)
    after, is_settled, _ = settled(planner, plan, [0.0], NOTHING, rng=rng)
    return plan, after, is_settled


@pytest.mark.parametrize("seed", range(3))
def test_saddle_is_left_downhill(seed: int) -> None:
    """u = 0 is stationary for u^2 / 9 + 4 cos x(1); the minimum lies at a bound."""
    plan, after, is_settled = looked_at(scalar(U**2 / 9, 4 * ca.cos(X)), seed)
    assert plan.point is not None
    assert curvature(plan.point) is Curvature.NEGATIVE
    np.testing.assert_allclose(plan.controls, 0, atol=1e-6)
    assert is_settled
    # With equal parts u: the least of u^2 / 9 + 4 cos u within |u| <= 2.
    np.testing.assert_allclose(np.abs(after.controls), 2, atol=1e-6)
    assert after.cost == pytest.approx(4 / 9 + 4 * np.cos(2))
    assert after.source is Source.POLISH
    assert after.evaluations > plan.evaluations
    assert after.states[0, -1] == pytest.approx(after.controls.mean())


def test_saddle_without_a_way_down_worth_it_is_not_settled() -> None:
    """Relative to a cost of 1e9 a fall of 4 is nothing; but a saddle is no minimum."""
    plan, after, is_settled = looked_at(scalar(1e9 + U**2 / 9, 4 * ca.cos(X)))
    assert plan.point is not None
    assert curvature(plan.point) is Curvature.NEGATIVE
    np.testing.assert_array_equal(after.controls, plan.controls)
    assert not is_settled


def test_strict_minimum_costs_no_evaluation() -> None:
    plan, after, is_settled = looked_at(scalar((U - 1) ** 2, X**2))
    assert is_settled
    assert after is plan


def test_flat_minimum_is_settled_by_all_starts() -> None:
    """Only the sum of the controls counts: singular, but nothing is better."""
    plan, after, is_settled = looked_at(scalar(ca.SX(0), (X - 0.5) ** 2))
    assert plan.point is not None
    assert curvature(plan.point) is Curvature.FLAT
    assert is_settled
    np.testing.assert_array_equal(after.controls, plan.controls)
    assert after.evaluations >= plan.evaluations + STARTS


def test_restarts_are_in_the_account_and_take_a_part_of_the_iterations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With less than five of them nothing is decided."""
    problem = scalar(ca.SX(0), (X - 0.5) ** 2)
    found = solve(problem, [0], search=None, backend="casadi", seed=0)
    told = found.restarts
    assert told is not None
    assert (told.starts, told.better) == (STARTS, 0)
    assert f"  restarts    {told.line}" in str(found)
    assert told.iterations >= STARTS
    monkeypatch.setattr(improving, "_LEAST_ITERATIONS", told.iterations // 2)
    fewer = solve(problem, [0], search=None, backend="casadi", seed=0).restarts
    assert fewer is not None
    assert 0 < fewer.starts < STARTS
    monkeypatch.setattr(improving, "_LEAST_ITERATIONS", 1)
    monkeypatch.setattr(improving, "_SHARE", 0.0)
    left = solve(problem, [0], search=None, backend="casadi", seed=0)
    assert left.restarts is not None and left.restarts.starts == 1
    assert left.status is SolutionStatus.FEASIBLE


def test_flat_minimum_of_a_large_problem_is_left_undecided(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Not all starts are tried if they take long; then it is not called a minimum."""
    monkeypatch.setattr(improving, "_MOST_WORK", 1)
    plan, after, is_settled = looked_at(scalar(ca.SX(0), X**4))
    assert not is_settled
    assert after.cost == plan.cost
    planner, plan = planned(scalar(ca.SX(0), X**4))
    told = settled(planner, plan, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert told.restarts is not None and told.restarts.starts > 0


def test_flat_point_that_is_no_minimum_is_left() -> None:
    """x^3 is flat at 0 to second order: it falls on one side."""
    plan, after, _ = looked_at(scalar(U**4 / 100, X**3))
    np.testing.assert_allclose(plan.controls, 0, atol=1e-2)
    assert after.cost < -1


def test_plan_that_is_not_stationary_is_not_settled() -> None:
    planner, plan = planned(scalar((U - 1) ** 2, X**2))
    other = replace(plan, point=None)
    same = settled(planner, other, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert same == (other, False, None)
    searching = Planner(planner.problem, search=None, backend="casadi")
    rng = np.random.default_rng(0)
    assert settled(searching, plan, [0.0], NOTHING, rng=rng)[:2] == (plan, False)


def test_solve_says_local_optimum_of_what_is_settled_only() -> None:
    def status(problem: OptimalControlProblem) -> tuple[SolutionStatus, str]:
        found = solve(problem, [0], search=None, backend="casadi", seed=0)
        return found.status, found.reason

    flat = status(scalar(ca.SX(0), (X - 0.5) ** 2))
    assert flat[0] is SolutionStatus.CONVERGED
    assert "no perturbed start" in flat[1]
    strict = status(scalar((U - 1) ** 2, X**2))
    assert strict == (
        SolutionStatus.CONVERGED, "stationary, with positive second derivatives"
    )  # fmt: skip
    saddle = solve(
        scalar(U**2 / 9, 4 * ca.cos(X)), [0], search=None, backend="casadi", seed=0
    )
    assert saddle.status is SolutionStatus.CONVERGED
    np.testing.assert_allclose(np.abs(saddle.controls), 2, atol=1e-6)
