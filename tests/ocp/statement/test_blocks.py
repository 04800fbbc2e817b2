"""Blocks of intervals with one control, against coarser grids and least squares."""

from dataclasses import replace
from itertools import product

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    Fitness,
    Free,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    SolutionStatus,
    simulate,
    solve,
)
from swarmstart.ocp.nlp.transcription import multiple_shooting
from swarmstart.ocp.rollout.fitness import NOTHING
from swarmstart.ocp.search.search_space import ControlSpace
from swarmstart.ocp.statement.control_shape import averaged

UNEVEN = (1, 1, 2, 2, 4, 4, 4, 6)


def pendulum(**more: object) -> OptimalControlProblem:
    """A swing-up with a weak torque."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    stated: dict[str, object] = {
        "horizon": 3.0,
        "intervals": 24,
        "stage_cost": u**2,
        "bounds": Bounds(controls=(-8, 8)),
        "terminal": [x - ca.vertcat(np.pi, 0)],
    }
    model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0])))
    return OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_even_blocks_are_a_coarser_grid_with_more_checks(backend: str) -> None:
    blocked = pendulum(blocks=[2] * 12)
    coarse = pendulum(intervals=12, checks=2)
    one, other = (
        solve(problem, [0, 0], budget=6000, backend=backend, seed=0)
        for problem in (blocked, coarse)
    )
    assert one.status is other.status is SolutionStatus.CONVERGED
    assert one.cost == pytest.approx(other.cost, rel=1e-9)
    np.testing.assert_allclose(one.controls[:, ::2], other.controls, atol=1e-6)
    np.testing.assert_array_equal(one.controls[:, ::2], one.controls[:, 1::2])


A, B = np.array([[0.9, 0.3], [-0.2, 1.05]]), np.array([[0.1, 0.5], [0.5, -0.4]])
LENGTHS = (1, 2, 3)


def linear(**more: object) -> OptimalControlProblem:
    """A linear-quadratic problem in discrete time with two controls."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    stated: dict[str, object] = {
        "horizon": 6.0,
        "intervals": 6,
        "step_cost": ca.sumsqr(x) + 0.1 * ca.sumsqr(u),
        "terminal_cost": 2 * ca.sumsqr(x),
        "bounds": Bounds(controls=(-5, 5)),
        "blocks": LENGTHS,
    }
    model = Model(states=x, controls=u, next_state=A @ x + B @ u)
    return OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


def least_squares(x0: np.ndarray) -> tuple[float, np.ndarray]:
    """Return cost and controls (2, 3) of the blocks, without bounds."""
    x, slope, rows, known = x0, np.zeros((2, 6)), [], []
    for block, length in enumerate(LENGTHS):
        unit = np.zeros((2, 6))
        unit[:, 2 * block : 2 * block + 2] = np.eye(2)
        for _ in range(length):
            rows += [slope, np.sqrt(0.1) * unit]
            known += [x, np.zeros(2)]
            x, slope = A @ x, A @ slope + B @ unit
    J = np.vstack([*rows, np.sqrt(2) * slope])
    r = np.concatenate([*known, np.sqrt(2) * x])
    v = np.linalg.lstsq(J, -r, rcond=None)[0]
    return float(np.square(J @ v + r).sum()), v.reshape(3, 2).T


@pytest.mark.parametrize("search", [None, "default"])
def test_uneven_blocks_have_the_optimum_of_least_squares(search: str | None) -> None:
    x0 = np.array([1.0, -0.5])
    cost, controls = least_squares(x0)
    answer = solve(linear(), x0, search=search, budget=2000 if search else None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.cost == pytest.approx(cost, rel=1e-9)
    np.testing.assert_allclose(
        answer.controls, np.repeat(controls, LENGTHS, axis=1), atol=1e-6
    )


def test_bounds_hold_in_every_block() -> None:
    free = solve(linear(), [1.0, -0.5], search=None, seed=0)
    top = 0.5 * float(free.controls.max())
    answer = solve(
        linear(bounds=Bounds(controls=(-5, top))), [1.0, -0.5], search=None, seed=0
    )
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.controls.max() == pytest.approx(top, rel=1e-6)
    assert answer.cost > free.cost


def test_minimum_among_blocks_need_not_be_one_without() -> None:
    """J = u_0 u_1 - u_1 has a saddle, but u^2 - u, with both equal, a minimum."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, next_state=u),
        horizon=2.0, intervals=2, step_cost=x * u, terminal_cost=-x,
        bounds=Bounds(controls=(-3, 3)), blocks=[2],
    )  # fmt: skip
    answer = solve(problem, [0.0], search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.reason == "stationary, with positive second derivatives"
    np.testing.assert_allclose(answer.controls, 0.5, rtol=1e-6)
    assert answer.cost == pytest.approx(-0.25, rel=1e-9)


def test_derivatives_of_the_nlp_are_those_that_casadi_finds() -> None:
    for problem in (pendulum(blocks=UNEVEN), linear(start={"x_0": Free(-2, 2)})):
        program = multiple_shooting(problem)
        nlp, rng = program.nlp, np.random.default_rng(0)
        w, q = (rng.uniform(0.5, 1.5, nlp[name].numel()) for name in ("x", "p"))
        lam = rng.standard_normal(nlp["g"].numel())
        symbols = [nlp["x"], nlp["p"]]
        slopes = ca.Function("J", symbols, [ca.jacobian(nlp["g"], nlp["x"])])
        found = program.derivatives["jac_g"](w, q)[1]
        np.testing.assert_allclose(np.array(found), np.array(slopes(w, q)), atol=1e-9)
        lagrangian = nlp["f"] + ca.dot(ca.DM(lam), nlp["g"])
        curved = ca.Function(
            "H", symbols, [ca.triu(ca.hessian(lagrangian, nlp["x"])[0])]
        )
        found = program.derivatives["hess_lag"](w, q, 1.0, lam)
        np.testing.assert_allclose(np.array(found), np.array(curved(w, q)), atol=1e-9)


def test_search_has_one_column_for_each_block() -> None:
    problem = linear(start={"x_0": Free(-2, 2)})
    fitness = Fitness(problem)
    space = ControlSpace(fitness)
    assert (space.box.dim, space.box.per_step, space.box.constant) == (7, 2, 1)
    points = np.random.default_rng(0).uniform(
        space.box.lower, space.box.upper, (5, 7)
    ).T  # fmt: skip
    cost, _ = space.objective([0.0, 1.0], NOTHING)(points)
    for x, value in zip(points.T, cost, strict=True):
        start = space.decoded(x, [0.0, 1.0], NOTHING)
        assert start.x0 is not None
        assert start.x0.tolist() == [x[-1], 1.0]
        np.testing.assert_array_equal(
            start.controls, np.repeat(x[:6].reshape(3, 2).T, LENGTHS, axis=1)
        )
        assert fitness.value(start.controls, start.x0)[0] == pytest.approx(value)
        np.testing.assert_array_equal(space.encoded(start.controls, start.x0), x)


def test_guess_has_the_mean_of_its_intervals_in_a_block() -> None:
    controls = np.array([[1.0, 2.0, 4.0, 0.1, 0.1, 0.1]])
    np.testing.assert_array_equal(
        averaged(controls, LENGTHS), [[1.0, 3.0, 3.0, 0.1, 0.1, 0.1]]
    )


def test_closed_loop_goes_on_by_one_interval() -> None:
    problem = linear()
    planner = Planner(problem, search=None, polish=IpoptOptions())
    plant = Plant(problem.model, dt=problem.dt, substeps=1)
    flight = simulate(
        plant, RecedingHorizon(planner=planner), [1, -0.5], steps=3, seed=0
    )
    x = np.array([1.0, -0.5])
    for k in range(3):
        np.testing.assert_allclose(flight.states[:, k], x, atol=1e-6)
        x = A @ x + B @ least_squares(x)[1][:, 0]


def test_whole_numbers_in_blocks_are_the_best_of_all() -> None:
    lengths = (1, 1, 2, 3, 5)
    x, on = ca.SX.sym("x", 2), ca.SX.sym("on")
    ode = ca.vertcat(x[1], 3 * on - ca.sin(x[0]) - 0.5 * x[1])
    problem = OptimalControlProblem(
        Model(states=x, controls=on, ode=ode), horizon=4.0, intervals=12,
        stage_cost=(x[0] - 1) ** 2, terminal_cost=x[1] ** 2, blocks=lengths,
        bounds=Bounds(controls=(0, 1), integer=[0]),
    )  # fmt: skip
    every = np.array([*product([0.0, 1.0], repeat=5)]).T
    cost, _ = Fitness(problem).objective([0, 0])(np.repeat(every, lengths, axis=0))
    for search in (None, "default"):
        answer = solve(
            problem, [0, 0], search=search, budget=500 if search else None, seed=0
        )
        assert answer.cost == pytest.approx(cost.min(), rel=1e-12)


def test_previous_controls_and_free_end_time_go_with_blocks() -> None:
    x, u, v = (ca.SX.sym(n) for n in "xuv")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=Free(0.5, 4.0), intervals=6, stage_cost=ca.SX(1),
        constraints=[u - v <= 0.5], previous=v, blocks=(2, 2, 2),
        bounds=Bounds(controls=(0, 5)), terminal=[(x, 2.0)],
    )  # fmt: skip
    answer = solve(problem, [0.0], known=Known(previous=[0.0]), budget=2000, seed=0)
    # Half, one and one and a half: 2 = T (0.5 + 1 + 1.5) / 3.
    assert answer.decided["end time"] == pytest.approx(2.0, rel=1e-6)
    np.testing.assert_allclose(
        answer.controls, [[0.5, 0.5, 1.0, 1.0, 1.5, 1.5]], rtol=1e-5
    )


@pytest.mark.parametrize("blocks", [[2, 3], [0, 6], [6.0], "222", [True] * 6, [-2, 8]])
def test_what_are_no_blocks_is_refused(blocks: object) -> None:
    with pytest.raises(InvalidProblemError, match="blocks must be"):
        linear(blocks=blocks)


def test_blocks_of_one_interval_change_nothing() -> None:
    assert replace(linear(), blocks=[1] * 6).blocks == ()
