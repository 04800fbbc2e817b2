"""Models that jump at the end of an interval: discrete time, previous controls."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    Known,
    Model,
    OptimalControlProblem,
    SolutionStatus,
    solve,
    stack_models,
    verified,
)
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.rollout.fitness import Fitness, replay
from swarmstart.ocp.rollout.shooting import Shooting
from swarmstart.ocp.statement.rewrites.chain import lowered

A = np.array([[0.9, 0.3], [-0.2, 1.05]])
B = np.array([[0.0], [0.5]])
Q, R, P = np.diag([1.0, 2.0]), np.array([[0.3]]), np.diag([4.0, 3.0])
N = 8


def linear(**more: object) -> OptimalControlProblem:
    """A discrete-time linear-quadratic problem."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    stated: dict[str, object] = {
        "horizon": N,
        "intervals": N,
        "step_cost": x.T @ Q @ x + u.T @ R @ u,
        "terminal_cost": x.T @ P @ x,
        "bounds": Bounds(controls=(-3, 3)),
    }
    model = Model(states=x, controls=u, next_state=A @ x + B @ u)
    return OptimalControlProblem(model, **(stated | more))  # type: ignore[arg-type]


def riccati(x0: np.ndarray) -> tuple[float, np.ndarray]:
    """Return the optimal cost and controls without bounds."""
    S = P
    gains: list[np.ndarray] = []
    for _ in range(N):
        K = np.linalg.solve(R + B.T @ S @ B, B.T @ S @ A)
        S = Q + A.T @ S @ (A - B @ K)
        gains.insert(0, K)
    x, controls = x0, []
    for K in gains:
        u = -K @ x
        controls.append(u)
        x = A @ x + B @ u
    return float(x0 @ S @ x0), np.array(controls).T


@pytest.mark.parametrize("search", [None, "default"])
def test_discrete_time_optimum_is_that_of_the_riccati_recursion(
    search: str | None,
) -> None:
    x0 = np.array([1.0, -0.5])
    cost, controls = riccati(x0)
    answer = solve(linear(), x0, search=search, budget=2000 if search else None, seed=0)
    assert answer.status is SolutionStatus.CONVERGED
    assert answer.cost == pytest.approx(cost, rel=1e-9)
    assert answer.verified_cost == pytest.approx(cost, rel=1e-9)
    np.testing.assert_allclose(answer.controls, controls, atol=1e-6)


@pytest.mark.parametrize("backend", ["llvm", "casadi"])
def test_population_replay_and_path_see_the_same_states(backend: str) -> None:
    problem = linear(constraints=[], terminal=[])
    x0, rng = np.array([1.0, -0.5]), np.random.default_rng(0)
    controls = rng.uniform(-3, 3, (1, N))
    x, cost = x0, 0.0
    course = [x]
    for u in controls.T:
        cost += float(x @ Q @ x + u @ R @ u)
        x = A @ x + B @ u
        course.append(x)
    cost += float(x @ P @ x)
    fitness = Fitness(problem, backend=backend)
    assert fitness.value(controls, x0) == pytest.approx((cost, 0.0))
    np.testing.assert_allclose(fitness.states(controls, x0), np.array(course).T)
    states, replayed, _ = replay(problem, controls, x0)
    np.testing.assert_allclose(states, np.array(course).T)
    assert replayed == pytest.approx(cost)


def test_state_constraints_hold_after_every_jump_the_last_included() -> None:
    x = ca.SX.sym("x")
    u = ca.SX.sym("u")
    model = Model(states=x, controls=u, next_state=x + u)
    for where in ({"constraints": [x <= 1]}, {"bounds": Bounds(states=(-9, 1))}):
        problem = OptimalControlProblem(
            model,
            horizon=3,
            intervals=3,
            terminal_cost=(x - 2) ** 2,
            **where,
        )
        fitness = Fitness(problem)
        _, broken = fitness.value(np.array([[0.0, 0.0, 1.5]]), [0.0])
        assert broken > 0
        _, before = fitness.value(np.array([[1.5, -1.0, 0.0]]), [0.0])
        assert before > 0
        assert fitness.value(np.array([[0.5, 0.5, 0.0]]), [0.0])[1] == 0
        answer = solve(problem, [0.0], search=None, seed=0)
        assert answer.states[0, -1] == pytest.approx(1.0, abs=1e-6)
        assert answer.status.is_confirmed
        planner = Planner(problem, search=None)
        plan = planner.plan(
            [0.0], guess=np.array([[0, 0, 1.5]]), rng=np.random.default_rng(0)
        )
        (excess,) = verified(planner.tracer, plan, [0.0]).path.broken
        assert excess.amount == pytest.approx(0.5)
        assert excess.time == pytest.approx(3.0)


def test_bounds_of_states_hold_before_the_end_of_an_interval_changes_them() -> None:
    """Half of the speed, which is then at its bound, is lost as an interval ends.

    With v = u_0 / 2 + u_1 = 1 / 2 before the last jump, u is (0.2, 0.4).
    """
    v, u = ca.SX.sym("v"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=v, controls=u, ode=u, next_state=v / 2),
        horizon=2.0,
        intervals=2,
        stage_cost=u**2,
        terminal_cost=(v - 2) ** 2,
        bounds=Bounds(states=(-9, 0.5)),
    )
    answer = solve(problem, [0.0], search=None, seed=0)
    np.testing.assert_allclose(answer.controls, [[0.2, 0.4]], atol=1e-6)
    assert answer.cost == pytest.approx(0.2 + 1.75**2, abs=1e-6)
    assert answer.status is SolutionStatus.CONVERGED


def test_equality_of_a_control_and_the_one_before_keeps_it_as_it_was() -> None:
    x, u, before = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("before")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=4,
        checks=2,
        terminal_cost=(x - 1) ** 2,
        constraints=[u - before == 0],
        previous=before,
    )
    answer = solve(problem, [0.0], search=None, known=Known(previous=[0.3]), seed=0)
    np.testing.assert_allclose(answer.controls, 0.3, atol=1e-8)
    assert answer.status is SolutionStatus.CONVERGED


def test_constraint_on_state_and_control_does_not_hold_after_the_last_jump() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, next_state=x + u),
        horizon=2,
        intervals=2,
        terminal_cost=(x - 2) ** 2,
        constraints=[x + u <= 1.5],
    )
    # x = 0, 1, 1.5: after the last jump x + u = 2 has no meaning.
    assert Fitness(problem).value(np.array([[1.0, 0.5]]), [0.0])[1] == 0
    answer = solve(problem, [0.0], search=None, seed=0)
    assert answer.states[0, -1] == pytest.approx(1.5, abs=1e-6)
    assert answer.status.is_confirmed


def rated(**more: object) -> tuple[OptimalControlProblem, ca.SX, ca.SX]:
    """x' = u towards 1, moves of u penalised."""
    x, u, before = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("before")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=2.0,
        intervals=N,
        stage_cost=(x - 1) ** 2,
        step_cost=0.05 * (u - before) ** 2,
        bounds=Bounds(controls=(-2, 2)),
        previous=before,
        **more,  # type: ignore[arg-type]
    )
    return problem, u, before


@pytest.mark.parametrize("first", [None, 0.7])
def test_penalised_moves_are_those_of_a_quadratic_programme(
    first: float | None,
) -> None:
    problem, _, _ = rated()
    u = ca.MX.sym("u", N)
    x, cost, before = (ca.MX(value) for value in (0, 0, first or 0))
    dt = 2.0 / N
    for k in range(N):
        # The integral of (x + u t - 1)^2 over dt.
        e = x - 1
        cost += dt * e**2 + dt**2 * e * u[k] + dt**3 / 3 * u[k] ** 2
        cost += 0.05 * (u[k] - before) ** 2
        x, before = x + dt * u[k], u[k]
    solver = ca.nlpsol("qp", "ipopt", {"x": u, "f": cost},
                       {"print_time": False, "ipopt.print_level": 0})  # fmt: skip
    expected = solver(x0=0, lbx=-2, ubx=2)
    known = Known(previous=None if first is None else [first])
    for search, budget in ((None, None), ("default", 3000)):
        answer = solve(
            problem, [0.0], search=search, budget=budget, known=known, seed=0
        )
        assert answer.status is SolutionStatus.CONVERGED
        assert answer.cost == pytest.approx(float(expected["f"]), rel=1e-7)
        assert answer.verified_cost == pytest.approx(answer.cost, rel=1e-9)
        np.testing.assert_allclose(
            answer.controls[0], expected["x"].full().ravel(), atol=1e-5
        )
        assert answer.states.shape == (1, N + 1)


def test_rate_limits_hold_from_the_first_control_on() -> None:
    problem, u, before = rated()
    limited, u, before = rated()
    x = limited.model.states
    problem = OptimalControlProblem(
        limited.model,
        horizon=2.0,
        intervals=N,
        stage_cost=(x - 1) ** 2,
        constraints=[u - before <= 0.3, u - before >= -0.3],
        bounds=Bounds(controls=(-2, 2)),
        previous=before,
    )
    answer = solve(problem, [0.0], budget=4000, seed=0, known=Known(previous=[-0.2]))
    moves = np.diff(answer.controls[0], prepend=-0.2)
    assert np.abs(moves).max() == pytest.approx(0.3, abs=1e-5)
    assert moves[0] == pytest.approx(0.3, abs=1e-5)
    assert answer.status.is_confirmed
    late = Fitness(problem)
    start = lowered(problem).start([0.0], [-0.2])
    jumping = np.zeros((1, N))
    jumping[0, 3:] = 0.5
    assert late.value(jumping, start)[1] > 0
    assert late.value(np.zeros((1, N)), start)[1] == 0


def test_hybrid_model_jumps_at_every_interval() -> None:
    """A ball that keeps half of its speed at the end of every interval."""
    h, v = ca.SX.sym("h"), ca.SX.sym("v")
    model = Model(
        states=ca.vertcat(h, v), controls=ca.SX(0, 1), ode=ca.vertcat(v, -2.0),
        next_state=ca.vertcat(h, v / 2),
    )  # fmt: skip
    problem = OptimalControlProblem(model, horizon=2.0, intervals=2, terminal_cost=h)
    states = Fitness(problem).states(np.empty((0, 2)), [0.0, 4.0])
    # v: 4 -> 2, halved 1 -> -1, halved -0.5; h: 0 + 3, 3 + 0.
    expected = np.array([[0, 3, 3], [4, 1, -0.5]])
    np.testing.assert_allclose(states, expected, atol=1e-12)
    answer = solve(problem, [0.0, 4.0], search=None, seed=0)
    np.testing.assert_allclose(answer.states, states, atol=1e-9)


def test_stacked_models_jump_side_by_side() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    jumping = Model(states=x, controls=u, next_state=x / 2 + u)
    flowing = Model(states=x, controls=u, ode=u)
    both = stack_models([jumping, flowing])
    problem = OptimalControlProblem(
        both, horizon=1.0, intervals=1, terminal_cost=both.states[0]
    )
    states = Fitness(problem).states(np.array([[3.0], [5.0]]), [4.0, 7.0])
    np.testing.assert_allclose(states[:, -1], [5.0, 12.0])


def test_signals_enter_the_dynamics_linear_between_nodes() -> None:
    x, u, wind = (ca.SX.sym(n) for n in ("x", "u", "wind"))
    model = Model(states=x, controls=u, ode=u + wind, signals=wind)
    problem = OptimalControlProblem(
        model, horizon=1.0, intervals=4, stage_cost=u**2, terminal_cost=x**2
    )
    rows = np.array([[0.0, 1.0, 0.5, -1.0, 2.0]])
    for backend in ("llvm", "casadi"):
        fitness = Fitness(problem, backend=backend)
        end = fitness.states(np.zeros((1, 4)), [0.0], Known((), rows))[0, -1]
        assert end == pytest.approx(np.trapezoid(rows[0], dx=0.25), abs=1e-12)
        # u = -c with c + c^.. : minimise u^2 + (e + u)^2, u = -e / 2.
        value, _ = fitness.value(np.full((1, 4), 0.1), [0.0], Known((), rows))
        assert value == pytest.approx(0.01 + (end + 0.1) ** 2, abs=1e-12)
    answer = solve(problem, [0.0], search=None, known=Known((), rows), seed=0)
    np.testing.assert_allclose(answer.controls, -end / 2, rtol=1e-6)
    assert answer.status is SolutionStatus.CONVERGED


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ode": ca.SX(0, 1)}, "must have an ode or a next_state"),
        ({"next_state": [1, 2]}, "next_state must have one row for each of the 1"),
        ({"next_state": ca.SX.sym("q")}, "next_state may depend on states, controls"),
        ({"time": ca.SX.sym("t", 2)}, "time must be one symbol, got 2"),
    ],
)
def test_models_that_change_in_no_way_are_refused(
    change: dict[str, object], message: str
) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    with pytest.raises(InvalidProblemError, match=message):
        Model(**({"states": x, "controls": u, "ode": u} | change))  # type: ignore[arg-type]


def test_no_jump_leaves_a_stage_as_it_is() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    plain = Model(states=x, controls=u, ode=u - x)
    problem = OptimalControlProblem(plain, horizon=1.0, intervals=2, stage_cost=u**2)
    assert lowered(problem).core is problem
    assert not Shooting(problem).has_begin
    assert not plain.jumps


def test_a_state_that_doubles_itself_reaches_no_farther_than_its_path() -> None:
    """Its own slope of 2 is no other state that it is written from."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = Model(states=x, controls=u, next_state=ca.vertcat(2 * x[0], 3 * x[0] + u))
    problem = OptimalControlProblem(
        model, horizon=3.0, intervals=3, stage_cost=u**2,
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    answer = solve(problem, [1.0, 0.0], search=None, lanes=0, seed=0)
    # x0 goes 1, 2, 4, 8; x1 is written from it, and goes 0, 3, 6, 12.
    np.testing.assert_allclose(answer.path.reach, [7, 21], atol=1e-6)
