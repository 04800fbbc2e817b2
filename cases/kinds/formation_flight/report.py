"""The sentence on the result of a formation flight, and surroundings for its pages.

Surroundings are the leader, the slots and the obstacles among which the UAVs are drawn.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.vehicles import Disc, Surroundings, points
from swarmstart.cases.drawing.wording import is_number, number_of, quantity
from swarmstart.cases.format.kind import Measure
from swarmstart.ocp import Trajectory


def outcome(trajectory: Trajectory, measures: Mapping[str, Measure]) -> str:
    """Return a sentence on whether the UAVs stay in their slots."""
    settle, tail = measures["settle_time_s"], measures["tail_error_m"]
    # A single plan is not flown to its end, so that settling says nothing.
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
    """Return how the polish of the first plan ended; empty without a polish."""
    plans = trajectory.decisions[0].plans
    ended = [one.polish_status for one in plans if one.polish_status is not None]
    return f"; the polish {ended[0].value}" if ended else ""


def surroundings(
    scenario: Mapping[str, Any], times: Array, positions: Array, headings: Array
) -> Surroundings:
    """Return the leader, the slots and the obstacles; see `surroundings_of`."""
    del positions, headings
    # From the recorded scenario: nothing is posed or compiled for this.
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
    )
