"""Result of a close formation in a sentence."""

from collections.abc import Mapping

from swarmstart.cases.drawing.naming.quantities import quantity
from swarmstart.cases.drawing.naming.wording import is_number, number_of
from swarmstart.cases.format.kind import Measure
from swarmstart.ocp import Trajectory


def outcome(trajectory: Trajectory, measures: Mapping[str, Measure]) -> str:
    """Return whether the wingman stays in its slot."""
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
