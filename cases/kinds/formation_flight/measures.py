"""Measures of a formation flight.

Positions are those of the plant, not of plans. Distances and clearances use the plant's
path between its integration steps, too.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Measure, WholeRun
from swarmstart.cases.kinds.formation_flight.names import MEASURES
from swarmstart.cases.kinds.formation_flight.pose import FormationFlight, PosedFormation
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import (
    POSITION,
    by_uav,
    flown_positions,
    pair_distances,
    rooms_of,
    smallest,
    smallest_pair_distance,
    smallest_range,
)
from swarmstart.cases.record.trajectory_arrays import effort
from swarmstart.ocp import Mode, Trajectory, interpolate
from swarmstart.terminal_set import held_spectral_radius, input_excess, linearise

SETTLED_M = 1.0  # Largest deviation in x or y of a UAV in its slot.
SHAPE = 0.1  # The same, by the smallest distance of two slots, in a recognised shape.
TAIL_S = 10.0  # Length of the end of a flight for the tail errors.
# Smaller values of e'Pe are rounding errors: it stalls at about 1e-25.
SMALLEST_LYAPUNOV = 1e-12
OF_TERMINAL_SET = (
    *("terminal_exits", "lyapunov_ratio_max", "held_spectral_radius"),
    *("input_excess_ratio", "terminal_level"),
)


def measure(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> Mapping[str, Measure]:
    """Return all measures of MEASURES by name, with None for undefined ones."""
    measures: dict[str, Measure] = {
        **_tracking(scenario, flight, trajectory),
        **_distances(scenario, flight, trajectory),
        **_terminal_set(flight, trajectory),
        **effort(trajectory),
        "plan_cost": _plan_cost(scenario, trajectory),
        "infeasible_steps": trajectory.infeasible_steps,
    }
    return {name: measures[name] for name in MEASURES}


def whole_run(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
    measures: Mapping[str, Measure],
) -> WholeRun:
    """Return the closed-loop cost, and the largest missing part of a distance.

    Between two UAVs the missing part is relative to the safe distance, at an obstacle
    to the radius of the obstacle.
    """
    del flight, trajectory
    safe = scenario.avoidance.safe_distance_m
    # The default is not used: without obstacles no clearance is measured.
    radius = max((o.radius_m for o in scenario.obstacles), default=1.0)
    near, clear = measures["min_distance_m"], measures["obstacle_clearance_m"]
    missing = [1.0 - near / safe] if isinstance(near, float) else []
    missing += [-clear / radius] if isinstance(clear, float) else []
    cost = measures["closed_loop_cost"]
    return WholeRun(cost if isinstance(cost, float) else np.nan, max([0.0, *missing]))


def errors(posed: PosedFormation, times: Array, states: Array) -> Array:
    """Return the deviation of each UAV from its slot, shape (uavs, 4, T)."""
    return by_uav(states, len(posed.agents)) - posed.slots(times)


def clearances(
    scenario: FormationScenario, flight: FormationFlight, states: Array
) -> Array:
    """Return each UAV's distance to each obstacle's edge, (uavs * obstacles, T) [m]."""
    rooms = rooms_of(by_uav(states, flight.agents), scenario.obstacles)
    return np.concatenate([np.empty((0, states.shape[1])), *rooms])


def lyapunov(posed: PosedFormation, trajectory: Trajectory) -> Array:
    """Return e'Pe of each UAV at the control instants, shape (uavs, T + 1).

    e is the deviation of a UAV from its slot, P the matrix of the terminal set.
    """
    deviations = errors(posed, trajectory.times, trajectory.states)
    return np.stack([posed.terminal_set.value(e) for e in deviations])


def linear_mask(trajectory: Trajectory) -> NDArray[np.bool_]:
    """Return for each step whether the linear law was in use, shape (T,)."""
    return np.array([d.mode is Mode.LINEAR for d in trajectory.decisions])


def _tracking(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> dict[str, Measure]:
    times = trajectory.times
    deviations = errors(flight.posed, times, trajectory.states)
    offset = np.abs(deviations[:, list(POSITION)]).max(axis=1)  # (uavs, T + 1)
    slots = flight.posed.slots(times).reshape(-1, times.size)
    # One UAV has no shape: its limit is that of settling.
    near = smallest(pair_distances(slots, flight.agents)) or SETTLED_M / SHAPE
    late = times >= times[-1] - TAIL_S - 1e-9  # Rounding only.
    tails = offset[:, late].max(axis=1)
    failing = np.flatnonzero(tails > SETTLED_M)
    return {
        "settle_time_s": _settle_time(times, offset.max(axis=0), SETTLED_M),
        "shape_time_s": _settle_time(times, offset.max(axis=0), SHAPE * near),
        "tail_error_m": float(tails.max()),
        "tail_error_by_uav_m": [float(tail) for tail in tails],
        "lone_failure": scenario.numbers[failing[0]] if failing.size == 1 else 0,
        "closed_loop_cost": float(
            np.sum(deviations[:, :, :-1] ** 2) + np.sum(trajectory.controls**2)
        ),
    }


def _plan_cost(scenario: FormationScenario, trajectory: Trajectory) -> float | None:
    """Return J of the one plan; None if there are several."""
    if scenario.steps != 1 or len(scenario.planning) != 1:
        return None
    return trajectory.decisions[0].plans[scenario.planning[0]].cost


def _settle_time(times: Array, offset: Array, limit: float) -> float | None:
    """Return the first time from which on the offset stays within the limit."""
    outside = np.flatnonzero(offset > limit)
    if outside.size == 0:
        return float(times[0])
    return float(times[outside[-1] + 1]) if outside[-1] + 1 < times.size else None


def _distances(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> dict[str, Measure]:
    uavs, sampled = flight.agents, trajectory.states
    flown = flown_positions(interpolate(flight.plant, trajectory), uavs)
    rooms = [smallest_range(flown, o) - o.radius_m for o in scenario.obstacles]
    speeds = by_uav(trajectory.dense_states, uavs)[:, 0]
    return {
        "min_distance_m": smallest_pair_distance(flown),
        "min_distance_sampled_m": smallest(pair_distances(sampled, uavs)),
        "obstacle_clearance_m": min(rooms, default=None),
        "obstacle_clearance_sampled_m": smallest(clearances(scenario, flight, sampled)),
        "speed_min_m_s": float(speeds.min()),
        "speed_max_m_s": float(speeds.max()),
    }


def _terminal_set(
    flight: FormationFlight, trajectory: Trajectory
) -> dict[str, Measure]:
    """Return the measures of the terminal set, null without one."""
    if flight.posed.designed_set is None:
        return {**dict.fromkeys(OF_TERMINAL_SET), "linear_steps": 0}
    terminal_set, values = flight.posed.terminal_set, lyapunov(flight.posed, trajectory)
    linear = linear_mask(trajectory)
    before, after = values[:, :-1][:, linear], values[:, 1:][:, linear]
    large = before > SMALLEST_LYAPUNOV
    A, B = linearise(flight.posed.dynamics, terminal_set.x_ref, terminal_set.u_ref)
    excess = input_excess(
        terminal_set.K, terminal_set.P, terminal_set.alpha, flight.posed.reference.u_max
    )
    return {
        "terminal_exits": int(np.sum((after > terminal_set.alpha).any(axis=0)))
        if linear.any()
        else None,
        "linear_steps": int(linear.sum()),
        "lyapunov_ratio_max": float((after[large] / before[large]).max())
        if large.any()
        else None,
        "held_spectral_radius": held_spectral_radius(
            A, B, terminal_set.K, flight.plant.dt
        ),
        "input_excess_ratio": float(np.max(excess)),
        "terminal_level": terminal_set.alpha,
    }
