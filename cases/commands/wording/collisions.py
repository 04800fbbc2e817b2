"""Sentences on what a flight must keep and has not kept: obstacles, distances."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.campaign.running.run import Run
from swarmstart.cases.drawing.naming.quantities import KEPT, quantity
from swarmstart.cases.drawing.naming.wording import is_number
from swarmstart.cases.drawing.report.pages.broken_limits import kept_distance
from swarmstart.cases.kinds.planar import POSITION, STATES, by_uav, pair_distances
from swarmstart.ocp import Mode

BUT_BROKEN = ", but the simulated path breaks a constraint"
"""Follows words on feasible plans, so that they do not hide what is broken."""


def collisions(finished: Run) -> list[str]:
    """Return a sentence on entered obstacles and one on a distance not kept.

    Each of them is left out if nothing is broken.
    """
    return [*_inside_obstacle(finished), *_too_close(finished)]


def closest_time(finished: Run) -> float:
    """Return when two UAVs are closest, to a step of the plant [s]."""
    trajectory = finished.trajectory
    apart = pair_distances(trajectory.dense_states, _uavs(finished)).min(axis=0)
    return float(trajectory.dense_times[int(apart.argmin())])


def safe_distance(finished: Run) -> float | None:
    """Return the distance that UAVs must keep [m]; None if the kind has none."""
    return kept_distance(finished.resolved.scenario.model_dump())


def _inside_obstacle(finished: Run) -> list[str]:
    """Return how far a UAV is inside an obstacle, when, and which UAVs enter one."""
    clear: Any = finished.measures.get("obstacle_clearance_m")
    if not is_number(clear) or clear >= -KEPT:
        return []
    rooms = _clearances(finished)  # At the plant's steps; `clear` is between them, too.
    deepest = np.unravel_index(int(rooms.argmin()), rooms.shape)
    entering = np.flatnonzero(rooms.min(axis=1) < 0)
    who = _names(finished, entering if entering.size else [int(deepest[0])])
    time = float(finished.trajectory.dense_times[int(deepest[1])])
    return [
        f"COLLISION: {quantity(-clear, 3)} m inside an obstacle at "
        f"{quantity(time, 4)} s ({who}){_law(finished, time)}."
    ]


def _too_close(finished: Run) -> list[str]:
    """Return which two UAVs come closer than the safe distance, and when."""
    near: Any = finished.measures.get("min_distance_m")
    safe = safe_distance(finished)
    if not is_number(near) or safe is None or near >= safe - KEPT:
        return []
    uavs = _uavs(finished)
    apart = pair_distances(finished.trajectory.dense_states, uavs)
    pair = int(apart.min(axis=1).argmin())
    who = [int(ends[pair]) for ends in np.triu_indices(uavs, k=1)]
    time = closest_time(finished)
    return [
        f"TOO CLOSE: {quantity(near, 4)} m between two UAVs at {quantity(time, 4)} s "
        f"({_names(finished, who)}){_law(finished, time)}; the safe distance is "
        f"{quantity(safe)} m."
    ]


def _clearances(finished: Run) -> Array:
    """Return the distance of each UAV to the nearest obstacle's edge, (uavs, T) [m]."""
    scenario: Any = finished.resolved.scenario
    states = finished.trajectory.dense_states
    positions = by_uav(states, _uavs(finished))[:, list(POSITION)]
    rooms = [
        np.linalg.norm(positions - np.array([[o.x_m], [o.y_m]]), axis=1) - o.radius_m
        for o in scenario.obstacles
    ]
    return np.asarray(np.min(rooms, axis=0))


def _uavs(finished: Run) -> int:
    return int(finished.trajectory.dense_states.shape[0]) // len(STATES)


def _names(finished: Run, places: Sequence[int] | NDArray[np.intp]) -> str:
    """Return UAVs by the numbers that the scenario gives them, or from 1 on."""
    scenario: Any = finished.resolved.scenario
    numbers = getattr(scenario, "numbers", range(1, _uavs(finished) + 1))
    return ", ".join(f"UAV {numbers[place]}" for place in places)


def _law(finished: Run, time: float) -> str:
    """Return ", under the linear law" if that law controls the UAVs at a time."""
    trajectory = finished.trajectory
    steps = len(trajectory.decisions)
    step = int(np.searchsorted(trajectory.times, time, side="left")) - 1
    decision = trajectory.decisions[min(max(step, 0), steps - 1)]
    return ", under the linear law" if decision.mode is Mode.LINEAR else ""
