"""The sentence on a reconfiguration's result, and the slots that its pages draw."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.vehicles import Surroundings, points
from swarmstart.cases.drawing.wording import number_of, quantity
from swarmstart.cases.format.kind import Measure
from swarmstart.ocp import Trajectory


def outcome(trajectory: Trajectory, measures: Mapping[str, Measure]) -> str:
    """Return a sentence on how far the UAVs are from their slots at the end."""
    del trajectory
    error = quantity(number_of(measures["position_error_m"]), 3)
    return (
        f"At the end every UAV is within {error} m of its slot, relative to the leader."
    )


def surroundings(
    scenario: Mapping[str, Any], times: Array, positions: Array, headings: Array
) -> Surroundings:
    """Return the slots around the leader; see `surroundings_of`."""
    leader = int(scenario["leader_uav"]) - 1
    slots = points(scenario["slots"])
    # From the recorded scenario: nothing is posed or compiled for this.
    psi = headings[leader] if scenario.get("frame") == "leader" else 0.0 * times
    around = np.stack(
        [
            np.outer(slots[:, 0], np.cos(psi)) - np.outer(slots[:, 1], np.sin(psi)),
            np.outer(slots[:, 0], np.sin(psi)) + np.outer(slots[:, 1], np.cos(psi)),
        ],
        axis=1,
    )
    return Surroundings(targets=around + positions[leader], called="slot")
