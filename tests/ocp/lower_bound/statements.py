"""Statements that the tests of a tube share, and trajectories of them."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.ocp.lower_bound.stated.statement import Statement

Rate = Callable[[ca.SX, ca.SX, ca.SX], Sequence[ca.SX | float]]


def stated(
    rate: Rate,
    x0: Sequence[float],
    controls: Sequence[tuple[float, float]],
    latest: float,
    *,
    state_box: tuple[Sequence[float], Sequence[float]] | None = None,
) -> Statement:
    """Return a statement with a right-hand side of (t, x, u), all sizes 1."""
    n, m = len(x0), len(controls)
    t, x, u = ca.SX.sym("t"), ca.SX.sym("x", n), ca.SX.sym("u", m)
    low, high = state_box or ([-np.inf] * n, [np.inf] * n)
    ends = np.array(controls, dtype=np.float64).reshape(m, 2)
    return Statement(
        time=t,
        states=x,
        controls=u,
        rate=ca.vertcat(*rate(t, x, u)),
        stage=ca.SX(0),
        end=ca.SX(0),
        x0=np.array(x0, dtype=np.float64),
        sizes=np.ones(n),
        horizon=(latest, latest),
        control_box=(ends[:, 0], ends[:, 1]),
        state_box=(np.array(low, dtype=float), np.array(high, dtype=float)),
    )


def double_integrator() -> Statement:
    return stated(lambda _, x, u: [x[1], u[0]], [1, 0], [(-1, 1)], 2.1)


def van_der_pol() -> Statement:
    return stated(
        lambda _, x, u: [(1 - x[1] ** 2) * x[0] - x[1] + u[0], x[0]],
        [0, 1],
        [(-0.3, 1)],
        5.0,
    )


def reactor() -> Statement:
    """The two-reaction reactor M3; {x_1 + x_2 <= .25, x >= (-.25, -.5)} holds it."""

    def rate(_: ca.SX, x: ca.SX, u: ca.SX) -> list[ca.SX]:
        r = (x[1] + 0.5) * ca.exp(25 * x[0] / (x[0] + 2))
        return [-2 * (x[0] + 0.25) + r - (x[0] + 0.25) * u[0], 0.5 - x[1] - r]

    return stated(rate, [0.09, 0.09], [(0, 5)], 0.78)


def unicycle() -> Statement:
    return stated(
        lambda _, x, u: [ca.cos(x[2]), ca.sin(x[2]), u[0]],
        [0, 0, 0],
        [(-1.5, 1.5)],
        2.0,
    )


def pendulum() -> Statement:
    return stated(
        lambda _, x, u: [x[1], u[0] - 9.81 * ca.sin(x[0])], [0, 0], [(-8, 8)], 1.5
    )


def pushed() -> Statement:
    """A state, time in the right-hand side, and a control that is not affine."""
    return stated(
        lambda t, x, u: [ca.sin(u[0]) * ca.cos(t) - x[0] + u[1] * ca.fabs(x[0])],
        [0.5],
        [(0, 3), (-0.5, 0.5)],
        4.0,
    )


def rates(statement: Statement) -> ca.Function:
    return ca.Function(
        "f",
        [statement.time, statement.states, statement.controls],
        [ca.densify(statement.rate)],
    )


def trajectories(
    statement: Statement, rng: np.random.Generator, count: int, pieces: int = 10
) -> tuple[Array, Array]:
    """Return trajectories under random controls, most of them bang-bang.

    Controls are constant on equal pieces of time, which the integrator does not step
    over; a third switch seldom.

    Returns:
        Times (N,) and states (N, n, count).
    """
    n, m = statement.n, statement.m
    low, high = (ends[:, None] for ends in statement.control_box)
    f = rates(statement).map(count)
    x = np.tile(statement.x0[:, None], count)
    edges = np.linspace(0, statement.horizon[1], pieces + 1)
    is_up = rng.random((m, count)) < 0.5
    times, states = [0.0], [x]
    for begin, end in pairwise(edges):
        switches = rng.random((m, count)) < np.where(np.arange(count) % 3, 0.5, 0.08)
        is_up ^= switches
        u = np.where(is_up, high, low)
        u = np.where(
            np.arange(count) % 5, u, low + (high - low) * rng.random((m, count))
        )

        def moved(t: float, y: Array, u: Array = u) -> Array:
            return np.asarray(f(t, y.reshape(n, count), u)).ravel()

        found = solve_ivp(
            moved,
            (begin, end),
            x.ravel(),
            method="DOP853",
            rtol=1e-6,
            atol=1e-8,
            t_eval=np.linspace(begin, end, 5)[1:],
        )
        times += list(found.t)
        states += list(found.y.T.reshape(-1, n, count))
        x = states[-1]
    return np.array(times), np.array(states)
