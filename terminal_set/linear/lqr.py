"""Linear-quadratic regulators: the gain K and the Riccati matrix P.

    continuous  min int e'Qe + du'R du dt   A'P + PA - PBK + Q = 0,  K = R^-1 B'P
    sampled     min sum e'Qe + du'R du      A'P(A - BK) - P + Q = 0,
                                            K = (R + B'PB)^-1 B'PA
    du = -K e

The chapter writes the feedback as u = K x (5.10), so its K is the negative of this one.

python-control solves the Riccati equation, always with method="scipy": with slycot
installed its default would be another solver with other errors. It may return a matrix
although no gain exists (a unicycle at rest, Q = 0). So the conditions for a gain to
exist are tested before, and the solution is checked after.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.terminal_set.linear.arrays import (
    finite_array,
    positive_definite,
    positive_semidefinite,
    read_only,
    square_matrix,
)
from swarmstart.terminal_set.linear.reliability import (
    RESIDUAL_LIMIT,
    UnreliableSolutionError,
    reliable_solution,
)
from swarmstart.terminal_set.linear.stability import (
    CONTINUOUS,
    SAMPLED,
    ComplexArray,
    TimeDomain,
    require_stabilisable,
    require_weighted,
)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Gain:
    """A stabilising gain, its Riccati matrix and eigenvalues; arrays are read-only.

    Attributes:
        K: Gain of du = -K e, shape (nu, nx).
        P: Riccati solution: e'Pe is the cost to go, shape (nx, nx), symmetric positive
            definite.
        eigenvalues: Eigenvalues of the closed loop A - B K, shape (nx,); in 1/s if
            continuous.
    """

    K: Array
    P: Array
    eigenvalues: ComplexArray


def continuous_lqr(A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike) -> Gain:
    """Design the gain that minimises int e'Qe + du'R du dt for e' = A e + B du.

    Args:
        A: System matrix, shape (nx, nx), 1/s.
        B: Input matrix, shape (nx, nu).
        Q: State weight, shape (nx, nx), symmetric positive semidefinite.
        R: Input weight, shape (nu, nu), symmetric positive definite.

    Returns:
        The gain, its Riccati matrix and the poles of the loop.

    Raises:
        InvalidShapeError: If the sizes of the matrices do not agree.
        NotFiniteError: If a matrix holds NaN or infinity.
        AsymmetricMatrixError: If Q or R is not symmetric.
        IndefiniteMatrixError: If Q or R has an eigenvalue of the wrong sign.
        NotStabilisableError: If no input reaches a mode that does not decay.
        UnweightedModeError: If Q does not see a mode on the boundary of stability.
        UnreliableSolutionError: If the Riccati solution fails a check.
    """
    return _design(A, B, Q, R, CONTINUOUS)


def sampled_lqr(Ad: ArrayLike, Bd: ArrayLike, Q: ArrayLike, R: ArrayLike) -> Gain:
    """Design the gain that minimises sum e'Qe + du'R du for e+ = Ad e + Bd du.

    Args:
        Ad: System matrix of one step, shape (nx, nx).
        Bd: Input matrix of one step, shape (nx, nu).
        Q: State weight per step, shape (nx, nx), symmetric positive semidefinite.
        R: Input weight per step, shape (nu, nu), symmetric positive definite.

    Returns:
        The gain, its Riccati matrix and the multipliers of the loop.

    Raises:
        InvalidShapeError: If the sizes of the matrices do not agree.
        NotFiniteError: If a matrix holds NaN or infinity.
        AsymmetricMatrixError: If Q or R is not symmetric.
        IndefiniteMatrixError: If Q or R has an eigenvalue of the wrong sign.
        NotStabilisableError: If no input reaches a mode that does not decay.
        UnweightedModeError: If Q does not see a mode on the boundary of stability.
        UnreliableSolutionError: If the Riccati solution fails a check.
    """
    return _design(Ad, Bd, Q, R, SAMPLED)


def _design(
    A: ArrayLike, B: ArrayLike, Q: ArrayLike, R: ArrayLike, domain: TimeDomain
) -> Gain:
    """Check the problem, solve it, check the answer."""
    A = square_matrix("A", A)
    B = finite_array("B", B, (len(A), None))
    Q = positive_semidefinite("Q", Q, len(A))
    R = positive_definite("R", R, B.shape[1])
    require_stabilisable(A, B, domain)
    require_weighted(A, Q, domain)

    equation = f"{domain.name} Riccati"
    try:
        K, P = _solve((A, B, Q, R), domain)
    # The solver gives up in these ways.
    except (np.linalg.LinAlgError, ValueError) as error:
        quantity = "|residual| / |P|"
        raise UnreliableSolutionError(
            equation, quantity, np.inf, RESIDUAL_LIMIT
        ) from error
    F = A - B @ K
    eigenvalues = np.linalg.eigvals(F).astype(np.complex128)
    largest = float(np.max(domain.growth(eigenvalues)))
    if not largest < domain.limit:
        quantity = f"the {domain.measure} of A - B K"
        raise UnreliableSolutionError(equation, quantity, largest, domain.limit)
    residual = A.T @ P + P @ F + Q if domain is CONTINUOUS else A.T @ P @ F - P + Q
    eigenvalues.setflags(write=False)
    return Gain(
        K=read_only(K),
        P=reliable_solution(equation, P, residual),
        eigenvalues=eigenvalues,
    )


def _solve(matrices: tuple[Array, ...], domain: TimeDomain) -> tuple[Array, Array]:
    """Return K and P by python-control, whose import takes about a second."""
    import control

    design = control.lqr if domain is CONTINUOUS else control.dlqr
    K, P, _ = design(*matrices, method="scipy")
    return K, P
