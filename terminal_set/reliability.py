"""Checks of the solutions of matrix equations.

SciPy's solvers return a matrix also if no useful one exists: for a unicycle at rest
a "gain" that leaves a mode at modulus 1, for an unstable loop a negative definite P. So
every solution is put back into its equation and measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.arrays import Array, read_only

CONDITION_LIMIT = 1e10
RESIDUAL_LIMIT = 1e-8
"""Largest |residual| / |P|, and largest |P - P'| / |P| (Frobenius norms)."""


@dataclass(eq=False)
class UnreliableSolutionError(SwarmstartError, ArithmeticError):
    """A matrix equation has no solution, or none that can be trusted.

    Attributes:
        equation: Name of the equation.
        quantity: What was measured.
        value: Its value; infinite where the solver gave up.
        limit: What it must stay below (above, for the smallest eigenvalue).
    """

    equation: str
    quantity: str
    value: float
    limit: float

    def __str__(self) -> str:
        """Say which check failed and by how much."""
        return (
            f"the {self.equation} equation has no reliable solution: "
            f"{self.quantity} is {self.value:.9g}, the limit is {self.limit:.9g}"
        )


def reliable_solution(equation: str, P: Array, residual: Array) -> Array:
    """Check that P is symmetric, positive definite, well conditioned and a solution.

    Args:
        equation: What an error calls the equation.
        P: The solution, shape (nx, nx).
        residual: What is left of the equation with P put in, shape (nx, nx).

    Returns:
        P, made symmetric to the last bit, as a read-only copy.

    Raises:
        UnreliableSolutionError: If one of the four does not hold.
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
