"""The leader's manoeuvre: speed, heading and height against time."""

import itertools
from collections.abc import Callable, Iterator

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.kinds.close_formation.scenario import Leader

TIMING_S = 1e-9
"""Difference below which instants are equal, since n dt is rounded [s]."""


def leader_of(leader: Leader) -> Callable[[Array], Array]:
    """Return times (n,) [s] -> (V_L, psi_L, h_L), shape (3, n).

    With `hold` a row is valid until the next; with `linear` values change evenly from
    row to row, and stay after the last. Headings are not wrapped.
    """
    times = np.array([row.time_s for row in leader.manoeuvre])
    rows = np.array(
        [[r.speed_ft_s, r.heading_rad, r.height_ft] for r in leader.manoeuvre]
    ).T
    if leader.between == "hold":

        def held(at: Array) -> Array:
            index = np.searchsorted(times, np.asarray(at) + TIMING_S, side="right") - 1
            return np.asarray(rows[:, index])

        return held
    return lambda at: np.stack([np.interp(at, times, row) for row in rows])


def first_manoeuvre_s(leader: Leader) -> float:
    """Return the begin of the leader's first change [s]; 0 without a change."""
    return min((begin for begin, _ in _changes(leader)), default=0.0)


def last_change_s(leader: Leader) -> float:
    """Return the end of the leader's last change [s]; 0 without a change."""
    return max((end for _, end in _changes(leader)), default=0.0)


def _changes(leader: Leader) -> Iterator[tuple[float, float]]:
    """Yield begin and end [s] of each change, equal if rows are held."""
    for before, row in itertools.pairwise(leader.manoeuvre):
        changed = (row.speed_ft_s, row.heading_rad, row.height_ft)
        if changed != (before.speed_ft_s, before.heading_rad, before.height_ft):
            begin = before.time_s if leader.between == "linear" else row.time_s
            yield begin, row.time_s
