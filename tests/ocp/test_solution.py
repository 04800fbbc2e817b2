"""What the finer grid says of a plan."""

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Model,
    OptimalControlProblem,
    Planner,
    PolishStatus,
    SolutionStatus,
    Source,
    verified,
)


def test_coarse_euler_is_unmasked_by_its_final_state_alone(pendulum: Model) -> None:
    """The cost u^2 is the same on every grid, and nothing is demanded of the end."""

    def status(integrator: str) -> SolutionStatus:
        problem = OptimalControlProblem(
            pendulum,
            horizon=2.0,
            intervals=4,
            stage_cost=pendulum.controls**2,
            integrator=integrator,
        )
        planner = Planner(problem, search=None)
        plan = planner.evaluated(np.ones((1, 4)), [1, 0], source=Source.GUESS)
        solution = verified(problem, plan, [1, 0])
        assert solution.verified_cost == pytest.approx(solution.cost)
        return solution.status

    assert status("euler") is SolutionStatus.MISMATCH
    assert status("rk4") is SolutionStatus.FEASIBLE


def test_fine_states_are_kept_beside_the_coarse_cost(pendulum: Model) -> None:
    problem = OptimalControlProblem(
        pendulum,
        horizon=1.0,
        intervals=2,
        stage_cost=pendulum.states[0] ** 2,
        integrator="euler",
        substeps=4,
    )
    planner = Planner(problem, search=None)
    plan = planner.evaluated(np.zeros((1, 2)), [1, 0], source=Source.GUESS)
    solution = verified(problem, plan, [1, 0])
    assert solution.plan is plan
    assert solution.cost == plan.cost != solution.verified_cost
    assert not np.array_equal(solution.states, plan.states)
    np.testing.assert_array_equal(solution.times, [0, 0.5, 1])


def test_violation_is_infeasible_even_if_confirmed(
    swing_up: Callable[..., OptimalControlProblem],
) -> None:
    problem = swing_up(5, 2)
    planner = Planner(problem, search=None)
    plan = planner.evaluated(np.zeros((1, 5)), [0, 0], source=Source.GUESS)
    solution = verified(problem, plan, [0, 0])
    assert solution.status is SolutionStatus.INFEASIBLE
    # Hanging at rest, without torque: the whole way of pi is missing on every grid.
    assert solution.violation == pytest.approx(1)
    assert solution.verified_violation == pytest.approx(1)


def test_cost_that_is_not_finite_is_named(double_integrator: Model) -> None:
    problem = OptimalControlProblem(
        double_integrator,
        horizon=1.0,
        intervals=2,
        stage_cost=ca.log(double_integrator.states[0]),
    )
    planner = Planner(problem, search=None)
    plan = planner.evaluated(np.zeros((1, 2)), [-1, 0], source=Source.GUESS)
    solution = verified(problem, plan, [-1, 0])
    assert solution.status is SolutionStatus.NOT_FINITE
    assert solution.violation == np.inf
    assert "the cost is not a finite number" in solution.reason


def test_only_feasible_answers_that_agree_on_the_finer_grid_are_confirmed() -> None:
    confirmed = {status for status in SolutionStatus if status.is_confirmed}
    assert confirmed == {SolutionStatus.CONVERGED, SolutionStatus.FEASIBLE}


def _at_speed_one(substeps: int) -> tuple[OptimalControlProblem, Planner]:
    """A place that any integrator knows exactly, and a cost that waves along it."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=2,
        stage_cost=1 + ca.cos(12 * x), substeps=substeps,
    )  # fmt: skip
    return problem, Planner(problem, search=None, backend="casadi")


def test_cost_alone_unmasks_a_coarse_grid() -> None:
    for substeps, status in (
        (1, SolutionStatus.MISMATCH), (8, SolutionStatus.FEASIBLE)
    ):  # fmt: skip
        problem, planner = _at_speed_one(substeps)
        plan = planner.evaluated(np.ones((1, 2)), [0], source=Source.GUESS)
        found = verified(problem, plan, [0])
        assert found.status is status
        # The integral of 1 + cos 12 t over 1 s.
        assert found.verified_cost == pytest.approx(1 + np.sin(12) / 12, abs=1e-3)
        if status is SolutionStatus.MISMATCH:
            assert found.reason.startswith("the cost is")
            assert "state" not in found.reason


def test_solver_that_only_says_it_converged_is_not_believed() -> None:
    problem, planner = _at_speed_one(8)
    plan = planner.evaluated(np.ones((1, 2)), [0], source=Source.GUESS)
    said = replace(plan, polish_status=PolishStatus.CONVERGED)
    found = verified(problem, said, [0])
    assert found.status is SolutionStatus.FEASIBLE
    assert found.reason == "the polish ended at a point that is not stationary"
