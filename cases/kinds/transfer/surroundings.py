"""Surroundings of a transfer, for the pages of recorded runs."""

from collections.abc import Mapping
from typing import Any

from swarmstart.arrays import Array
from swarmstart.cases.drawing.naming.surroundings import Surroundings, points, standing


def surroundings(
    scenario: Mapping[str, Any], times: Array, positions: Array, headings: Array
) -> Surroundings:
    """Return the goals; see `surroundings_of`."""
    del positions, headings
    goals = points(uav["goal"] for uav in scenario["uavs"])
    return Surroundings(targets=standing(goals, times), called="goal")
