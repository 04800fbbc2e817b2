"""The linear system near a reference, in continuous time and with the input held.

    e' = A e + B du,    A = df/dx, B = df/du at (x_ref, u_ref)            (5.9)
    e+ = Ad e + Bd du,  [Ad Bd; 0 I] = exp([A B; 0 0] dt)

with e = x - x_ref, du = u - u_ref, and e+ the deviation after a time dt in which u is
held.

A reference may move, like the leader of a formation, so that f(x_ref, u_ref) is not
zero. The motion relative to it, with e' = f(x_ref + e, u_ref + du) - f(x_ref, u_ref),
is linearised. It has its equilibrium at e = 0 for any f(x_ref, u_ref), if the Jacobian
does not change along the reference (for a leader: f must not depend on positions, and
the leader's speed and heading must stay constant).

Source: (5.9) of the chapter (docs/chapter); the held system by Van Loan, IEEE Trans.
Automatic Control 23 (1978).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import a_number, checked, of_kind
from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.linear.arrays import (
    NotPositiveError,
    finite_array,
    read_only,
    square_matrix,
)
from swarmstart.terminal_set.linear.kept import Solution, kept
from swarmstart.terminal_set.linear.stability import SAMPLED, growth

EXPONENTIAL_LIMIT = 1e-9
"""Largest relative error of a kept exponential (Frobenius norms)."""
MOST_EXPONENT = 1e6
"""Largest sum of a row of a matrix whose exponential is kept."""


@dataclass(eq=False)
class InvalidDynamicsError(SwarmstartError, ValueError):
    """A function given as dynamics is not of the form f(x, u) -> xdot.

    Attributes:
        inputs: Shapes of its inputs.
        outputs: Shapes of its outputs.
    """

    inputs: list[tuple[int, int]]
    outputs: list[tuple[int, int]]

    def __str__(self) -> str:
        """Return a message with the required form and the given one."""
        return (
            "dynamics must map columns x (nx, 1), u (nu, 1) to xdot (nx, 1), but maps "
            f"{self.inputs} to {self.outputs}"
        )


@checked(dynamics=of_kind(ca.Function, "a casadi.Function"))
def linearise(
    dynamics: ca.Function, x_ref: ArrayLike, u_ref: ArrayLike
) -> tuple[Array, Array]:
    """Linearise the motion relative to a reference.

    Args:
        dynamics: f(x, u) -> xdot as a casadi.Function, SI units. Its value at the
            reference need not be zero: only the motion relative to the reference is
            linearised.
        x_ref: Reference state, shape (nx,).
        u_ref: Reference input, shape (nu,).

    Returns:
        A = df/dx of shape (nx, nx) and B = df/du of shape (nx, nu) at the reference,
        read-only.

    Raises:
        InvalidDynamicsError: If the function has other inputs or outputs.
        InvalidShapeError: If a reference has another size than the function's input.
        NotFiniteError: If a reference or a derivative there is NaN or infinite.
    """
    nx, nu = _sizes(dynamics)
    point = [finite_array("x_ref", x_ref, (nx,)), finite_array("u_ref", u_ref, (nu,))]
    x, u = ca.MX.sym("x", nx), ca.MX.sym("u", nu)
    xdot = dynamics(x, u)
    derivatives = ca.Function(
        "linearised", [x, u], [ca.jacobian(xdot, x), ca.jacobian(xdot, u)]
    )
    A, B = (matrix.full() for matrix in derivatives(*point))
    return (
        finite_array("the derivative df/dx at the reference", A, (nx, nx)),
        finite_array("the derivative df/du at the reference", B, (nx, nu)),
    )


@checked(dt=a_number(finite=False, nan=True))
def hold(A: ArrayLike, B: ArrayLike, dt: float) -> tuple[Array, Array]:
    """Sample a linear system whose input is held over each step (zero-order hold).

    Args:
        A: System matrix, shape (nx, nx), 1/s.
        B: Input matrix, shape (nx, nu).
        dt: Length of a step, > 0, s.

    Returns:
        Ad of shape (nx, nx) and Bd of shape (nx, nu), read-only.

    Raises:
        NotPositiveError: If dt is not positive and finite.
        NotFiniteError: If A or B holds NaN or infinity.
        InvalidShapeError: If A is not square or B has another number of rows.
    """
    block, nx = _block(A, B, dt)

    def solve() -> Solution:
        from scipy.linalg import expm  # Takes as long to import as CasADi and NumPy.

        return (np.asarray(expm(block)),)

    def solves(found: Solution) -> bool:
        return [one.shape for one in found] == [block.shape] and _is_exponential(
            found[0], block
        )

    (whole,) = kept("exponential", (block,), solve, solves)
    exponential = whole[:nx]  # The rows below are (0, I).
    return read_only(exponential[:, :nx].copy()), read_only(exponential[:, nx:].copy())


def _is_exponential(found: Array, block: Array) -> bool:
    """Return whether a matrix is exp(block), by a series and squaring."""
    largest = float(np.abs(block).sum(axis=1).max())
    if not largest < MOST_EXPONENT:  # Nothing is kept of it.
        return False
    halvings = max(0, int(np.ceil(np.log2(1e3 * (np.linalg.norm(block) + 1e-3)))))
    with np.errstate(over="ignore", invalid="ignore"):
        series = _series(block / 2.0**halvings)  # The next term is below 1e-17.
        for _ in range(halvings):
            series = series @ series
        error, size = np.linalg.norm(found - series), np.linalg.norm(series)
    return bool(error <= EXPONENTIAL_LIMIT * size)  # False if one is not finite.


def runge_kutta_hold(
    A: ArrayLike, B: ArrayLike, dt: float, *, substeps: int
) -> tuple[Array, Array]:
    """Sample a linear system by the classic Runge-Kutta method.

    One step equals the series of the exponential to fourth order.

    Args:
        A: System matrix, shape (nx, nx), 1/s.
        B: Input matrix, shape (nx, nu).
        dt: Length of a hold, > 0, s.
        substeps: Number of Runge-Kutta steps in a hold, at least 1.

    Returns:
        Ad of shape (nx, nx) and Bd of shape (nx, nu), read-only.

    Raises:
        NotPositiveError: If dt is not positive and finite.
        NotFiniteError: If A or B holds NaN or infinity, or so does the result.
        InvalidShapeError: If A is not square or B has another number of rows.
    """
    block, nx = _block(A, B, dt / substeps)
    with np.errstate(over="ignore", invalid="ignore"):  # An overflow is refused below.
        whole = np.linalg.matrix_power(_series(block), substeps)[:nx]
    whole = finite_array("the Runge-Kutta map of the hold", whole, whole.shape)
    return read_only(whole[:, :nx].copy()), read_only(whole[:, nx:].copy())


def _series(block: Array) -> Array:
    """Return I + M + M^2/2! + M^3/3! + M^4/4!, by Horner's rule."""
    series = one = np.eye(len(block))
    for order in (4, 3, 2, 1):
        series = one + block @ series / order
    return series


def _block(A: ArrayLike, B: ArrayLike, dt: float) -> tuple[Array, int]:
    """Return ((A, B), (0, 0)) dt, the system with its input as a constant; and nx."""
    if not 0 < dt < np.inf:
        raise NotPositiveError("dt", dt)
    A = square_matrix("A", A)
    nx = len(A)
    B = finite_array("B", B, (nx, None))
    block = np.zeros((nx + B.shape[1],) * 2)
    block[:nx, :nx] = A
    block[:nx, nx:] = B
    return block * dt, nx


@checked(dt=a_number(finite=False, nan=True))
def held_spectral_radius(A: ArrayLike, B: ArrayLike, K: ArrayLike, dt: float) -> float:
    """Compute the spectral radius of a gain whose input is held: max |eig(Ad - Bd K)|.

    A gain designed in continuous time may be unstable when held: the radius is then at
    least 1.

    Args:
        A: System matrix, shape (nx, nx), 1/s.
        B: Input matrix, shape (nx, nu).
        K: Gain of du = -K e, shape (nu, nx).
        dt: Length of a step, > 0, s.

    Returns:
        The factor by which the slowest mode shrinks (or grows) per step.

    Raises:
        NotPositiveError: If dt is not positive and finite.
        NotFiniteError: If a matrix holds NaN or infinity.
        InvalidShapeError: If the sizes of the matrices do not agree.
    """
    Ad, Bd = hold(A, B, dt)
    return growth(Ad - Bd @ finite_array("K", K, Bd.T.shape), SAMPLED)


def _sizes(dynamics: ca.Function) -> tuple[int, int]:
    """Return nx and nu of f(x, u) -> xdot, or refuse the function."""
    inputs = [dynamics.size_in(index) for index in range(dynamics.n_in())]
    outputs = [dynamics.size_out(index) for index in range(dynamics.n_out())]
    # Columns x, u and xdot; x and xdot must have the same size.
    if not ([columns for _, columns in inputs] == [1, 1] and outputs == inputs[:1]):
        raise InvalidDynamicsError(inputs, outputs)
    return inputs[0][0], inputs[1][0]
