"""Surroundings of a reconfiguration, for the pages of recorded runs."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.naming.surroundings import Surroundings, points


def surroundings(
    scenario: Mapping[str, Any], times: Array, positions: Array, headings: Array
) -> Surroundings:
    """Return the slots around the leader; see `surroundings_of`."""
    leader = int(scenario["leader_uav"]) - 1
    slots = points(scenario["slots"])
    psi = headings[leader] if scenario.get("frame") == "leader" else 0.0 * times
    around = np.stack(
        [
            np.outer(slots[:, 0], np.cos(psi)) - np.outer(slots[:, 1], np.sin(psi)),
            np.outer(slots[:, 0], np.sin(psi)) + np.outer(slots[:, 1], np.cos(psi)),
        ],
        axis=1,
    )
    return Surroundings(targets=around + positions[leader], called="slot")
