"""Vehicles of a few models for tests of committed plans."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

import swarmstart as ss

DISTANCE = 1.0


class Made(NamedTuple):
    """A vehicle: its agent, its set and its model."""

    agent: ss.Agent
    near: ss.TerminalSet
    model: ss.Model


def body(axes: int, *, drag: float = 0.1, wind: float = 0.0) -> ss.Model:
    """Return a mass with drag, in a wind that grows with the place."""
    x, v, u = (ca.SX.sym(name, axes) for name in "xvu")
    rate = u - drag * v - wind * x
    return ss.Model(states=ca.vertcat(x, v), controls=u, ode=ca.vertcat(v, rate))


def vehicle(
    goal: Sequence[float], others: int, model: ss.Model | None = None, **changes: Any
) -> Made:
    """Return a vehicle that goes to a goal and keeps away from others."""
    axes = len(goal)
    model = model or body(axes)
    x = model.states[:axes]
    seen = [ca.SX.sym(f"p{k}", axes) for k in range(2 * others)]
    reserve = ca.SX.sym("reserve")
    away = ca.sumsqr(x - ca.DM(goal))
    options: dict[str, Any] = {
        "horizon": 4.0, "intervals": 16,
        "stage_cost": away + ca.sumsqr(model.controls), "terminal_cost": 10 * away,
        "bounds": ss.Bounds(controls=(-1.5, 1.5)),
        "constraints": [
            ss.PathConstraint(
                expression=ca.sumsqr(x - p) - (DISTANCE + reserve) ** 2, lower=0
            )
            for p in seen
        ],
        "terminal": [(model.states[axes:], 0)],
        "signals": ca.vertcat(*seen, reserve),
    }  # fmt: skip
    problem = ss.OptimalControlProblem(model, **(options | changes))
    planner = ss.Planner(problem, search=None, polish=ss.IpoptOptions())
    near = ss.terminal_set_of(
        problem,
        at=[*goal, *np.zeros(model.nx - axes)],
        weights=ss.Weights(Q=np.eye(model.nx), R=np.eye(axes)),
        rng=np.random.default_rng(0),
    )
    loop = ss.RecedingHorizon(planner=planner)
    return Made(ss.Agent(controller=loop, shows=tuple(range(axes))), near, model)


def together(models: Sequence[ss.Model], *, pushed: bool = False) -> ss.Model:
    """Return models side by side; with a push on each rate as parameters."""
    states = [ca.SX.sym(f"x{i}", m.nx) for i, m in enumerate(models)]
    controls = [ca.SX.sym(f"u{i}", m.nu) for i, m in enumerate(models)]
    rates = ca.vertcat(
        *(
            ca.substitute(m.ode, ca.vertcat(m.states, m.controls), ca.vertcat(x, u))
            for m, x, u in zip(models, states, controls, strict=True)
        )
    )
    push = ca.SX.sym("push", rates.numel() if pushed else 0)
    return ss.Model(
        states=ca.vertcat(*states), controls=ca.vertcat(*controls),
        ode=rates + push if pushed else rates, parameters=push,
    )  # fmt: skip
