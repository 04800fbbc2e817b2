"""The kind of scenario "swarm", and its measures (definitions in names.py)."""

import itertools
from collections.abc import Iterator, Mapping

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import FLIGHT_CERTIFICATE, Kind, Measure, WholeRun
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.swarm.names import MEASURES, UNDEFINED
from swarmstart.cases.kinds.swarm.pose import SwarmRun, pose
from swarmstart.cases.kinds.swarm.scenario import SwarmScenario
from swarmstart.ocp import SwarmFlight, Trajectory
from swarmstart.ocp.swarm.controller import SwarmDecision

AT_GOAL_M = 1e-6
"""Distance from a goal that is rounding; the tracking error is added [m]."""


def flight_of(trajectory: Trajectory) -> SwarmFlight:
    """Return the committed plans of a run.

    Raises:
        TypeError: If the run has another controller.
    """
    last = trajectory.decisions[-1]
    if not isinstance(last, SwarmDecision):
        raise TypeError(f"expected the run of a swarm, found a {type(last).__name__}")
    return last.flight


def positions_of(trajectory: Trajectory) -> Array:
    """Return the positions on the simulated path, shape (n, 3, times) [m]."""
    states = trajectory.dense_states
    return states.reshape(-1, 6, states.shape[1])[:, :3]


def measure(
    scenario: SwarmScenario, flight: SwarmRun, trajectory: Trajectory
) -> Mapping[str, Measure]:
    """Return all measures of MEASURES by name, with None for undefined ones."""
    controller, plans = flight.posed.controller, flight_of(trajectory)
    swarm = controller.swarm
    path = positions_of(trajectory)
    gaps = least_gaps(path * swarm.scale[None, :, None])
    arrival = arrivals(path, flight, trajectory)
    came = np.isfinite(arrival)
    lengths = np.linalg.norm(np.diff(path, axis=2), axis=1).sum(axis=1)
    straight = np.linalg.norm(swarm.goals - swarm.starts, axis=1)
    ratios = (lengths / np.where(straight > 0, straight, lengths + 1e-300))[came]
    off = (path[:, :, :: scenario.plant.substeps] - plans.positions) * swarm.scale[
        None, :, None
    ]
    steps = len(trajectory.decisions)
    seconds = float(np.nansum(trajectory.step_seconds))
    measures: dict[str, Measure] = {
        "collisions": int((gaps < scenario.safe_distance_m).sum()),
        "obstacle_hits": obstacle_hits(path, flight, trajectory),
        "min_distance_m": float(gaps.min()) if gaps.size else None,
        "arrived_share": float(came.mean()),
        "arrival_time_s": float(arrival.max()) if came.all() else None,
        "mean_arrival_time_s": float(arrival[came].mean()) if came.any() else None,
        "path_ratio": float(np.median(ratios)) if came.any() else None,
        "acceleration_max_m_s2": float(np.abs(trajectory.controls).max()),
        "tracking_error_m": float(np.linalg.norm(off, axis=1).max()),
        "plans_proposed": len(plans.log.vehicle) - swarm.size,
        "plans_committed": plans.commitments,
        "searches": plans.searches,
        "vehicle_step_ms": 1e3 * seconds / (steps * swarm.size),
    }
    return {name: measures[name] for name in MEASURES}


def least_gaps(path: Array) -> Array:
    """Return the least distance of each pair between all samples, shape (pairs,) [m].

    Relative motion is straight from one sample to the next.

    Args:
        path: Scaled positions, shape (n, 3, times) [m].
    """
    found = []
    for i, j in itertools.combinations(range(len(path)), 2):
        apart = path[i] - path[j]
        way = np.diff(apart, axis=1)
        size = np.maximum((way**2).sum(axis=0), np.finfo(float).tiny)
        share = np.clip(-(apart[:, :-1] * way).sum(axis=0) / size, 0.0, 1.0)
        found.append(np.linalg.norm(apart[:, :-1] + share * way, axis=0).min())
    return np.array(found)


def arrivals(path: Array, flight: SwarmRun, trajectory: Trajectory) -> Array:
    """Return the time from which each vehicle stays at its goal; infinite if never.

    Args:
        path: Positions, shape (n, 3, times) [m].
        flight: The closed loop.
        trajectory: Its path.
    """
    swarm = flight.posed.controller.swarm
    off = np.linalg.norm(
        (path - swarm.goals[:, :, None]) * swarm.scale[:, None], axis=1
    )
    away = off > AT_GOAL_M + swarm.tracking_error
    # The sample after the last one that is elsewhere.
    first = away.shape[1] - away[:, ::-1].argmax(axis=1)
    first = np.where(away.any(axis=1), first, 0)
    times = np.append(trajectory.dense_times, np.inf)
    return np.asarray(times[first])


def obstacle_hits(path: Array, flight: SwarmRun, trajectory: Trajectory) -> int:
    """Return the number of vehicles that come too near to an obstacle."""
    swarm = flight.posed.controller.swarm
    hit = np.zeros(len(path), dtype=bool)
    for one in swarm.obstacles:
        centre = one.position(trajectory.dense_times).T
        away = np.linalg.norm((path - centre) * swarm.scale[:, None], axis=1)
        least = swarm.clearance(one) - swarm.tracking_error
        hit |= (away < least).any(axis=1)
    return int(hit.sum())


def whole_run(
    scenario: SwarmScenario,
    flight: SwarmRun,
    trajectory: Trajectory,
    measures: Mapping[str, Measure],
) -> WholeRun:
    """Return the mean time of arrival, and the excess over what is required.

    The excess is the missing part of the safe distance, relative to this distance, or,
    if it is larger, the share of vehicles that do not arrive.
    """
    del flight, trajectory
    cost, near = measures["mean_arrival_time_s"], measures["min_distance_m"]
    missing = 1.0 - near / scenario.safe_distance_m if isinstance(near, float) else 0.0
    share = measures["arrived_share"]
    absent = 1.0 - share if isinstance(share, float) else 1.0
    return WholeRun(
        cost if isinstance(cost, float) else np.nan, max(0.0, missing, absent)
    )


def documents(
    scenario: SwarmScenario, flight: SwarmRun, trajectory: Trajectory
) -> Mapping[str, str]:
    """Return the flight's certificate if the rule is `acknowledged`, else nothing."""
    del flight
    if scenario.rule != "acknowledged":
        return {}
    return {FLIGHT_CERTIFICATE: flight_of(trajectory).certificate()}


def flaws(scenario: SwarmScenario) -> Iterator[LocatedFlaw]:
    """Yield errors between parts of the scenario, with their places."""
    yield from scenario.flaws()


KIND = Kind(
    scenario=SwarmScenario,
    poses=pose,
    measure=measure,
    whole_run=whole_run,
    measures=MEASURES,
    undefined=UNDEFINED,
    documents=documents,
    flaws=flaws,
    drawn_by="swarmstart.cases.kinds.swarm.figures:draw",
    animated_by="swarmstart.cases.kinds.swarm.animation",
)
