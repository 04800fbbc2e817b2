"""Algebraic equations: comparison with closed forms, and errors."""

import math
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.special import lambertw

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.ocp import (
    AlgebraicEquations,
    Bounds,
    InvalidProblemError,
    Model,
    OptimalControlProblem,
    PathConstraint,
    right_hand_side,
    stack_models,
)
from swarmstart.ocp.rollout.kinks import kink_sizes, kinks_of, smoothed
from swarmstart.ocp.statement.problem import STATE_BOUNDS
from swarmstart.ocp.system.algebraic import UNSOLVED

X, U, Z = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("z")


def omega(x: Any) -> Array:
    """The solution of z + exp(z) = x is x - W(exp(x)), W of Lambert."""
    return np.asarray(x - lambertw(np.exp(x)).real, dtype=np.float64)


def exponential(**options: object) -> Model:
    """x' = u - z with z + exp(z) = x."""
    equations = AlgebraicEquations(symbols=Z, residual=Z + ca.exp(Z) - X, **options)  # type: ignore[arg-type]
    return Model(states=X, controls=U, ode=U - Z, algebraic=equations)


def double_pendulum(*, as_dae: bool) -> Model:
    """Two rods on a cart, M(q) q'' = h(q, q') + B u (do-mpc's example in its form)."""
    q, v, u = ca.SX.sym("q", 3), ca.SX.sym("v", 3), ca.SX.sym("u")
    inertia = ca.blockcat([
        [1.0, 0.15 * ca.cos(q[1]), 0.05 * ca.cos(q[2])],
        [0.15 * ca.cos(q[1]), 0.08, 0.025 * ca.cos(q[1] - q[2])],
        [0.05 * ca.cos(q[2]), 0.025 * ca.cos(q[1] - q[2]), 0.02],
    ])  # fmt: skip
    swing = 0.025 * ca.sin(q[1] - q[2])
    forces = ca.vertcat(
        u + 0.15 * v[1] ** 2 * ca.sin(q[1]) + 0.05 * v[2] ** 2 * ca.sin(q[2]),
        1.47 * ca.sin(q[1]) - swing * v[2] ** 2,
        0.49 * ca.sin(q[2]) + swing * v[1] ** 2,
    )
    states = ca.vertcat(q, v)
    if not as_dae:
        return Model(
            states=states, controls=u, ode=ca.vertcat(v, ca.inv(inertia) @ forces)
        )
    z = ca.SX.sym("acceleration", 3)
    return Model(
        states=states,
        controls=u,
        ode=ca.vertcat(v, z),
        algebraic=AlgebraicEquations(symbols=z, residual=inertia @ z - forces),
    )


def test_double_pendulum_as_dae_is_its_ode() -> None:
    dae, ode = (right_hand_side(double_pendulum(as_dae=a)) for a in (True, False))
    rng = np.random.default_rng(0)
    for _ in range(50):
        x, u = rng.normal(size=6), rng.normal()
        np.testing.assert_allclose(
            np.array(dae(x, u, [])), np.array(ode(x, u, [])), rtol=1e-12, atol=1e-12
        )


def test_linear_equations_need_no_path_constraint_and_have_no_kink() -> None:
    model = double_pendulum(as_dae=True)
    problem = OptimalControlProblem(model, horizon=1.0, intervals=2)
    assert not problem.path_constraints
    assert not kinks_of(problem).names


def test_a_pivot_that_is_zero_is_no_obstacle() -> None:
    z = ca.SX.sym("z", 2)
    residual: Any = [X * z[0] + z[1] - U, z[0] - 2 * X]  # the matrix [[x, 1], [1, 0]]
    model = Model(
        states=X,
        controls=U,
        ode=z[1],
        algebraic=AlgebraicEquations(symbols=z, residual=residual),
    )
    assert float(right_hand_side(model)(0.0, 3.0, [])) == 3.0
    assert float(right_hand_side(model)(2.0, 3.0, [])) == pytest.approx(-5.0)


@pytest.mark.parametrize("start", [0.0, -2.0, X / 2, [1.0]])
def test_nonlinear_equation_has_the_value_of_its_closed_form(start: object) -> None:
    z = ca.Function("z", [X], [exponential(start=start).elimination.solution])
    places = np.linspace(-3, 3, 25)
    np.testing.assert_allclose(
        np.array(z(places)).ravel(), omega(places), rtol=1e-12, atol=1e-12
    )


def test_its_derivatives_are_those_of_the_closed_form() -> None:
    solution = exponential().elimination.solution
    slope = ca.jacobian(solution, X)
    values = ca.Function("values", [X], [slope, ca.jacobian(slope, X)])
    for x in np.linspace(-3, 3, 13):
        # 1 = (1 + exp(z)) z', and once more with exp(z) = x - z
        w = float(x - omega(x))
        first = 1 / (1 + w)
        np.testing.assert_allclose(
            np.array(values(x)).ravel(), [first, -w * first**3], rtol=1e-12, atol=1e-12
        )


def test_costs_and_constraints_may_have_the_algebraic_variable() -> None:
    rows: Any = [Z, X * Z]
    problem = OptimalControlProblem(
        exponential(),
        horizon=1.0,
        intervals=2,
        stage_cost=Z**2,
        constraints=[Z <= 3, PathConstraint(expression=rows, lower=-9)],
    )
    place = problem.model.states, problem.model.controls
    cost = ca.Function("cost", [*place], [problem.stage_cost])
    assert float(cost(2.0, 0.0)) == pytest.approx(float(omega(2.0)) ** 2, rel=1e-12)
    names = [constraint.name for constraint in problem.path_constraints]
    assert names == ["(z<=3)", "", UNSOLVED]
    again = replace(problem, horizon=2.0)
    assert [c.name for c in again.path_constraints] == names
    assert not kinks_of(problem).names


def test_what_stands_at_the_end_has_no_variable_that_depends_on_controls() -> None:
    of_state = OptimalControlProblem(
        exponential(), horizon=1.0, intervals=2, terminal_cost=Z**2, terminal=[Z <= 1]
    )
    assert not ca.depends_on(of_state.terminal_cost, Z)
    with pytest.raises(InvalidProblemError, match=r"terminal_cost may .*, found u"):
        replace(root(Z - U, 0.0), terminal_cost=Z)


def test_bounds_and_rounded_kinks_keep_the_constraint_of_the_equations() -> None:
    problem = OptimalControlProblem(
        exponential(),
        horizon=1.0,
        intervals=2,
        stage_cost=ca.fabs(U),
        bounds=Bounds(controls=(-1.0, 1.0), states=(-9.0, 9.0)),
    )
    rounded = smoothed(problem, kink_sizes(problem, [1.0], ss.Known()), 1e-3)
    for posed in (problem, rounded):
        names = [constraint.name for constraint in posed.path_constraints]
        assert names == [UNSOLVED, STATE_BOUNDS]


def test_symbols_and_equations_may_be_mx() -> None:
    x, z, u = (ca.MX.sym(name) for name in "xzu")
    given: Any = {
        "states": x,
        "controls": u,
        "ode": u - z,
        "algebraic": AlgebraicEquations(
            symbols=z,  # type: ignore[arg-type]
            residual=z + ca.exp(z) - x,  # type: ignore[arg-type]
            start=x / 2,  # type: ignore[arg-type]
        ),
    }
    model = replace(Model(**given), control_names=("push",))
    value = float(right_hand_side(model)(2.0, 1.0, []))
    assert value == pytest.approx(1.0 - float(omega(2.0)), rel=1e-12)
    cost = model.sx("cost", z**2)
    assert ca.depends_on(cost, model.states)


def test_a_problem_is_solved_as_the_same_problem_without_the_equation() -> None:
    """With w = z as the state, z' = x' / (1 + exp(z)), the answer is the same."""

    def solved(model: Model, **stated: object) -> ss.Solution:
        problem = OptimalControlProblem(
            model,
            horizon=1.0,
            intervals=10,
            bounds=Bounds(controls=(-4.0, 4.0)),
            substeps=8,
            **stated,  # type: ignore[arg-type]
        )
        start = 1.0 + math.e if model.algebraic else 1.0
        return ss.solve(problem, [start], budget=200, seed=0)

    dae = solved(exponential(), stage_cost=U**2, terminal_cost=100 * (X - 2) ** 2)
    w = ca.SX.sym("w")
    other = Model(states=w, controls=U, ode=(U - w) / (1 + ca.exp(w)))
    end = 100 * (w + ca.exp(w) - 2) ** 2
    ode = solved(other, stage_cost=U**2, terminal_cost=end)
    assert dae.status is ode.status is ss.SolutionStatus.CONVERGED
    assert dae.cost == pytest.approx(ode.cost, rel=1e-6)  # RK4 on another state


def test_the_equations_are_compiled_to_machine_code() -> None:
    problem = OptimalControlProblem(
        exponential(),
        horizon=1.0,
        intervals=4,
        stage_cost=U**2 + Z**2,
        bounds=Bounds(controls=(-4.0, 4.0)),
    )
    answers = [
        ss.solve(problem, [1.0], budget=400, seed=0, polish=None, backend=backend)
        for backend in ("llvm", "casadi")
    ]
    assert answers[0].cost == pytest.approx(answers[1].cost, rel=1e-12)
    assert answers[0].violation == 0


def root(residual: ca.SX, start: float) -> OptimalControlProblem:
    """x' = u with equations that Newton's method cannot always solve."""
    equations = AlgebraicEquations(symbols=Z, residual=residual, start=start)
    return OptimalControlProblem(
        Model(states=X, controls=U, ode=U, algebraic=equations),
        horizon=1.0,
        intervals=2,
        stage_cost=(U + 1) ** 2 + Z,
        bounds=Bounds(controls=(-1.0, 1.0)),
    )


@pytest.mark.parametrize("residual", [Z**2 + 1 + X**2, Z**4 + 0.1 * Z - 1e3 * X])
def test_a_start_whose_equations_are_not_solved_is_refused(residual: ca.SX) -> None:
    with pytest.raises(InvalidProblemError, match="'algebraic equations' is broken"):
        ss.solve(root(residual, 5e-3), [2.0], budget=100, seed=0)


def test_an_answer_whose_equations_are_not_solved_is_infeasible() -> None:
    """z^2 = x has no solution for negative x, to which the cost drives it."""
    solvable = root(Z**2 - X, 1.0)
    answer = ss.solve(solvable, [0.5], budget=400, seed=0)
    assert answer.status in (ss.SolutionStatus.CONVERGED, ss.SolutionStatus.FEASIBLE)
    assert answer.states.min() > 0
    unsolvable = replace(solvable, bounds=Bounds(controls=(-1.0, -0.99)))
    answer = ss.solve(unsolvable, [0.5], budget=100, seed=0)
    assert answer.status is ss.SolutionStatus.INFEASIBLE


def test_what_is_left_has_no_unit() -> None:
    """Equations and z in other units leave the same residual."""
    left = []
    for unit, of_z in ((1.0, 1.0), (1e6, 1.0), (1.0, 1e-6)):
        z = Z / of_z
        equations = AlgebraicEquations(
            symbols=Z,
            residual=unit * (z + ca.exp(z) - X),
            scale=of_z,
            iterations=2,
        )
        model = Model(states=X, controls=U, ode=U, algebraic=equations)
        r = ca.Function("r", [X], [model.elimination.unsolved])
        left.append(float(r(3.0)))
    assert abs(left[0]) > 1e-6
    np.testing.assert_allclose(left, left[0], rtol=1e-9)


Z2 = ca.SX.sym("z", 2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"residual": [Z2[0] - X, X + U]}, r"\(.*index 1\): no equation has z_1"),
        ({"residual": [Z2[0] + Z2[1], X + U]}, "equation 1 has none of them"),
        (
            {"residual": [Z2[0] + Z2[1] - X, 2 * Z2[0] + 2 * Z2[1]]},
            "the equations depend on each other",
        ),
        (
            {"residual": [ca.exp(Z2[0] * Z2[1]) - X, 3 * Z2[0] * Z2[1] - U]},
            "the equations depend on each other",
        ),
        ({"residual": [Z2[0] - X]}, r"each algebraic variable \(z_0, z_1\), got 1"),
        ({"residual": Z2 - ca.SX.sym("wind")}, "found wind"),
        ({"residual": "z"}, "residual must be a CasADi expression, numbers, or a list"),
        ({"residual": ca.MX.sym("m", 2)}, "equations has MX symbols .*: m"),
        ({"symbols": 2 * Z2}, "algebraic symbols must be CasADi SX symbols"),
        ({"start": [1.0, 2.0, 3.0]}, "start must be a number or 2 of them, got 3"),
        ({"start": np.nan}, "start of algebraic variables must be finite"),
        ({"start": "0"}, "start must be a CasADi expression, numbers, or a list"),
        ({"start": Z2}, "start of the algebraic variables may depend on .*, found z_0"),
        ({"scale": 0.0}, "scale of algebraic variables must be positive"),
        ({"scale": [1.0, 2.0, 3.0]}, "scale .* must be a number or 2 of them"),
        ({"iterations": 0}, "iterations must be an integer of at least 1, got 0"),
    ],
)
def test_refuses_what_determines_no_variables(
    arguments: dict[str, object], message: str
) -> None:
    given = {"symbols": Z2, "residual": Z2 + ca.exp(Z2) - X, **arguments}
    with pytest.raises(InvalidProblemError, match=message):
        Model(
            states=X,
            controls=U,
            ode=U,
            algebraic=AlgebraicEquations(**given),  # type: ignore[arg-type]
        )


def test_refuses_other_objects_and_stacks_linear_equations_only() -> None:
    with pytest.raises(InvalidProblemError, match="algebraic must be swarmstart"):
        Model(states=X, controls=U, ode=U, algebraic=(Z, Z - X))  # type: ignore[arg-type]
    with pytest.raises(InvalidProblemError, match="would be lost"):
        stack_models([exponential(), exponential()])
    stacked = stack_models([double_pendulum(as_dae=True)] * 2)
    assert stacked.nx == 12
