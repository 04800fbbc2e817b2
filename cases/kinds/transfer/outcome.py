"""Result of a transfer in a sentence, after the one on the cost of its plan."""

from collections.abc import Mapping

from swarmstart.cases.drawing.naming.quantities import quantity
from swarmstart.cases.drawing.naming.wording import is_number, number_of
from swarmstart.cases.format.kind import Measure


def ending(measures: Mapping[str, Measure]) -> str:
    """Return how far UAVs are from their goals; empty if that is not measured."""
    error = measures.get("goal_error_m")
    if not is_number(error):
        return ""
    return (
        f"At the end every UAV is within {quantity(number_of(error), 2)} m of its goal."
    )
