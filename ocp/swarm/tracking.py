"""Linear law that keeps a disturbed vehicle near its plan, and how near.

Along each axis a vehicle is a double integrator that is pushed by an unknown w(t) with
|w(t)| <= w. It holds a - K e in each step of h seconds: the acceleration a of its plan,
and K, the gain of the sampled LQR, times the error e = (position, velocity) at the
beginning of the step. With F = A - B K,

    e_{k+1} = F e_k + g_k,    g_k = integral of (t, 1) w(h - t) dt over [0, h],

from e_0 = 0. So for every row c (a position, a velocity, or K)

    |c e_k| <= sum over i of w * integral of |c F^i (t, 1)| dt,

and what is left after m terms is bounded in the norm of P, in which F contracts:
F' P F = P - Q - K' R K. Within a step the position keeps to its chord within
(|K e| + w) h^2 / 8, as the error has no larger second derivative.

Source: Kolmanovsky and Gilbert (1998), Theory and computation of disturbance invariant
sets, Mathematical Problems in Engineering 4 (the sum over F^i).
"""

from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.terminal_set import Gain, sampled_lqr

ERROR_WEIGHT, PUSH_WEIGHT = np.eye(2), 0.1 * np.eye(1)
"""Weights Q of the error [1/m^2, s^2/m^2] and R of the correction [s^4/m^2]."""
TERMS = 400
"""Number of terms that are summed; the others are bounded."""
ROUNDING = 1e-9
"""Relative increase of sums, more than their rounding."""


class Tracking(NamedTuple):
    """Law that follows a plan, and bounds of its errors along each axis.

    Attributes:
        gain: Gain K on the error e of position and velocity, shape (2,) [1/s^2, 1/s].
        position: Largest error of the position at all times [m].
        velocity: Largest error of the velocity at all times [m/s].
        correction: Largest size of the correction K e [m/s^2].
    """

    gain: Array
    position: float
    velocity: float
    correction: float

    def distance(self, scale: Array) -> float:
        """Return the largest scaled distance of a vehicle from its plan [m]."""
        return self.position * float(np.linalg.norm(scale))


EXACT = Tracking(np.zeros(2), 0.0, 0.0, 0.0)
"""Law of vehicles without a disturbance, which follow their plans as they are."""


def tracking_of(disturbance: float, step_s: float) -> Tracking:
    """Return the tracking law, with bounds of its errors.

    Args:
        disturbance: Largest size w of the disturbance along an axis [m/s^2].
        step_s: Time h for which an acceleration is held [s].
    """
    if disturbance == 0.0:
        return EXACT
    h = step_s
    A, B = np.array([[1.0, h], [0.0, 1.0]]), np.array([[h**2 / 2.0], [h]])
    law = sampled_lqr(A, B, ERROR_WEIGHT, PUSH_WEIGHT)
    F = A - B @ law.K
    position, velocity, push = (
        disturbance * _largest(row, F, law, h) for row in (*np.eye(2), law.K[0])
    )
    return Tracking(
        gain=law.K[0],
        position=position + (push + disturbance) * h**2 / 8.0,
        velocity=velocity + (push + disturbance) * h,
        correction=push,
    )


def _largest(row: Array, F: Array, law: Gain, h: float) -> float:
    """Return a bound of |c e_k| for all k and all disturbances of size 1."""
    total, left = 0.0, row.copy()
    for _ in range(TERMS):
        total += _integral(float(left[0]), float(left[1]), h)
        left = left @ F
    # |c F^j g| <= |c|* |F|^j |g| in the norm of P and its dual.
    Q = ERROR_WEIGHT + law.K.T @ PUSH_WEIGHT @ law.K
    shrinking = 1.0 - np.linalg.eigvalsh(Q)[0] / np.linalg.eigvalsh(law.P)[-1]
    ends = np.array([[h**2 / 2.0, h], [h**2 / 2.0, -h]])  # Corners of a box of g.
    largest = np.sqrt(max(end @ law.P @ end for end in ends))
    tail = np.sqrt(left @ np.linalg.solve(law.P, left)) * largest
    return float((total + tail / (1.0 - np.sqrt(shrinking))) * (1.0 + ROUNDING))


def _integral(slope: float, offset: float, h: float) -> float:
    """Return the integral of |slope t + offset| over [0, h].

    Example:
        >>> _integral(1.0, -1.0, 2.0)
        1.0
    """

    def up_to(t: float) -> float:
        return slope * t**2 / 2.0 + offset * t

    root = -offset / slope if slope else -1.0
    if not 0.0 < root < h:
        return abs(up_to(h))
    return abs(up_to(root)) + abs(up_to(h) - up_to(root))
