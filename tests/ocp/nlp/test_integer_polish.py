"""Controls of whole numbers, against enumeration and published values."""

from dataclasses import replace
from itertools import product

import casadi as ca
import numpy as np
import pytest

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
    ensemble,
    multistart,
    simulate,
    solve,
)

N = 6


def switched(
    bounds: Bounds | None = None, highest: float = np.inf
) -> OptimalControlProblem:
    """A damped pendulum that an on-off torque brings to an angle of 1."""
    x, on = ca.SX.sym("x", 2), ca.SX.sym("on")
    ode = ca.vertcat(x[1], 3 * on - ca.sin(x[0]) - 0.5 * x[1])
    return OptimalControlProblem(
        Model(states=x, controls=on, ode=ode),
        horizon=3.0,
        intervals=N,
        stage_cost=(x[0] - 1) ** 2 + 0.05 * on,
        terminal_cost=2 * x[1] ** 2 + (x[0] - 1) ** 2,
        constraints=[x[0] <= highest] if np.isfinite(highest) else [],
        bounds=bounds or Bounds(controls=(0, 1), integer=["on"]),
    )


def enumerated(problem: OptimalControlProblem, x0: list[float]) -> tuple[float, ...]:
    """Return the costs of all 64 sequences, without the rounding, sorted."""
    free = replace(problem, bounds=replace(problem.bounds, integer=()))
    every = np.array([*product([0.0, 1.0], repeat=N)]).T
    cost, violation = Fitness(free, backend="casadi").objective(x0)(every)
    return tuple(np.sort(cost[violation <= problem.tolerance]))


@pytest.mark.parametrize("seed", range(10))
def test_best_of_all_sequences_is_found_by_every_seed(seed: int) -> None:
    problem = switched()
    best, second, *_ = enumerated(problem, [0.0, 0.0])
    assert best < 0.999 * second
    answer = solve(problem, [0.0, 0.0], budget=500, seed=seed)
    assert answer.cost == pytest.approx(best, rel=1e-12)
    assert {*answer.controls.ravel()} <= {0.0, 1.0}
    assert answer.status is SolutionStatus.FEASIBLE
    assert answer.plan.relaxed_cost < best
    assert f"whole numbers cost {best:.6g}, relaxed" in answer.reason
    assert "% apart" in answer.reason


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_search_sees_whole_numbers_only(backend: str) -> None:
    """In a population every coordinate counts as its nearest whole number."""
    problem = switched(bounds=Bounds(controls=(-1, 2), integer=[0]))
    rng = np.random.default_rng(0)
    population = rng.uniform(-1.499, 2.499, (N, 40))
    objective = Fitness(problem, backend=backend).objective([0.0, 0.0])
    free = replace(problem, bounds=Bounds(controls=(-1, 2)))
    expected = Fitness(free, backend="casadi").objective([0.0, 0.0])
    np.testing.assert_allclose(
        objective(population)[0], expected(np.floor(population + 0.5))[0], rtol=1e-12
    )


@pytest.mark.parametrize("highest", [0.9, 1.1])
def test_constraints_hold_with_whole_numbers(highest: float) -> None:
    base, limited = switched(), switched(highest=highest)
    answer = solve(limited, [0.0, 0.0], budget=500, seed=0)
    assert answer.cost == pytest.approx(enumerated(limited, [0.0, 0.0])[0], rel=1e-12)
    assert answer.cost > enumerated(base, [0.0, 0.0])[0]
    assert answer.violation <= limited.tolerance


def fishing() -> OptimalControlProblem:
    """Lotka-Volterra fishing, controls 0 or 1."""
    x, w = ca.SX.sym("x", 2), ca.SX.sym("w")
    ode = ca.vertcat(
        x[0] - x[0] * x[1] - 0.4 * x[0] * w, -x[1] + x[0] * x[1] - 0.2 * x[1] * w
    )
    return OptimalControlProblem(
        Model(states=x, controls=w, ode=ode),
        horizon=12.0,
        intervals=60,
        stage_cost=ca.sumsqr(x - 1),
        bounds=Bounds(controls=(0, 1), integer=[0]),
    )


@pytest.mark.parametrize("search", [None, "default"])
def test_fishing_is_near_its_relaxation(search: str | None) -> None:
    """Relaxed 1.34466; the best of searches with rounding by hand was 1.34900."""
    budget = None if search is None else 4000
    answer = solve(fishing(), [0.5, 0.7], search=search, budget=budget, seed=0)
    assert answer.plan.relaxed_cost == pytest.approx(1.34466, abs=1e-5)
    assert answer.cost == pytest.approx(1.34900, abs=1e-5)
    assert answer.verified_cost == pytest.approx(answer.cost, rel=1e-5)
    assert answer.status is SolutionStatus.FEASIBLE
    assert "cost 1.349, relaxed 1.34466: 0.32 % apart" in answer.reason


A, B = np.array([[0.9, 0.3], [-0.2, 1.05]]), np.array([[0.1, 0.5], [0.5, -0.4]])


def mixed() -> OptimalControlProblem:
    """A linear-quadratic problem in discrete time: one control whole, one not."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    return OptimalControlProblem(
        Model(states=x, controls=u, next_state=A @ x + B @ u),
        horizon=4.0, intervals=4, step_cost=ca.sumsqr(x) + 0.1 * ca.sumsqr(u),
        terminal_cost=2 * ca.sumsqr(x),
        bounds=Bounds(controls=([-1, -10], [1, 10]), integer=["u_0"]),
    )  # fmt: skip


def best_mixed(x0: np.ndarray) -> float:
    """The least over the 81 sequences, each by least squares over the other control."""
    costs = []
    for sequence in product([-1.0, 0.0, 1.0], repeat=4):
        rows, known = [], []
        x, slope = x0, np.zeros((2, 4))
        for k, w in enumerate(sequence):
            unit = np.eye(4)[k]
            rows += [slope, np.sqrt(0.1) * unit[None, :], np.zeros((1, 4))]
            known += [x, [0.0], [np.sqrt(0.1) * w]]
            x, slope = A @ x + B[:, 0] * w, A @ slope + np.outer(B[:, 1], unit)
        J = np.vstack([*rows, np.sqrt(2) * slope])
        r = np.concatenate([*known, np.sqrt(2) * x])
        v = np.linalg.lstsq(J, -r, rcond=None)[0]
        costs.append(float(np.square(J @ v + r).sum()))
    return min(costs)


def test_what_is_not_whole_is_optimal_beside_what_is() -> None:
    for x0 in ([3.0, -1.0], [-2.0, 2.5]):
        answer = solve(mixed(), x0, budget=2000, seed=0)
        assert answer.cost == pytest.approx(best_mixed(np.array(x0)), rel=1e-6)
        np.testing.assert_array_equal(answer.controls[0], np.rint(answer.controls[0]))


def test_other_decisions_are_made_beside_whole_numbers() -> None:
    """x' = w + b over 1 s from 0 to 0.25 at least cost b^2: one of four on, b = 0."""
    x, w, b = (ca.SX.sym(n) for n in "xwb")
    problem = OptimalControlProblem(
        Model(states=x, controls=w, ode=w + b, parameters=b),
        horizon=1.0, intervals=4, terminal_cost=(x - 0.3) ** 2, stage_cost=b**2,
        bounds=Bounds(controls=(0, 1), integer=[0]), decided={"b": Free(-1, 1)},
    )  # fmt: skip
    answer = solve(problem, [0.0], budget=1000, seed=0)
    assert answer.controls.sum() == 1
    # (0.25 + b - 0.3)^2 + b^2 is least at b = 0.025.
    assert answer.decided["b"] == pytest.approx(0.025, rel=1e-5)


def test_ensemble_of_switches_has_the_worst_cost_of_the_best_sequence() -> None:
    x, w, k = (ca.SX.sym(n) for n in "xwk")
    problem = OptimalControlProblem(
        Model(states=x, controls=w, ode=-x + k * w, parameters=k),
        horizon=3.0, intervals=N, stage_cost=(x - 0.5) ** 2,
        bounds=Bounds(controls=(0, 1), integer=[0]),
    )  # fmt: skip
    pair = ensemble(problem, {"k": [0.8, 1.5]}, risk="worst")
    answer = solve(pair, [0.0], budget=500, seed=0)
    every = np.array([*product([0.0, 1.0], repeat=N)]).T
    free = replace(problem, bounds=Bounds(controls=(0, 1)))
    costs = [
        Fitness(ensemble(free, {"k": [gain]})).objective([0.0])(every)[0]
        for gain in (0.8, 1.5)
    ]
    assert answer.cost == pytest.approx(np.max(costs, axis=0).min(), rel=1e-9)


def test_closed_loop_applies_whole_numbers() -> None:
    problem = switched()
    planner = Planner(problem, search="lshade", polish=IpoptOptions())
    plant = Plant(problem.model, dt=problem.dt, substeps=10)
    loop = RecedingHorizon(planner=planner)
    flight = simulate(plant, loop, [0.0, 0.0], steps=3, seed=0)
    assert {*flight.controls.ravel()} <= {0.0, 1.0}


def test_guess_is_rounded_and_search_alone_says_what_is_not_known() -> None:
    answer = solve(
        switched(), [0.0, 0.0], polish=None, budget=300, seed=0,
        guess=np.full((1, N), 0.6),
    )  # fmt: skip
    assert {*answer.controls.ravel()} <= {0.0, 1.0}
    assert "not polished, so that no relaxed cost is known" in answer.reason
    assert answer.status is SolutionStatus.FEASIBLE
    assert answer.advice == ""


def test_multistart_refuses_whole_numbers() -> None:
    planner = Planner(switched(), search=None, polish=IpoptOptions())
    with pytest.raises(InvalidProblemError, match="no controls of whole numbers"):
        multistart(
            planner,
            [0.0, 0.0],
            budget=Budget(evaluations=10),
            rng=np.random.default_rng(0),
        )
