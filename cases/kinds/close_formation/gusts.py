"""Dryden turbulence as a sequence in time: first-order noise on a velocity.

    w_k+1 = a w_k + sigma sqrt(1 - a^2) n_k,   a = exp(-V dt / L)

with n_k standard normal: variance sigma^2, correlation exp(-V t / L), L the scale
length and V the airspeed. Source: MIL-F-8785C, the longitudinal Dryden spectrum.
"""

import numpy as np

from swarmstart.arrays import Array


def dryden(
    count: int,
    *,
    sigma: float,
    length: float,
    speed: float,
    dt: float,
    rng: np.random.Generator,
) -> Array:
    """Return gusts in three directions, shape (3, count), stationary from the start.

    Args:
        count: Number of instants.
        sigma: Standard deviation of each component [ft/s].
        length: Scale length L [ft].
        speed: Airspeed V [ft/s].
        dt: Time between two instants [s].
        rng: Source of randomness.
    """
    a = np.exp(-speed * dt / length)
    noise = rng.standard_normal((3, count))
    gusts = np.empty((3, count))
    gusts[:, 0] = noise[:, 0]
    spread = np.sqrt(1.0 - a * a)
    for k in range(1, count):
        gusts[:, k] = a * gusts[:, k - 1] + spread * noise[:, k]
    return np.asarray(sigma * gusts)
