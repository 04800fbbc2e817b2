"""The sentence on the result of a close formation; leader and slot for its pages."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.vehicles import Surroundings, standing
from swarmstart.cases.drawing.wording import is_number, number_of, quantity
from swarmstart.cases.format.kind import Measure
from swarmstart.ocp import Trajectory


def outcome(trajectory: Trajectory, measures: Mapping[str, Measure]) -> str:
    """Return a sentence on whether the wingman stays in its slot."""
    del trajectory
    times = [measures.get(name) for name in ("x_settle_s", "y_settle_s")]
    last = number_of(measures.get("position_error_late_ft"))
    off = f"in the last 5 s it is at most {quantity(last, 3)} ft off"
    if all(map(is_number, times)):
        latest = quantity(max(map(number_of, times)))
        return (
            f"Settled {latest} s after the leader's last change: the wingman then "
            f"stays within 1 ft of its slot in x and y; {off}."
        )
    return f"Not settled: the wingman does not stay within 1 ft of its slot; {off}."


def surroundings(
    scenario: Mapping[str, Any], times: Array, positions: Array, headings: Array
) -> Surroundings:
    """Return the leader and the slot, as seen from above; see `surroundings_of`."""
    del positions, headings
    slot = scenario["slot"]
    # Seen from the leader, which stands at zero, x and y change their signs.
    place = np.array([[-float(slot["y_ft"]), -float(slot["x_ft"])]])
    return Surroundings(
        targets=standing(place, times),
        called="slot",
        leader=np.zeros((2, times.size)),
    )
