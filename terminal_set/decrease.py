"""By how much V(e) = e'Pe changes under the linear law, as a function of the deviation.

    continuous  c(e) = 2 e'P (f(x_ref + e, u_ref - K e) - f(x_ref, u_ref)) + e'Q_m e
    held        c(e) = V(F(x_ref + e, u_ref - K e) - F(x_ref, u_ref)) - V(e) + e'Q_m e

with x+ = F(x, u) the state after dt with u held. V decreases with the margin Q_m where
c(e) < 0. Q_m = 0 asks for any decrease; Q_m = Q + K'RK makes V a bound of the cost to
go, which takes kappa > 0 in P: the Riccati P leaves no margin in the linear part.

As everywhere here what counts is the motion relative to the reference
(linearisation.py): f(x_ref, u_ref) need not be zero.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.terminal_set.arrays import finite_array
from swarmstart.terminal_set.design import TerminalSet


def continuous_change(
    dynamics: ca.Function, terminal_set: TerminalSet, *, Q_m: ArrayLike | None = None
) -> ca.Function:
    """Return e -> c(e) for an input that moves all the time.

    Args:
        dynamics: f(x, u) -> xdot, SI units.
        terminal_set: The law and P; its level is not used.
        Q_m: Margin, shape (nx, nx), symmetric; None means 0.

    Raises:
        InvalidShapeError: Q_m has another shape.
        NotFiniteError: Q_m holds NaN or infinity.
    """
    e, P, margin = _symbols(terminal_set, Q_m)
    moved = _relative(dynamics, terminal_set, e)
    change = 2 * ca.dot(P @ e, moved) + margin
    return ca.Function("change", [e], [change], ["e"], ["change"])


def held_change(
    step: ca.Function, terminal_set: TerminalSet, *, Q_m: ArrayLike | None = None
) -> ca.Function:
    """Return e -> c(e) for an input that is held over each step.

    Args:
        step: F(x, u) -> x after dt, SI units.
        terminal_set: The law and P; its level is not used.
        Q_m: Margin, shape (nx, nx), symmetric; None means 0.

    Raises:
        InvalidShapeError: Q_m has another shape.
        NotFiniteError: Q_m holds NaN or infinity.
    """
    e, P, margin = _symbols(terminal_set, Q_m)
    after = _relative(step, terminal_set, e)
    change = ca.dot(P @ after, after) - ca.dot(P @ e, e) + margin
    return ca.Function("change", [e], [change], ["e"], ["change"])


def _symbols(
    terminal_set: TerminalSet, Q_m: ArrayLike | None
) -> tuple[ca.SX, ca.DM, ca.SX]:
    """Return e, P and e'Q_m e."""
    nx = len(terminal_set.P)
    e = ca.SX.sym("e", nx)
    margin = np.zeros((nx, nx)) if Q_m is None else finite_array("Q_m", Q_m, (nx, nx))
    return e, ca.DM(terminal_set.P), ca.bilin(ca.DM(margin), e, e)


def _relative(function: ca.Function, terminal_set: TerminalSet, e: ca.SX) -> ca.SX:
    """Return a function at the deviation e under the law, less its reference value."""
    x_ref, u_ref = ca.DM(terminal_set.x_ref), ca.DM(terminal_set.u_ref)
    u = u_ref - ca.DM(terminal_set.K) @ e
    here: ca.SX = function(x_ref + e, u) - function(x_ref, u_ref)
    return here
