"""Maximised costs: the answer equals that of the negated problem."""

import math
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import Budget
from swarmstart.ocp import (
    Bounds,
    Fitness,
    Free,
    InvalidProblemError,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    SolutionStatus,
    simulate,
    solve,
)


def turned(problem: OptimalControlProblem) -> OptimalControlProblem:
    """Return the same problem with its costs as gains."""
    return replace(
        problem,
        stage_cost=-problem.stage_cost,
        step_cost=-problem.step_cost,
        initial_cost=-problem.initial_cost,
        terminal_cost=-problem.terminal_cost,
        maximize=True,
    )


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_largest_gain_is_that_of_the_riccati_recursion(
    lq: OptimalControlProblem, riccati: tuple[Array, Array], backend: str
) -> None:
    _, P = riccati
    x0 = np.array([1.0, 0.5])
    gain = replace(turned(lq), bounds=Bounds(controls=(-5, 5)))
    for search in (None, "default"):
        answer = solve(gain, x0, search=search, budget=2000, seed=0, backend=backend)
        assert answer.status is SolutionStatus.CONVERGED
        assert answer.cost == pytest.approx(-x0 @ P @ x0, rel=1e-8)
        assert answer.plan.cost == -answer.cost
        assert answer.problem.maximize
        assert f"cost        {answer.cost:.9g}  (finer path: {answer.verified_cost:.9g})" in repr(answer)  # fmt: skip # noqa: E501
        assert "maximised" in repr(answer.problem)


def test_harvest_is_largest_where_a_closed_form_says() -> None:
    """A stock x' = x - u of 1 at the start is used up, with the gain sqrt(u).

    The costate falls as exp(-t), so that u grows as exp(2 t).
    """
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    T, N = 1.0, 50
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=x - u),
        horizon=T,
        intervals=N,
        stage_cost=ca.sqrt(u),
        maximize=True,
        bounds=Bounds(controls=(1e-6, 20)),
        terminal=[(x, 0.0)],
    )
    answer = solve(problem, [1.0], search=None, seed=0)
    # The integral of e^-t u is 1 with u = c e^2t: c = 1 / (e - 1).
    best = np.sqrt(math.e - 1)
    assert answer.cost == pytest.approx(best, rel=1e-3)
    assert answer.cost < best  # Held controls are worth less.
    assert answer.verified_cost == pytest.approx(answer.cost, rel=1e-6)


def test_flight_of_a_gain_is_that_of_its_cost(
    lq: OptimalControlProblem, double_integrator: Model
) -> None:
    flights = []
    for problem in (lq, turned(lq)):
        planner = Planner(problem, search=None, polish=IpoptOptions())
        plant = Plant(double_integrator, dt=lq.dt, substeps=1)
        loop = RecedingHorizon(planner=planner)
        flights.append(simulate(plant, loop, [1.0, 0.5], steps=4, seed=0))
    np.testing.assert_array_equal(flights[0].states, flights[1].states)


def test_what_is_decided_of_a_gain_is_what_its_cost_decides() -> None:
    """(p - 3)^2 + (x(0) - 2)^2 + the end time, with a start without a guess."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("p")
    cost = OptimalControlProblem(
        Model(states=x, controls=u, ode=u, parameters=p),
        horizon=Free(0.5, 2.0),
        intervals=4,
        stage_cost=1 + u**2,
        initial_cost=(x - 2) ** 2 + (p - 3) ** 2,
        bounds=Bounds(controls=(-1, 1)),
        start={"x": Free(-5, 5)},
        decided={"p": Free(0, 10)},
    )
    answer = solve(turned(cost), [np.nan], search=None, seed=0)
    assert answer.decided == pytest.approx({"end time": 0.5, "p": 3.0}, abs=1e-5)
    assert answer.states[0, 0] == pytest.approx(2.0, abs=1e-5)
    assert answer.cost == pytest.approx(-0.5, abs=1e-6)


def test_start_is_decided_with_a_core_of_the_same_size() -> None:
    """Neither a gain nor the time adds a state, and the start has no guess."""
    x, u, t = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("t")
    cost = OptimalControlProblem(
        Model(states=x, controls=u, ode=u + t, time=t),
        horizon=1.0,
        intervals=4,
        stage_cost=u**2,
        initial_cost=(x - 2) ** 2,
        bounds=Bounds(controls=(-1, 1)),
        start={"x": Free(-5, 5)},
    )
    for problem in (cost, turned(cost)):
        answer = solve(problem, [np.nan], search=None, seed=0)
        assert answer.states[0] == pytest.approx(2 + answer.times**2 / 2, abs=1e-5)


def test_target_of_a_search_is_a_gain(lq: OptimalControlProblem) -> None:
    bounded = replace(lq, bounds=Bounds(controls=(-5, 5)))
    best = -solve(bounded, [1, 0], search=None, seed=0).cost
    budget = Budget(evaluations=20_000, target=2 * best)
    answer = solve(turned(bounded), [1, 0], budget=budget, polish=None, seed=0)
    assert 2 * best <= answer.cost <= best
    assert answer.plan.evaluations < 20_000


def test_mismatch_is_told_in_the_sense_of_the_user(pendulum: Model) -> None:
    cost = OptimalControlProblem(
        pendulum,
        horizon=2.0,
        intervals=4,
        stage_cost=pendulum.states[0] ** 2,
        integrator="euler",
        substeps=1,
        bounds=Bounds(controls=(-1, 1)),
    )
    answer = solve(turned(cost), [1, 0], search=None, seed=0)
    assert answer.status is SolutionStatus.MISMATCH
    assert answer.cost < 0 > answer.verified_cost
    assert f"the cost is {answer.verified_cost:.6g} on the finer path" in answer.reason


def test_problem_that_is_minimised_has_the_functions_it_had(
    lq: OptimalControlProblem,
) -> None:
    fitness = Fitness(lq)
    assert fitness.problem is lq
    assert fitness.shooting.lowered.core is lq


def test_refuses_a_sense_that_is_no_truth_value(lq: OptimalControlProblem) -> None:
    with pytest.raises(InvalidProblemError, match="maximize must be True or False"):
        replace(lq, maximize="yes")  # type: ignore[arg-type]


def test_kinks_of_a_gain_are_followed_to_the_better_answer() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    cost = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=2.0,
        intervals=8,
        stage_cost=ca.fabs(u) + 2 * (x - 1) ** 2 + ca.fabs(x - 0.5) / 3,
        bounds=Bounds(controls=(-3, 3)),
    )
    answers = [solve(p, [0.0], search=None, seed=0) for p in (cost, turned(cost))]
    assert answers[0].path.kinks
    assert answers[1].cost == pytest.approx(-answers[0].cost, rel=1e-9)
