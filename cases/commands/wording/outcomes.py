"""Sentences on the result of a run and on its constraints, by kind of scenario.

For a flight the sentences give distances: how near vehicles came, and which obstacles
they entered. For every other run they give the cost and the largest excess over a
constraint, with the time at which the simulated path exceeds it most.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pkgutil import resolve_name
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.drawing.report.pages.broken_limits import kept_distance
from swarmstart.cases.drawing.wording import KEPT, is_number, number_of, quantity
from swarmstart.cases.format.document import printable
from swarmstart.cases.format.registry import words_of
from swarmstart.cases.kinds.planar import STATES, by_uav, pair_distances, rooms_of
from swarmstart.ocp import Mode, SolutionStatus, Trajectory

_SETTLING = "settling("
_MEANINGS = {
    SolutionStatus.CONVERGED: "a local optimum, confirmed by a finer integration",
    SolutionStatus.FEASIBLE: "feasible, confirmed by a finer integration, but not "
    "shown to be a local optimum",
}
"""Statuses of a plan that can be used, in plain words; others speak for themselves."""
_BUT_BROKEN = ", but the simulated path breaks a constraint"
"""Follows words on feasible plans, so that they do not hide what is broken."""


def outcome(finished: Run) -> str:
    """Return a sentence on the result: whether and when a flight settled, or a cost."""
    words = words_of(finished.resolved.scenario.kind)
    if words.outcome:
        told: str = resolve_name(words.outcome)(finished.trajectory, finished.measures)
        return told
    ending = resolve_name(words.ending)(finished.measures) if words.ending else ""
    return f"{_of_problem(finished)} {ending}".strip()


def kept_constraints(finished: Run) -> str:
    """Return a sentence on how near vehicles came, or whether constraints are kept."""
    words = words_of(finished.resolved.scenario.kind)
    if words.kept:
        return str(resolve_name(words.kept)(finished.measures)[0])
    if not _is_flight(finished):
        return _constraints(finished)
    parts = [*_distances(finished), _feasible_plans(finished)]
    said = "; ".join(filter(None, parts))
    # A single vehicle without obstacles has none, if its plans are not feasible.
    return f"{said[:1].upper()}{said[1:]}." if said else ""


def collisions(finished: Run) -> list[str]:
    """Return a sentence on entered obstacles and one on a distance not kept.

    A sentence is left out if there is no such violation.
    """
    if words_of(finished.resolved.scenario.kind).kept:
        return []  # The kind says it itself.
    return [*_inside_obstacle(finished), *_too_close(finished)]


def time_of_excess(finished: Run) -> str:
    """Return " between T1 and T2 s": the control interval of the largest excess.

    It is the first interval at whose end the largest excess so far is that of the whole
    path; bisection finds it. The text is empty if the run has no measure of the excess.
    """
    whole = finished.measures.get("constraint_excess")
    if not is_number(whole):
        return ""
    few, many = 0, len(finished.trajectory.decisions)
    while many - few > 1:
        middle = (few + many) // 2
        # Equal as soon as the step is in: the largest excess never falls.
        if _excess(finished, middle) >= float(whole):  # type: ignore[arg-type]
            many = middle
        else:
            few = middle
    times = finished.trajectory.times
    begin, end = quantity(float(times[few]), 4), quantity(float(times[many]), 4)
    return f" between {begin} and {end} s"


def told_status(finished: Run) -> str:
    """Return the sentence on how a run ended.

    If all plans are feasible, but the path breaks a constraint, the sentence says so.
    """
    hides_broken = finished.ended.all_found and breaks_constraint(finished)
    return finished.ended.sentence(_BUT_BROKEN if hides_broken else "")


def breaks_constraint(finished: Run) -> bool:
    """Return whether a flight or a closed loop breaks a constraint along its path."""
    words = words_of(finished.resolved.scenario.kind)
    if words.kept:
        return not resolve_name(words.kept)(finished.measures)[1]
    if _is_flight(finished):
        return bool(collisions(finished))
    if finished.flight.posed.open_loop:
        return False
    # Not `>`: NaN counts as broken.
    return not number_of(finished.measures.get("constraint_excess")) <= KEPT


def _of_problem(finished: Run) -> str:
    """Return the cost, with what it is worth, of a problem of any system."""
    measures, status = finished.measures, finished.ended.plan
    settled = _own_settling(finished)
    if status is not None:
        cost = _cost(finished, "cost")
        if not status.is_confirmed:
            said = printable(f"{status.value}{finished.ended.more}")
            # A cost has no meaning then.
            if status in (SolutionStatus.INFEASIBLE, SolutionStatus.NOT_FINITE):
                return f"{said[:1].upper()}{said[1:]}."
            return f"{cost}, {said}."
        return f"{cost}: {_MEANINGS[status]}{finished.ended.more}.{settled}"
    said = "The cost of the simulated path is not finite"
    if is_number(measures.get("flown_cost")):
        said = f"{_cost(finished, 'flown_cost')} along the simulated path"
    return f"{said}; {_plans_in_words(finished)}.{settled}"


def _cost(finished: Run, name: str) -> str:
    """Return a cost, by the name that the problem gives it."""
    value = finished.measures.get(name)
    sense = finished.flight.sense
    word = "Cost" if sense > 0 else "Value (maximised)"
    return (
        f"{word} {quantity(number_of(value))}"
        if is_number(value)
        else f"{word} not finite"
    )


def _own_settling(finished: Run) -> str:
    """Return the settling times that the scenario itself measures, if it does."""
    own: Mapping[str, str] = getattr(finished.resolved.scenario, "measures", {})
    said = []
    for name, expression in own.items():
        if str(expression).startswith((_SETTLING, f"max({_SETTLING}")):
            value = finished.measures.get(name)
            when = (
                f"{quantity(number_of(value))} s" if is_number(value) else "not settled"
            )
            said.append(f"{name} {when}")
    return f" Settling time: {', '.join(said)}." if said else ""


def _constraints(finished: Run) -> str:
    """Return whether path and terminal constraints are kept, else by how much not."""
    measures, status = finished.measures, finished.ended.plan
    along = number_of(measures.get("constraint_excess"))
    missed = number_of(measures.get("terminal_excess"))
    # A closed loop ends before its last plan, so its end conditions are not due.
    at_end = missed if status is not None else 0.0
    if max(along, at_end) <= KEPT:
        return f"All constraints are kept along the simulated path{_missed(missed)}."
    is_plan = status is not None and not finished.flight.posed.differs
    if status is not None and (is_plan or not status.is_confirmed):
        # The finer check names the constraint, which the measure does not.
        path = finished.flight.answer(finished.trajectory).path
        broken = path.outside if status.is_confirmed else path.outside + path.broken
        if broken:
            worst = max(broken, key=lambda excess: excess.relative)
            after = "; all are kept later" if status.is_confirmed else ""
            return f"A constraint is broken: {printable(str(worst))}{after}."
    parts = []
    # Not `>`: NaN counts as broken.
    if not along <= KEPT:
        when = "" if is_plan else time_of_excess(finished)
        parts.append(f"{_amount(along)} along the path{when}")
    if not at_end <= KEPT:
        parts.append(f"{_amount(at_end)} at the end")
    listed = f"largest excess {' and '.join(parts)}, in the unit of the constraint"
    if is_plan:
        tolerance = finished.flight.posed.agents[0].problem.path_tolerance
        return (
            f"All constraints are kept within the tolerance, {tolerance:g} of their "
            f"scales ({listed})."
        )
    return f"Constraints are broken: {listed}."


def _missed(excess: float) -> str:
    """Return by how much a closed loop that has ended misses its end conditions.

    Each plan meets them at its own end, which lies beyond the end of the run.
    """
    if excess <= KEPT:
        return ""
    return f"; at its end the end conditions are missed by up to {_amount(excess)}"


def _amount(excess: float) -> str:
    return quantity(excess, 3) if np.isfinite(excess) else "an infinite amount"


def _distances(finished: Run) -> list[str]:
    """Return the closest distances of a flight, each with what it has to be."""
    measures, parts = finished.measures, []
    near = measures.get("min_distance_m")
    if is_number(near):
        when, apart = quantity(_closest_time(finished), 4), number_of(near)
        parts.append(
            f"closest distance of two UAVs {quantity(apart, 4)} m, at {when} s"
            f"{_against(apart, _safe_distance(finished))}"
        )
    clear = measures.get("obstacle_clearance_m")
    if is_number(clear):
        inside = " inside it" if number_of(clear) < 0 else ""
        away = quantity(abs(number_of(clear)), 3)
        parts.append(f"closest to the edge of an obstacle {away} m{inside}")
    aircraft = measures.get("min_range_ft")
    if is_number(aircraft):
        away = quantity(number_of(aircraft), 4)
        parts.append(f"closest distance of the two aircraft {away} ft")
    return parts


def _against(near: float, safe: float | None) -> str:
    """Return a distance beside the one to be kept."""
    if safe is None:
        return ""
    if near < safe - KEPT:
        missing = quantity(safe - near, 3)
        return f", {missing} m less than the safe distance of {quantity(safe)} m"
    return f" (to be kept: {quantity(safe)} m)"


def _feasible_plans(finished: Run) -> str:
    """Return whether all plans are feasible."""
    status = finished.ended.plan
    if status is None:
        return _plans_in_words(finished)
    broken = _BUT_BROKEN if breaks_constraint(finished) else ""
    return f"the plan is feasible{broken}" if status.is_confirmed else ""


def _plans_in_words(finished: Run) -> str:
    """Return how many steps found a feasible plan."""
    ended = finished.ended
    broken = _BUT_BROKEN if breaks_constraint(finished) else ""
    if len(finished.trajectory.decisions) == 1:
        is_feasible = finished.feasible
        return f"the plan is feasible{broken}" if is_feasible else "no plan is feasible"
    return f"{ended.found}{broken if ended.all_found else ''}{ended.more}"


def _is_flight(finished: Run) -> bool:
    """Return whether a run is a flight of aircraft, which keep distances."""
    return bool(words_of(finished.resolved.scenario.kind).flown_by)


def _excess(finished: Run, steps: int) -> float:
    """Return the largest excess of the first steps."""
    kind, scenario = finished.resolved.kind, finished.resolved.scenario
    begun = _first(finished.trajectory, steps)
    measures = kind.measure(scenario, finished.flight, begun)
    value = measures.get("constraint_excess")
    return float(value) if isinstance(value, int | float) else float("inf")


def _first(trajectory: Trajectory, steps: int) -> Trajectory:
    """Return the first steps of a trajectory."""
    # All steps have as many steps of the plant.
    fine = steps * (trajectory.dense_times.size - 1) // len(trajectory.decisions)
    return replace(
        trajectory,
        times=trajectory.times[: steps + 1],
        states=trajectory.states[:, : steps + 1],
        controls=trajectory.controls[:, :steps],
        dense_times=trajectory.dense_times[: fine + 1],
        dense_states=trajectory.dense_states[:, : fine + 1],
        decisions=trajectory.decisions[:steps],
        step_seconds=trajectory.step_seconds[:steps],
    )


def _closest_time(finished: Run) -> float:
    """Return when two UAVs are closest, to a step of the plant [s]."""
    trajectory = finished.trajectory
    apart = pair_distances(trajectory.dense_states, _uavs(finished)).min(axis=0)
    return float(trajectory.dense_times[int(apart.argmin())])


def _safe_distance(finished: Run) -> float | None:
    """Return the distance that UAVs must keep [m]; None if the kind has none."""
    return kept_distance(finished.resolved.scenario.model_dump())


def _inside_obstacle(finished: Run) -> list[str]:
    """Return how far a UAV is inside an obstacle, when, and which UAVs enter one."""
    clear: Any = finished.measures.get("obstacle_clearance_m")
    if not is_number(clear) or clear >= -KEPT:
        return []
    rooms = _clearances(finished)  # At the plant's steps; `clear` is between them, too.
    deepest = np.unravel_index(int(rooms.argmin()), rooms.shape)
    entering = np.flatnonzero(rooms.min(axis=1) < 0)
    # Between the plant's steps alone: then the UAV that comes nearest is named.
    who = _names(finished, entering if entering.size else [int(deepest[0])])
    time = float(finished.trajectory.dense_times[int(deepest[1])])
    return [
        f"COLLISION: {quantity(-clear, 3)} m inside an obstacle at "
        f"{quantity(time, 4)} s ({who}){_law(finished, time)}."
    ]


def _too_close(finished: Run) -> list[str]:
    """Return which two UAVs come closer than the safe distance, and when."""
    near: Any = finished.measures.get("min_distance_m")
    safe = _safe_distance(finished)
    if not is_number(near) or safe is None or near >= safe - KEPT:
        return []
    uavs = _uavs(finished)
    apart = pair_distances(finished.trajectory.dense_states, uavs)
    pair = int(apart.min(axis=1).argmin())
    who = [int(ends[pair]) for ends in np.triu_indices(uavs, k=1)]
    time = _closest_time(finished)
    return [
        f"TOO CLOSE: {quantity(near, 4)} m between two UAVs at {quantity(time, 4)} s "
        f"({_names(finished, who)}){_law(finished, time)}; the safe distance is "
        f"{quantity(safe)} m."
    ]


def _clearances(finished: Run) -> Array:
    """Return the distance of each UAV to the nearest obstacle's edge, (uavs, T) [m]."""
    scenario: Any = finished.resolved.scenario
    states = finished.trajectory.dense_states
    rooms = rooms_of(by_uav(states, _uavs(finished)), scenario.obstacles)
    return np.asarray(np.min(rooms, axis=0))


def _uavs(finished: Run) -> int:
    return int(finished.trajectory.dense_states.shape[0]) // len(STATES)


def _names(finished: Run, places: Sequence[int] | NDArray[np.intp]) -> str:
    """Return UAVs by the numbers that the scenario gives them, or from 1 on."""
    scenario: Any = finished.resolved.scenario
    numbers = getattr(scenario, "numbers", range(1, _uavs(finished) + 1))
    return ", ".join(f"UAV {numbers[place]}" for place in places)


def _law(finished: Run, time: float) -> str:
    """Return ", under the linear law" if that law controls the UAVs at a time."""
    trajectory = finished.trajectory
    steps = len(trajectory.decisions)
    # The state at a control instant is the result of the step that ends there; time 0
    # ends no step.
    step = int(np.searchsorted(trajectory.times, time, side="left")) - 1
    decision = trajectory.decisions[min(max(step, 0), steps - 1)]
    return ", under the linear law" if decision.mode is Mode.LINEAR else ""
