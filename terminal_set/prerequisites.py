"""What a reference and a hold must be before anything is proven of them.

A reference must be an equilibrium but for states on which nothing depends, and a gain
must still be stable when its input is held.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.arrays import FloatArray, finite_array
from swarmstart.terminal_set.intervals import interval_function
from swarmstart.terminal_set.linearisation import held_spectral_radius
from swarmstart.terminal_set.reference import Reference

NEARBY = 1e-12
"""Within which part of its own size a reference must have an equilibrium."""


@dataclass(eq=False)
class NotAnEquilibriumError(SwarmstartError, ValueError):
    """A reference moves, and the dynamics depend on where it moves to.

    Attributes:
        entries: Which entries of x_ref move and matter.
        rates: Their rates, of f(x_ref, u_ref).
    """

    entries: tuple[int, ...]
    rates: tuple[float, ...]

    def __str__(self) -> str:
        """Say which entries."""
        moving = ", ".join(
            f"xdot[{entry}] = {rate:.6g}"
            for entry, rate in zip(self.entries, self.rates, strict=True)
        )
        return (
            f"x_ref and u_ref are no equilibrium: {moving} there, and the dynamics "
            "depend on these states; only states that the dynamics do not depend on "
            "may move along the reference"
        )


@dataclass(eq=False)
class HeldTooLongError(SwarmstartError, ValueError):
    """A gain does not survive that its input is held for so long.

    Attributes:
        dt: How long it is to be held [s].
        spectral_radius: Of the held loop.
        longest: Up to which time the held loop is stable [s].
    """

    dt: float
    spectral_radius: float
    longest: float

    def __str__(self) -> str:
        """Say how long would do."""
        return (
            f"the gain is unstable when its input is held for {self.dt:g} s: the "
            f"spectral radius is {self.spectral_radius:.4g}; it is stable up to "
            f"{self.longest:.3g} s, and a sampled design for any dt"
        )


def require_equilibrium(dynamics: ca.Function, reference: Reference) -> None:
    """Refuse a reference whose motion changes the linear system around it.

    Args:
        dynamics: f(x, u) -> xdot.
        reference: The reference; it may move in states that f does not depend on.

    Raises:
        NotAnEquilibriumError: It moves in a state that matters, and so do all points
            within rounding of it.
        NotFiniteError: The rate there is NaN or infinite.
        UnknownIntervalOperationError: f has an operation without interval form.
    """
    xdot = np.array(dynamics(reference.x_ref, reference.u_ref)).ravel()
    xdot = finite_array("the rate at the reference", xdot, (None,))
    x = ca.SX.sym("x", reference.x_ref.size)
    u = ca.SX.sym("u", reference.u_ref.size)
    rate = ca.Function("rate", [ca.vertcat(x, u)], [dynamics(x, u)])
    at = np.concatenate([reference.x_ref, reference.u_ref])[:, None]
    around = NEARBY * np.abs(at)
    low, high = interval_function(rate)(at - around, at + around)
    moving = ((low > 0) | (high < 0))[:, 0]
    matters = np.array(dynamics.jac_sparsity(0, 0).T.get_triplet()[0], dtype=int)
    entries = sorted(set(np.flatnonzero(moving)) & set(matters))
    if entries:
        rates = tuple(float(xdot[entry]) for entry in entries)
        raise NotAnEquilibriumError(tuple(int(entry) for entry in entries), rates)


def require_stable_hold(A: FloatArray, B: FloatArray, K: FloatArray, dt: float) -> None:
    """Refuse a gain that is unstable when its input is held.

    Args:
        A: System matrix, shape (nx, nx), 1/s.
        B: Input matrix, shape (nx, nu).
        K: Gain of du = -K e, shape (nu, nx).
        dt: How long the input is held [s].

    Raises:
        HeldTooLongError: The held loop has a spectral radius of 1 or more.
        NotPositiveError: dt is not positive and finite.
    """
    radius = held_spectral_radius(A, B, K, dt)
    if radius < 1:
        return
    stable, unstable = 0.0, dt
    for _ in range(40):
        middle = (stable + unstable) / 2
        if held_spectral_radius(A, B, K, middle) < 1:
            stable = middle
        else:
            unstable = middle
    raise HeldTooLongError(dt, radius, stable)
