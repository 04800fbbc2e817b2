"""RODAS4 against closed forms, matrix exponentials and an independent integrator."""

import math
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Free,
    Known,
    Model,
    OptimalControlProblem,
    Plant,
    held_step,
    solve,
)
from swarmstart.ocp.integration.rodas import (
    GAMMA,
    IN_TIME,
    TIMES,
    A,
    C,
    Rate,
    factored,
    rodas4,
    rodas4_with_error,
)
from swarmstart.ocp.nlp.transcription import multiple_shooting
from swarmstart.ocp.rollout.fitness import Fitness
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.tests.ocp import catalyst


def follow(rate: Rate, x0: list[float], end: float, steps: int) -> Array:
    """Return the state at `end`, from 0 in equal steps."""
    x, t, h = ca.SX.sym("x", len(x0)), ca.SX.sym("t"), end / steps
    after = rodas4(rate, x, t, h)  # type: ignore[arg-type]
    path = ca.Function("step", [x, t], [after]).mapaccum(steps)
    return np.array(path(x0, h * np.arange(steps)[None]))[:, -1]


def quadratic(t: float, x: ca.SX) -> ca.SX:
    """Return x' of x = 1 / (1 + t^2), and of its integral, the arc tangent."""
    return ca.vertcat(-2 * t * x[0] ** 2, x[0])


def test_error_falls_with_order_four_if_rates_depend_on_time_too() -> None:
    exact = [1 / 5, np.arctan(2.0)]
    errors = [
        np.abs(follow(quadratic, [1.0, 0.0], 2.0, n) - exact).max()
        for n in (64, 128, 256)
    ]
    rates = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(rates, 4, atol=0.2)


def test_coefficients_belong_together() -> None:
    """Row sums of alpha (c) and gamma (d), and order four for linear equations.

    With the transformation of the book, u = Gamma k: C = I / gamma - Gamma^-1 and
    a = alpha Gamma^-1 (eq. IV.7.22 f.).
    """
    a = np.zeros((6, 6))
    for i, row in enumerate((*A, (*A[-1], 1.0))):
        a[i, : len(row)] = row
    couplings = np.zeros((6, 6))
    for i, row in enumerate(C):
        couplings[i, : len(row)] = row
    gamma = np.linalg.inv(np.eye(6) / GAMMA - couplings)
    np.testing.assert_allclose((a @ gamma).sum(axis=1), TIMES, rtol=0, atol=2e-14)
    np.testing.assert_allclose(gamma.sum(axis=1), IN_TIME, rtol=0, atol=2e-14)
    weights = np.append(a[-1, :5], 1.0) @ gamma
    summed, beta = np.ones(6), a @ gamma + gamma
    for power in range(1, 5):  # Linear equations: the series of e^z to order four.
        off = weights @ summed - 1 / math.factorial(power)
        assert abs(off) < 2e-14
        summed = beta @ summed


def test_error_estimate_is_that_of_a_solution_of_order_three() -> None:
    def estimated(h: float) -> float:
        k6 = rodas4_with_error(quadratic, ca.SX([0.5, 0.0]), 1.0, h)[1]
        return float(ca.norm_inf(ca.DM(k6)))

    local = np.log2(estimated(0.02) / estimated(0.01))
    assert local == pytest.approx(4, abs=0.2)  # One step of order three.


def test_time_may_as_well_be_a_state() -> None:
    def clocked(_: float, z: ca.SX) -> ca.SX:
        return ca.vertcat(quadratic(z[2], z[:2]), 1)  # type: ignore[arg-type]

    x0, t, h = [0.7, 0.1], 0.4, 0.3
    own = ca.DM(rodas4(quadratic, ca.SX(x0), t, h))
    as_state = ca.DM(rodas4(clocked, ca.SX([*x0, t]), 0.0, h))
    np.testing.assert_allclose(as_state[:2], own, rtol=1e-14)
    assert float(as_state[2]) == pytest.approx(t + h, rel=1e-14)


def test_no_decaying_or_swinging_mode_grows_and_fast_ones_are_gone() -> None:
    A, x = ca.SX.sym("A", 2, 2), ca.SX.sym("x", 2)
    step = ca.Function("step", [A, x], [rodas4(lambda _, y: A @ y, x, 0.0, 1.0)])
    for size in np.logspace(-2, 6, 25):
        for angle in np.linspace(np.pi / 2, np.pi, 7):
            z = size * np.exp(1j * angle)
            turn = np.array([[z.real, -z.imag], [z.imag, z.real]])
            left = np.linalg.norm(np.array(step(turn, [1.0, 0.0])))
            assert left <= min(1.0, 100 / size) + 1e-12


@pytest.mark.parametrize("rate", [1e2, 1e4, 1e6, 1e9])
def test_slow_solution_is_followed_past_a_mode_of_any_rate(rate: float) -> None:
    # Prothero and Robinson: x = cos t attracts with any rate.
    def near_cosine(t: float, x: ca.SX) -> ca.SX:
        return -rate * (x - ca.cos(t)) - ca.sin(t)

    assert follow(near_cosine, [1.0], 2.0, 8) == pytest.approx(np.cos(2.0), abs=1e-4)
    assert follow(near_cosine, [3.0], 2.0, 8) == pytest.approx(np.cos(2.0), abs=2e-3)


def test_van_der_pol_is_that_of_an_independent_integrator() -> None:
    def rate(_: float, x: ca.SX) -> ca.SX:
        return ca.vertcat(x[1], 100 * (1 - x[0] ** 2) * x[1] - x[0])

    def numbers(_: float, x: Array) -> list[float]:
        return [x[1], 100 * (1 - x[0] ** 2) * x[1] - x[0]]

    # On the slow branch: 0.5 s are some 150 of the fast mode's times.
    truth = solve_ivp(
        numbers, (0, 50), [2.0, 0.0], method="Radau", rtol=1e-11, atol=1e-13
    ).y[:, -1]
    for steps, allowed in ((40, 6e-5), (160, 4e-6)):
        found = follow(rate, [2.0, 0.0], 50.0, steps)
        np.testing.assert_allclose(found[0], truth[0], rtol=0, atol=allowed)


@pytest.mark.parametrize(
    ("substeps", "at_best", "anywhere"),
    [(4, 1e-8, 2e-6), (8, 3e-11, 1e-8), (16, 2e-12, 1e-9)],
)
def test_catalyst_is_that_of_matrix_exponentials(
    substeps: int, at_best: float, anywhere: float
) -> None:
    # Some 1500 times of the fastest mode in each interval.
    step = held_step(catalyst.model(), 200.0, method="stiff", substeps=substeps)
    path = step.mapaccum("path", 10)

    def error(controls: Array) -> float:
        end = np.array(path(catalyst.X0, controls, ca.DM(0, 10)))[6, -1]
        return abs(float(end / catalyst.exact_end(controls)[6]) - 1)

    rng = np.random.default_rng(0)
    assert error(catalyst.BEST_CONTROLS) < at_best
    assert max(error(rng.uniform(0.6, 0.9, (1, 10))) for _ in range(10)) < anywhere


def test_catalyst_is_solved_to_the_best_known_yield_and_confirmed() -> None:
    solution = solve(catalyst.problem(integrator="stiff", substeps=4), catalyst.X0,
                     seed=0)  # fmt: skip
    assert solution.status.is_confirmed, solution
    assert -solution.cost == pytest.approx(catalyst.BEST, abs=1e-6)
    assert -solution.verified_cost == pytest.approx(catalyst.BEST, abs=1e-7)
    exact = catalyst.exact_end(solution.controls)
    np.testing.assert_allclose(solution.states[:, -1], exact, rtol=1e-9, atol=1e-15)


def test_machine_code_and_casadi_compute_the_same() -> None:
    problem = catalyst.problem(integrator="stiff", substeps=2)
    population = np.random.default_rng(1).uniform(0.6, 0.9, (10, 9))
    compiled, mapped = (
        Fitness(problem, backend=backend).objective(catalyst.X0, Known())(population)
        for backend in ("llvm", "casadi")
    )
    np.testing.assert_allclose(compiled, mapped, rtol=1e-11)


def test_plant_follows_a_stiff_model() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=-1e5 * (x - u))
    plant = Plant(model, dt=1.0, substeps=2, integrator="stiff")
    after = plant(np.array([5.0]), np.array([0.3]))
    np.testing.assert_allclose(after[:, -1], 0.3, atol=1e-6)
    explicit = Plant(model, dt=1.0, substeps=2)(np.array([5.0]), np.array([0.3]))
    assert abs(explicit[0, -1]) > 1e30


@settings(max_examples=60, deadline=None)
@given(
    n=st.integers(1, 9),
    density=st.floats(0, 1),
    seed=st.integers(0, 2**32 - 1),
)
def test_factors_solve_what_numpy_solves(n: int, density: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    there = (rng.uniform(size=(n, n)) < density) | np.eye(n, dtype=bool)
    M = np.where(there, rng.uniform(-1, 1, (n, n)), 0.0)
    M += np.diag(np.sign(np.diag(M)) * np.abs(M).sum(axis=1))  # No pivot is small.
    b = rng.normal(size=n)
    pattern = ca.DM(there.astype(float)).sparsity()
    symbols = ca.SX.sym("M", ca.sparsify(ca.DM(there.astype(float))).sparsity())
    assert pattern.shape == symbols.shape
    solved = ca.Function("solved", [symbols], [factored(symbols).solve(ca.SX(b))])
    np.testing.assert_allclose(
        np.array(solved(M)).ravel(), np.linalg.solve(M, b), rtol=1e-9, atol=1e-12
    )


def test_triangular_matrix_in_any_order_costs_no_more_than_substitution() -> None:
    n, rng = 12, np.random.default_rng(3)
    order = rng.permutation(n)
    there = np.tril(np.ones((n, n)))[order][:, order]
    M = ca.SX.sym("M", ca.sparsify(ca.DM(there)).sparsity())
    b = ca.SX.sym("b", n)
    solved = ca.Function("solved", [M, b], [factored(M).solve(b)])
    arithmetic = solved.n_instructions() - M.nnz() - 2 * n
    # An inverse pivot, its products with the column and with b; x -= l y below.
    assert arithmetic <= n * (n - 1) // 2 * 3 + 2 * n


def test_only_the_step_after_controls_jump_is_divided() -> None:
    def operations(checks: int, substeps: int) -> int:
        problem = replace(
            catalyst.problem(integrator="stiff", substeps=substeps),
            integrator_tolerance=None,
            checks=checks,
        )
        return int(Shooting(problem).stage.n_instructions())

    one, more = operations(1, 1), operations(1, 2)
    step = more - one
    assert one == pytest.approx(5 * step, rel=0.15)  # Five parts.
    assert operations(4, 1) == pytest.approx(one + 3 * step, rel=0.1)


def test_robertson_is_that_of_an_independent_integrator() -> None:
    """Three time scales: 1e-4 s at the start of 4 s, and never at rest."""

    def rates(x: Any) -> list[Any]:
        made, lost = 0.04 * x[0], 1e4 * x[1] * x[2]
        return [lost - made, made - lost - 3e7 * x[1] ** 2, 3e7 * x[1] ** 2]

    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=ca.vertcat(*rates(x)))
    step = held_step(model, 4.0, method="stiff", substeps=16)
    found = np.array(step.mapaccum(10)([1, 0, 0], np.zeros((1, 10)), ca.DM(0, 10)))
    truth = solve_ivp(
        lambda _, y: rates(y), (0, 40), [1, 0, 0], method="Radau", rtol=1e-10,
        atol=1e-14, t_eval=np.linspace(4, 40, 10),
    ).y  # fmt: skip
    off = np.abs(found - truth).max(axis=1) / np.abs(truth).max(axis=1)
    assert off.max() < 1e-4


def test_nlp_and_rollout_take_the_same_steps() -> None:
    problem = replace(
        catalyst.problem(integrator="stiff", substeps=1),
        checks=2,
        integrator_tolerance=None,
    )
    shooting = Shooting(problem)
    program = multiple_shooting(shooting)
    x0, none = catalyst.X0, np.empty((0, problem.nodes))
    controls = np.random.default_rng(5).uniform(0.6, 0.9, (1, 10))
    states = Fitness(shooting).states(controls, x0)
    sizes = shooting.sizing(x0, np.empty(0), none)
    both = ca.Function("g", [program.nlp["x"], program.nlp["p"]], [program.nlp["g"]])
    defects = both(
        program.variables(controls, states[:, ::2], sizes),
        program.arguments(x0, np.empty(0), np.empty(0), sizes),
    )
    np.testing.assert_allclose(np.array(defects), 0, atol=1e-12)


def test_time_in_a_stiff_model_is_followed() -> None:
    """Prothero and Robinson's problem, planned: x is the cosine of time."""
    x, u, t = (ca.SX.sym(name) for name in ("x", "u", "t"))
    problem = OptimalControlProblem(
        Model(states=x, controls=u, time=t, ode=-1e6 * (x - ca.cos(t)) - ca.sin(t)),
        horizon=3.0,
        intervals=6,
        stage_cost=(u - x) ** 2,
        bounds=Bounds(controls=(-2, 2)),
        integrator="stiff",
    )
    answer = solve(problem, [1.0], search=None, seed=0)
    assert answer.status.is_confirmed, answer
    np.testing.assert_allclose(answer.states[0], np.cos(answer.times), atol=1e-6)
    # The best held control is the mean of the cosine in its interval.
    means = np.diff(np.sin(problem.times)) / 0.5
    np.testing.assert_allclose(answer.controls[0], means, atol=1e-6)


def test_free_end_time_of_a_stiff_model_is_found() -> None:
    """From rest to 1 in minimum time behind a lag of 1e-5 s: u = 2, then T = 0.5."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], 1e5 * (u - x[1]))),
        horizon=Free(0.1, 3.0),
        intervals=5,
        stage_cost=1.0,  # type: ignore[arg-type]
        bounds=Bounds(controls=(-2, 2)),
        terminal=[x[0] - 1],
        integrator="stiff",
    )
    answer = solve(problem, [0.0, 0.0], budget=1000, seed=0)
    assert answer.status.is_confirmed, answer
    assert answer.cost == pytest.approx(0.5 + 1e-5, abs=1e-6)
