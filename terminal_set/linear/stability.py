"""Stability of a linear loop, and whether feedback can stabilise a system.

e' = F e decays if every eigenvalue of F has a negative real part, e+ = F e if every one
lies inside the unit circle. The Popov-Belevitch-Hautus test for (A, B) checks, for each
eigenvalue lam that does not decay, whether [A - lam I, B] has full row rank; if not, no
feedback moves lam. The same test on (A', Q') finds the modes to which a weight Q gives
no cost.

Source: M. L. J. Hautus, Controllability and observability conditions of linear
autonomous systems, Indag. Math. 31 (1969).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.linear.arrays import square_matrix

ComplexArray = NDArray[np.complex128]

RANK_TOLERANCE = 1e-8
"""Smallest singular value, relative to the largest, that still counts as rank."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TimeDomain:
    """The measure of decay: real parts, or moduli.

    Attributes:
        name: "continuous" or "sampled".
        measure: Name of the growth of a loop, such as "spectral radius".
        growth: Function: eigenvalues -> growth of each.
        boundary: Growth of a mode that neither decays nor grows.
        limit: Growth below which a loop counts as stable.
    """

    name: str
    measure: str
    growth: Callable[[ComplexArray], Array]
    boundary: float
    limit: float


CONTINUOUS = TimeDomain(
    name="continuous",
    measure="largest real part",
    growth=np.real,
    boundary=0.0,
    limit=-1e-9,
)
SAMPLED = TimeDomain(
    name="sampled",
    measure="spectral radius",
    growth=np.abs,
    boundary=1.0,
    limit=1 - 1e-6,
)


@dataclass(eq=False)
class UnstableLoopError(SwarmstartError, ValueError):
    """A Lyapunov equation was requested for a loop that does not decay.

    Attributes:
        eigenvalues: Eigenvalues of the loop, shape (nx,).
        measure: "largest real part" or "spectral radius".
        value: Value of the measure.
        limit: Upper limit of the measure.
    """

    eigenvalues: ComplexArray
    measure: str
    value: float
    limit: float

    def __str__(self) -> str:
        """Return a message with the growth."""
        return (
            f"F must be stable: its {self.measure} is {self.value:.9g}, allowed is "
            f"less than {self.limit:.9g}"
        )


@dataclass(eq=False)
class NotStabilisableError(SwarmstartError, ValueError):
    """Some modes do not decay by themselves and no input reaches them.

    Attributes:
        modes: The eigenvalues of these modes, shape (number,). An eigenvalue with
            several columns in `directions` is listed once for each of them.
        directions: For each mode the combination of states that no input moves, a
            column of unit length, shape (nx, number).
    """

    modes: ComplexArray
    directions: ComplexArray

    def __str__(self) -> str:
        """Name the modes."""
        return (
            "(A, B) cannot be stabilised: no input reaches the mode with eigenvalue "
            f"{_listed(self.modes, self.directions)}"
        )


@dataclass(eq=False)
class UnweightedModeError(SwarmstartError, ValueError):
    """Q gives no cost to a mode on the boundary of stability.

    So the optimal feedback would leave this mode as it is, without decay.

    Attributes:
        modes: The eigenvalues of these modes, shape (number,). An eigenvalue with
            several columns in `directions` is listed once for each of them.
        directions: For each mode a direction of states in which it moves at no cost, a
            column of unit length, shape (nx, number).
    """

    modes: ComplexArray
    directions: ComplexArray

    def __str__(self) -> str:
        """Name the modes."""
        return (
            "Q must weigh every mode that neither decays nor grows, but gives no cost "
            f"to the one with eigenvalue {_listed(self.modes, self.directions)}"
        )


def growth(F: ArrayLike, domain: TimeDomain) -> float:
    """Compute the growth of a loop: its spectral abscissa or its spectral radius.

    Args:
        F: Loop matrix, shape (nx, nx).
        domain: CONTINUOUS or SAMPLED.

    Returns:
        max Re(lam) [1/s] if continuous, max |lam| if sampled.

    Raises:
        NotFiniteError: If F holds NaN or infinity.
        InvalidShapeError: If F is not square.
    """
    return float(np.max(domain.growth(_eigenvalues(square_matrix("F", F)))))


def require_stable(F: Array, domain: TimeDomain) -> None:
    """Validate that a loop decays.

    Args:
        F: Loop matrix, shape (nx, nx), finite.
        domain: CONTINUOUS or SAMPLED.

    Raises:
        UnstableLoopError: If the growth of F is not below the domain's limit.
    """
    value = growth(F, domain)
    if not value < domain.limit:
        raise UnstableLoopError(_eigenvalues(F), domain.measure, value, domain.limit)


def require_stabilisable(A: Array, B: Array, domain: TimeDomain) -> None:
    """Validate that inputs reach every mode that does not decay.

    Args:
        A: System matrix, shape (nx, nx), finite.
        B: Input matrix, shape (nx, nu), finite.
        domain: CONTINUOUS or SAMPLED.

    Raises:
        NotStabilisableError: If no input reaches one of these modes.
    """
    eigenvalues = _eigenvalues(A)
    lasting = eigenvalues[domain.growth(eigenvalues) >= domain.limit]
    modes, directions = _deficient_modes(A, B, lasting)
    if modes.size:
        raise NotStabilisableError(modes, directions)


def require_weighted(A: Array, Q: Array, domain: TimeDomain) -> None:
    """Validate that a weight gives a cost to every mode on the boundary of stability.

    Args:
        A: System matrix, shape (nx, nx), finite.
        Q: State weight, shape (nx, nx), finite and symmetric.
        domain: CONTINUOUS or SAMPLED.

    Raises:
        UnweightedModeError: If there is a mode that the weight does not see.
    """
    eigenvalues = _eigenvalues(A)
    distance = np.abs(domain.growth(eigenvalues) - domain.boundary)
    # The margin of `limit`, on both sides of the boundary.
    marginal = eigenvalues[distance <= domain.boundary - domain.limit]
    modes, directions = _deficient_modes(A.T, Q, marginal)
    if modes.size:
        raise UnweightedModeError(modes, directions)


def _deficient_modes(
    A: Array, B: Array, candidates: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """Find each mode lam and direction w with w'A = lam w' and w'B = 0.

    Only the directions of B's columns count, so each is scaled to the size of A:
    whether a mode can be reached must not depend on the unit of an input.
    """
    # A column of zeros, or A = 0, is left as it is.
    lengths = np.linalg.norm(B, axis=0)
    columns = B / np.where(lengths > 0, lengths, 1.0) * (np.linalg.norm(A) or 1.0)
    modes: list[complex] = []
    directions: list[ComplexArray] = []
    for mode in candidates:
        if np.any(np.isclose(modes, mode, atol=RANK_TOLERANCE)):
            continue  # A multiple eigenvalue: its directions were found with the first.
        pencil = np.hstack([A - mode * np.eye(len(A)), columns])
        left, singular, _ = np.linalg.svd(pencil)
        for column in np.flatnonzero(singular <= RANK_TOLERANCE * singular[0]):
            modes.append(mode)
            directions.append(left[:, column])
    return (
        np.array(modes, dtype=np.complex128),
        np.array(directions, dtype=np.complex128).reshape(-1, len(A)).T,
    )


def _eigenvalues(F: Array) -> ComplexArray:
    """Compute eigenvalues, complex even if all are real; shape (nx,)."""
    return np.linalg.eigvals(F).astype(np.complex128)


def _listed(modes: ComplexArray, directions: ComplexArray) -> str:
    """Write each mode with its direction, without zero imaginary parts or "-0"."""
    parts = []
    for mode, direction in zip(modes, directions.T, strict=True):
        # An eigenvector is free up to a phase: its largest entry is made positive.
        largest = direction[np.argmax(np.abs(direction))]
        entries = [_number(entry * abs(largest) / largest) for entry in direction]
        parts.append(f"{_number(mode)} along ({', '.join(entries)})")
    return "; ".join(parts)


def _number(value: complex) -> str:
    """Write a complex number to three decimals, as a real number if it is real."""
    # To add 0 turns -0 into 0.
    value = complex(round(value.real, 3) + 0.0, round(value.imag, 3) + 0.0)
    return f"{value:.3g}" if value.imag else f"{value.real:.3g}"
