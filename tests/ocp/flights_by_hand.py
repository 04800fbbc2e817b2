"""Closed-loop results that are written down, not simulated."""

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.ocp import Plant, Trajectory


def written(plant: Plant, dense_states: ArrayLike, controls: ArrayLike) -> Trajectory:
    """Return a trajectory with states (nx, T * m + 1) and controls (nu, T)."""
    dense = np.asarray(dense_states, dtype=np.float64)
    held = np.asarray(controls, dtype=np.float64)
    steps, pieces = held.shape[1], dense.shape[1] - 1
    end = steps * plant.dt
    return Trajectory(
        times=np.linspace(0.0, end, steps + 1),
        states=dense[:, :: max(pieces // max(steps, 1), 1)],
        controls=held,
        dense_times=np.linspace(0.0, end, pieces + 1),
        dense_states=dense,
        decisions=(),
        step_seconds=np.zeros(steps),
    )
