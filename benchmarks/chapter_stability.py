"""Eigenvalues of the receding horizon with p = 1 about the slot, in closed form.

A follower and a leader that flies straight at speed v. The error is the follower's
state less the leader's, less the slot; the follower holds an acceleration a and a turn
rate w over a step of T seconds and minimises the cost at its end,

    e = (dv, dpsi, dx, dy),   J = e+'Q e+,   Q = diag(q1, q2, q3, q4)

Linearised about straight flight in the slot, no bound active,

    dv+   = dv + a T          dx+ = dx + dv T + a T^2/2
    dpsi+ = dpsi + w T        dy+ = dy + v dpsi T + v w T^2/2

Both are the same pair, with (r, s, u, c) = (dv, dx, a T, T) or (dpsi, dy, w T, v T):

    r+ = r + u,   s+ = s + c r + c u/2,   u = argmin q r+^2 + p s+^2

Where the derivative by u is zero, and with u eliminated,

    q r+ + p (c/2) s+ = 0                                                   (1)
    s+ - (c/2) r+ = s + (c/2) r                                             (2)

By (1) every step ends on one line, so an eigenvalue is 0. On that line (r, s) is a
multiple m of (-p c/2, q), and (2) reads (q + p c^2/4) m+ = (q - p c^2/4) m:

    longitudinal  {0, (q1 - q3 T^2/4)     / (q1 + q3 T^2/4)}
    lateral       {0, (q2 - q4 v^2 T^2/4) / (q2 + q4 v^2 T^2/4)}

The second, lambda, is inside (-1, 1) if and only if q > 0 and p > 0: with q1 to q4 > 0
the slot is asymptotically stable, for any T and v. It is -1 for q = 0 (position only:
marginal, dv and dpsi change sign for ever) and 1 for p = 0 (the slot is not sought). It
is 0 at c = 2 sqrt(q/p), and towards -1 as c grows: where v T is large the follower
rings, with 1 - |lambda| about 8 q / (p c^2). From step to step a pair's J is multiplied
by lambda^2.

What this describes. J is a sum over the followers, and where the leader flies straight
each is this system by itself. The nonlinear closed loop has these eigenvalues too: J is
0 in the slot, so that its minimiser there is differentiable and has the gain above. It
is local: headings are not wrapped, a follower may stay a whole turn off.

A free leader is another system. J and, to first order, the errors depend on differences
only; but a manoeuvre that all fly together costs nothing, need not be small and changes
the matrices above. The joint minimum takes the one that leaves the least J. That
depends on the direction of the errors, not on their size: J is at most that with the
leader straight, the differences are others, and the closed loop has no linearisation.
"""

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp import InvalidProblemError

WEIGHTS = 4


def longitudinal_eigenvalues(weights: ArrayLike, *, dt: float) -> Array:
    """Return 0 and (q1 - q3 T^2/4) / (q1 + q3 T^2/4), of (dv, dx), shape (2,).

    Args:
        weights: Diagonal of Q, of v, psi, x and y, shape (4,), at least 0.
        dt: T [s].

    Raises:
        InvalidProblemError: If a weight is negative, T is not positive, a number is not
            finite, or q1 and q3 are both 0: no acceleration is better than another.
    """
    q1, _, q3, _ = _checked_weights(weights)
    return _eigenvalues(q1, q3, reach=_positive("dt", dt), names="q1 and q3")


def lateral_eigenvalues(weights: ArrayLike, *, speed: float, dt: float) -> Array:
    """Return 0 and (q2 - q4 v^2 T^2/4) / (q2 + q4 v^2 T^2/4), of (dpsi, dy).

    Args:
        weights: Diagonal of Q, of v, psi, x and y, shape (4,), at least 0.
        speed: The leader's, v [m/s].
        dt: T [s].

    Returns:
        Shape (2,).

    Raises:
        InvalidProblemError: If a weight is negative, v or T is not positive, a number
            is not finite, or q2 and q4 are both 0: no turn is better than another.
    """
    _, q2, _, q4 = _checked_weights(weights)
    reach = _positive("speed", speed) * _positive("dt", dt)
    return _eigenvalues(q2, q4, reach=reach, names="q2 and q4")


def _eigenvalues(q: float, p: float, *, reach: float, names: str) -> Array:
    """Return 0 and lambda of a pair; reach is its c."""
    # Then J does not depend on u, and lambda is 0/0.
    if q == p == 0.0:
        raise InvalidProblemError(
            f"weights must not have both {names} 0, got {q:g} and {p:g}"
        )
    seen = p * (reach / 2) ** 2
    # By (1) and (2), with c the reach.
    return np.array([0.0, (q - seen) / (q + seen)])


def _checked_weights(weights: ArrayLike) -> list[float]:
    q = np.asarray(weights, dtype=np.float64)
    if q.shape != (WEIGHTS,):
        raise InvalidProblemError(f"weights must have shape (4,), got {q.shape}")
    if not (np.isfinite(q).all() and (q >= 0).all()):
        raise InvalidProblemError(f"weights must be finite and at least 0, got {q}")
    return [float(weight) for weight in q]


def _positive(name: str, value: float) -> float:
    if not (np.isfinite(value) and value > 0):
        raise InvalidProblemError(f"{name} must be finite and positive, got {value}")
    return value
