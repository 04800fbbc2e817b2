"""Change of V(e) = e'Pe under the linear law, as a function of the deviation.

    continuous  c(e) = 2 e'P (f(x_ref + e, u_ref - K e) - f(x_ref, u_ref)) + e'Q_m e
    held        c(e) = V(F(x_ref + e, u_ref - K e) - F(x_ref, u_ref)) - V(e) + e'Q_m e

for x' = f(x, u) with a reference (x_ref, u_ref), e = x - x_ref, and F(x, u) the state
after a time dt in which u is held. V decreases with the margin Q_m (a matrix) if
c(e) < 0. Q_m = 0 requires any decrease. Q_m = Q + K'RK makes V a bound of the cost to
go; this needs kappa > 0 in P, since the Riccati P leaves no margin in the linear part.

As in all proofs of this folder, the motion is relative to the reference
(`linearisation.py`), so f(x_ref, u_ref) need not be zero.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import FLAG, checked, of_kind, optional, reals
from swarmstart.arrays import Array
from swarmstart.errors import InvalidArgumentError, SwarmstartError
from swarmstart.terminal_set.certificates.design import TerminalSet
from swarmstart.terminal_set.linear.arrays import (
    InvalidShapeError,
    finite_array,
    positive_definite,
)

ORDER = 4
"""Order of the classical Runge-Kutta method."""


@dataclass(eq=False)
class MovingCentreError(SwarmstartError, ValueError):
    """A motion does not map the deviation 0 to 0.

    Attributes:
        motion: The motion at e = 0.
    """

    motion: Array

    def __str__(self) -> str:
        """Return a message with the motion there."""
        found = ", ".join(f"{entry:.6g}" for entry in self.motion)
        return (
            f"the motion must be 0 at e = 0, got ({found}): it is that of a deviation, "
            "less the reference's own"
        )


_FUNCTION = of_kind(ca.Function, "a casadi.Function")
_CHANGE = {
    "terminal_set": of_kind(TerminalSet, "a TerminalSet"),
    "Q_m": optional(reals()),
}


@checked(motion=_FUNCTION, is_held=FLAG)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Change:
    """The change of V(e) = e'Pe under a linear law.

    Attributes:
        motion: e (nx, 1) -> the rate of e, or e after one step if held; it must map 0
            to 0.
        P: Shape of the ellipsoids, (nx, nx), symmetric positive definite; copied.
        Q_m: Margin, shape (nx, nx); copied.
        is_held: Whether the input is held over each step.
        function: e -> c(e), made from the other attributes.

    Raises:
        InvalidShapeError: If Q_m or the motion is of another size than P.
        NotFiniteError: If P or Q_m holds NaN or infinity.
        AsymmetricMatrixError: If P is not symmetric.
        IndefiniteMatrixError: If P is not positive definite.
        MovingCentreError: If the motion is not 0 at 0, or not a number there.
    """

    motion: ca.Function
    P: Array
    Q_m: Array
    is_held: bool
    function: ca.Function = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check and copy; build c."""
        P = positive_definite("P", self.P)
        sizes = {self.motion.size_in(0), self.motion.size_out(0)}
        if sizes != {(len(P), 1)}:
            raise InvalidShapeError("the motion", max(sizes), (len(P), 1))
        at_centre = np.array(self.motion(0)).ravel()
        # Every proof assumes that c is of second order there.
        if not np.all(at_centre == 0):
            raise MovingCentreError(at_centre)
        Q_m = finite_array("Q_m", self.Q_m, P.shape)
        e = ca.SX.sym("e", len(P))
        moved = self.motion(e)
        change = 2 * ca.dot(ca.DM(P) @ e, moved)
        if self.is_held:
            change = ca.bilin(ca.DM(P), moved, moved) - ca.bilin(ca.DM(P), e, e)
        change += ca.bilin(ca.DM(Q_m), e, e)
        made = {
            "P": P,
            "Q_m": Q_m,
            "function": ca.Function("change", [e], [change], ["e"], ["change"]),
        }
        for name, value in made.items():
            object.__setattr__(self, name, value)


@checked(InvalidArgumentError, dynamics=_FUNCTION, **_CHANGE)
def continuous_change(
    dynamics: ca.Function, terminal_set: TerminalSet, *, Q_m: ArrayLike | None = None
) -> Change:
    """Return c(e), the rate of e'Pe plus the margin e'Q_m e, for a continuous input.

    Args:
        dynamics: f(x, u) -> xdot, SI units.
        terminal_set: The law and P; its level is not used.
        Q_m: Margin, shape (nx, nx), symmetric; None means 0.

    Raises:
        InvalidShapeError: If Q_m has another shape.
        NotFiniteError: If Q_m holds NaN or infinity.
    """
    return _change(dynamics, terminal_set, Q_m, is_held=False)


@checked(InvalidArgumentError, step=_FUNCTION, **_CHANGE)
def held_change(
    step: ca.Function, terminal_set: TerminalSet, *, Q_m: ArrayLike | None = None
) -> Change:
    """Return c(e), the change of e'Pe plus the margin, for an input held over a step.

    Args:
        step: F(x, u) -> x after dt, SI units.
        terminal_set: The law and P; its level is not used.
        Q_m: Margin, shape (nx, nx), symmetric; None means 0.

    Raises:
        InvalidShapeError: If Q_m has another shape.
        NotFiniteError: If Q_m holds NaN or infinity.
    """
    return _change(step, terminal_set, Q_m, is_held=True)


def held_map(dynamics: ca.Function, dt: float, substeps: int) -> ca.Function:
    """Return F(x, u) -> x after a hold, by steps of the classical Runge-Kutta method.

    Args:
        dynamics: f(x, u) -> xdot.
        dt: Time for which the input is held [s].
        substeps: Number of steps.
    """
    x = ca.SX.sym("x", dynamics.size1_in(0))
    u = ca.SX.sym("u", dynamics.size1_in(1))
    step = ca.simpleRK(dynamics, substeps, ORDER).expand()
    return ca.Function("step", [x, u], [step(x, u, dt)])


def _change(
    function: ca.Function,
    terminal_set: TerminalSet,
    Q_m: ArrayLike | None,
    *,
    is_held: bool,
) -> Change:
    """Return c of a function of (x, u) under the law, relative to the reference."""
    e = ca.SX.sym("e", len(terminal_set.P))
    x_ref, u_ref = ca.DM(terminal_set.x_ref), ca.DM(terminal_set.u_ref)
    u = u_ref - ca.DM(terminal_set.K) @ e
    moved = function(x_ref + e, u)
    # The same operations on the same numbers: exactly 0 at 0.
    moved -= ca.substitute(moved, e, ca.DM.zeros(e.shape))
    return Change(
        motion=ca.Function("motion", [e], [moved], ["e"], ["moved"]),
        P=terminal_set.P,
        Q_m=np.zeros_like(terminal_set.P) if Q_m is None else np.asarray(Q_m),
        is_held=is_held,
    )
