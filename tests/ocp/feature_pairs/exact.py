"""The path of a stated problem by SciPy: DOP853 at a relative tolerance of 1e-10."""

from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.tests.ocp.feature_pairs.peer import Peer, Point


def exact(peer: Peer, point: Point) -> tuple[Array, float]:
    """Return the state at the end, and the cost, by DOP853 at rtol 1e-10."""
    stated = peer.stated
    p = peer.parameters_with(ca.DM(point.decided))
    dt, m = point.length / stated.intervals, stated.checks
    x, before, cost = point.x0, stated.previous, 0.0
    stage = peer.function(stated.stage)
    for k in range(stated.intervals):
        u, S = point.controls[:, k], peer.nodes(k)
        t = peer.begun(k, point.length)
        begin = x, u, p, S[:, 0], t, before
        cost += float(peer.function(stated.step)(*begin))
        if stated.quadrature == "left":
            cost += dt * float(stage(*begin))
        y = np.append(x, 0.0)
        for j in range(m):
            held = (u, peer.late(point.controls, k)), p, before
            y = _flown(peer, y, held, (S[:, j], S[:, j + 1]), (t, j, dt))
        x = y[:-1]
        cost += y[-1] if stated.quadrature == "integral" else 0.0
        end = u, p, S[:, m + 1], peer.begun(k + 1, point.length), before
        if stated.next_state.numel():
            late = peer.late(point.controls, k), *end[1:]
            x = np.array(peer.function(stated.next_state)(x, *late)).ravel()
        if stated.quadrature == "right":
            cost += dt * float(stage(x, *end))
        before = u if stated.before.numel() else before
    ends, _ = peer.at_ends(point.x0, x, p, point.length)
    return x, cost + float(ends)


def _flown(
    peer: Peer, y: Array, held: tuple[Any, Any, Any], signals: tuple[Array, Array],
    times: tuple[Any, int, float],
) -> Array:  # fmt: skip
    """Return state and integrated cost after one check."""
    ((u, late), p, before), (s0, s1), (t, j, dt) = held, signals, times
    ode, stage = peer.rates
    h = dt / peer.stated.checks

    def rate(after: float, at: Array) -> Array:
        now = t + j * h + after if peer.stated.time.numel() else t
        s = s0 + after / h * (s1 - s0)
        there = p, s, now, before
        both = ode(at[:-1], late, *there), stage(at[:-1], u, *there)
        return np.concatenate([np.array(one).ravel() for one in both])

    found = solve_ivp(rate, (0.0, h), y, method="DOP853", rtol=1e-10, atol=1e-12)
    return np.asarray(found.y[:, -1])
