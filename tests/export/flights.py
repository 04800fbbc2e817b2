"""Paths whose every derivative is known."""

import numpy as np

from swarmstart.arrays import Array
from swarmstart.export.paths import VehiclePath


def loop_at(times: Array) -> Array:
    """Return places on a rising loop, shape (k, 3) [m]."""
    return np.stack(
        [2 * np.cos(times), 2 * np.sin(1.3 * times), 1 + 0.1 * times], axis=1
    )


def loop(seconds: float = 20.0, samples: int = 401) -> VehiclePath:
    """Return the loop as a path."""
    times = np.linspace(0.0, seconds, samples)
    return VehiclePath("loop", times, loop_at(times))
