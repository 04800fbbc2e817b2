"""Moving-horizon estimation as an ordinary problem: against Kalman's smoother."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Free,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
    Planner,
    SolutionStatus,
    solve,
)

A = np.array([[1.0, 0.2], [-0.4, 0.9]])
C = np.array([[1.0, 0.0]])
Q, R = np.diag([0.02, 0.05]), np.array([[0.1]])
P0, PRIOR = np.diag([0.5, 0.8]), np.array([0.3, -0.2])
N = 12


def window() -> OptimalControlProblem:
    """Process noise as controls, measurements as a signal, the prior as parameters."""
    x, w = ca.SX.sym("x", 2), ca.SX.sym("w", 2)
    y, prior = ca.SX.sym("y"), ca.SX.sym("prior", 2)
    model = Model(
        states=x, controls=w, next_state=ca.mtimes(A, x) + w, parameters=prior
    )

    def weighted(error: ca.SX, covariance: Array) -> ca.SX:
        return error.T @ np.linalg.inv(covariance) @ error

    misfit = weighted(y - C @ x, R)
    return OptimalControlProblem(
        model,
        horizon=N,
        intervals=N,
        step_cost=weighted(w, Q) + misfit,
        terminal_cost=misfit,
        initial_cost=weighted(x - prior, P0),
        signals=y,
        start={"x_0": Free(), "x_1": Free()},
    )


def measured(rng: np.random.Generator) -> tuple[Array, Array]:
    """Return true states, (2, N + 1), and their measurements, (N + 1,)."""
    x = PRIOR + rng.multivariate_normal(np.zeros(2), P0)
    course = [x]
    for _ in range(N):
        x = A @ x + rng.multivariate_normal(np.zeros(2), Q)
        course.append(x)
    states = np.array(course).T
    return states, (C @ states)[0] + rng.normal(0, np.sqrt(R[0, 0]), N + 1)


def smoothed(y: Array) -> Array:
    """Return the states by the Rauch-Tung-Striebel smoother, (2, N + 1)."""
    m, P = PRIOR, P0
    filtered, predicted = [], []
    for k in range(N + 1):
        if k:
            m, P = A @ m, A @ P @ A.T + Q
        predicted.append((m, P))
        K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R)
        m, P = m + K @ (y[k] - C @ m), P - K @ C @ P
        filtered.append((m, P))
    found = [m]
    for k in reversed(range(N)):
        (m, P), (ahead, P_ahead) = filtered[k], predicted[k + 1]
        gain = P @ A.T @ np.linalg.inv(P_ahead)
        found.insert(0, m + gain @ (found[0] - ahead))
    return np.array(found).T


@pytest.mark.parametrize("seed", range(3))
def test_estimate_is_that_of_the_smoother(seed: int) -> None:
    _, y = measured(np.random.default_rng(seed))
    answer = solve(
        window(), [np.nan, np.nan], search=None, known=Known(PRIOR, y[None, :]), seed=0
    )
    assert answer.status is SolutionStatus.CONVERGED
    np.testing.assert_allclose(answer.states, smoothed(y), atol=1e-6)


def test_window_moves_on_without_building_anything_again() -> None:
    """Without noise the estimate ends at the truth, window after window."""
    planner = Planner(window(), search=None, polish=IpoptOptions())
    truth = [np.array([1.0, 0.5])]
    for _ in range(N + 5):
        truth.append(A @ truth[-1])
    course = np.array(truth).T
    rng = np.random.default_rng(0)
    for first in range(5):
        y = (C @ course)[:, first : first + N + 1]
        x0, known, _ = planner.posed([np.nan] * 2, Known(course[:, first], y))
        plan = planner.plan(x0, known=known, rng=rng)
        np.testing.assert_allclose(
            plan.states, course[:, first : first + N + 1], atol=1e-6
        )
