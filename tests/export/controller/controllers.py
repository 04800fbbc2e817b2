"""Controllers of small problems that a C file is made of."""

from collections.abc import Callable

import casadi as ca
import numpy as np

import swarmstart as ss

Case = tuple[ss.RecedingHorizon | ss.DualMode, list[float]]
"""A controller, and the initial state."""


def loop_of(problem: ss.OptimalControlProblem, **more: object) -> ss.RecedingHorizon:
    """Return a loop without a search, which makes its first plan by IPOPT."""
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    return ss.RecedingHorizon(planner=planner, **more)  # type: ignore[arg-type]


def pendulum(search: str | None = None) -> Case:
    """Return the swing-up of a pendulum with a weak motor."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    low = 1 + ca.cos(x[0])
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0]))),
        horizon=2.0, intervals=20, bounds=ss.Bounds(controls=(-5, 5)),
        stage_cost=10 * low + 0.1 * x[1] ** 2 + 0.05 * u**2,
        terminal_cost=100 * low + 10 * x[1] ** 2,
    )  # fmt: skip
    planner = ss.Planner(problem, search=search, polish=ss.IpoptOptions())
    return ss.RecedingHorizon(planner=planner), [0.0, 0.0]


def integrator() -> ss.OptimalControlProblem:
    """Return a double integrator with bounded force."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        horizon=2.0, intervals=10, substeps=1,
        stage_cost=ca.sumsqr(x) + 0.1 * u**2, terminal_cost=ca.sumsqr(x),
        bounds=ss.Bounds(controls=(-1, 1)),
    )  # fmt: skip


def dual_mode() -> Case:
    """Return a double integrator with a proven terminal set."""
    problem = integrator()
    near = ss.terminal_set_of(
        problem, at=[0, 0], weights=ss.Weights(Q=np.eye(2), R=np.eye(1)),
        rng=np.random.default_rng(0),
    )  # fmt: skip
    target: Callable[[float], np.ndarray] = lambda time: np.zeros(2)  # noqa: E731
    return ss.DualMode(loop_of(problem), sets=[near], targets=[target]), [2.0, 0.0]


def way_round() -> Case:
    """Return a point that must go round a disc, with bounded speed, to its goal."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    distance = (x[0] - 2) ** 2 + (x[1] - 0.1) ** 2
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[2], x[3], u[0], u[1])),
        horizon=4.0, intervals=20, substeps=1, terminal=[(x[0], 4), (x[1], 0)],
        stage_cost=0.1 * ca.sumsqr(u) + (x[0] - 4) ** 2 + x[1] ** 2,
        constraints=[ss.PathConstraint(expression=distance, lower=1.0)],
        bounds=ss.Bounds(controls=(-4, 4), states=([-9, -9, -2, -2], [9, 9, 2, 2])),
    )  # fmt: skip
    return loop_of(problem), [0.0, 0.0, 0.0, 0.0]


def tracking() -> Case:
    """Return a first-order lag that follows a signal, with a parameter and limits.

    Changes of the control cost, and a soft limit may be broken.
    """
    x, u, s, p = (ca.SX.sym(name) for name in ("x", "u", "s", "p"))
    before = ca.SX.sym("before")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=p * (u - x), parameters=p),
        horizon=2.0, intervals=10, substeps=2, signals=s, previous=before,
        stage_cost=(x - s) ** 2, step_cost=0.1 * (u - before) ** 2,
        constraints=[
            ss.PathConstraint(
                expression=x, upper=1.2, weight=3.0, quadratic_weight=1.0
            )
        ],
        bounds=ss.Bounds(controls=(-3, 3)),
    )  # fmt: skip
    loop = loop_of(
        problem, append="last", parameters=lambda time: np.array([1.5]),
        reference=lambda times: 1.5 * np.sin(times)[None, :],
    )  # fmt: skip
    return loop, [0.5]


def curved() -> Case:
    """Return a system of powers, exponentials and angles."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    rate = ca.vertcat(
        ca.exp(-(x[1] ** 2)) - ca.sqrt(1 + x[0] ** 2) + ca.tanh(u),
        ca.atan2(x[0], 1 + x[1] ** 2) + 0.3 * ca.fabs(x[1] + 0.1) ** 1.5 - x[1] + u,
    )
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=rate), horizon=1.0, intervals=8, substeps=2,
        stage_cost=ca.log1p(ca.sumsqr(x)) + 0.1 * ca.cosh(u) + ca.fmod(x[0], 9) ** 2,
        bounds=ss.Bounds(controls=(-2, 2)),
    )  # fmt: skip
    return loop_of(problem), [1.0, -1.0]


CASES: dict[str, Callable[[], Case]] = {
    "pendulum": pendulum,
    "dual_mode": dual_mode,
    "way_round": way_round,
    "tracking": tracking,
    "curved": curved,
}
