"""Lyapunov matrices P, for which e'Pe decreases along a stable loop by exactly e'Qe.

    continuous  F'P + PF = -Q      (5.12), corrected
    sampled     F'PF - P = -Q

Along e' = F e the function e'Pe changes at the rate e'(F'P + PF)e, so the first is the
equation to solve. With F = A - B K and Q* = Q + K'RK of an LQR, it gives the Riccati
matrix back. python-control solves both equations (method="scipy", as in lqr.py).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.terminal_set.linear.arrays import positive_semidefinite, square_matrix
from swarmstart.terminal_set.linear.reliability import reliable_solution
from swarmstart.terminal_set.linear.stability import CONTINUOUS, SAMPLED, require_stable


def continuous_lyapunov(F: ArrayLike, Q: ArrayLike) -> Array:
    """Solve F'P + PF = -Q, the corrected form of (5.12).

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
    F = square_matrix("F", F)
    Q = positive_semidefinite("Q", Q, len(F))
    require_stable(F, CONTINUOUS)
    import control

    P = np.asarray(control.lyap(F.T, Q, method="scipy"), dtype=np.float64)
    return reliable_solution("continuous Lyapunov", P, F.T @ P + P @ F + Q)


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
    F = square_matrix("F", F)
    Q = positive_semidefinite("Q", Q, len(F))
    require_stable(F, SAMPLED)
    import control

    P = np.asarray(control.dlyap(F.T, Q, method="scipy"), dtype=np.float64)
    return reliable_solution("sampled Lyapunov", P, F.T @ P @ F - P + Q)
