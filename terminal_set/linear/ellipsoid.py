"""The ellipsoid e'Pe <= alpha around a reference, and the level that its bounds allow.

With e = x - x_ref it is the terminal region Omega, (5.8) of the chapter (docs/chapter).
With P = LL', e = sqrt(alpha) L^-T d maps the unit ball of d onto the ellipsoid; the
extent of the ellipsoid along axis j is sqrt(alpha (P^-1)_jj), and its shadow on the
plane of two axes is the ellipse e'Se <= alpha in these two coordinates, with S the
inverse of the block of P^-1 that belongs to them.

On the ellipsoid a row F_i e reaches at most sqrt(alpha F_i P^-1 F_i'). So the largest
level that keeps the bounds |F_i e| <= g_i is

    alpha = min_i g_i^2 / (F_i P^-1 F_i').

F = K, with g the distances of the inputs' bounds from u_ref, gives the level of the
input bounds, which is the chapter's (5.14) corrected. F = I, with g the distances of
the states' bounds from x_ref, gives that of the state bounds. The ellipsoid is
symmetric, so the nearer one of two unequal bounds counts.

Such a level keeps the bounds of inputs and states only. That e'Pe also decreases under
the nonlinear dynamics is a further condition, which is not checked here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import MOST, a_count, a_number, checked, text
from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.linear.arrays import (
    Mask,
    NotPositiveError,
    bound_array,
    columns_of,
    finite_array,
    positive_definite,
    read_only,
)

_AXIS = a_count(least=-MOST)
"""Any integer: an axis that does not exist has an error of its own."""


@dataclass(eq=False)
class InvalidPlaneError(SwarmstartError, ValueError):
    """A plane is not spanned by two different axes of the ellipsoid.

    Attributes:
        i: First axis as given.
        j: Second axis as given.
        nx: Number of axes of the ellipsoid.
    """

    i: int
    j: int
    nx: int

    def __str__(self) -> str:
        """Return a message with the axes that exist."""
        return (
            f"a plane needs two different axes from 0 to {self.nx - 1}, got "
            f"{self.i} and {self.j}"
        )


@checked(alpha=a_number(finite=False, nan=True))
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Ellipsoid:
    """The set e'Pe <= alpha around the origin.

    Attributes:
        P: Shape, (nx, nx), symmetric positive definite; copied and read-only.
        alpha: Level, > 0 and finite.

    Raises:
        InvalidShapeError: If P is not a square matrix.
        NotFiniteError: If P holds NaN or infinity.
        AsymmetricMatrixError: If P is not symmetric.
        IndefiniteMatrixError: If P is not positive definite.
        NotPositiveError: If alpha is not positive and finite.
    """

    P: Array
    alpha: float

    def __post_init__(self) -> None:
        """Check P and alpha; copy P."""
        object.__setattr__(self, "P", positive_definite("P", self.P))
        if not 0 < self.alpha < np.inf:
            raise NotPositiveError("alpha", self.alpha)

    def value(self, e: ArrayLike) -> Array:
        """Compute e'Pe.

        Args:
            e: A deviation from the reference, shape (nx,), or many, shape (nx, n).

        Returns:
            The value, shape () or (n,).

        Raises:
            InvalidShapeError: If e has another number of rows.
        """
        columns = columns_of("e", e, len(self.P))
        return np.asarray(np.einsum("i...,ij,j...->...", columns, self.P, columns))

    @checked(tolerance=a_number())
    def contains(self, e: ArrayLike, *, tolerance: float = 0.0) -> Mask:
        """Return whether e'Pe <= alpha (1 + tolerance).

        Args:
            e: A deviation from the reference, shape (nx,), or many, shape (nx, n).
            tolerance: Allowance relative to alpha, for rounding.

        Returns:
            True for deviations inside, shape () or (n,); False for NaN.

        Raises:
            InvalidShapeError: If e has another number of rows.
        """
        return np.asarray(self.value(e) <= self.alpha * (1 + tolerance))

    def extent(self) -> Array:
        """Compute the half widths sqrt(alpha (P^-1)_jj), shape (nx,)."""
        return np.asarray(np.sqrt(self.alpha * np.diag(np.linalg.inv(self.P))))

    def boundary(self, directions: ArrayLike) -> Array:
        """Map directions onto the boundary, e'Pe = alpha.

        Directions that are uniform on the unit sphere are mapped to points that are
        uniform in the coordinates in which the ellipsoid is a ball.

        Args:
            directions: One direction, shape (nx,), or many, shape (nx, n), not zero.

        Returns:
            Points on the boundary, of the same shape.

        Raises:
            InvalidShapeError: If directions have another number of rows.
            NotPositiveError: If a direction is zero.
        """
        columns = columns_of("directions", directions, len(self.P))
        lengths = np.linalg.norm(columns, axis=0)
        if not np.all(lengths > 0):
            raise NotPositiveError("the length of a direction", float(np.min(lengths)))
        on_ball = np.sqrt(self.alpha) * columns / lengths
        return np.asarray(np.linalg.solve(np.linalg.cholesky(self.P).T, on_ball))

    @checked(i=_AXIS, j=_AXIS, count=a_count(least=2))
    def shadow(self, i: int, j: int, *, count: int = 201) -> Array:
        """Outline the projection on the plane of two axes, as for a figure.

        Args:
            i: First axis, 0 to nx - 1.
            j: Second axis, another one.
            count: Number of points; the last closes the curve.

        Returns:
            Points on the outline, shape (2, count), coordinate i in the first row.

        Raises:
            InvalidPlaneError: If the axes are equal or out of range.
        """
        nx = len(self.P)
        if i == j or not (0 <= i < nx and 0 <= j < nx):
            raise InvalidPlaneError(i, j, nx)
        block = np.linalg.inv(self.P)[np.ix_([i, j], [i, j])]
        angle = np.linspace(0.0, 2 * np.pi, count)
        circle = np.sqrt(self.alpha) * np.array([np.cos(angle), np.sin(angle)])
        return np.asarray(np.linalg.cholesky(block) @ circle)


@dataclass(eq=False)
class SaturatedReferenceError(SwarmstartError, ValueError):
    """A reference lies on or outside its bounds, which leaves no room for feedback.

    Attributes:
        name: Name of the reference.
        index: Index of the entry (the first, if several).
        value: Value of the entry.
        lower: Lower bound of the entry.
        upper: Upper bound of the entry.
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


@checked(name=text())
def smaller_side(
    name: str, reference: ArrayLike, *, lower: ArrayLike, upper: ArrayLike
) -> Array:
    """Return the distance between a reference and the nearer of its two bounds.

    If the bounds are given relative to the reference, pass zeros as `reference`.

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


@dataclass(eq=False)
class MovingReferenceError(SwarmstartError, ValueError):
    """A reference cannot move with the velocity that it states.

    Attributes:
        entry: Number of the state.
        velocity: Velocity that is stated for this state.
        found: Reason why the reference cannot move so, in words.
    """

    entry: int
    velocity: float
    found: str

    def __str__(self) -> str:
        """Return a message with the state and the reason why it cannot move so."""
        return (
            "expected a reference to move with its rate at x_ref and u_ref, in states "
            "without bounds on which the dynamics do not depend; found the velocity "
            f"{self.velocity:.12g} of x[{self.entry}], {self.found}"
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Reference:
    """A reference state and input inside their bounds; arrays copied and read-only.

    Attributes:
        x_ref: Reference state, shape (nx,), SI units; its value at time 0 if the
            reference moves.
        u_ref: Reference input, shape (nu,).
        u_lower: Lower bounds of the input, shape (nu,); -inf if missing.
        u_upper: Upper bounds of the input, shape (nu,); inf if missing.
        x_lower: Lower bounds of the state, shape (nx,); None if unbounded.
        x_upper: Upper bounds of the state, shape (nx,); None if unbounded.
        velocity: Velocity of a reference that moves, such as a leader, shape (nx,), per
            second; None if it rests. Deviations are relative to x_ref + velocity t. A
            state that moves may have no bounds, and the dynamics may not depend on it.

    Raises:
        SaturatedReferenceError: If x_ref or u_ref is on or outside a bound.
        MovingReferenceError: If a state that moves has bounds.
        NotFiniteError: If a value is NaN, or one of x_ref or u_ref infinite.
        InvalidShapeError: If an array is no vector, or sizes differ.

    Example:
        >>> import swarmstart as ss
        >>> upright = ss.Reference(
        ...     x_ref=[0, 0], u_ref=[0], u_lower=[-8], u_upper=[5]
        ... )
        >>> upright.u_max.tolist(), upright.e_max.tolist()
        ([5.0], [inf, inf])
    """

    x_ref: Array
    u_ref: Array
    u_lower: Array
    u_upper: Array
    x_lower: Array | None = None
    x_upper: Array | None = None
    velocity: Array | None = None

    def __post_init__(self) -> None:
        """Check and copy; the reference must lie strictly inside its bounds."""
        for name in ("x_ref", "u_ref"):
            checked = finite_array(name, getattr(self, name), (None,))
            object.__setattr__(self, name, checked)
        for name in ("u_lower", "u_upper", "x_lower", "x_upper"):
            bound = getattr(self, name)
            if bound is not None:
                size = self.u_ref.size if name.startswith("u") else self.x_ref.size
                object.__setattr__(self, name, bound_array(name, bound, (size,)))
        _ = self.u_max, self.e_max  # Raises if there is no room.
        if self.velocity is not None:
            size = self.x_ref.size
            moving = finite_array("velocity", self.velocity, (size,))
            object.__setattr__(self, "velocity", moving)
            leaving = np.flatnonzero((moving != 0) & np.isfinite(self.e_max))
            for entry in leaving.tolist():
                raise MovingReferenceError(entry, float(moving[entry]), "with bounds")

    @property
    def rates(self) -> Array:
        """Velocity of each state, 0 if it rests, shape (nx,), per second."""
        return np.zeros(self.x_ref.size) if self.velocity is None else self.velocity

    @property
    def u_max(self) -> Array:
        """Distance of each input of u_ref from the nearer bound, shape (nu,), > 0."""
        return smaller_side("u_ref", self.u_ref, lower=self.u_lower, upper=self.u_upper)

    @property
    def e_max(self) -> Array:
        """Distance of each state of x_ref from the nearer bound, shape (nx,), > 0."""
        nowhere = np.full(self.x_ref.shape, np.inf)
        lower = -nowhere if self.x_lower is None else self.x_lower
        upper = nowhere if self.x_upper is None else self.x_upper
        return smaller_side("x_ref", self.x_ref, lower=lower, upper=upper)


def level_from_inputs(K: ArrayLike, P: ArrayLike, u_max: ArrayLike) -> float:
    """Compute the largest level that keeps |K e| <= u_max: the chapter's (5.14).

    The formula is the corrected one; that of the chapter has P in place of P^-1.

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


@checked(alpha=a_number(finite=False, nan=True))
def input_excess(K: ArrayLike, P: ArrayLike, alpha: float, u_max: ArrayLike) -> Array:
    """Compute the largest value of each input on an ellipsoid, relative to its bound.

    Args:
        K: Gain, shape (nu, nx).
        P: Shape of the ellipsoid, (nx, nx), symmetric positive definite.
        alpha: Level of the ellipsoid, > 0.
        u_max: Room of each input around its reference (see `smaller_side`), shape
            (nu,), > 0.

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
