"""Riccati and Lyapunov equations: the gain K of an LQR, and matrices P.

Linear-quadratic regulators du = -K e, with weights Q and R, for e' = A e + B du
(continuous) or e+ = A e + B du (sampled):

    continuous  min int e'Qe + du'R du dt   A'P + PA - PBK + Q = 0,  K = R^-1 B'P
    sampled     min sum e'Qe + du'R du      A'P(A - BK) - P + Q = 0,
                                            K = (R + B'PB)^-1 B'PA

The chapter (docs/chapter) writes the feedback as u = K x (5.10), so its K is the
negative of this one.

Lyapunov matrices P, for which e'Pe decreases along a stable loop e' = F e or e+ = F e
by exactly e'Qe, per second or per step:

    continuous  F'P + PF = -Q      the chapter's (5.12), corrected
    sampled     F'PF - P = -Q

Along e' = F e the function e'Pe changes at the rate e'(F'P + PF)e, so the first of the
two is the equation for a continuous loop. With F = A - B K of an LQR, and Q + K'RK in
place of Q, the solution of either equation is the Riccati matrix.

python-control solves all equations, now or in an earlier process (`kept.py`), always
with method="scipy": if slycot is installed, the default of python-control is another
solver with other errors. python-control returns a matrix even if no useful one exists:
for a unicycle at rest and Q = 0 a "gain" that leaves a mode at modulus 1, for an
unstable loop a negative definite P. So the conditions under which a gain or a P exists
are tested first, and the residual of every solution is checked afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.linear.arrays import (
    finite_array,
    positive_definite,
    positive_semidefinite,
    read_only,
    square_matrix,
)
from swarmstart.terminal_set.linear.kept import Solution, kept
from swarmstart.terminal_set.linear.stability import (
    CONTINUOUS,
    SAMPLED,
    ComplexArray,
    TimeDomain,
    growth,
    require_stabilisable,
    require_stable,
    require_weighted,
)

CONDITION_LIMIT = 1e10
RESIDUAL_LIMIT = 1e-8
"""Largest |residual| / |P|, and largest |P - P'| / |P| (Frobenius norms)."""


@dataclass(eq=False)
class UnreliableSolutionError(SwarmstartError, ArithmeticError):
    """A matrix equation has no reliable solution.

    Attributes:
        equation: Name of the equation.
        quantity: Name of the checked quantity.
        value: Value of the checked quantity; infinite if the solver failed.
        limit: Upper limit of the quantity; for the smallest eigenvalue, its lower
            limit.
    """

    equation: str
    quantity: str
    value: float
    limit: float

    def __str__(self) -> str:
        """Return a message with the failed check and its value."""
        return (
            f"the {self.equation} equation has no reliable solution: "
            f"{self.quantity} is {self.value:.9g}, the limit is {self.limit:.9g}"
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
    """Return K and P by python-control, or kept ones that it computed before."""

    def solve() -> Solution:
        import control  # Takes about a second.

        design = control.lqr if domain is CONTINUOUS else control.dlqr
        K, P, _ = design(*matrices, method="scipy")
        return np.asarray(K), np.asarray(P)

    def solves(found: Solution) -> bool:
        return _is_gain(found, matrices, domain)

    K, P = kept(f"{domain.name} Riccati", matrices, solve, solves)
    return K, P


def _is_gain(found: Solution, matrices: tuple[Array, ...], domain: TimeDomain) -> bool:
    """Return whether (K, P) stabilises and solves both equations at the module's head.

    The Riccati equation has one solution that stabilises, so there is no other pair.
    """
    A, B, Q, R = matrices
    if [one.shape for one in found] != [B.T.shape, A.shape]:
        return False
    K, P = found
    if not (np.isfinite(K).all() and np.isfinite(P).all() and P.any()):
        return False
    F = A - B @ K
    if domain is CONTINUOUS:
        residual, gain = A.T @ P + P @ F + Q, R @ K - B.T @ P
    else:
        residual = A.T @ P @ F - P + Q
        gain = R @ K - B.T @ P @ F
    size = float(np.linalg.norm(P))
    return (
        _is_small(residual, size)
        and _is_small(gain, float(np.linalg.norm(R @ K) + np.linalg.norm(B.T @ P)))
        and growth(F, domain) < domain.limit
    )


def _is_small(residual: Array, size: float) -> bool:
    return bool(np.linalg.norm(residual) <= RESIDUAL_LIMIT * size)


def continuous_lyapunov(F: ArrayLike, Q: ArrayLike) -> Array:
    """Solve F'P + PF = -Q, the corrected form of the chapter's (5.12).

    Args:
        F: Stable loop e' = F e, shape (nx, nx), 1/s.
        Q: Decrease of e'Pe per second, shape (nx, nx), symmetric positive semidefinite.

    Returns:
        P, shape (nx, nx), symmetric positive definite, read-only.

    Raises:
        InvalidShapeError: If F is not square or Q is of another size.
        NotFiniteError: If F or Q holds NaN or infinity.
        AsymmetricMatrixError: If Q is not symmetric.
        IndefiniteMatrixError: If Q has a negative eigenvalue.
        UnstableLoopError: If F does not decay.
        UnreliableSolutionError: If P fails a check.
    """
    return _lyapunov(F, Q, CONTINUOUS)


def sampled_lyapunov(F: ArrayLike, Q: ArrayLike) -> Array:
    """Solve F'PF - P = -Q, the equation for a loop with held inputs.

    Args:
        F: Stable loop e+ = F e, shape (nx, nx).
        Q: Decrease of e'Pe per step, shape (nx, nx), symmetric positive semidefinite.

    Returns:
        P, shape (nx, nx), symmetric positive definite, read-only.

    Raises:
        InvalidShapeError: If F is not square or Q is of another size.
        NotFiniteError: If F or Q holds NaN or infinity.
        AsymmetricMatrixError: If Q is not symmetric.
        IndefiniteMatrixError: If Q has a negative eigenvalue.
        UnstableLoopError: If F does not decay.
        UnreliableSolutionError: If P fails a check.
    """
    return _lyapunov(F, Q, SAMPLED)


def _lyapunov(F: ArrayLike, Q: ArrayLike, domain: TimeDomain) -> Array:
    """Return P by python-control, or a kept one that it computed before."""
    F = square_matrix("F", F)
    Q = positive_semidefinite("Q", Q, len(F))
    require_stable(F, domain)
    equation = f"{domain.name} Lyapunov"

    def solve() -> Solution:
        import control  # Takes about a second.

        # It solves A X + X A' = -Q, or A X A' - X = -Q.
        solver = control.lyap if domain is CONTINUOUS else control.dlyap
        return (np.asarray(solver(F.T, Q, method="scipy"), dtype=np.float64),)

    def residual(P: Array) -> Array:
        if domain is CONTINUOUS:
            return np.asarray(F.T @ P + P @ F + Q)
        return np.asarray(F.T @ P @ F - P + Q)

    def solves(found: Solution) -> bool:
        # For a stable loop the solution is unique.
        return [one.shape for one in found] == [F.shape] and _is_small(
            residual(found[0]), float(np.linalg.norm(found[0]))
        )

    (P,) = kept(equation, (F, Q), solve, solves)
    return reliable_solution(equation, P, residual(P))


def reliable_solution(equation: str, P: Array, residual: Array) -> Array:
    """Check that P is symmetric, positive definite, well conditioned and a solution.

    Args:
        equation: Name of the equation in errors.
        P: The solution, shape (nx, nx).
        residual: Residual of the equation at P, shape (nx, nx).

    Returns:
        P, made symmetric to the last bit, as a read-only copy.

    Raises:
        UnreliableSolutionError: If one of the four checks fails.
    """
    norm = float(np.linalg.norm(P))
    if not np.isfinite(norm):
        raise UnreliableSolutionError(equation, "|P|", norm, np.inf)
    eigenvalues = np.linalg.eigvalsh((P + P.T) / 2)
    if not eigenvalues[0] > 0:
        quantity = "the smallest eigenvalue of P"
        raise UnreliableSolutionError(equation, quantity, float(eigenvalues[0]), 0.0)
    measured = {
        "|P - P'| / |P|": (np.linalg.norm(P - P.T) / norm, RESIDUAL_LIMIT),
        "the condition of P": (eigenvalues[-1] / eigenvalues[0], CONDITION_LIMIT),
        "|residual| / |P|": (np.linalg.norm(residual) / norm, RESIDUAL_LIMIT),
    }
    for quantity, (value, limit) in measured.items():
        if not value < limit:
            raise UnreliableSolutionError(equation, quantity, float(value), limit)
    return read_only((P + P.T) / 2)
