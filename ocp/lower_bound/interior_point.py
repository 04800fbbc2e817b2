"""Linear programs with few unknowns and many rows, by an interior-point method.

    maximise c'w  subject to  A w + b >= 0

w are the unknowns. Mehrotra's predictor and corrector work on the normal equations,
which have no more unknowns than w: an iteration costs one product A'DA with a diagonal
matrix D. The method ends near the centre of the optimal set, not at a vertex, so that
the polynomial changes little from one round (subsolution.py) to the next. Measured on
the programs of this package (10,000 rows, 84 unknowns) it takes a fifth of the time of
HiGHS.

Source: Mehrotra (1992), On the implementation of a primal-dual interior point method.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg

from swarmstart.arrays import Array
from swarmstart.machine_code import done

RIDGE = 1e-14
LARGEST_RIDGE = 1e-4
_PER_ITERATION, _PER_ENTRY = 5e5, 0.25
"""Work of an iteration, in operations, and for each row and pair of unknowns."""
STEP = 0.995
FEASIBLE = 1e-8
DIVERGED = 1e100
"""Size of an iterate above which the program certainly has no optimum."""


class Optimum(NamedTuple):
    """The answer to a linear program.

    Attributes:
        w: The unknowns.
        duals: Dual variables of the rows, >= 0.
        gap: Complementarity, an upper bound of the distance of c'w from the optimum.
        solved: Whether primal and dual constraints hold to rounding.
    """

    w: Array
    duals: Array
    gap: float
    solved: bool


@np.errstate(over="ignore", divide="ignore", invalid="ignore")
def maximised(
    c: Array, A: Array, b: Array, *, tolerance: float = 1e-6, iterations: int = 150
) -> Optimum:
    """Solve a linear program from a cold start.

    Args:
        c: Objective, shape (m,).
        A: Matrix of the rows, shape (N, m), of rank m; bounds of all unknowns, as rows,
            ensure this rank.
        b: Offsets of the rows, shape (N,).
        tolerance: Tolerance of the gap, in units of the objective.
        iterations: Largest number of iterations.
    """
    # Rows of equal size, so that one tolerance serves all of them.
    sizes = 1.0 / np.maximum(np.abs(A).max(axis=1), 1e-12)
    A, b = A * sizes[:, None], b * sizes
    rows, m = A.shape
    w = np.zeros(m)
    s = b.copy()
    # The method needs positive slacks from the start, not feasible ones.
    s += max(0.0, 1e-2 - 1.5 * float(s.min()))
    z = np.full(rows, 10.0 / rows)
    gap, solved = np.inf, False
    for _ in range(iterations):
        done(_PER_ITERATION + _PER_ENTRY * rows * m * m)
        short, dual = A @ w + b - s, c + A.T @ z
        gap = float(s @ z)
        solved = bool(
            np.abs(short).max() < FEASIBLE
            and np.abs(dual).max() < 10 * FEASIBLE * (1 + np.abs(c).max())
        )
        if gap < tolerance and solved:
            break
        try:
            newton = _Newton(A, s, z, short, dual)
        except scipy.linalg.LinAlgError:
            break
        dw, ds, dz = newton.step(-z * s)
        far_s, far_z = _longest(ds, s), _longest(dz, z)
        after = float((s + far_s * ds) @ (z + far_z * dz))
        # Mehrotra's choice: the better the predictor, the less centring.
        center = (max(after, 0.0) / gap) ** 3 * gap / rows
        # ds dz is the part of second order that the predictor leaves out.
        dw, ds, dz = newton.step(center - z * s - ds * dz)
        far_s = min(1.0, STEP * _longest(ds, s))
        far_z = min(1.0, STEP * _longest(dz, z))
        moved = (w + far_s * dw, s + far_s * ds, z + far_z * dz)
        if not all((np.abs(part) < DIVERGED).all() for part in moved):
            break
        w, s, z = moved
    # Of the rows as given: z belongs to the scaled ones.
    return Optimum(w, z * sizes, gap, solved)


def _longest(step: Array, value: Array) -> float:
    """Return the longest step that keeps values positive, at most 1."""
    worst = float((-step / value).max())
    return 1.0 if worst <= 1.0 else 1.0 / worst


class _Newton:
    """The factorised normal equations of one iteration."""

    def __init__(self, A: Array, s: Array, z: Array, short: Array, dual: Array) -> None:
        self._A, self._s, self._z = A, s, z
        self._short, self._dual = short, dual
        self._weights = z / s
        weighted = A * np.sqrt(self._weights)[:, None]
        normal = weighted.T @ weighted
        # A diagonal of ones, so that one ridge suits all unknowns.
        self._sizes = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
        normal *= self._sizes[:, None] * self._sizes
        diagonal, ridge = np.diag_indices(len(normal)), RIDGE
        while ridge < LARGEST_RIDGE:
            normal[diagonal] += ridge
            try:
                self._factor = scipy.linalg.cho_factor(normal, check_finite=False)
                return
            except scipy.linalg.LinAlgError:
                # Cholesky fails if the rows hardly determine some unknown.
                ridge *= 10.0
        raise scipy.linalg.LinAlgError("the normal equations are singular")

    def _solved(self, right: Array) -> Array:
        inner = scipy.linalg.cho_solve(
            self._factor, self._sizes * right, check_finite=False
        )
        return np.asarray(self._sizes * inner)

    def step(self, wanted: Array) -> tuple[Array, Array, Array]:
        """Return steps of w, of s = A w + b and of the duals z for a change of z s.

        Args:
            wanted: Wanted change of the product z s of each row, shape (N,).
        """
        pushed = (wanted - self._z * self._short) / self._s
        right = self._dual + self._A.T @ pushed
        dw = self._solved(right)
        # The normal equations lose half of the digits; one refinement restores some.
        left = self._A.T @ (self._weights * (self._A @ dw))
        dw = dw + self._solved(right - left)
        ds = self._A @ dw + self._short
        return dw, ds, (wanted - self._z * ds) / self._s
