"""Checks before a proof: the held loop is stable, the integrator accurate enough."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.certificates.design import TerminalSet
from swarmstart.terminal_set.linear.arrays import NotFiniteError
from swarmstart.terminal_set.linear.linearisation import (
    held_spectral_radius,
    hold,
    runge_kutta_hold,
)

MOST_SUBSTEPS = 2**20
"""Largest number of Runge-Kutta steps in a hold that is tried for a recommendation."""


@dataclass(eq=False)
class HeldTooLongError(SwarmstartError, ValueError):
    """A gain is unstable when its input is held for this time.

    Attributes:
        dt: Time for which it is held [s].
        spectral_radius: Spectral radius of the held loop.
        longest: Longest time for which the held loop is stable [s].
    """

    dt: float
    spectral_radius: float
    longest: float

    def __str__(self) -> str:
        """Return a message with the longest stable time."""
        return (
            f"the gain is unstable when its input is held for {self.dt:g} s: the "
            f"spectral radius is {self.spectral_radius:.4g}; it is stable up to "
            f"{self.longest:.3g} s, and a sampled design for any dt"
        )


@dataclass(eq=False)
class TooFewSubstepsError(SwarmstartError, ValueError):
    """The Runge-Kutta map of a hold is too far from the flow for any proof.

    Attributes:
        substeps: Number of Runge-Kutta steps in a hold.
        factor: Largest factor by which the map changes the length of a small deviation.
        error: Largest difference of map and flow for a small deviation, relative to its
            length.
        enough: Number of steps that is enough for small deviations; None if it is above
            `MOST_SUBSTEPS`.
    """

    substeps: int
    factor: float
    error: float
    enough: int | None

    def __str__(self) -> str:
        """Return a message with the number of steps that is enough."""
        advice = "shorten the hold"
        if self.enough is not None:
            advice = f"use ProofOptions(substeps={self.enough}) or more"
        return (
            f"substeps={self.substeps} is too few: near the reference one hold "
            f"multiplies deviations by {self.factor:.3g} in the Runge-Kutta map, with "
            f"an error of {self.error:.3g} against the flow, and the sum must stay "
            f"below 1; {advice}"
        )


def require_enough_substeps(
    A: Array, B: Array, law: TerminalSet, *, dt: float, substeps: int
) -> None:
    """Validate that some level can be proven with a Runge-Kutta map.

    Lengths are measured by P. For the linear parts: if the flow shrinks every
    deviation, the sum of the map's factor and its error against the flow must be below
    1.

    Args:
        A: System matrix, shape (nx, nx), 1/s.
        B: Input matrix, shape (nx, nu).
        law: The law and P; its level is not used.
        dt: Time for which the input is held [s].
        substeps: Number of Runge-Kutta steps in a hold.

    Raises:
        TooFewSubstepsError: If the sum is not below 1.
        NotPositiveError: If dt is not positive and finite.
    """
    root = np.linalg.cholesky(law.P).T
    Ad, Bd = hold(A, B, dt)
    flow = Ad - Bd @ law.K

    def length(matrix: Array) -> float:
        if not np.all(np.isfinite(matrix)):
            return float("inf")
        return float(np.linalg.norm(root @ np.linalg.solve(root.T, matrix.T).T, 2))

    def factor_and_error(substeps: int) -> tuple[float, float]:
        try:
            Ad, Bd = runge_kutta_hold(A, B, dt, substeps=substeps)
        except NotFiniteError:
            return float("inf"), float("inf")
        map_ = Ad - Bd @ law.K
        return length(map_), length(map_ - flow)

    factor, error = factor_and_error(substeps)
    if factor + error < 1 or not length(flow) < 1:
        return
    enough = substeps
    while enough <= MOST_SUBSTEPS and not sum(factor_and_error(enough)) < 1:
        enough *= 2
    tried = enough if enough <= MOST_SUBSTEPS else None
    raise TooFewSubstepsError(substeps, factor, error, tried)


def require_stable_hold(A: Array, B: Array, K: Array, dt: float) -> None:
    """Validate that a gain is stable when its input is held.

    Args:
        A: System matrix, shape (nx, nx), 1/s.
        B: Input matrix, shape (nx, nu).
        K: Gain of du = -K e, shape (nu, nx).
        dt: Time for which the input is held [s].

    Raises:
        HeldTooLongError: If the held loop has a spectral radius of 1 or more.
        NotPositiveError: If dt is not positive and finite.
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
