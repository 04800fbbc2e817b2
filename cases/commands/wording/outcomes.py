"""Sentences on the result of a run and on its constraints, by kind of scenario."""

from collections.abc import Mapping
from pkgutil import resolve_name

import numpy as np

from swarmstart.cases.campaign.running.run import Run
from swarmstart.cases.commands.wording.collisions import (
    BUT_BROKEN,
    closest_time,
    collisions,
    safe_distance,
)
from swarmstart.cases.commands.wording.excess import time_of_excess
from swarmstart.cases.drawing.naming.quantities import KEPT, quantity
from swarmstart.cases.drawing.naming.wording import is_number, number_of
from swarmstart.cases.format.document import printable
from swarmstart.cases.format.registry import words_of
from swarmstart.ocp import SolutionStatus

_SETTLING = "settling("
_MEANINGS = {
    SolutionStatus.CONVERGED: "a local optimum, confirmed by a finer integration",
    SolutionStatus.FEASIBLE: "feasible, confirmed by a finer integration, but not "
    "shown to be a local optimum",
}
"""Statuses of a plan that can be used, in plain words; others speak for themselves."""


def outcome(finished: Run) -> str:
    """Return the result in a sentence: whether it settled and when, or the cost."""
    words = words_of(finished.resolved.scenario.kind)
    if words.outcome:
        told: str = resolve_name(words.outcome)(finished.trajectory, finished.measures)
        return told
    ending = resolve_name(words.ending)(finished.measures) if words.ending else ""
    return f"{_of_problem(finished)} {ending}".strip()


def kept_constraints(finished: Run) -> str:
    """Return how near vehicles came, or whether constraints are kept, in a sentence."""
    if not _is_flight(finished):
        return _constraints(finished)
    parts = [*_distances(finished), _feasible_plans(finished)]
    said = "; ".join(filter(None, parts))
    return f"{said[:1].upper()}{said[1:]}."


def _of_problem(finished: Run) -> str:
    """Return the cost, with what it is worth, of a problem of any system."""
    measures, status = finished.measures, finished.ended.plan
    settled = _own_settling(finished)
    if status is not None:
        cost = _cost(finished, "cost")
        if not status.is_confirmed:
            said = printable(f"{status.value}{finished.ended.more}")
            if status in (SolutionStatus.INFEASIBLE, SolutionStatus.NOT_FINITE):
                return f"{said[:1].upper()}{said[1:]}."
            return f"{cost}, {said}."
        return f"{cost}: {_MEANINGS[status]}.{settled}"
    said = "The cost of the simulated path is not finite"
    if is_number(measures.get("flown_cost")):
        said = f"{_cost(finished, 'flown_cost')} along the simulated path"
    return f"{said}; {_plans_in_words(finished)}.{settled}"


def _cost(finished: Run, name: str) -> str:
    """Return a cost, by the name that the problem gives it."""
    value = finished.measures.get(name)
    sense = finished.flight.posed.agents[0].problem.sense
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
    at_end = missed if status is not None else 0.0
    if max(along, at_end) <= KEPT:
        return f"All constraints are kept along the simulated path{_missed(missed)}."
    if status is not None and not status.is_confirmed:
        broken = finished.flight.answer(finished.trajectory).path.broken
        if broken:
            return f"A constraint is broken: {printable(str(broken[0]))}."
    is_plan = status is not None and not finished.flight.posed.plant.differs
    parts = []
    if not along <= KEPT:
        when = "" if is_plan else time_of_excess(finished)
        parts.append(f"{_amount(along)} along the path{when}")
    if not at_end <= KEPT:
        parts.append(f"{_amount(at_end)} at the end")
    listed = f"largest excess {' and '.join(parts)}, in the unit of the constraint"
    if is_plan:
        return f"All constraints are kept within the tolerance ({listed})."
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
        when, apart = quantity(closest_time(finished), 4), number_of(near)
        parts.append(
            f"closest distance of two UAVs {quantity(apart, 4)} m, at {when} s"
            f"{_against(apart, safe_distance(finished))}"
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
    broken = BUT_BROKEN if breaks_constraint(finished) else ""
    return f"the plan is feasible{broken}" if status.is_confirmed else ""


def _plans_in_words(finished: Run) -> str:
    """Return how many steps found a feasible plan."""
    ended = finished.ended
    broken = BUT_BROKEN if breaks_constraint(finished) else ""
    if len(finished.trajectory.decisions) == 1:
        is_feasible = finished.feasible
        return f"the plan is feasible{broken}" if is_feasible else "no plan is feasible"
    return f"{ended.found}{broken if ended.all_found else ''}{ended.more}"


def told_status(finished: Run) -> str:
    """Return the sentence on how a run ended, which hides no broken constraint."""
    hides_broken = finished.ended.all_found and breaks_constraint(finished)
    return finished.ended.sentence(BUT_BROKEN if hides_broken else "")


def breaks_constraint(finished: Run) -> bool:
    """Return whether a flight or a closed loop breaks a constraint on its way."""
    if _is_flight(finished):
        return bool(collisions(finished))
    if finished.flight.posed.open_loop:
        return False
    return not number_of(finished.measures.get("constraint_excess")) <= KEPT


def _is_flight(finished: Run) -> bool:
    """Return whether a run is a flight of aircraft, which keep distances."""
    return bool(words_of(finished.resolved.scenario.kind).flown_by)
