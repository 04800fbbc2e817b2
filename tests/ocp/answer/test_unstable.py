"""Models whose deviations grow so much that no roll-out confirms an answer."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.ocp.answer.solution import verified
from swarmstart.ocp.rollout.status import growth_along


class Posed(NamedTuple):
    """A problem, its start and known data, and the logarithm of its growth."""

    problem: ss.OptimalControlProblem
    x0: list[float]
    known: ss.Known
    growth: float


def scalar() -> Posed:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=40 * x + u), horizon=1.0, intervals=50,
        stage_cost=x**2 + 0.01 * u**2, bounds=ss.Bounds(controls=(-100, 100)),
        terminal=[x],
    )  # fmt: skip
    return Posed(problem, [1.0], ss.Known(), 40.0)


def pendulum() -> Posed:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    ode = ca.vertcat(x[1], 9.81 * ca.sin(x[0]) + u)
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ode), horizon=10.0, intervals=100,
        stage_cost=ca.sumsqr(x) + 0.1 * u**2, bounds=ss.Bounds(controls=(-5, 5)),
        terminal=[x],
    )  # fmt: skip
    return Posed(problem, [0.3, 0.0], ss.Known(), 10 * np.sqrt(9.81))


def aircraft() -> Posed:
    """Angle of attack, pitch rate and pitch, with a fast unstable short period."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    A = np.array([[-2.0, 1.0, 0.0], [160.0, -2.0, 0.0], [0.0, 1.0, 0.0]])
    ode = ca.mtimes(ca.DM(A), x) + ca.DM([-0.1, -40.0, 0.0]) * u
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ode), horizon=3.0, intervals=60,
        stage_cost=100 * (x[2] - 0.1) ** 2 + x[1] ** 2 + u**2,
        bounds=ss.Bounds(controls=(-0.5, 0.5)), terminal=[(x, [0.0, 0.0, 0.1])],
    )  # fmt: skip
    fastest = np.linalg.eigvals(A).real.max()
    return Posed(problem, [0.0, 0.0, 0.0], ss.Known(), 3 * fastest)


def saddle() -> Posed:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    ode = ca.vertcat(
        5 * x[0] + u[0] + 0.1 * x[1] ** 2, -5 * x[1] + u[1] - 0.2 * x[0] * x[1]
    )
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ode), horizon=8.0, intervals=80,
        stage_cost=ca.sumsqr(x) + ca.sumsqr(u), bounds=ss.Bounds(controls=(-8, 8)),
        terminal=[(x, [0.5, -0.5])],
    )  # fmt: skip
    return Posed(problem, [1.0, 1.0], ss.Known(), 40.0)


def estimation() -> Posed:
    """A disturbance and a start are estimated from a record; growth e^60."""
    x, seen, w = (ca.SX.sym(name) for name in ("x", "seen", "w"))
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=w, ode=12 * x + w), horizon=5.0, intervals=100,
        stage_cost=100 * (x - seen) ** 2 + 1e-4 * w**2, signals=seen,
        start={"x": ss.Free(-2, 2)}, bounds=ss.Bounds(controls=(-50, 50)),
    )  # fmt: skip
    record = np.sin(np.linspace(0, 5, 101))[None]
    return Posed(problem, [np.nan], ss.Known(signals=record), 60.0)


POSED = {one.__name__: one for one in (scalar, pendulum, aircraft, saddle, estimation)}


def largest_miss(problem: ss.OptimalControlProblem, found: ss.Solution) -> Array:
    """Return by how much SciPy's integration of each interval misses the next state."""
    ends = found.plan.ends
    assert ends is not None
    f, dt = (
        ca.Function(
            "f", [problem.model.states, problem.model.controls], [problem.model.ode]
        ),
        problem.dt,
    )
    missed = []
    for k, u in enumerate(found.controls.T):
        flown = solve_ivp(
            lambda _, y, u=u: np.array(f(y, u)).ravel(), (0.0, dt), ends[:, k],
            method="DOP853", rtol=1e-11, atol=1e-13,
        )  # fmt: skip
        missed.append(np.abs(flown.y[:, -1] - ends[:, k + 1]))
    return np.asarray(np.max(missed, axis=0))


@pytest.mark.parametrize("pose", POSED.values(), ids=POSED.keys())
def test_unstable_model_is_solved_and_confirmed_interval_by_interval(
    pose: Callable[[], Posed],
) -> None:
    problem, x0, known, growth = pose()
    found = ss.solve(problem, x0, known=known, seed=0)
    assert found.status is ss.SolutionStatus.CONVERGED
    assert "interval by interval, since a deviation grows" in found.reason
    assert "feedback" in found.advice
    if pose is scalar:  # Known from the first start on: no search, no lanes.
        assert not found.plan.is_searched
        assert found.plan.starts is not None
        assert "unstable" in found.plan.starts.without_lanes
    assert found.plan.violation < 1e-6
    reach = np.ptp(found.path.states, axis=1)
    assert (largest_miss(problem, found) < 1e-4 * reach + 1e-7).all()
    sizes = ss.Fitness(problem, backend="casadi").arguments.sizes(found.plan.x0, known)
    ends = found.plan.ends
    assert ends is not None
    told = growth_along(
        ss.Fitness(problem, backend="casadi").shooting, ends[:, :-1], found.controls,
        known, sizes.states,
    )  # fmt: skip
    assert told.is_large
    assert told.log == pytest.approx(growth, rel=0.15)


def test_scalar_answer_is_that_of_its_linear_equations() -> None:
    """With held controls the problem is a quadratic program; no bound is met."""
    problem, x0, known, _ = scalar()
    found = ss.solve(problem, x0, known=known, seed=0)
    N, dt = 50, 0.02
    a = np.exp(40 * dt)
    b = (a - 1) / 40
    # On an interval x(t) = e^40t (x + u / 40) - u / 40.
    grown = {n: (np.exp(n * 40 * dt) - 1) / (n * 40) for n in (1, 2)}
    own, mixed, of_u = grown[2], (grown[2] - grown[1]) / 40, None
    of_u = (grown[2] - 2 * grown[1] + dt) / 40**2 + 0.01 * dt
    # Unknowns u_0, x_1, u_1, ... x_N; the cost is half z'Hz + g'z.
    H, g = np.zeros((2 * N, 2 * N)), np.zeros(2 * N)
    A, right = np.zeros((N + 1, 2 * N)), np.zeros(N + 1)
    for k in range(N):
        u, x = 2 * k, 2 * k - 1
        H[u, u] += 2 * of_u
        if k:
            H[x, x] += 2 * own
            H[x, u] += 2 * mixed
            H[u, x] += 2 * mixed
            A[k, x] = a
        else:
            g[u] += 2 * mixed * x0[0]
            right[0] = -a * x0[0]
        A[k, u], A[k, 2 * k + 1] = b, -1.0
    A[N, 2 * N - 1] = 1.0
    K = np.block([[H, A.T], [A, np.zeros((N + 1, N + 1))]])
    z = np.linalg.solve(K, np.concatenate([-g, right]))[: 2 * N]
    least = z @ H @ z / 2 + g @ z + own * x0[0] ** 2
    assert found.cost == pytest.approx(least, rel=1e-4)
    np.testing.assert_allclose(found.controls[0], z[::2], atol=2e-2)


def test_intervals_that_a_coarse_method_gets_wrong_are_not_confirmed() -> None:
    """Euler's steps of 0.02 s at a rate of 40 per second."""
    problem, x0, known, _ = scalar()
    coarse = ss.OptimalControlProblem(
        problem.model, horizon=1.0, intervals=50, stage_cost=problem.stage_cost,
        bounds=problem.bounds, terminal=problem.terminal, integrator="euler",
        substeps=1,
    )  # fmt: skip
    found = ss.solve(coarse, x0, known=known, seed=0)
    assert found.status is ss.SolutionStatus.MISMATCH


def test_what_intervals_miss_adds_up() -> None:
    """Each of 50 intervals by 1e-4 of the range: five thousandths are too much."""
    problem, x0, known, _ = scalar()
    found = ss.solve(problem, x0, known=known, seed=0)
    plan, ends = found.plan, found.plan.ends
    assert ends is not None
    reach = float(np.ptp(found.path.states[0]))
    for part, agrees in ((1e-6, True), (1e-4, False)):
        moved = ends.copy()
        # Every second state: each of two intervals misses by as much.
        moved[0, 1:-1:2] += part * reach * np.exp(-40 * 0.02)
        other = replace(plan, ends=moved)
        again = verified(problem, other, x0)
        assert again.status.is_confirmed is agrees
        assert again.reason.startswith("state x ends") is not agrees


def test_neighbours_at_a_kink_are_judged_by_intervals_too() -> None:
    """A roll-out of controls moved by 1e-8 would end at 1e9."""
    problem, x0, known, _ = scalar()
    kinked = replace(
        problem, stage_cost=problem.stage_cost + ca.fabs(problem.model.states - 0.3)
    )
    found = ss.solve(kinked, x0, known=known, seed=0)
    assert found.path.kinks
    assert found.status is ss.SolutionStatus.FEASIBLE


def test_stable_model_is_judged_by_its_roll_out() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=-40 * x + u), horizon=1.0, intervals=50,
        stage_cost=x**2 + u**2, bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip
    found = ss.solve(problem, [1.0], seed=0)
    assert found.status is ss.SolutionStatus.CONVERGED
    assert found.plan.ends is None
    assert "interval by interval" not in found.reason


def test_search_alone_is_told_of_the_growth() -> None:
    """Nothing can be confirmed, and the advice is not a longer horizon."""
    problem, x0, known, _ = scalar()
    found = ss.solve(problem, x0, known=known, polish=None, budget=200, seed=0)
    assert not found.status.is_confirmed
    assert found.advice.startswith("the model is unstable: a deviation grows")
    assert "polish='ipopt'" in found.advice
