"""The logistic map as a source of numbers in (0, 1).

    Z_{n+1} = mu Z_n (1 - Z_n),    mu = 4                                    (5.17)

Its numbers follow the arcsine law, Beta(1/2, 1/2): they crowd at 0 and 1. The map runs
in float64; in float32 its orbits soon fall into the fixed point 0.

Source: chapter 5, eq. (5.17); May (1976), Nature 261.
"""

import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import kernel

MU = 4.0
TRAPS = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Fixed points of the map and the points that lead to one; no seeds (5.17)."""


@kernel
def logistic(z: Array) -> None:
    """Advance every orbit by one step of the map (5.17).

    Args:
        z: Chaotic numbers in (0, 1), shape (dim, size), changed in place.
    """
    dim, size = z.shape
    for d in range(dim):
        for i in range(size):
            z[d, i] = MU * z[d, i] * (1.0 - z[d, i])  # (5.17)


@kernel
def leave_traps(rng: np.random.Generator, z: Array) -> None:
    """Give every orbit that stands on a trap a new seed.

    Rounding leads an orbit onto a trap about once in 2e8 steps (a number within 2^-28
    of 1/2 is mapped to 1), and there it would stay.

    Args:
        rng: Source of the seeds; used only if an orbit is trapped.
        z: Chaotic numbers, shape (dim, size), changed in place.
    """
    dim, size = z.shape
    for d in range(dim):
        for i in range(size):
            while z[d, i] in TRAPS:
                z[d, i] = rng.random()


def draw_seeds(shape: tuple[int, int], *, rng: np.random.Generator) -> Array:
    """Draw seeds of the map, uniform in (0, 1) without the traps.

    Args:
        shape: Shape of the array to draw, (dim, size).
        rng: Source of randomness.

    Returns:
        The seeds, a new array of that shape.
    """
    z = np.zeros(shape)  # every entry a trap
    leave_traps(rng, z)
    return z
