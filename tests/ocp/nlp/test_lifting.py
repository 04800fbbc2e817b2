"""Algebraic variables as unknowns of the NLP, against closed forms and Opti."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.cases.record.results import load
from swarmstart.ocp import (
    AlgebraicEquations,
    Bounds,
    Fitness,
    Free,
    Model,
    OptimalControlProblem,
    PolishStatus,
    Radau,
    SolutionStatus,
    solve,
)
from swarmstart.ocp.nlp.collocation import layout_of, lifted
from swarmstart.ocp.nlp.polish import Polisher
from swarmstart.ocp.nlp.transcription import multiple_shooting

N, T = 8, 3.0
X, Z, U = ca.SX.sym("x", 2), ca.SX.sym("voltage"), ca.SX.sym("u")
X0 = [0.0, 0.0]


def current(z: Any) -> Any:
    """Current of a diode, for which Newton steps are short or wild."""
    return 1e-6 * (ca.exp(z / 0.05) - 1)


def rates(x: Any, z: Any) -> Any:
    """A capacitor behind the diode, and a lag."""
    return ca.vertcat((z - x[0]) / 0.5 - x[1], x[0] - x[1])


def balance(x: Any, z: Any, u: Any) -> Any:
    """Sum of the currents into the node, which must be 0."""
    return (u - z) - current(z) - (z - x[0]) / 0.5


def spent(x: Any, u: Any) -> Any:
    """The stage cost."""
    return (x[1] - 0.4) ** 2 + 1e-3 * u**2


def diode(
    iterations: int = 20, start: float = 0.8, **options: Any
) -> OptimalControlProblem:
    """The circuit, led to 0.4 V."""
    equations = AlgebraicEquations(
        symbols=Z, residual=balance(X, Z, U), start=start, iterations=iterations
    )
    told: dict[str, Any] = {
        "stage_cost": spent(X, U),
        "horizon": T,
        "intervals": N,
        "substeps": 2,
        "transcription": "radau",
    }
    return OptimalControlProblem(
        Model(states=X, controls=U, ode=rates(X, Z), algebraic=equations),
        bounds=Bounds(controls=(-4, 4)),
        **(told | options),
    )


def by_opti(elements: int) -> tuple[float, Array]:
    """Return cost and controls by CasADi's Opti with the same points."""
    opti = ca.Opti()
    C, _, B = ca.collocation_coeff(ca.collocation_points(3, "radau"))
    controls, h, cost = opti.variable(1, N), T / N / elements, 0
    state = ca.MX(X0)
    for k in range(N):
        for _ in range(elements):
            inside, z = opti.variable(2, 3), opti.variable(1, 3)
            slopes = ca.horzcat(state, inside) @ C
            for j in range(3):
                opti.subject_to(slopes[:, j] == h * rates(inside[:, j], z[j]))
                opti.subject_to(balance(inside[:, j], z[j], controls[k]) == 0)
                cost += h * B[j] * spent(inside[:, j], controls[k])
            state = inside[:, 2]
    opti.subject_to(opti.bounded(-4, controls, 4))
    opti.minimize(cost)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    found = opti.solve()
    return float(found.value(cost)), np.array(found.value(controls)).ravel()


def test_circuit_has_the_answer_of_opti_with_the_same_equations() -> None:
    cost, controls = by_opti(4)
    finely = diode(10, 0.6, substeps=6, transcription=Radau(elements=4))
    answer = solve(finely, X0, search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    point = answer.plan.point
    assert point is not None
    nlp = float(point.program.derivatives["grad_f"](point.w, point.q)[0])
    assert nlp * point.cost_size == pytest.approx(cost, rel=1e-9)
    np.testing.assert_allclose(answer.controls[0], controls, atol=1e-5)


def test_nlp_has_nothing_of_newtons_method() -> None:
    few, many = (
        multiple_shooting(diode(iterations)).parts.interval for iterations in (5, 20)
    )
    for name in ("values", "slopes", "curvature"):
        one, other = getattr(few, name), getattr(many, name)
        assert one.n_instructions() == other.n_instructions()
    shot = multiple_shooting(diode(20, transcription="shooting")).parts.interval
    assert many.curvature.n_instructions() < shot.curvature.n_instructions() / 10


def test_it_converges_where_newtons_method_in_the_nlp_does_not() -> None:
    # Ten iterations from 0.5 V are enough for some voltages only.
    rng = np.random.default_rng(0)
    guesses = [rng.uniform(-4, 4, (1, N)) for _ in range(5)]
    found = {}
    for transcription in ("shooting", "radau"):
        polish = Polisher(Fitness(diode(10, 0.5, transcription=transcription)))
        polished = [polish(guess, X0) for guess in guesses]
        solved = (PolishStatus.CONVERGED, PolishStatus.WORSE)
        found[transcription] = sum(one.status in solved for one in polished)
    assert found["radau"] == len(guesses)
    assert found["shooting"] < len(guesses)


def test_an_answer_whose_equations_the_evaluator_does_not_solve_is_not_confirmed() -> (
    None
):
    answer = solve(diode(3), X0, search=None, seed=0)
    assert not answer.status.is_confirmed
    assert "algebraic equations" in answer.reason


def test_costs_and_constraints_have_them_as_unknowns() -> None:
    # At least 0.35 V at the diode, and a cost of its heat.
    told: dict[str, Any] = {
        "constraints": [Z >= 0.35],
        "stage_cost": spent(X, U) + 1e-2 * Z * current(Z),
    }
    shot, collocated = (
        solve(diode(transcription=t, **told), X0, search=None, seed=0)
        for t in ("shooting", "radau")
    )
    assert collocated.status is shot.status is SolutionStatus.CONVERGED
    assert collocated.cost == pytest.approx(shot.cost, rel=1e-4)
    assert collocated.algebraic.min() == pytest.approx(0.35, abs=1e-4)
    few, many = (
        multiple_shooting(diode(n, **told)).parts.interval.values.n_instructions()
        for n in (5, 20)
    )
    assert few == many


def test_free_end_time_and_time_keep_them_as_unknowns() -> None:
    x, z, u, t = (ca.SX.sym(n) for n in "xzut")

    def problem(iterations: int, transcription: str) -> OptimalControlProblem:
        equations = AlgebraicEquations(
            symbols=z, residual=z + ca.exp(z) - x - t, iterations=iterations
        )
        model = Model(states=x, controls=u, ode=u - z, time=t, algebraic=equations)
        return OptimalControlProblem(
            model,
            horizon=Free(0.5, 3.0),
            intervals=4,
            stage_cost=1 + u**2 + z**2,
            bounds=Bounds(controls=(-4, 4)),
            terminal=[(x, 2.0)],
            checks=2,
            substeps=1,
            transcription=transcription,  # type: ignore[arg-type]
        )

    sizes = [
        multiple_shooting(problem(n, "radau")).parts.interval.curvature.n_instructions()
        for n in (2, 6)
    ]
    assert sizes[0] == sizes[1]
    shot, collocated = (
        solve(problem(6, t), [0.0], search=None, seed=0) for t in ("shooting", "radau")
    )
    assert collocated.status is shot.status is SolutionStatus.CONVERGED
    assert collocated.cost == pytest.approx(shot.cost, rel=1e-5)
    assert collocated.decided["end time"] == pytest.approx(
        shot.decided["end time"], rel=1e-3
    )


def test_answer_has_them_by_name_and_keeps_them(tmp_path: Path) -> None:
    answer = solve(diode(6, 0.6), X0, search=None, seed=0)
    assert answer.algebraic_names == ("voltage",)
    assert answer.algebraic.shape == (1, N + 1)
    held = np.append(answer.controls[0], answer.controls[0, -1])
    left = balance(answer.states, answer.algebraic[0], held)
    np.testing.assert_allclose(np.array(ca.DM(left)).ravel(), 0.0, atol=1e-10)
    assert "algebraic   voltage" in repr(answer)
    kept = load(answer.save(tmp_path / "saved"))
    np.testing.assert_array_equal(kept.arrays["algebraic"], answer.algebraic)
    assert [*kept.arrays["algebraic_names"]] == ["voltage"]
    pytest.importorskip("pandas")
    table = answer.to_dataframe()
    np.testing.assert_array_equal(table["voltage"], answer.algebraic[0])


def test_equations_linear_in_their_variables_stay_eliminated() -> None:
    x, z, u = (ca.SX.sym(n) for n in "xzu")
    linear = AlgebraicEquations(symbols=z, residual=(2 + ca.cos(x)) * z - u)
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=z, algebraic=linear),
        horizon=1.0,
        intervals=2,
        transcription=Radau(elements=1),
    )
    layout = layout_of(problem)
    assert layout is not None and layout.lifted == 0 and layout.size == 3


def test_values_give_way_to_symbols_wherever_they_stand() -> None:
    a, b, z = (ca.SX.sym(n) for n in "abz")
    value = ca.sin(a) - ca.exp(b)
    expression = ca.vertcat(a * value + value**2, -value, b)
    found = lifted(expression, value, z)
    # CasADi writes -(c - d) as d - c, which is no longer the value.
    assert not ca.depends_on(found[:2], b)
    whole = ca.Function("whole", [a, b, z], [found])
    np.testing.assert_allclose(
        np.array(whole(2.0, 3.0, 5.0)).ravel(), [35.0, -5.0, 3.0], rtol=1e-15
    )
    at = float(ca.Function("at", [a, b], [value])(0.3, 0.7))
    np.testing.assert_allclose(
        np.array(whole(0.3, 0.7, at)),
        np.array(ca.Function("old", [a, b], [expression])(0.3, 0.7)),
        rtol=1e-14,
    )


def test_expression_without_the_values_stays_what_it_is() -> None:
    a, z = ca.SX.sym("a"), ca.SX.sym("z")
    found = lifted(ca.vertcat(ca.cos(a), 2.0), ca.exp(a), z)
    assert not ca.depends_on(found, z)
    assert float(ca.Function("f", [a], [found])(0.0)[0]) == 1.0


def test_replaced_problem_keeps_its_algebraic_variables() -> None:
    problem = replace(diode(), horizon=2.0)
    assert problem.model.elimination.names == ("voltage",)
