"""An inverted pendulum under linear laws, whose sets are not certified."""

import casadi as ca
import numpy as np

from swarmstart.terminal_set import Reference, TerminalSet, sampled_terminal_set


def upright() -> ca.Function:
    """Return f(x, u) of (angle, rate) about the upright position."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    return ca.Function("pendulum", [x, u], [ca.vertcat(x[1], 9.81 * ca.sin(x[0]) + u)])


def pendulum() -> tuple[ca.Function, TerminalSet]:
    """Return the dynamics, and a law without a hold of its own."""
    return upright(), TerminalSet(
        K=np.array([[12.0, 4.0]]), P=np.array([[9.0, 2.0], [2.0, 1.0]]), alpha=1.0,
        x_ref=np.zeros(2), u_ref=np.zeros(1), dt=None, design="own",
    )  # fmt: skip


def sampled_pendulum(dt: float) -> tuple[ca.Function, TerminalSet]:
    """Return the dynamics, and the law that is designed for a hold [s]."""
    f, zero = upright(), np.zeros(1)
    wide = Reference(
        x_ref=np.zeros(2), u_ref=zero, u_lower=-np.ones(1), u_upper=np.ones(1)
    )
    return f, sampled_terminal_set(f, wide, dt=dt, Q=np.eye(2), R=np.eye(1))
