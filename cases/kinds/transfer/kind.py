"""The kind of scenario "transfer", and its measures (definitions in names.py)."""

from collections.abc import Mapping

import numpy as np

from swarmstart.cases.format.kind import Kind, Measure, WholeRun
from swarmstart.cases.kinds.planar import (
    POSITION,
    by_uav,
    flown_positions,
    pair_distances,
    smallest,
    smallest_pair_distance,
)
from swarmstart.cases.kinds.transfer.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.transfer.pose import TransferFlight, flaws, pose
from swarmstart.cases.kinds.transfer.scenario import TransferScenario
from swarmstart.ocp import PolishStatus, Trajectory, interpolate


def measure(
    scenario: TransferScenario, flight: TransferFlight, trajectory: Trajectory
) -> Mapping[str, Measure]:
    """Return all measures of MEASURES by name, with None for undefined ones."""
    plan = trajectory.decisions[0].plans[0]
    solution = flight.answer(trajectory)
    uavs = len(flight.posed.goals)
    flown = by_uav(trajectory.dense_states, uavs)
    path = interpolate(flight.plant, trajectory)
    off = flown[:, list(POSITION), -1] - flight.posed.goals
    # A run of fewer steps ends on the way.
    ended = len(trajectory.decisions) == scenario.prediction.intervals
    measures: dict[str, Measure] = {
        "cost": plan.cost,
        "violation": plan.violation,
        "verified_cost": solution.verified_cost,
        "confirmed": int(solution.status.is_confirmed),
        "converged": int(plan.polish_status is PolishStatus.CONVERGED),
        "search_cost": _known(plan.search.cost),
        "search_violation": _known(plan.search.violation),
        "goal_error_m": float(np.hypot(*off.T).max()) if ended else None,
        "min_distance_m": smallest_pair_distance(flown_positions(path, uavs)),
        "min_distance_checked_m": smallest(pair_distances(solution.states, uavs)),
        "speed_min_m_s": float(flown[:, 0].min()),
        "speed_max_m_s": float(flown[:, 0].max()),
        "evaluations": plan.evaluations,
        "plan_seconds": float(trajectory.step_seconds[0]),
    }
    return {name: measures[name] for name in MEASURES}


def whole_run(
    scenario: TransferScenario,
    flight: TransferFlight,
    trajectory: Trajectory,
    measures: Mapping[str, Measure],
) -> WholeRun:
    """Return the verified cost of the plan, and the missing part of the safe distance.

    Distances between the checks count, too.
    """
    del flight, trajectory
    near, cost = measures["min_distance_m"], measures["verified_cost"]
    # A single UAV has no distance to others.
    missing = 1.0 - near / scenario.safe_distance_m if isinstance(near, float) else 0.0
    return WholeRun(cost if isinstance(cost, float) else np.nan, max(0.0, missing))


def _known(value: float) -> float | None:
    return None if np.isnan(value) else value


KIND = Kind(
    scenario=TransferScenario,
    poses=pose,
    measure=measure,
    whole_run=whole_run,
    measures=MEASURES,
    undefined=UNDEFINED,
    flaws=flaws,
    drawn_by="swarmstart.cases.kinds.transfer.figures:draw",
)
