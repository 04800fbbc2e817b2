"""Result of a reconfiguration in a sentence."""

from collections.abc import Mapping

from swarmstart.cases.drawing.naming.quantities import quantity
from swarmstart.cases.drawing.naming.wording import number_of
from swarmstart.cases.format.kind import Measure
from swarmstart.ocp import Trajectory


def outcome(trajectory: Trajectory, measures: Mapping[str, Measure]) -> str:
    """Return how far UAVs are from their slots at the end."""
    del trajectory
    error = quantity(number_of(measures["position_error_m"]), 3)
    return (
        f"At the end every UAV is within {error} m of its slot, relative to the leader."
    )
