"""A problem with two valleys, of which zero controls lead to the costlier one."""

import casadi as ca

from swarmstart.ocp import Bounds, Model, OptimalControlProblem


def two_valleys() -> OptimalControlProblem:
    """(u - 2)^2 (u + 1)^2 - 0.1 u: from zero the valley at -1, from 2.5 that at 2."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=2,
        stage_cost=(u - 2) ** 2 * (u + 1) ** 2 - 0.1 * u,
        bounds=Bounds(controls=(-1.5, 6)),
    )  # fmt: skip
