"""Lanes that stand in for the compiled ones, and problems for several modules."""

from collections.abc import Callable
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp import Bounds, Model, OptimalControlProblem
from swarmstart.ocp.instances.in_lanes import LaneStart
from swarmstart.ocp.lanes.answers import LaneAnswers
from swarmstart.ocp.lanes.interior import Instances

X, U, MASS, WIND = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("m"), ca.SX.sym("w")
N, DT = 5, 0.2
A, B = np.array([[1.0, DT], [0.0, 1.0]]), np.array([[DT**2 / 2], [DT]])


def double_integrator(**given: object) -> OptimalControlProblem:
    """Return dt sum u^2 + 10 |x_N|^2 for x'' = u, from a few steps of exact motion."""
    settings: dict[str, object] = {
        "horizon": N * DT,
        "intervals": N,
        "stage_cost": U**2,
        "terminal_cost": 10 * ca.sumsqr(X),
        "bounds": Bounds(controls=(-1e3, 1e3)),
    }
    model = Model(
        states=X, controls=U, ode=ca.vertcat(X[1], U), state_names=("place", "speed")
    )
    return OptimalControlProblem(model, **settings | given)  # type: ignore[arg-type]


def riccati() -> tuple[list[Array], Array]:
    """Return the gains of all steps, u = -K x, and P of the optimal cost x0'P x0."""
    P, gains = 10 * np.eye(2), list[Array]()
    for _ in range(N):
        K = np.linalg.solve(DT + B.T @ P @ B, B.T @ P @ A)
        P = A.T @ P @ (A - B @ K)
        gains.insert(0, K)
    return gains, P


def parametric() -> OptimalControlProblem:
    """Return a problem with a parameter, a signal and a bounded state."""
    return OptimalControlProblem(
        Model(
            states=X,
            controls=U,
            ode=ca.vertcat(X[1], U / MASS + WIND),
            parameters=MASS,
            signals=WIND,
        ),
        horizon=1.0,
        intervals=N,
        stage_cost=U**2 + ca.sumsqr(X),
        bounds=Bounds(controls=(-9, 9), states=([-2, -np.inf], [2, np.inf])),
    )


def by_gains(x0: Array, guess: Array) -> Array:
    """Return the optimal controls of `double_integrator` from a state."""
    del guess
    controls = np.empty((1, N))
    for k, K in enumerate(riccati()[0]):
        controls[:, k] = -K @ x0
        x0 = A @ x0 + B @ controls[:, k]
    return controls


Answer = Callable[[Array, Array], Array | None]
"""(initial state, guess of the controls) -> controls; None: the lane breaks down."""


@dataclass
class FakeLanes:
    """Lanes without machine code.

    Attributes:
        answer: What each lane answers.
        calls: Numbers of lanes of each call so far.
    """

    answer: Answer
    calls: list[int] = field(default_factory=list)

    def __call__(
        self, instances: Instances, start: LaneStart, starts: Array
    ) -> LaneAnswers:
        """Return the answers, lane by lane."""
        controls = start.controls
        n = controls.shape[2]
        self.calls.append(n)
        found = controls.copy()
        cost = np.full(n, np.inf)
        for k in range(n):
            answer = self.answer(instances.x0[:, k], controls[:, :, k])
            if answer is not None:
                found[:, :, k], cost[k] = answer, 0.0
        return LaneAnswers(
            controls=found,
            starts=starts,
            states=np.zeros((len(instances.x0), controls.shape[1] + 1, n)),
            cost=cost,
            violation=np.zeros(n),
            iterations=np.full(n, 7),
        )
