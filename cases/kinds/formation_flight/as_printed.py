"""The terminal set as the chapter prints it: errata, kept for measurements.

    (5.12)  FP + PF' = -Q
    (5.14)  alpha K'PK <= u_max^2

The first is the Lyapunov equation of the transposed loop: the ellipsoid of its solution
need not be invariant for the loop itself. The two sides of the second do not conform;
read as alpha K P K' they do, but P stands in the place of its inverse, and no input is
bounded. `terminal_set.input_excess` returns the excess over the bounds. The correct
formulas are in the heads of `lyapunov.py` and `level.py` in `terminal_set/linear`.
"""

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.terminal_set import (
    Reference,
    TerminalSet,
    continuous_lqr,
    continuous_lyapunov,
    linearise,
)
from swarmstart.terminal_set.linear import bound_array, finite_array, positive_definite


def lyapunov_as_printed(F: ArrayLike, Q: ArrayLike) -> Array:
    """Solve FP + PF' = -Q, (5.12) as printed.

    Args:
        F: Stable loop e' = F e, shape (nx, nx), 1/s.
        Q: The chapter's Q*, shape (nx, nx), symmetric positive semidefinite.

    Returns:
        P, shape (nx, nx), symmetric positive definite, read-only.

    Raises:
        SwarmstartError: As in `continuous_lyapunov`.
    """
    return continuous_lyapunov(np.transpose(F), Q)


def level_as_printed(K: ArrayLike, P: ArrayLike, u_max: ArrayLike) -> float:
    """Compute the level of (5.14) as printed.

    Args:
        K: Gain, shape (nu, nx).
        P: Shape of the ellipsoid, (nx, nx), symmetric positive definite.
        u_max: Room of each input around its reference, shape (nu,), > 0.

    Returns:
        alpha = min_i u_max_i^2 / (K_i P K_i').

    Raises:
        SwarmstartError: If sizes do not agree, a number is not finite, or P is not
            positive definite.
    """
    P = positive_definite("P", P)
    K = finite_array("K", K, (None, len(P)))
    room = bound_array("u_max", u_max, (len(K),))
    return float(np.min(room**2 / np.einsum("ij,jk,ik->i", K, P, K)))


def terminal_set_as_printed(
    dynamics: ca.Function,
    reference: Reference,
    *,
    Q: ArrayLike,
    R: ArrayLike,
    P: ArrayLike,
) -> TerminalSet:
    """Design the terminal set as the chapter prints it.

    Args:
        dynamics: f(x, u) -> xdot, SI units.
        reference: Reference and bounds; (5.14) uses those of the input only.
        Q: State weight, shape (nx, nx), symmetric positive semidefinite.
        R: Input weight, shape (nu, nu), symmetric positive definite.
        P: The matrix printed in section 5.2.4, or that of `lyapunov_as_printed`, shape
            (nx, nx), symmetric positive definite.

    Returns:
        K of the continuous Riccati equation, P as given, alpha of (5.14) as printed.
        Its law can exceed the input bounds in the set, and can be unstable when held
        (`held_spectral_radius`).

    Raises:
        SwarmstartError: As in `linearise`, `continuous_lqr` and `level_as_printed`.
    """
    A, B = linearise(dynamics, reference.x_ref, reference.u_ref)
    K = continuous_lqr(A, B, Q, R).K
    return TerminalSet(
        K=K,
        P=finite_array("P", P, A.shape),
        alpha=level_as_printed(K, P, reference.u_max),
        x_ref=reference.x_ref,
        u_ref=reference.u_ref,
        dt=None,
        design="literal",
    )
