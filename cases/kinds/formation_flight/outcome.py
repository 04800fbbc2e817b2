"""Result of a formation flight in a sentence."""

from collections.abc import Mapping

from swarmstart.cases.drawing.naming.quantities import quantity
from swarmstart.cases.drawing.naming.wording import is_number, number_of
from swarmstart.cases.format.kind import Measure
from swarmstart.ocp import Trajectory


def outcome(trajectory: Trajectory, measures: Mapping[str, Measure]) -> str:
    """Return whether UAVs stay in their slots."""
    settle, tail = measures["settle_time_s"], measures["tail_error_m"]
    if is_number(measures.get("plan_cost")):
        cost = quantity(number_of(measures["plan_cost"]))
        return f"Cost of the plan {cost}{_polished(trajectory)}."
    cost = f"closed-loop cost {quantity(number_of(measures['closed_loop_cost']))}"
    if is_number(settle):
        said = f"Settled after {quantity(number_of(settle))} s"
        return f"{said}: every UAV then stays within 1 m of its slot; {cost}."
    return (
        f"Not settled: in the last 10 s a UAV is up to {quantity(number_of(tail), 3)} "
        f"m off its slot (settled: at most 1 m); {cost}."
    )


def _polished(trajectory: Trajectory) -> str:
    """Return how IPOPT ended for the first plan; empty without a polish."""
    plans = trajectory.decisions[0].plans
    ended = [one.polish_status for one in plans if one.polish_status is not None]
    return f"; IPOPT {ended[0].value}" if ended else ""
