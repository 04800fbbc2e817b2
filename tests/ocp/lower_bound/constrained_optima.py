"""Problems with constraints along the path whose optimum is known in closed form."""

import math

import casadi as ca
import numpy as np

from swarmstart.ocp import PathConstraint
from swarmstart.tests.ocp.lower_bound.known_optimum import (
    KnownOptimum,
    Symbols,
    known,
    stated,
)


def bryson_denham(limit: float) -> float:
    """Return the least integral of u^2 / 2 with x <= limit, x'' = u.

    From (0, 1) to (0, -1) in 1 s. Source: Bryson and Ho (1975), chapter 3.11.
    """
    if limit >= 1 / 4:
        return 2.0
    if limit >= 1 / 6:
        return 2 + 6 * (1 - 4 * limit) ** 2
    return 4 / (9 * limit)


def ball(limit: float) -> KnownOptimum:
    """Return the problem of Bryson and Denham; u is at most 2 / (3 limit)."""
    s = Symbols(2)
    problem = stated(
        s, [s.x[1], s.u], horizon=1.0, controls=(-10, 10), stage=s.u**2 / 2,
        states=([-np.inf, -np.inf], [limit, np.inf]),
        terminal=[s.x - ca.DM([0, -1])],
    )  # fmt: skip
    return known(
        f"Bryson and Denham, {limit:.3g}", problem, [0.0, 1.0], bryson_denham(limit),
        "Bryson and Ho (1975), 3.11", within=0.02,
    )  # fmt: skip


def floor() -> KnownOptimum:
    """x' = u, |u| <= 1, x >= 1/4, the integral of x: down to the floor, and along."""
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=3.0, controls=(-1, 1), stage=s.x, states=(0.25, np.inf)
    )
    optimum = 0.75 * (1 + 0.25) / 2 + 2.25 / 4
    return known("a floor", problem, 1.0, optimum, "an area")


def rising_floor() -> KnownOptimum:
    """x' = u, |u| <= 2, x >= t / 2, the integral of x."""
    s = Symbols(1)
    problem = stated(
        s, s.u, horizon=2.0, controls=(-2, 2), stage=s.x, path=[s.x >= s.t / 2]
    )
    return known("a rising floor", problem, 1.0, 1.2, "an area; they meet at 0.4 s")


def round_a_disc() -> KnownOptimum:
    """x' = u in the plane, u^2, from (-2, 0) to (2, 0) round a disc of radius 1."""
    s = Symbols(2, 2)
    outside = PathConstraint(expression=ca.sumsqr(s.x), lower=1.0)
    problem = stated(
        s, s.u, horizon=1.0, controls=(-6, 6), stage=ca.sumsqr(s.u), path=[outside],
        terminal=[s.x - ca.DM([2, 0])], intervals=300,
    )  # fmt: skip
    length = 2 * np.sqrt(3) + np.pi / 3
    return known(
        "round a disc", problem, [-2.0, 0.0], length**2, "two tangents and an arc"
    )


def slow() -> KnownOptimum:
    """x'' = u, |u| <= 1, v <= 1/2: as far as possible in 2 s, at rest at the end."""
    s = Symbols(2)
    problem = stated(
        s, [s.x[1], s.u], horizon=2.0, controls=(-1, 1), end=s.x[0],
        states=([-np.inf, -np.inf], [np.inf, 0.5]), terminal=[s.x[1]], maximize=True,
    )  # fmt: skip
    return known("farthest, slowly", problem, [0.0, 0.0], 0.75, "a trapezium")


def mixed() -> KnownOptimum:
    """x' = u1 + u2 with u1 + 2 u2 <= 1, u >= 0: u1 = 1 is worth most."""
    s = Symbols(1, 2)
    problem = stated(
        s, ca.sum1(s.u), horizon=1.0, controls=(0, 1), end=s.x,
        path=[s.u[0] + 2 * s.u[1] <= 1], maximize=True,
    )  # fmt: skip
    return known("controls that share", problem, 0.0, 1.0, "u1 + u2 <= 1")


def speed_by_place() -> KnownOptimum:
    """x' = u with 0 <= u <= 1 + x, a constraint of both: x(T) = e^T - 1."""
    s, T = Symbols(1), 1.0
    problem = stated(
        s, s.u, horizon=T, controls=(0, 4), end=s.x, path=[s.u <= 1 + s.x],
        maximize=True,
    )  # fmt: skip
    return known(
        "a speed that depends on the place", problem, 0.0, math.e - 1, "e^T - 1",
        within=0.02,
    )  # fmt: skip


def family() -> list[KnownOptimum]:
    """Return all problems with constraints along the path."""
    return [
        ball(1 / 9),
        ball(1 / 5),
        ball(0.3),
        floor(),
        rising_floor(),
        round_a_disc(),
        slow(),
        mixed(),
        speed_by_place(),
    ]
