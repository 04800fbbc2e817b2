"""IPOPT with the evaluator: Riccati, bounds, and the better of both answers."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Fitness,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    NlpOptions,
    OptimalControlProblem,
    Polisher,
    PolishStatus,
    SolveError,
    disc,
)
from swarmstart.ocp.nlp.polish import is_better

Posed = tuple[OptimalControlProblem, Array, Known]


@pytest.fixture(scope="module")
def polish_passing(passing_side: Posed) -> tuple[Fitness, Polisher]:
    fitness = Fitness(passing_side[0])
    return fitness, Polisher(fitness)


# Rounded, since squares of 1e-161 underflow.
@given(x0=st.tuples(*[st.floats(-5, 5).map(lambda x: round(x, 9))] * 2).map(np.array))
@settings(max_examples=15, deadline=None)
def test_linear_quadratic_optimum_is_riccatis(
    lq_polisher: Polisher, riccati: tuple[Array, Array], x0: Array
) -> None:
    polished = lq_polisher(np.zeros((1, 10)), x0)
    K, P = riccati
    assert polished.status is PolishStatus.CONVERGED
    # IPOPT's tolerance is 1e-8; the cost is flat at its minimum.
    assert polished.cost == pytest.approx(x0 @ P @ x0, rel=1e-8, abs=1e-8)
    np.testing.assert_allclose(polished.controls[:, 0], -K @ x0, atol=1e-6)


@pytest.fixture(scope="module")
def lq_polisher(lq: OptimalControlProblem) -> Polisher:
    return Polisher(Fitness(lq))


@pytest.mark.parametrize("seed", range(8))
def test_never_worse_than_the_guess_and_exactly_within_bounds(
    passing_side: Posed, polish_passing: tuple[Fitness, Polisher], seed: int
) -> None:
    problem, x0, known = passing_side
    fitness, polish = polish_passing
    lower, upper = (limit[:, None] for limit in problem.control_limits)
    guess = np.random.default_rng(seed).uniform(lower, upper, (2, 8))
    before = fitness.value(guess, x0, known)
    polished = polish(guess, x0, known)
    value = (polished.cost, polished.violation)
    assert not is_better(before, value, tolerance=problem.tolerance)
    assert value == fitness.value(polished.controls, x0, known)
    assert (lower <= polished.controls).all()
    assert (polished.controls <= upper).all()
    if polished.improved:
        assert is_better(value, before, tolerance=problem.tolerance)
    else:
        np.testing.assert_array_equal(polished.controls, guess)
    assert polished.evaluations >= polished.iterations > 0


@pytest.mark.parametrize("seed", range(4))
def test_active_constraints_survive_the_way_back_into_the_bounds(
    passing_side: Posed, polish_passing: tuple[Fitness, Polisher], seed: int
) -> None:
    """IPOPT's own relaxation of bounds once cost 1e-6 m of clearance."""
    _, x0, known = passing_side
    upwards = np.zeros((2, 8))
    upwards[1, :2], upwards[1, 2:4] = 0.15, -0.1
    guess = upwards + np.random.default_rng(seed).normal(scale=0.01, size=(2, 8))
    polished = polish_passing[1](guess, x0, known)
    assert polished.improved
    assert polished.status is PolishStatus.CONVERGED
    assert polished.cost == pytest.approx(446.7, rel=5e-3)
    assert polished.violation <= 1e-9


def test_optimal_guess_stays_an_optimum(
    passing_side: Posed, polish_passing: tuple[Fitness, Polisher]
) -> None:
    _, x0, known = passing_side
    polish = polish_passing[1]
    first = polish(np.zeros((2, 8)), x0, known)
    again = polish(first.controls, x0, known, near=True)
    assert again.status is PolishStatus.CONVERGED
    assert again.cost == pytest.approx(first.cost, rel=1e-6)


def test_optimum_worse_than_the_guess_is_no_local_optimum_of_the_answer(
    passing_side: Posed, polish_passing: tuple[Fitness, Polisher]
) -> None:
    """With a margin that only the NLP sees, its optimum is costlier than the guess."""
    problem, x0, known = passing_side
    best = polish_passing[1](np.zeros((2, 8)), x0, known).controls
    wide = disc(problem.model.states[2:], centre=[0, 1], radius=12, smooth_margin=2)
    polished = Polisher(Fitness(replace(problem, constraints=[wide])))(best, x0, known)
    assert polished.status is PolishStatus.WORSE
    assert not polished.improved
    np.testing.assert_array_equal(polished.controls, best)


def far_too_far(model: Model) -> OptimalControlProblem:
    """10 m from rest to rest in 1 s with at most 1 m/s^2."""
    return OptimalControlProblem(
        model,
        horizon=1.0,
        intervals=5,
        stage_cost=model.controls**2,
        bounds=Bounds(controls=(-1, 1)),
        terminal=[model.states - ca.vertcat(10, 0)],
    )


def test_infeasible_problem_is_a_status(double_integrator: Model) -> None:
    polish = Polisher(Fitness(far_too_far(double_integrator)))
    polished = polish(np.zeros((1, 5)), [0, 0])
    assert polished.status is PolishStatus.INFEASIBLE
    # At least 10 - 1/4 m of the 10 m to the target are missing.
    assert polished.violation >= 0.975 - 1e-6


def test_limit_of_iterations_is_a_status(
    swing_up: Callable[..., OptimalControlProblem],
) -> None:
    polish = Polisher(Fitness(swing_up(10, 1)), IpoptOptions(max_iterations=1))
    polished = polish(np.zeros((1, 10)), [0, 0])
    assert polished.status is PolishStatus.ITERATION_LIMIT
    assert polished.iterations == 1


def test_rollout_that_is_not_finite_is_a_status(double_integrator: Model) -> None:
    problem = OptimalControlProblem(
        double_integrator,
        horizon=1.0,
        intervals=2,
        stage_cost=ca.log(double_integrator.states[0]),
    )
    polished = Polisher(Fitness(problem))(np.zeros((1, 2)), [-1, 0])
    assert polished.status is PolishStatus.NUMERICAL_FAILURE
    assert not polished.improved


def test_guess_outside_the_bounds_is_brought_into_them(
    double_integrator: Model,
) -> None:
    """Unchanged it would be cheaper than any feasible answer."""
    problem = OptimalControlProblem(
        double_integrator,
        horizon=1.0,
        intervals=2,
        stage_cost=(double_integrator.controls - 5) ** 2,
        bounds=Bounds(controls=(-1, 1)),
    )
    guess = np.full((1, 2), 5.0)
    polished = Polisher(Fitness(problem))(guess, [0, 0])
    np.testing.assert_array_equal(polished.controls, [[1, 1]])
    assert polished.cost == pytest.approx(16)
    np.testing.assert_array_equal(guess, [[5, 5]])


def test_better_means_violation_first_then_cost() -> None:
    nan, inf = np.nan, np.inf
    in_order = [(1.0, 0.0), (2.0, 0.5e-6), (0.0, 0.1), (-5.0, 0.2), (inf, 0.0)]
    for i, one in enumerate(in_order):
        for j, other in enumerate(in_order):
            assert is_better(one, other, tolerance=1e-6) == (i < j)
    assert not is_better((nan, 0.0), (1.0, 9.0), tolerance=1e-6)
    assert is_better((1.0, 9.0), (0.0, nan), tolerance=1e-6)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"max_iterations": 0}, "max_iterations must be an integer of at least 1"),
        ({"tolerance": 0.0}, "tolerance must be a finite number above 0, got 0.0"),
    ],
)
def test_refuses_options_ipopt_would_refuse(
    options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        IpoptOptions(**options)


def test_solver_that_cannot_be_run_is_an_error(
    lq: OptimalControlProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    polish = Polisher(Fitness(lq))
    fails = Mock(side_effect=RuntimeError("no MUMPS"))
    solvers = polish.solvers(None)._replace(far=lambda is_observed: fails)
    monkeypatch.setitem(polish.solvers.built, None, solvers)
    with pytest.raises(SolveError, match="ipopt could not be run: no MUMPS"):
        polish(np.zeros((1, 10)), [0, 0])


@pytest.mark.parametrize(
    ("options", "solves"),
    [
        (IpoptOptions(max_iterations=1), 2),
        (NlpOptions(plugin="sqpmethod", options={"max_iter": 1}), 1),
    ],
    ids=["ipopt", "sqpmethod"],
)
def test_a_failed_start_near_a_guess_is_tried_again_if_there_is_another_way(
    passing_side: Posed,
    options: IpoptOptions | NlpOptions,
    solves: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    problem, x0, known = passing_side
    polish, ways = Polisher(Fitness(problem), options), []
    tried = polish._tried

    def counted(*given: Any) -> Any:
        ways.append(given[-1].near)
        return tried(*given)

    monkeypatch.setattr(polish, "_tried", counted)
    braking = np.zeros((2, 8))
    braking[0, :5] = -3
    polish(braking, x0, known, near=True)
    assert ways == [True, False][:solves]


def test_start_whose_roll_out_is_no_number_is_held_where_it_begins() -> None:
    """A tank is empty before the end without inflow, where its root is undefined."""
    h, u = ca.SX.sym("h"), ca.SX.sym("u")
    tank = OptimalControlProblem(
        Model(states=h, controls=u, ode=u - 0.5 * ca.sqrt(h)), horizon=6.0,
        intervals=20, stage_cost=u**2, bounds=Bounds(controls=(0.0, 1.0)),
        terminal=[(h, 0.5)],
    )  # fmt: skip
    fitness = Fitness(tank, backend="casadi")
    assert not np.isfinite(fitness.states(np.zeros((1, 20)), [1.0])).all()
    polished = Polisher(fitness)(np.zeros((1, 20)), [1.0])
    assert polished.status is PolishStatus.CONVERGED
    assert polished.cost == pytest.approx(0.455183, abs=1e-6)


def test_a_point_must_keep_the_dynamics() -> None:
    """Controls of zero cost least, whatever the states are."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0, intervals=1, stage_cost=u**2,
    )  # fmt: skip
    polisher, x0 = Polisher(Fitness(problem)), np.array([1.0])
    for error in (0.0, 1e-3):
        states = np.linspace([1.0], [1.0 + error], problem.nodes, axis=1)
        found = polisher.point(np.zeros((1, 1)), states, x0, Known())
        assert (found is None) == (error > 0)
