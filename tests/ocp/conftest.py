"""Models and problems for several test modules."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Fitness,
    Known,
    Model,
    OptimalControlProblem,
    Separation,
    disc,
)
from swarmstart.ocp.compiled.engine import NoCompilerError, machine
from swarmstart.terminal_set import hold, linearise, sampled_lqr

Posed = tuple[OptimalControlProblem, Array, Known]
TURN_RATE = np.pi / 18  # 10 deg/s


@pytest.fixture(scope="session")
def double_integrator() -> Model:
    """x'' = u; one RK4 step with u held is exact, since A^2 = 0."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return Model(states=x, controls=u, ode=ca.vertcat(x[1], u))


@pytest.fixture(scope="session")
def pendulum() -> Model:
    """The pendulum of design.md, section 5: hanging at angle 0, torque u."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0])))


@pytest.fixture(scope="session")
def unicycle() -> Model:
    """States (v, psi, x, y), controls (acceleration, turn rate), eq. (5.1)."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    return Model(
        states=x,
        controls=u,
        ode=ca.vertcat(u, x[0] * ca.cos(x[1]), x[0] * ca.sin(x[1])),
    )


@pytest.fixture(scope="session")
def swing_up(pendulum: Model) -> Callable[..., OptimalControlProblem]:
    """The swing-up of design.md, section 5, on any grid."""

    def pose(intervals: int, substeps: int) -> OptimalControlProblem:
        return OptimalControlProblem(
            pendulum,
            horizon=3.0,
            intervals=intervals,
            stage_cost=pendulum.controls**2,
            bounds=Bounds(controls=(-8.0, 8.0)),
            terminal=[pendulum.states - ca.vertcat(np.pi, 0)],
            substeps=substeps,
        )

    return pose


@pytest.fixture(scope="session")
def passing_side(unicycle: Model) -> Posed:
    """The problem of the scenario passing_side: pass above or below."""
    x, u, slot = unicycle.states, unicycle.controls, ca.SX.sym("slot", 4)
    dynamics = ca.Function("f", [x, u], [unicycle.ode])
    A, B = linearise(dynamics, np.array([15.0, 0, 0, 0]), np.zeros(2))
    P = sampled_lqr(*hold(A, B, 1.0), np.eye(4), np.eye(2)).P
    problem = OptimalControlProblem(
        unicycle,
        horizon=8.0,
        intervals=8,
        stage_cost=ca.sumsqr(x - slot) + ca.sumsqr(u),
        terminal_cost=ca.bilin(ca.DM(P), x - slot, x - slot),
        bounds=Bounds(controls=([-5, -TURN_RATE], [5, TURN_RATE])),
        constraints=[disc(x[2:], centre=[0, 1], radius=12)],
        signals=slot,
        quadrature="left",
        checks=4,
        substeps=1,
    )
    t = problem.times
    slots = np.stack([0 * t + 15, 0 * t, 15 * t - 50, 0 * t + 8])
    return problem, np.array([15.0, 0, -60, 0]), Known(signals=slots)


@pytest.fixture(scope="session")
def crossing(unicycle: Model) -> Posed:
    """A UAV that meets an obstacle and another UAV; every kind of constraint."""
    x, u = unicycle.states, unicycle.controls
    signals = ca.SX.sym("signals", 6)
    error, relative = x - signals[:4], x[2:] - signals[4:]
    problem = OptimalControlProblem(
        unicycle,
        horizon=3.0,
        intervals=3,
        stage_cost=ca.sumsqr(error) + ca.sumsqr(u),
        terminal_cost=2 * ca.sumsqr(error),
        bounds=Bounds(
            controls=([-5, -1], [5, 1]),
            states=([0, -np.inf, -np.inf, -np.inf], [12, np.inf, np.inf, np.inf]),
        ),
        constraints=[
            disc(x[2:], centre=[15, 1], radius=4, margin=0.5, along="segments"),
            Separation(relative=relative, distance=3.0),
            Separation(
                relative=relative, distance=6.0, measure="indicator", along="segments"
            ),
        ],
        signals=signals,
        quadrature="left",
        checks=2,
        substeps=3,
    )
    t = problem.times
    rows = [0 * t + 10, 0 * t, 10 * t, 0 * t, 20 - 2 * t, 3 - 2 * t]
    return problem, np.array([10.0, 0.1, 0, 0]), Known(signals=np.stack(rows))


@pytest.fixture(scope="session")
def lq(double_integrator: Model) -> OptimalControlProblem:
    """Minimise sum of dt (x'x + u^2 / 2) + 3 x_N'x_N, without any constraint."""
    x, u = double_integrator.states, double_integrator.controls
    return OptimalControlProblem(
        double_integrator,
        horizon=2.0,
        intervals=10,
        stage_cost=ca.sumsqr(x) + u**2 / 2,
        terminal_cost=3 * ca.sumsqr(x),
        quadrature="left",
        substeps=1,
    )


@pytest.fixture(scope="session")
def riccati() -> tuple[Array, Array]:
    """First gain (1, 2) and cost-to-go matrix of `lq`, by the backward recursion."""
    dt, N = 0.2, 10
    A, B = np.array([[1, dt], [0, 1]]), np.array([[dt**2 / 2], [dt]])
    Q, R, P = dt * np.eye(2), dt / 2 * np.eye(1), 3 * np.eye(2)
    K = np.zeros((1, 2))
    for _ in range(N):
        K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
        P = Q + A.T @ P @ (A - B @ K)
    return K, P


@pytest.fixture(scope="session")
def crossing_fitness(crossing: Posed) -> Fitness:
    """The evaluator of `crossing`."""
    return Fitness(crossing[0])


@pytest.fixture(scope="session")
def compiler() -> None:
    """Skip tests that need machine code if it cannot be made."""
    try:
        machine()
    except NoCompilerError as error:
        pytest.skip(str(error))
