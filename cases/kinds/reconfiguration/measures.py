"""Measures of a reconfiguration; definitions in names.py."""

import itertools
from collections.abc import Mapping

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Measure, WholeRun
from swarmstart.cases.kinds.planar import (
    by_uav,
    flown_positions,
    largest_pair_distance,
    smallest_pair_distance,
)
from swarmstart.cases.kinds.problem.measuring.flown_path import flown_values
from swarmstart.cases.kinds.reconfiguration.names import MEASURES
from swarmstart.cases.kinds.reconfiguration.pose import ReconfigurationFlight
from swarmstart.cases.kinds.reconfiguration.reference import gaps
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.cases.kinds.reconfiguration.target import position_errors
from swarmstart.cases.record.trajectory_arrays import effort, found_plans, plan_costs
from swarmstart.ocp import Trajectory, interpolate, shifted_controls

LOSS = 1e-9
"""Relative difference of costs up to which a plan is not worse."""


def measure(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> Mapping[str, Measure]:
    """Return all measures of MEASURES by name, null if one is not defined."""
    plans = [plan for decision in trajectory.decisions for plan in decision.plans]
    measures: dict[str, Measure] = {
        **_shape(scenario, flight, trajectory),
        **_costs(scenario, flight, trajectory),
        **_motion(flight, trajectory),
        "penalty_max": max(plan.violation for plan in plans),
        "infeasible_steps": sum(not found_plans(d) for d in trajectory.decisions),
        **effort(trajectory),
    }
    return {name: measures[name] for name in MEASURES}


def whole_run(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
    measures: Mapping[str, Measure],
) -> WholeRun:
    """Return the cost of the path flown, and the missing part of the safe distance.

    The cost is the integral of the stage cost of all UAVs, or the sum of the costs of
    their plans if each plans on its own.
    """
    safe, found = scenario.distances.safe_m, measures["min_distance_m"]
    near = found if isinstance(found, float) else np.inf
    if flight.posed.order is not None or flight.posed.nearby is not None:
        cost = float(plan_costs(trajectory).sum())
    else:
        problem = flight.posed.agents[0].problem
        cost, *_ = flown_values(problem, flight, trajectory)
    return WholeRun(cost, max(0.0, 1.0 - near / safe))


def errors_of(
    scenario: ReconfigurationScenario, flight: ReconfigurationFlight, states: Array
) -> Array:
    """Return the distance of each UAV from its slot, shape (uavs, T) [m]."""
    return position_errors(
        states,
        flight.posed.slots,
        leader=scenario.leader_index,
        turned=scenario.frame == "leader",
    )


def link_distances(flight: ReconfigurationFlight, distances: Array) -> Array:
    """Return the rows of all pairs' distances that are links, shape (links, T)."""
    pairs = itertools.combinations(range(len(flight.posed.slots)), 2)
    linked = {(min(pair), max(pair)) for pair in flight.posed.links}
    return np.asarray(distances[[pair in linked for pair in pairs]])


def _shape(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> dict[str, Measure]:
    off = errors_of(scenario, flight, trajectory.states).max(axis=0)
    headings = by_uav(trajectory.states, len(flight.posed.slots))[:, 1, -1]
    path = interpolate(flight.plant, trajectory)
    flown = flown_positions(path, len(flight.posed.slots))
    return {
        "position_error_m": float(off[-1]),
        "position_error_per_horizon_m": off[1:].tolist(),
        "heading_error_rad": float(
            np.abs(headings - headings[scenario.leader_index]).max()
        ),
        "min_distance_m": smallest_pair_distance(flown),
        "max_distance_m": largest_pair_distance(flown),
        "max_link_distance_m": largest_pair_distance(flown, pairs=flight.posed.links),
    }


def _costs(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> dict[str, Measure]:
    costs = plan_costs(trajectory)
    gap: Array | None = None
    if scenario.reference != "none" and flight.posed.nearby is None:
        gap = gaps(flight.loop, trajectory)
    return {
        "cost_per_horizon": costs.tolist(),
        "cost_rises": int(np.sum(np.diff(costs) > 0)),
        "candidate_losses": _losses(flight, trajectory, costs),
        "gap_per_horizon": None if gap is None else gap.tolist(),
        "gap_max": None if gap is None else float(gap.max()),
    }


def _losses(
    flight: ReconfigurationFlight, trajectory: Trajectory, costs: Array
) -> int | None:
    """Return the number of plans that cost more than the shifted last plan (5.29)."""
    if flight.posed.nearby is not None:
        return None
    planner, losses = flight.loop.planner, 0
    for k in range(1, costs.size):
        last = trajectory.decisions[k - 1].plans[0].controls
        again = shifted_controls(planner.problem, last, flight.loop.append)
        value, broken = planner.fitness.value(again, trajectory.states[:, k])
        allowed = broken <= planner.problem.tolerance
        losses += bool(allowed and costs[k] > value * (1 + LOSS))
    return losses


def _motion(
    flight: ReconfigurationFlight, trajectory: Trajectory
) -> dict[str, Measure]:
    speeds = by_uav(trajectory.dense_states, len(flight.posed.slots))[:, 0]
    banks = flight.posed.controls_by_uav(trajectory.controls)[:, 1]
    return {
        "speed_min_m_s": float(speeds.min()),
        "speed_max_m_s": float(speeds.max()),
        "bank_max_rad": float(np.abs(banks).max()),
    }
