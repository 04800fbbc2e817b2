"""Measures of a close formation flight; definitions in names.py."""

from collections.abc import Mapping

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Measure, WholeRun
from swarmstart.cases.kinds.close_formation.names import MEASURES
from swarmstart.cases.kinds.close_formation.pose import (
    CloseFormationFlight,
    first_manoeuvre_s,
    last_change_s,
)
from swarmstart.cases.kinds.close_formation.scenario import CloseFormationScenario
from swarmstart.cases.kinds.models.close_formation import POSITION
from swarmstart.cases.kinds.models.horseshoe_vortex import drag_saving
from swarmstart.cases.kinds.problem.measuring.flown_path import flown_values
from swarmstart.cases.record.trajectory_arrays import effort, plan_costs
from swarmstart.ocp import (
    IpoptOptions,
    Trajectory,
    interpolate,
    shifted_controls,
    smallest_distance,
)
from swarmstart.ocp.nlp import Polisher

SETTLED_FT = 1.0  # Largest distance of a settled coordinate from the slot.
LATE_S = 5.0  # Length of the end of a flight that counts as late.
EARLY_S = 10.0  # From the manoeuvre on; later rises of J are mostly noise of a search.
LOW_SAVING = 0.3  # Part of the drag; less counts as low.
RISE = 1e-6  # A smaller rise of J does not count.
ROUNDING_S = 1e-9  # Instants are sums of dt.


def measure(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
) -> Mapping[str, Measure]:
    """Return all measures of MEASURES by name, with None for undefined ones."""
    measures: dict[str, Measure] = {
        **_tracking(scenario, trajectory),
        **_motion(scenario, flight, trajectory),
        **_costs(scenario, flight, trajectory),
        **_saving(flight, trajectory),
        **_gaps(scenario, flight, trajectory),
        **effort(trajectory),
    }
    return {name: measures[name] for name in MEASURES}


def whole_run(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
    measures: Mapping[str, Measure],
) -> WholeRun:
    """Return the cost of the simulated path, and the largest excess of a constraint.

    The cost is the integral of the stage cost of (5.21).
    """
    del scenario, measures
    problem = flight.posed.agents[0].problem
    cost, excess, _ = flown_values(problem, flight, trajectory)
    return WholeRun(cost, excess)


def deviations(scenario: CloseFormationScenario, states: Array) -> Array:
    """Return (x, y, z) minus the slot, shape (3, T) [ft]."""
    slot = scenario.slot
    wanted = np.array([slot.x_ft, slot.y_ft, slot.z_ft])
    return np.asarray(states[list(POSITION)] - wanted[:, None])


def savings(flight: CloseFormationFlight, states: Array) -> Array:
    """Return the drag saved at each state, a fraction, shape (T,)."""
    # One call for each state: `drag_saving` takes floats, not arrays.
    _, y, z = states[list(POSITION)]
    return np.array(
        [
            drag_saving(flight.posed.aircraft, float(a), float(b))
            for a, b in zip(y, z, strict=True)
        ]
    )


def best_saving(flight: CloseFormationFlight) -> float:
    """Return the largest saving of drag at the leader's height, as a fraction."""
    from scipy.optimize import minimize_scalar  # Slow to import; only measures need it.

    span = flight.posed.aircraft.span_ft
    found = minimize_scalar(
        lambda y: -drag_saving(flight.posed.aircraft, float(y), 0.0),
        # The saving is even in y; only one of its two maxima is in this range.
        bounds=(span / 2, 2 * span),
        method="bounded",
    )
    return -float(found.fun)


def reference_costs(flight: CloseFormationFlight, trajectory: Trajectory) -> Array:
    """Return the cost of each step's plan after a polish by IPOPT, shape (T,)."""
    # Tighter than a plan's polish, so that the error of J* is not in the gaps.
    polisher = Polisher(flight.loop.planner.fitness, IpoptOptions(tolerance=1e-10))
    best, lowered = [], flight.loop.planner.lowered
    for k, decision in enumerate(trajectory.decisions):
        known = flight.loop.known(float(trajectory.times[k]))
        start = lowered.start(trajectory.states[:, k])
        best.append(polisher(decision.plans[0].controls, start, known).cost)
    return np.array(best)


def _tracking(
    scenario: CloseFormationScenario, trajectory: Trajectory
) -> dict[str, Measure]:
    times = trajectory.times
    off = deviations(scenario, trajectory.states)
    begin = last_change_s(scenario.leader)
    late = times > times[-1] - LATE_S + ROUNDING_S
    rms = np.sqrt(np.mean(off[:, late] ** 2, axis=1))
    return {
        "x_settle_s": _settled(times, off[0], begin),
        "y_settle_s": _settled(times, off[1], begin),
        "x_max_dev_ft": float(off[0].max()),
        "x_min_dev_ft": float(off[0].min()),
        "y_max_dev_ft": float(np.abs(off[1]).max()),
        "y_min_dev_ft": float(off[1].min()),
        "z_max_ft": float(np.abs(off[2]).max()),
        "x_rms_last_5s_ft": float(rms[0]),
        "y_rms_last_5s_ft": float(rms[1]),
        "z_rms_last_5s_ft": float(rms[2]),
        "position_error_late_ft": float(np.linalg.norm(off[:, late], axis=0).max()),
    }


def _settled(times: Array, off: Array, begin: float) -> float | None:
    """Return the time after `begin` until the deviation stays within SETTLED_FT."""
    if times[-1] < begin:  # The manoeuvre is not over.
        return None
    outside = np.flatnonzero(np.abs(off) > SETTLED_FT)
    if outside.size == 0:
        return 0.0
    if outside[-1] + 1 == times.size:
        return None
    return max(float(times[outside[-1] + 1]) - begin, 0.0)


def _motion(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
) -> dict[str, Measure]:
    _, _, heading, speed, _, _ = trajectory.states
    late = trajectory.times[:-1] > trajectory.times[-1] - LATE_S + ROUNDING_S
    late[-1] = True  # At least one step, also if it is longer.
    turned = np.diff(heading) / np.diff(trajectory.times)
    # Headings are not wrapped, so that a difference is the turn.
    first = scenario.leader.manoeuvre[0].heading_rad
    return {
        "speed_max_ft_s": float(speed.max()),
        "heading_max_deg": float(np.degrees(heading.max() - first)),
        "turn_rate_max_deg_s": float(np.degrees(np.abs(turned).max())),
        "steady_altitude_command_ft": float(trajectory.controls[2, late].mean()),
        "min_range_ft": _smallest_range(flight, trajectory),
    }


def _smallest_range(flight: CloseFormationFlight, trajectory: Trajectory) -> float:
    """Return the smallest distance of the two aircraft [ft], the leader at zero."""
    relative = interpolate(flight.plant, trajectory).curves[list(POSITION)]
    both = np.stack([relative, np.zeros_like(relative)])
    return smallest_distance(both, np.array([0]), np.array([1]))


def _costs(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
) -> dict[str, Measure]:
    costs = plan_costs(trajectory)
    # A rise compares a step with the one before, which must be in the manoeuvre, too.
    times, rises = trajectory.times[1:-1], np.diff(costs) > RISE
    begin = first_manoeuvre_s(scenario.leader) - ROUNDING_S
    early = rises & (trajectory.times[:-2] >= begin) & (times < begin + EARLY_S)
    late = rises & (times >= begin + EARLY_S)
    return {
        "cost_max": float(costs.max()),
        "cost_rises": int(early.sum() + late.sum()),
        "cost_rises_early": int(early.sum()),
        "cost_rises_late": int(late.sum()),
        "candidate_losses": _losses(flight, trajectory, costs),
    }


def _losses(flight: CloseFormationFlight, trajectory: Trajectory, costs: Array) -> int:
    """Return how many plans cost more than the shifted last plan, against (5.29)."""
    planner, losses = flight.loop.planner, 0
    for k in range(1, len(costs)):
        last = trajectory.decisions[k - 1].plans[0].controls
        held = shifted_controls(planner.problem, last, flight.loop.append)
        known = flight.loop.known(float(trajectory.times[k]))
        start = planner.lowered.start(trajectory.states[:, k])
        value, _ = planner.fitness.value(held, start, known)
        losses += costs[k] > value + RISE
    return int(losses)


def _saving(flight: CloseFormationFlight, trajectory: Trajectory) -> dict[str, Measure]:
    saved = savings(flight, trajectory.states)
    _, best_y, _ = slot_of(flight)
    dt = float(trajectory.times[1] - trajectory.times[0])
    ideal, best = drag_saving(flight.posed.aircraft, best_y, 0.0), best_saving(flight)
    return {
        "drag_saving_percent": float(100 * saved.mean()),
        "drag_saving_min_percent": float(100 * saved.min()),
        "drag_saving_ideal_percent": 100 * ideal,
        "drag_saving_best_percent": 100 * best,
        "drag_saving_shortfall_percent": 100 * (1 - ideal / best),
        "drag_saving_low_s": float(np.sum(saved < LOW_SAVING) * dt),
    }


def slot_of(flight: CloseFormationFlight) -> tuple[float, float, float]:
    """Return the slot (2 b, pi b/4, 0) at which the chapter linearises (5.20) [ft]."""
    span = flight.posed.aircraft.span_ft
    return 2 * span, np.pi * span / 4, 0.0


def _gaps(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
) -> dict[str, Measure]:
    names = (
        "gap_relative_median",
        "gap_absolute_median",
        "gap_absolute_p90",
        "gap_min",
    )
    if scenario.reference == "none":
        return dict.fromkeys(names)
    best = reference_costs(flight, trajectory)
    gap = plan_costs(trajectory) - best
    times = trajectory.times[:-1]
    begin = first_manoeuvre_s(scenario.leader) - ROUNDING_S
    early = (times >= begin) & (times < begin + EARLY_S)
    late = times >= begin + EARLY_S
    values = (
        _median(gap[early] / best[early]),
        _median(gap[late]),
        float(np.quantile(gap[late], 0.9)) if late.any() else None,
        # J* goes to zero in the slot, where a relative gap says nothing.
        float(np.min(gap / np.maximum(best, 1.0))),
    )
    return dict(zip(names, values, strict=True))


def _median(values: Array) -> float | None:
    return float(np.median(values)) if values.size else None
