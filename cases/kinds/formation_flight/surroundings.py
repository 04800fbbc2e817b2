"""Surroundings of a formation flight, for the pages of recorded runs."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.naming.surroundings import Disc, Surroundings, points


def surroundings(
    scenario: Mapping[str, Any], times: Array, positions: Array, headings: Array
) -> Surroundings:
    """Return leader, slots and obstacles; see `surroundings_of`."""
    del positions, headings
    given = scenario["leader"]
    psi, speed = float(given["heading_rad"]), float(given["speed_m_s"])
    start = np.array([float(given["x_m"]), float(given["y_m"])])
    leader = start[:, None] + speed * np.array([[np.cos(psi)], [np.sin(psi)]]) * times
    slots = points(uav["slot"] for uav in scenario["uavs"])
    discs = [
        Disc(
            x=float(disc["x_m"]), y=float(disc["y_m"]), radius=float(disc["radius_m"]),
            name="obstacle",
        )
        for disc in scenario.get("obstacles") or []
    ]  # fmt: skip
    return Surroundings(
        discs=discs,
        targets=slots[:, :, None] + leader,
        called="slot",
        leader=leader,
        leader_heading=np.full(times.size, psi),
    )
