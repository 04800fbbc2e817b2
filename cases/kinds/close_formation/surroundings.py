"""Surroundings of a close formation, for the pages of recorded runs."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.naming.surroundings import Surroundings, standing


def surroundings(
    scenario: Mapping[str, Any], times: Array, positions: Array, headings: Array
) -> Surroundings:
    """Return the leader and the slot, as seen from above; see `surroundings_of`."""
    del positions, headings
    slot = scenario["slot"]
    place = np.array([[-float(slot["y_ft"]), -float(slot["x_ft"])]])
    return Surroundings(
        targets=standing(place, times),
        called="slot",
        leader=np.zeros((2, times.size)),
        leader_heading=np.full(times.size, np.pi / 2),
    )
