"""Polish by collocation: against Opti with the same points, and against shooting."""

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Fitness,
    Free,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Planner,
    Plant,
    PolishStatus,
    Radau,
    RecedingHorizon,
    Solution,
    SolutionStatus,
    ensemble,
    phases,
    simulate,
    solve,
)
from swarmstart.ocp.nlp.optimality import Curvature, curvature
from swarmstart.ocp.nlp.polish import Polisher
from swarmstart.ocp.rollout.fitness import NOTHING
from swarmstart.tests.ocp import catalyst

MU, N, ELEMENTS, T = 100.0, 20, 2, 4.0
X0 = [2.0, 0.0]


def van_der_pol(x: Any, u: Any) -> Any:
    """A stiff oscillator."""
    return ca.vertcat(x[1], MU * (1 - x[0] ** 2) * x[1] - x[0] + u)


def spent(x: Any, u: Any) -> Any:
    """Its stage cost."""
    return (x[0] - 1.5) ** 2 + 1e-3 * x[1] ** 2 + 1e-3 * u**2


def stiff_problem(*, target: float | None, **options: Any) -> OptimalControlProblem:
    """The oscillator, with or without a terminal state."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=van_der_pol(x, u)),
        horizon=T,
        intervals=N,
        stage_cost=spent(x, u),
        bounds=Bounds(controls=(-50, 50)),
        terminal=[] if target is None else [(x[0], target)],
        integrator="stiff",
        **options,
    )


def by_opti(target: float | None) -> tuple[float, Array]:
    """Return cost and controls of CasADi's Opti, with CasADi's collocation."""
    opti = ca.Opti()
    C, _, B = ca.collocation_coeff(ca.collocation_points(3, "radau"))
    controls, h, cost = opti.variable(1, N), T / N / ELEMENTS, 0
    state = ca.MX(X0)
    for k in range(N):
        for _ in range(ELEMENTS):
            inside = opti.variable(2, 3)
            opti.set_initial(inside, np.tile(X0, (3, 1)).T)
            slopes = ca.horzcat(state, inside) @ C
            for j in range(3):
                rate = van_der_pol(inside[:, j], controls[k])
                opti.subject_to(slopes[:, j] == h * rate)
                cost += h * B[j] * spent(inside[:, j], controls[k])
            state = inside[:, 2]
    opti.subject_to(opti.bounded(-50, controls, 50))
    if target is not None:
        opti.subject_to(state[0] == target)
    opti.minimize(cost)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    found = opti.solve()
    return float(found.value(cost)), np.array(found.value(controls)).ravel()


def cost_of_nlp(answer: Solution) -> float:
    """Return the cost as the NLP evaluates it."""
    point = answer.plan.point
    assert point is not None
    found = point.program.derivatives["grad_f"](point.w, point.q)[0]
    return float(found) * point.cost_size


def test_stiff_oscillator_has_the_answer_of_opti_with_the_same_points() -> None:
    cost, controls = by_opti(None)
    problem = stiff_problem(target=None, transcription=Radau(elements=ELEMENTS))
    answer = solve(problem, X0, search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert cost_of_nlp(answer) == pytest.approx(cost, rel=1e-9)
    np.testing.assert_allclose(answer.controls[0], controls, atol=1e-5)


def test_an_end_is_reached_where_the_model_leads_not_the_collocation() -> None:
    # With two elements an interval the end is missed by 6e-4, as with Opti.
    problem = stiff_problem(
        target=1.0, transcription=Radau(elements=ELEMENTS), substeps=16
    )
    answer = solve(problem, X0, search=None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.violation <= problem.tolerance
    fine = X0
    for u in answer.controls[0]:
        fine = solve_ivp(
            lambda _, y, u=u: np.array(van_der_pol(y, u)).ravel(), (0, T / N), fine,
            method="Radau", rtol=1e-10, atol=1e-10,
        ).y[:, -1]  # fmt: skip
    assert fine[0] == pytest.approx(1.0, abs=1e-5)
    assert abs(answer.cost - by_opti(1.0)[0]) > 1e-4  # Opti's belongs to no path.
    shot = solve(replace(problem, transcription="shooting"), X0, search=None, seed=0)
    assert answer.cost == pytest.approx(shot.cost, rel=1e-5)


@pytest.mark.parametrize("elements", [2, 4])
def test_catalyst_has_its_published_yield_on_coarse_elements(elements: int) -> None:
    problem = replace(
        catalyst.problem(integrator="stiff", substeps=4),
        transcription=Radau(elements=elements),
    )
    polish = Polisher(Fitness(problem))
    found = polish(catalyst.BEST_CONTROLS + 0.0, catalyst.X0, near=True)
    assert found.status is PolishStatus.CONVERGED
    assert -found.cost == pytest.approx(catalyst.BEST, rel=1e-6)
    exact = 1000 * catalyst.exact_end(found.controls)[6]
    assert exact == pytest.approx(catalyst.BEST, rel=1e-6)


def test_rate_of_robertsons_reaction_is_found_again() -> None:
    # Three rates from 0.04 to 3e7; the first layer lasts 1e-3 of 40 s.
    def rates(y: Any, k: Any) -> list[Any]:
        first, second, third = k * y[0], 3e7 * y[1] ** 2, 1e4 * y[1] * y[2]
        return [third - first, first - second - third, second]

    fine = solve_ivp(
        lambda _, y: rates(y, 0.04), (0, 40), [1, 0, 0],
        method="Radau", rtol=1e-11, atol=1e-13,
    ).y[:, -1]  # fmt: skip
    y, k = ca.SX.sym("y", 3), ca.SX.sym("k")
    model = Model(
        states=y, controls=ca.SX(0, 1), ode=rates(y, k),  # type: ignore[arg-type]
        parameters=k,
    )  # fmt: skip
    problem = OptimalControlProblem(
        model,
        horizon=40.0,
        intervals=10,
        terminal_cost=(y[0] - float(fine[0])) ** 2,
        decided={"k": Free(0.01, 0.1, guess=0.02)},
        integrator="stiff",
        substeps=32,
        transcription=Radau(elements=4),
    )
    answer = solve(problem, [1.0, 0.0, 0.0], search=None, seed=0)
    assert answer.plan.polish_status is PolishStatus.CONVERGED
    assert answer.decided["k"] == pytest.approx(0.04, rel=1e-4)


X, V, U, P, W, TIME = (ca.SX.sym(name) for name in ("x", "v", "u", "p", "w", "time"))
CART = Model(states=ca.vertcat(X, V), controls=U, ode=ca.vertcat(V, U - 0.3 * V**3))


def cart(model: Model = CART, **options: Any) -> OptimalControlProblem:
    """A cart with friction that is brought to rest."""
    told: dict[str, Any] = {
        "horizon": 2.0,
        "intervals": 8,
        "stage_cost": U**2 + X**2,
        "bounds": Bounds(controls=(-4, 4)),
        "terminal": [X, V],
    }
    return OptimalControlProblem(model, **(told | options))


BLOWN = Model(
    states=CART.states, controls=U, ode=ca.vertcat(V, U + W * ca.sin(TIME)),
    signals=W, time=TIME,
)  # fmt: skip
HEAVY = Model(states=CART.states, controls=U, ode=ca.vertcat(V, P * U), parameters=P)
KICKED = Model(
    states=CART.states, controls=U, ode=CART.ode, next_state=ca.vertcat(X, 0.9 * V)
)
BEFORE = ca.SX.sym("before")
LIMIT = PathConstraint(expression=V, lower=-0.6, weight=1.0, quadratic_weight=2.0)
WIND = Known(signals=np.linspace(0.5, -1.0, 9)[None, :])
PROBLEMS: dict[str, tuple[OptimalControlProblem, Known]] = {
    "plain": (cart(), Known()),
    "free end time": (
        cart(horizon=Free(0.5, 4.0), stage_cost=1 + U**2), Known(),
    ),
    "decided parameter": (
        cart(HEAVY, decided={"p": Free(0.5, 2.0)}, terminal_cost=P**2), Known(),
    ),
    "free start": (cart(start={"v": Free(-1, 1)}, initial_cost=V**2), Known()),
    "periodic": (cart(periodic=["x"], terminal=[V], stage_cost=U**2 + V), Known()),
    "time and signals": (cart(BLOWN), WIND),
    "jumps": (cart(KICKED), Known()),
    "previous control": (
        cart(previous=BEFORE, step_cost=(U - BEFORE) ** 2), Known(previous=[0.0]),
    ),
    "path constraint": (cart(constraints=[V >= -0.6], checks=3), Known()),
    "state bounds": (
        cart(bounds=Bounds(controls=(-4, 4), states=([-1, -0.6], [2, 1]))), Known(),
    ),
    "soft constraint": (cart(constraints=[LIMIT], checks=2), Known()),
    "blocks": (cart(blocks=[1, 1, 2, 4]), Known()),
    "linear controls": (cart(control_shape="linear"), Known()),
    "continuous controls": (cart(control_shape="continuous"), Known()),
    "summed on the left": (cart(quadrature="left"), Known()),
    "summed on the right": (cart(quadrature="right"), Known()),
    "maximised": (cart(stage_cost=-(U**2), maximize=True), Known()),
    "ensemble": (
        ensemble(
            cart(HEAVY, terminal=[], terminal_cost=X**2 + V**2),
            {"p": [0.8, 1.2]}, risk="worst",
        ),
        Known(),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", PROBLEMS)
def test_it_finds_what_shooting_finds(name: str) -> None:
    shot_at, known = PROBLEMS[name]
    answers = [
        solve(one, [1.0, 0.0], known=known, search=None, seed=0)
        for one in (shot_at, replace(shot_at, transcription="radau"))
    ]
    shot, collocated = answers
    assert collocated.status is shot.status is SolutionStatus.CONVERGED
    assert collocated.cost == pytest.approx(shot.cost, rel=1e-5, abs=1e-7)
    for found, expected in zip(
        collocated.decided.values(), shot.decided.values(), strict=True
    ):
        assert found == pytest.approx(expected, rel=1e-3, abs=1e-4)
    assert collocated.multipliers is not None and shot.multipliers is not None
    if name == "path constraint":  # Active at more checks than there are controls:
        return  # the multipliers are not the only ones.
    size = np.abs(shot.multipliers.costates).max()
    np.testing.assert_allclose(
        collocated.multipliers.costates, shot.multipliers.costates, atol=2e-3 * size
    )


def test_phases_are_collocated() -> None:
    light = Model(states=CART.states, controls=U, ode=ca.vertcat(V, 2 * U))
    told: dict[str, Any] = {
        "horizon": Free(0.2, 3), "intervals": 4, "stage_cost": 1 + U**2,
    }  # fmt: skip
    costs = []
    for transcription in ("shooting", "radau"):
        first = cart(terminal=[(X, 0.5)], transcription=transcription, **told)
        last = cart(
            light, terminal=[(X, 2.0), (V, 0.0)], transcription=transcription, **told
        )
        both = phases([first, last])
        assert both.problem.transcription == transcription
        start = both.start([0.0, 0.0])
        answer = solve(both.problem, start, search=None, seed=0)
        assert answer.status is SolutionStatus.CONVERGED
        costs.append(answer.cost)
    assert costs[1] == pytest.approx(costs[0], rel=1e-5)


@pytest.mark.parametrize("length", [3.0, 3.3])
def test_a_saddle_is_told_from_a_minimum(length: float) -> None:
    # x'' = u and a cost of u^2 - x^2: at rest is the minimum up to a horizon of pi
    # between two rests at 0, a saddle beyond (Jacobi's conjugate point).
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=length,
        intervals=60,
        stage_cost=u**2 - x**2,
        terminal=[x],
        transcription=Radau(points=2, elements=1),
    )
    found = Polisher(Fitness(problem))(np.zeros((1, 60)), [0.0])
    assert found.point is not None and found.status is PolishStatus.CONVERGED
    expected = Curvature.POSITIVE if length < np.pi else Curvature.NEGATIVE
    assert curvature(found.point) is expected


def test_a_search_and_a_flight_use_it() -> None:
    problem = replace(cart(terminal=[], terminal_cost=10 * (X**2 + V**2)),
                      transcription="radau")  # fmt: skip
    answer = solve(problem, [1.0, 0.0], budget=2000, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    ends = [
        simulate(
            Plant(CART, dt=0.25, substeps=10),
            RecedingHorizon(planner=Planner(one, search=None, polish=IpoptOptions())),
            [1.0, 0.0],
            steps=4,
            seed=0,
        ).states[:, -1]
        for one in (problem, replace(problem, transcription="shooting"))
    ]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-5)
    assert ends[0][0] < 0.8


def test_states_that_are_not_finite_are_no_obstacle_to_begin_with() -> None:
    # Controls of 3 let x explode before the end.
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=x**3 + u),
        horizon=2.0,
        intervals=10,
        stage_cost=x**2 + u**2,
        bounds=Bounds(controls=(-3, 3)),
        transcription="radau",
    )
    found = Polisher(Fitness(problem))(np.full((1, 10), 3.0), [0.5])
    assert found.status is PolishStatus.CONVERGED
    assert not np.isfinite(Fitness(problem).value(np.full((1, 10), 3.0), [0.5])[0])
    assert np.isfinite(found.cost) and found.violation == 0.0


def test_its_summary_says_so() -> None:
    assert "polished by collocation" in repr(cart(transcription="radau"))
    assert "collocation" not in repr(cart())


def test_pieces_of_a_system_at_rest_are_followed_by_controlled_steps() -> None:
    """Its steps are controlled by the sizes; by zeros, 0 / 0 gave no number."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 0.5 * x[1])),
        horizon=2.0, intervals=6, stage_cost=u**2 + ca.sumsqr(x),
        bounds=Bounds(controls=(-3, 3)), integrator="stiff",
        integrator_tolerance=1e-6, transcription="radau",
    )  # fmt: skip
    fitness = Fitness(problem)
    program = Polisher(fitness, IpoptOptions()).program
    assert program is not None and program.inner_guess is not None
    for push in (0.0, 1.0):
        pieces = program.inner_guess.followed(
            np.full((1, 6), push), np.zeros((2, 6)),
            (np.empty(0), np.empty((0, problem.nodes))),
            fitness.arguments.sizes(np.zeros(2), NOTHING),
        )  # fmt: skip
        # x'' = 1 - x' / 2 from rest, over a third of a second.
        speed = push * 2 * (1 - np.exp(-0.5 / 3))
        np.testing.assert_allclose(pieces[1, -1], speed, rtol=1e-5, atol=1e-12)
