"""Distances of UAVs in the plane over a whole flight, between the plant's steps too."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.kinds.planar import POSITION, Point
from swarmstart.ocp import DenseOutput, largest_distance, smallest_distance

Array = NDArray[np.float64]


def flown_positions(path: DenseOutput, uavs: int) -> Array:
    """Return the position of each UAV as curves, shape (uavs, 2, pieces, 6) [m].

    Args:
        path: Of the stacked states, uavs * 4 rows.
        uavs: Number of UAVs.
    """
    curves = path.curves
    return curves.reshape(uavs, -1, *curves.shape[1:])[:, list(POSITION)]


def smallest_pair_distance(positions: Array) -> float | None:
    """Return the smallest distance of two UAVs [m]; None of one alone.

    Args:
        positions: As `flown_positions` returns them.
    """
    first, second = np.triu_indices(len(positions), k=1)
    return smallest_distance(positions, first, second) if first.size else None


def largest_pair_distance(
    positions: Array, *, pairs: Sequence[tuple[int, int]] | None = None
) -> float | None:
    """Return the largest distance of two UAVs [m]; None without a pair.

    Args:
        positions: As `flown_positions` returns them.
        pairs: Numbers from 0 of the UAVs that are looked at; None means all pairs.
    """
    first, second = np.triu_indices(len(positions), k=1)
    if pairs is not None:
        first, second = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
    return largest_distance(positions, first, second) if first.size else None


def smallest_range(positions: Array, point: Point) -> float:
    """Return the smallest distance of any UAV to a point that stands [m].

    Args:
        positions: As `flown_positions` returns them.
        point: The point.
    """
    away = positions - np.array([point.x_m, point.y_m])[:, None, None]
    both = np.concatenate([away, np.zeros_like(away[:1])])
    uavs = len(positions)
    return smallest_distance(both, np.arange(uavs), np.full(uavs, uavs))
