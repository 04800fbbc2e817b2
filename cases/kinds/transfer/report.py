"""The sentence on the result of a transfer, and the goals that its pages draw.

The sentence follows the one on the cost of the plan.
"""

from collections.abc import Mapping
from typing import Any

from swarmstart.arrays import Array
from swarmstart.cases.drawing.vehicles import Surroundings, points, standing
from swarmstart.cases.drawing.wording import is_number, number_of, quantity
from swarmstart.cases.format.kind import Measure


def ending(measures: Mapping[str, Measure]) -> str:
    """Return a sentence on the distances of the UAVs from their goals.

    The text is empty if these distances are not measured.
    """
    error = measures.get("goal_error_m")
    if not is_number(error):
        return ""
    return (
        f"At the end every UAV is within {quantity(number_of(error), 2)} m of its goal."
    )


def surroundings(
    scenario: Mapping[str, Any], times: Array, positions: Array, headings: Array
) -> Surroundings:
    """Return the goals; see `surroundings_of`."""
    del positions, headings
    goals = points(uav["goal"] for uav in scenario["uavs"])
    return Surroundings(targets=standing(goals, times), called="goal")
