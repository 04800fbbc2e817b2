"""Levels: the largest alpha for which the ellipsoid e'Pe <= alpha keeps all bounds.

On the ellipsoid a row F_i e reaches at most sqrt(alpha F_i P^-1 F_i'), so with the
bounds |F_i e| <= g_i

    alpha = min_i g_i^2 / (F_i P^-1 F_i').

F = K and g = u_max is the input bound, (5.14) corrected; F = I and g = e_max the state
bound. The ellipsoid is symmetric, so the nearer one of two unequal bounds counts.

Such a level keeps the bounds of inputs and states only. That e'Pe also decreases under
the nonlinear dynamics is a further condition, which is not checked here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.linear.arrays import (
    NotPositiveError,
    bound_array,
    finite_array,
    positive_definite,
    read_only,
)


@dataclass(eq=False)
class SaturatedReferenceError(SwarmstartError, ValueError):
    """A reference lies on or outside its bounds, which leaves no room for feedback.

    Attributes:
        name: Name of the reference.
        index: Index of the entry (the first, if several).
        value: That entry.
        lower: Its lower bound.
        upper: Its upper bound.
    """

    name: str
    index: int
    value: float
    lower: float
    upper: float

    def __str__(self) -> str:
        """Return a message with the entry and its bounds."""
        return (
            f"{self.name}[{self.index}] must lie between its bounds "
            f"{self.lower:.6g} and {self.upper:.6g}, not on or outside them; "
            f"got {self.value:.6g}"
        )


def smaller_side(
    name: str, reference: ArrayLike, *, lower: ArrayLike, upper: ArrayLike
) -> Array:
    """Return the distance between a reference and the nearer of its two bounds.

    For bounds that are already relative to the reference, the reference is zero.

    Args:
        name: Name of the reference in errors.
        reference: Reference values, shape (n,).
        lower: Lower bounds, shape (n,); -inf if missing.
        upper: Upper bounds, shape (n,); inf if missing.

    Returns:
        min(upper - reference, reference - lower) > 0, shape (n,), read-only.

    Raises:
        SaturatedReferenceError: If the reference is on or outside a bound.
        NotFiniteError: If an argument holds NaN, or the reference infinity.
        InvalidShapeError: If the sizes differ.
    """
    reference = finite_array(name, reference, (None,))
    lower = bound_array(f"the lower bound of {name}", lower, reference.shape)
    upper = bound_array(f"the upper bound of {name}", upper, reference.shape)
    room = np.minimum(upper - reference, reference - lower)
    if np.any(room <= 0):
        index = int(np.argmax(room <= 0))
        at = float(reference[index]), float(lower[index]), float(upper[index])
        raise SaturatedReferenceError(name, index, *at)
    return read_only(room)


def level_from_inputs(K: ArrayLike, P: ArrayLike, u_max: ArrayLike) -> float:
    """Compute the largest level that keeps |K e| <= u_max: (5.14), corrected.

    Args:
        K: Gain, shape (nu, nx).
        P: Shape of the ellipsoid, (nx, nx), symmetric positive definite.
        u_max: Room of each input around its reference (see `smaller_side`), shape
            (nu,), > 0; infinite if there is no bound.

    Returns:
        alpha = min_i u_max_i^2 / (K_i P^-1 K_i'); infinite if no bound is ever reached.

    Raises:
        InvalidShapeError: If the sizes do not agree.
        NotFiniteError: If K or P holds NaN or infinity, or u_max NaN.
        AsymmetricMatrixError: If P is not symmetric.
        IndefiniteMatrixError: If P is not positive definite.
        NotPositiveError: If an entry of u_max is zero or negative.
    """
    P, K = _ellipsoid_and_rows(P, K)
    return _level(_squared_reach(P, K), _room("u_max", u_max, len(K)))


def level_from_states(P: ArrayLike, e_max: ArrayLike) -> float:
    """Compute the largest level that keeps every |e_j| <= e_max_j.

    Args:
        P: Shape of the ellipsoid, (nx, nx), symmetric positive definite.
        e_max: Room of each state around its reference (see `smaller_side`), shape
            (nx,), > 0; infinite if there is no bound.

    Returns:
        alpha = min_j e_max_j^2 / (P^-1)_jj; infinite if there is no bound.

    Raises:
        InvalidShapeError: If the sizes do not agree.
        NotFiniteError: If P holds NaN or infinity, or e_max NaN.
        AsymmetricMatrixError: If P is not symmetric.
        IndefiniteMatrixError: If P is not positive definite.
        NotPositiveError: If an entry of e_max is zero or negative.
    """
    P = positive_definite("P", P)
    return _level(_squared_reach(P, np.eye(len(P))), _room("e_max", e_max, len(P)))


def input_excess(K: ArrayLike, P: ArrayLike, alpha: float, u_max: ArrayLike) -> Array:
    """Compute the largest value of each input on an ellipsoid, relative to its bound.

    Args:
        K: Gain, shape (nu, nx).
        P: Shape of the ellipsoid, (nx, nx), symmetric positive definite.
        alpha: Its level, > 0.
        u_max: Room of each input around its reference, shape (nu,), > 0.

    Returns:
        max over the set of |K_i e| / u_max_i = sqrt(alpha K_i P^-1 K_i') / u_max_i,
        shape (nu,). The bounds hold on the set if no entry is above 1.

    Raises:
        InvalidShapeError: If the sizes do not agree.
        NotFiniteError: If K or P holds NaN or infinity, or u_max NaN.
        AsymmetricMatrixError: If P is not symmetric.
        IndefiniteMatrixError: If P is not positive definite.
        NotPositiveError: If alpha or an entry of u_max is zero or negative.
    """
    P, K = _ellipsoid_and_rows(P, K)
    if not 0 < alpha < np.inf:
        raise NotPositiveError("alpha", alpha)
    reach: Array = np.sqrt(alpha * _squared_reach(P, K))
    return reach / _room("u_max", u_max, len(K))


def _ellipsoid_and_rows(P: ArrayLike, K: ArrayLike) -> tuple[Array, Array]:
    """Check P and K against each other."""
    P = positive_definite("P", P)
    return P, finite_array("K", K, (None, len(P)))


def _room(name: str, value: ArrayLike, size: int) -> Array:
    """Check bounds: positive, infinite if missing; shape (size,)."""
    room = bound_array(name, value, (size,))
    if np.any(room <= 0):
        raise NotPositiveError(name, float(room.min()))
    return room


def _squared_reach(P: Array, F: Array) -> Array:
    """Compute F_i P^-1 F_i' as |L^-1 F_i'|^2 with P = LL', shape (m,), >= 0."""
    columns = np.linalg.solve(np.linalg.cholesky(P), F.T)
    return np.asarray(np.sum(columns**2, axis=0))


def _level(squared_reach: Array, room: Array) -> float:
    """Compute min room^2 / reach^2; a row with reach 0 counts as infinite."""
    with np.errstate(divide="ignore", over="ignore"):
        return float(np.min(room**2 / squared_reach))
