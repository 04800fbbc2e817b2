"""Radau IIA collocation: a polynomial that satisfies a differential equation.

Over an element of length h a state is a polynomial of degree d through its value X_0 at
the start and X_1 ... X_d at the points c_1 < ... < c_d = 1, which are the roots of
P_d-1 - P_d (Legendre, on [0, 1]). At each of these points the polynomial satisfies x' =
f(x):

    sum_j D_ij X_j = h f(X_i),   D = A^-1 (-1, I),   A_ij = integral_0^c_i l_j

The last point is the element's end. An integral over it is h sum_j b_j L(X_j) with b
the last row of A. The order is 2 d - 1; the method is L-stable.

Source: Hairer and Wanner (1996), Solving Ordinary Differential Equations II, IV.5.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.polynomial import legendre

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.common.expressions import shortened
from swarmstart.ocp.common.limits import require_count

Transcription = Literal["shooting", "radau"]
"""Name of a transcription, for modules that must know the names before any import."""
_MOST_POINTS = 9


@dataclass(frozen=True, kw_only=True, slots=True)
class Radau:
    """Settings of Radau IIA collocation in the polish.

    Attributes:
        points: Collocation points d in each element, 1 to 9; the order is 2 d - 1.
        elements: Number of elements from one check to the next; None: the integrator's
            number of substeps.

    Raises:
        InvalidProblemError: If a number is not allowed.

    Example:
        >>> import casadi as ca
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x"), ca.SX.sym("u")
        >>> problem = ss.OptimalControlProblem(
        ...     ss.Model(states=x, controls=u, ode=u - 50 * x),
        ...     horizon=1.0, intervals=4, transcription=ss.Radau(points=2),
        ... )
        >>> problem.collocation.points
        2
    """

    points: int = 3
    elements: int | None = None

    def __post_init__(self) -> None:
        """Validate the numbers."""
        require_count("points", self.points)
        if self.points > _MOST_POINTS:
            raise InvalidProblemError(
                f"points must be at most {_MOST_POINTS}, got {self.points}"
            )
        if self.elements is not None:
            require_count("elements", self.elements)


def as_transcription(given: object) -> Radau | None:
    """Return the collocation for a user's entry; None: multiple shooting.

    Raises:
        InvalidProblemError: If the entry is neither of the two.
    """
    if isinstance(given, Radau):
        return given
    if given == "radau":
        return Radau()
    if given is None or given == "shooting":
        return None
    raise InvalidProblemError(
        "transcription must be 'shooting', 'radau' or swarmstart.Radau(points=..., "
        f"elements=...), got {shortened(given)}"
    )


@dataclass(frozen=True, slots=True, eq=False)
class Coefficients:
    """Coefficients of collocation at d points.

    Attributes:
        times: Points c as fractions of the element, shape (d,).
        slopes: Matrix D, shape (d, d + 1), from the values at the start and at the
            points to the slopes at the points, times the length of the element.
        weights: Weights b of an integral, shape (d,).
    """

    times: Array
    slopes: Array
    weights: Array


def radau_coefficients(points: int) -> Coefficients:
    """Return the coefficients of Radau IIA collocation.

    Args:
        points: Number d of points, at least 1.
    """
    polynomial = np.zeros(points + 1)
    polynomial[-2:] = 1.0, -1.0
    # All roots are real; rounding may give them imaginary parts.
    roots = np.sort(legendre.legroots(polynomial).real)
    times = (1 + roots) / 2
    times[-1] = 1.0  # A root is exactly 1, which rounding may miss.
    powers = np.arange(points)
    grown = times[:, None] ** (powers + 1) / (powers + 1)
    # The integrals of l_j, from those of the powers.
    A = np.linalg.solve((times[:, None] ** powers).T, grown.T).T
    inverse = np.linalg.inv(A)
    slopes = np.hstack([-inverse.sum(axis=1, keepdims=True), inverse])
    return Coefficients(times, slopes, A[-1].copy())
