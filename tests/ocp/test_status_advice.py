"""Advice: the suggested change, and its success."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Planner,
    Solution,
    SolutionStatus,
    Source,
    solve,
    verified,
)
from swarmstart.ocp.rollout.status import Found, advice_for

X, U = ca.SX.sym("x", 2), ca.SX.sym("u")


def relaxing(rate: float, **stated: object) -> OptimalControlProblem:
    """A place driven by a control, and a lag behind it with a given decay rate."""
    given = {"substeps": 4, **stated}
    return OptimalControlProblem(
        Model(states=X, controls=U, ode=ca.vertcat(U, rate * (X[0] - X[1]))),
        horizon=2.0,
        intervals=5,
        stage_cost=U**2 + X[1] ** 2,
        bounds=Bounds(controls=(-1, 1)),
        **given,  # type: ignore[arg-type]
    )


def judged(problem: OptimalControlProblem, x0: list[float]) -> Solution:
    planner = Planner(problem, search=None, backend="casadi")
    controls = np.zeros((1, problem.intervals))
    return verified(problem, planner.evaluated(controls, x0, source=Source.GUESS), x0)


@pytest.mark.parametrize("rate", [30.0, 100.0, 1000.0])
def test_stiff_model_is_named_with_substeps_that_are_enough(rate: float) -> None:
    """The step is 0.1 s: stable up to 2.78 / 0.1 s; the advice asks for 2.5."""
    coarse = judged(relaxing(rate), [1, 0])
    assert not coarse.status.is_confirmed
    needed = int(np.ceil(4 * rate * 0.1 / 2.5))
    assert f"a mode decays at {rate:.3g} per second" in coarse.advice
    assert coarse.advice.endswith(f"set substeps to at least {needed}")
    fine = solve(
        relaxing(rate, substeps=needed), [1, 1], search=None, backend="casadi", seed=0
    )
    assert fine.status.is_confirmed
    assert fine.advice == ""


def test_model_that_is_not_stiff_is_not_called_so() -> None:
    assert "stiff" not in judged(relaxing(3.0), [1, 0]).advice
    growing = judged(relaxing(-30.0), [1, 0])  # It grows: no step makes that stable.
    assert "stiff" not in growing.advice


def test_no_number_of_substeps_is_advised_where_none_is_finite() -> None:
    assert "stiff" not in judged(relaxing(1e308, substeps=400), [1, 0]).advice


def test_euler_is_told_of_a_better_integrator(pendulum: Model) -> None:
    problem = OptimalControlProblem(
        pendulum, horizon=2.0, intervals=4, stage_cost=pendulum.states[0] ** 2,
        integrator="euler",
    )  # fmt: skip
    assert judged(problem, [1, 0]).advice == "integrate more finely: integrator='rk4'"


def test_mismatch_is_told_of_substeps_that_help(pendulum: Model) -> None:
    def at(substeps: int) -> Solution:
        problem = OptimalControlProblem(
            pendulum, horizon=3.0, intervals=4, stage_cost=pendulum.states[0] ** 2,
            substeps=substeps,
        )  # fmt: skip
        return judged(problem, [1, 0])

    coarse = at(1)
    assert coarse.status is SolutionStatus.MISMATCH
    assert "substeps=2 or more" in coarse.advice
    assert at(8).status.is_confirmed


def test_broken_constraint_is_told_of_a_margin_that_mends_it() -> None:
    def with_margin(margin: float) -> Solution:
        bump = PathConstraint(
            expression=X[1] - ca.sin(np.pi * X[0]) ** 2, lower=-1 + margin, name="bump"
        )
        problem = OptimalControlProblem(
            Model(states=X, controls=U, ode=ca.vertcat(1, U)), horizon=2.0, intervals=2,
            stage_cost=(X[1] + 0.5) ** 2 + U**2, bounds=Bounds(controls=(-1, 1)),
            constraints=[bump],
        )  # fmt: skip
        return judged(problem, [0, -0.5 + margin])

    found = with_margin(0.0)
    assert found.status is SolutionStatus.BROKEN
    assert found.advice.startswith("repair=True, more checks (checks=2)")
    assert "a margin of 0.5 on 'bump'" in found.advice


def test_every_status_has_advice_where_there_is_something_to_turn() -> None:
    problem = relaxing(1.0)
    for status in SolutionStatus:
        told = advice_for(problem, Found(status, "for a reason"), None)
        assert bool(told) == (not status.is_confirmed)


def test_answer_of_a_search_is_told_of_the_polish() -> None:
    asked = {"search": "lshade", "budget": 200, "backend": "casadi", "seed": 0}
    searched = solve(relaxing(1.0), [1, 1], polish=None, **asked)  # type: ignore[arg-type]
    assert searched.status is SolutionStatus.FEASIBLE
    assert searched.advice == "polish='ipopt' would make it a local optimum"
    polished = solve(relaxing(1.0), [1, 1], **asked)  # type: ignore[arg-type]
    assert polished.status is SolutionStatus.CONVERGED


def test_model_that_is_undefined_is_told_of_bounds() -> None:
    problem = OptimalControlProblem(
        Model(states=X, controls=U, ode=ca.vertcat(U, ca.log(X[0] - 2))),
        horizon=1.0,
        intervals=2,
    )
    found = judged(problem, [1, 0])
    assert found.status is SolutionStatus.NOT_FINITE
    assert "bound the states to the domain of the model" in found.advice
    # The end of the first fine step, a fortieth of half a second long in the mean.
    assert found.reason.startswith("state x_1 is not a finite number from 0.01331 s")


def test_mismatch_of_steps_with_a_tolerance_asks_for_a_finer_one() -> None:
    found = Found(SolutionStatus.MISMATCH, "")
    problem = relaxing(100.0, integrator="stiff")
    assert "integrator_tolerance=1e-07" in advice_for(problem, found, None)
    lost = Found(SolutionStatus.NOT_FINITE, "")
    assert "after 4096 steps from check to check" in advice_for(problem, lost, None)
    equal = relaxing(100.0, integrator="stiff", integrator_tolerance=None)
    assert "substeps=8" in advice_for(equal, found, None)
    assert "4096" not in advice_for(equal, lost, None)
