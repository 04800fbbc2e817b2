"""Check before a proof that a gain is still stable when its input is held."""

from __future__ import annotations

from dataclasses import dataclass

from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.arrays import FloatArray
from swarmstart.terminal_set.linearisation import held_spectral_radius


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
