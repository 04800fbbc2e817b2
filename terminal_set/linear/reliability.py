"""Checks of the solutions of matrix equations.

The solvers return a matrix even if no useful one exists: for a unicycle at rest a
"gain" that leaves a mode at modulus 1, for an unstable loop a negative definite P. So
the residual of every solution is checked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.linear.arrays import read_only

CONDITION_LIMIT = 1e10
RESIDUAL_LIMIT = 1e-8
"""Largest |residual| / |P|, and largest |P - P'| / |P| (Frobenius norms)."""


@dataclass(eq=False)
class UnreliableSolutionError(SwarmstartError, ArithmeticError):
    """A matrix equation has no reliable solution.

    Attributes:
        equation: Name of the equation.
        quantity: Name of the checked quantity.
        value: Its value; infinite if the solver failed.
        limit: Its upper limit (for the smallest eigenvalue, its lower limit).
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
