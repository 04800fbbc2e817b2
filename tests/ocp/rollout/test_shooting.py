"""The rollout against SciPy, and against a simulation written in NumPy."""

from collections.abc import Callable
from typing import Any, Literal, cast

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Fitness,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    TerminalConstraint,
    solve,
)
from swarmstart.ocp.rollout import shooting
from swarmstart.ocp.rollout.fitness import flatten
from swarmstart.ocp.rollout.shooting import Shooting

Posed = tuple[OptimalControlProblem, Array, Known]


def test_integral_cost_is_that_of_an_independent_integrator(pendulum: Model) -> None:
    """Signals are linear between nodes; costs contain parameters as well."""
    x, u, s = pendulum.states, pendulum.controls, ca.SX.sym("s", 2)
    p = ca.SX.sym("p")
    model = Model(states=x, controls=u, parameters=p, ode=pendulum.ode)
    problem = OptimalControlProblem(
        model,
        horizon=1.5,
        intervals=3,
        stage_cost=p * (x[0] - s[0]) ** 2 * (1 + u**2) + s[1] ** 2 * x[1],
        terminal_cost=p * x[1] * s[1],
        signals=s,
        checks=2,
        substeps=30,
    )
    controls, x0 = np.array([[3.0, -1.0, 2.0]]), [0.4, -0.2]
    signals = np.random.default_rng(0).normal(size=(2, problem.nodes))

    def rate(t: float, y: Array) -> list[float]:
        held = controls[0, min(int(t / 0.5), 2)]
        a, b = (np.interp(t, problem.times, row) for row in signals)
        spent = 0.7 * (y[0] - a) ** 2 * (1 + held**2) + b**2 * y[1]
        return [y[1], held - 9.81 * np.sin(y[0]), spent]

    y = np.array([*x0, 0.0])
    for begin, end in zip(problem.times, problem.times[1:], strict=False):
        # One call from node to node, since the right-hand side has a kink there.
        inside = (begin, np.nextafter(end, begin))
        y = solve_ivp(rate, inside, y, rtol=1e-12, atol=1e-12).y[:, -1]
    cost = y[2] + 0.7 * y[1] * signals[1, -1]
    known = Known(parameters=[0.7], signals=signals)
    fitness = Fitness(problem)
    # RK4 with steps of 1/120 s: global error of some (1/120)^4 = 5e-9.
    np.testing.assert_allclose(fitness.states(controls, x0, known)[:, -1], y[:2], 1e-7)
    assert fitness.value(controls, x0, known)[0] == pytest.approx(cost, rel=1e-7)


def by_hand(posed: Posed, controls: Array) -> tuple[float, float, Array]:
    """Cost, violation and states of `crossing`, without CasADi."""
    _, state, known = posed
    signals = np.asarray(known.signals)

    def rate(y: Array, u: Array) -> Array:
        v, psi = y[0], y[1]
        return np.array([u[0], u[1], v * np.cos(psi), v * np.sin(psi)])

    def to_segment(a: Array, b: Array) -> float:
        if np.dot(-a, b - a) <= 0:
            return float(np.linalg.norm(a))
        if np.dot(-b, a - b) <= 0:
            return float(np.linalg.norm(b))
        return float(abs(a[0] * b[1] - a[1] * b[0]) / np.linalg.norm(b - a))

    cost, violation, states, node, h = 0.0, 0.0, [state], 0, 0.5 / 3
    for u in controls.T:
        error = state - signals[:4, node]
        cost += 1.0 * (error @ error + u @ u)
        for _ in range(2):
            before = state
            for _ in range(3):
                k1 = rate(state, u)
                k2 = rate(state + h / 2 * k1, u)
                k3 = rate(state + h / 2 * k2, u)
                k4 = rate(state + h * k3, u)
                state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
            node += 1
            centre = np.array([15.0, 1.0])
            others = signals[4:, node - 1], signals[4:, node]
            gap = to_segment(before[2:] - centre, state[2:] - centre)
            beside = to_segment(before[2:] - others[0], state[2:] - others[1])
            violation += max(4.5 - gap, 0) / 4  # In parts of the distances,
            violation += max(3 - float(np.linalg.norm(state[2:] - others[1])), 0) / 3
            violation += beside <= 6
            # of the width of the bounds.
            violation += (max(-state[0], 0) + max(state[0] - 12, 0)) / 12
            states.append(state)
    error = state - signals[:4, node]
    return cost + 2 * (error @ error), violation, np.array(states).T


@given(seed=st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_rollout_is_the_simulation_written_by_hand(
    crossing: Posed, crossing_fitness: Fitness, seed: int
) -> None:
    problem, x0, known = crossing
    lower, upper = problem.control_limits
    controls = np.random.default_rng(seed).uniform(lower, upper, (3, 2)).T
    cost, violation, states = by_hand(crossing, controls)
    found = crossing_fitness.value(controls, x0, known)
    np.testing.assert_allclose(found, (cost, violation), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(
        crossing_fitness.states(controls, x0, known), states, rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize(("quadrature", "first"), [("left", 0), ("right", 1)])
def test_summed_cost_is_taken_at_one_end_of_each_interval(
    quadrature: Literal["left", "right"], first: int
) -> None:
    """x' = u from 1 with u = 1, 2, 3: L = x u + s at x_k or x_k+1."""
    x, u, s = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("s")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.5,
        intervals=3,
        stage_cost=x * u + s,
        signals=s,
        quadrature=quadrature,
    )
    states, signals = np.array([1.0, 1.5, 2.5, 4.0]), np.array([7.0, 5.0, 3.0, 2.0])
    controls = np.array([1.0, 2.0, 3.0])
    ends = slice(first, first + 3)
    expected = 0.5 * np.sum(states[ends] * controls + signals[ends])
    cost, _ = Shooting(problem).rollout(controls, 1.0, [], signals)
    assert float(cost) == pytest.approx(expected, rel=1e-14)


def test_state_bounds_count_at_every_check(double_integrator: Model) -> None:
    """A stone exceeds the bound within the interval, but not at its end."""

    def violation(checks: int) -> float:
        problem = OptimalControlProblem(
            double_integrator,
            horizon=2.0,
            intervals=1,
            bounds=Bounds(states=([-np.inf, -np.inf], [0.3, np.inf]), state_scale=1.0),
            checks=checks,
        )
        return Fitness(problem).value(np.array([[-1.0]]), [0, 1])[1]

    # Height t - t^2 / 2 at the checks: 0 | 3/8, 1/2, 3/8, 0.
    assert violation(1) == 0
    assert violation(4) == pytest.approx(0.075 + 0.2 + 0.075, abs=1e-12)


def test_terminal_parts_see_the_end_only(double_integrator: Model) -> None:
    x, s = double_integrator.states, ca.SX.sym("s")
    problem = OptimalControlProblem(
        double_integrator,
        horizon=2.0,
        intervals=2,
        terminal_cost=x[0] * s,
        terminal=[
            TerminalConstraint(expression=x[1] - s, scale=1),
            TerminalConstraint(expression=x[0], upper=5.0, scale=10),
        ],
        signals=s,
    )
    # x(2) = 1 + 2 * 3 + 1 * (2 - 1/2) + (-2) / 2, v(2) = 3 + 1 - 2.
    known = Known(signals=[[50.0, 60.0, 7.0]])
    value = Fitness(problem).value(np.array([[1.0, -2.0]]), [1, 3], known)
    assert value == pytest.approx((7.5 * 7, 5 + 0.25), rel=1e-13)


def test_path_constraint_on_controls_holds_them_to_its_limits() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 2)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u[0]),
        horizon=1.0,
        intervals=2,
        constraints=[PathConstraint(expression=u[0] + u[1], upper=1.0)],
        checks=3,
    )
    value = Fitness(problem).value(np.array([[1.0, 0.0], [0.5, 0.0]]), [0.0])
    # At three checks, and at the start of the interval, at which its control jumps.
    assert value == pytest.approx((0.0, 4 * 0.5))


def test_arguments_are_column_after_column(crossing: Posed) -> None:
    problem, x0, known = crossing
    controls = np.random.default_rng(1).normal(size=(2, 3))
    signals = flatten(np.asarray(known.signals))
    found, outside = Shooting(problem).trajectory(controls.T.ravel(), x0, [], signals)
    states = np.array(found)
    assert float(outside) == 0
    assert states.shape == (4, problem.nodes)
    np.testing.assert_allclose(states[0, 2::2], 10 + np.cumsum(controls[0]), rtol=1e-13)
    assert Shooting(problem).rollout.name_in() == [
        "decisions",
        "x0",
        "parameters",
        "signals",
    ]


def test_planner_and_all_its_parts_share_functions_built_once(
    pendulum: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[str] = []
    for name in ("_stage", "_terminal", "Sizing"):
        original = getattr(shooting, name)

        def noted(given: object, name: str = name, original: object = original) -> Any:
            built.append(name)
            return cast(Callable[[object], Any], original)(given)

        monkeypatch.setattr(shooting, name, noted)
    problem = OptimalControlProblem(
        pendulum,
        horizon=1.0,
        intervals=5,
        stage_cost=pendulum.controls**2 + pendulum.states[0] ** 2,
        bounds=Bounds(controls=(-8, 8)),
    )
    solve(problem, [0.5, 0.0], budget=200, seed=0, backend="casadi")
    assert sorted(built) == ["Sizing", "_stage", "_terminal"]
