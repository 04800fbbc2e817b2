"""Measures of a reconfiguration; definitions in names.py.

The gap of a plan is its cost J minus the lowest known cost from the same state: the
least cost of the flown plan, of the best distinct points (basins) of a long L-SHADE
search, each improved by IPOPT, and of random points, improved likewise. From the first
state of the chapter's experiment one random start in seven finds the best minimum; from
later states all random starts find it.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence

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
from swarmstart.cases.kinds.reconfiguration.problem import position_errors
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.cases.record.trajectory_arrays import effort, plan_costs
from swarmstart.heuristics import LSHADE, Budget, RandomSearch, feasibility_first
from swarmstart.ocp import (
    IpoptOptions,
    Plan,
    Planner,
    RecedingHorizon,
    SearchSettings,
    Trajectory,
    interpolate,
    shifted_controls,
)

LOSS = 1e-9
"""Relative difference of costs up to which a plan is not worse."""

# Of both searches the best basins are polished, one after another.
LONG = SearchSettings(
    algorithm=LSHADE(size=100),
    budget=Budget(evaluations=30_000),
    order=feasibility_first(),
    basins=5,
)
SCATTERED = SearchSettings(
    algorithm=RandomSearch(size=200),
    budget=Budget(evaluations=200),
    order=feasibility_first(),
    basins=15,
)
EXACT = IpoptOptions(tolerance=1e-10)  # Its error is not to be seen in a gap.


def measure(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> Mapping[str, Measure]:
    """Return all measures of MEASURES by name, with None for undefined ones."""
    plans = [plan for decision in trajectory.decisions for plan in decision.plans]
    measures: dict[str, Measure] = {
        **_shape(scenario, flight, trajectory),
        **_costs(scenario, flight, trajectory),
        **_motion(flight, trajectory),
        "penalty_max": max(plan.violation for plan in plans),
        "infeasible_steps": trajectory.infeasible_steps,
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
    # No problem of all UAVs exists, whose stage cost could be integrated.
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
    """Return the distances of the pairs that are links, shape (links, T)."""
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
        # The first column is the start, before any horizon.
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
    # UAVs that plan one after another have no joint problem, and no best J of it.
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
        start = planner.lowered.start(trajectory.states[:, k])
        value, broken = planner.fitness.value(again, start)
        # A shifted plan that breaks a limit is no candidate that could win.
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


def gaps(joint: RecedingHorizon, trajectory: Trajectory) -> Array:
    """Return the cost of each plan minus the lowest one found from its state, (T,).

    The difference is below 0 if a plan costs less because it breaks a limit. The seed
    of the search for the lowest cost is the number of the step, so that the result does
    not depend on the search of the flight.

    Args:
        joint: The controller of all UAVs at once.
        trajectory: The flight.
    """
    best = best_costs(joint, trajectory.states[:, :-1])
    flown = [decision.plans[0] for decision in trajectory.decisions]
    costs = np.array([plan.cost for plan in flown])
    feasible = np.array([plan.feasible for plan in flown])
    return costs - np.where(feasible, np.minimum(best, costs), best)


def best_costs(joint: RecedingHorizon, states: Array) -> Array:
    """Return the lowest cost of plans found from each state, shape (T,).

    It is infinite for a state from which no feasible plan is found.

    Args:
        joint: The controller of all UAVs at once.
        states: States from which plans are made, stacked, shape (uavs * 4, T).
    """
    planners = [
        Planner(joint.planner.problem, search=search, polish=EXACT)
        for search in (LONG, SCATTERED)
    ]
    return np.array(
        [
            min(
                (plan.cost for plan in _plans(planners, state, k) if plan.feasible),
                default=np.inf,
            )
            for k, state in enumerate(map(joint.planner.lowered.start, states.T))
        ]
    )


def _plans(planners: Sequence[Planner], state: Array, seed: int) -> Iterator[Plan]:
    for planner in planners:
        yield planner.plan(state, rng=np.random.default_rng(seed))
