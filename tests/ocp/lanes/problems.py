"""Problems whose local optima are known."""

import itertools

import casadi as ca
import numpy as np

from swarmstart.ocp import (
    Bounds,
    Free,
    Model,
    OptimalControlProblem,
    PathConstraint,
    Separation,
)

DISCS = [(2.0, 0.3, 0.9), (4.2, -0.6, 1.0), (6.2, 0.5, 1.0), (8.2, -0.3, 0.9)]


def pendulum() -> OptimalControlProblem:
    """Swing up and stand still."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0])))
    return OptimalControlProblem(
        model, horizon=3.0, intervals=50, stage_cost=u**2, substeps=2,
        bounds=Bounds(controls=(-8, 8)), terminal=[x - ca.vertcat(np.pi, 0)],
    )  # fmt: skip


def four_discs() -> OptimalControlProblem:
    """Steer around four discs; the end time is free."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), u))
    return OptimalControlProblem(
        model, horizon=Free(10, 20), intervals=40, stage_cost=1 + 0.1 * u**2,
        substeps=2, bounds=Bounds(controls=(-3, 3)),
        terminal=[x[:2] - ca.vertcat(10, 0)],
        constraints=[
            PathConstraint(expression=r * r - (x[0] - a)**2 - (x[1] - b)**2, upper=0.0)
            for a, b, r in DISCS
        ],
    )  # fmt: skip


def cart(**more: object) -> OptimalControlProblem:
    """A double integrator from (0, 1) to (0, -1), or as said."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    given: dict[str, object] = {
        "horizon": 1.0, "intervals": 50, "stage_cost": u**2 / 2, "substeps": 2,
        "bounds": Bounds(controls=(-20, 20)), "terminal": [x - ca.vertcat(0, -1)],
    }  # fmt: skip
    model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u))
    return OptimalControlProblem(model, **(given | more))  # type: ignore[arg-type]


def crossing(apart: float = 0.4) -> OptimalControlProblem:
    """Four points of a unit circle change places; states x, y, x, y..."""
    x, u = ca.SX.sym("x", 8), ca.SX.sym("u", 8)
    ends = np.array([1.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, -1.0])
    pairs = itertools.combinations(range(0, 8, 2), 2)
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0, intervals=20, checks=2, stage_cost=ca.sumsqr(u),
        bounds=Bounds(controls=(-6.0, 6.0)), terminal=[(x, ends)],
        constraints=[
            Separation(relative=x[i : i + 2] - x[j : j + 2], distance=apart)
            for i, j in pairs
        ],
    )  # fmt: skip


def bryson_denham() -> OptimalControlProblem:
    """The same with the first state at most 1/9 (Bryson and Ho 1975): cost 4."""
    states = [-np.inf, -np.inf], [1 / 9, np.inf]
    return cart(bounds=Bounds(controls=(-20, 20), states=states))
