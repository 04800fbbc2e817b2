"""Sentences on the result of a run and on its constraints, by kind of scenario."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from swarmstart.cases.campaign.running.run import Run
from swarmstart.cases.commands.wording.collisions import (
    closest_time,
    collisions,
    qualified,
    safe_distance,
)
from swarmstart.cases.commands.wording.excess import time_of_excess
from swarmstart.cases.commands.wording.quantities import KEPT, quantity
from swarmstart.cases.drawing.naming.wording import is_number
from swarmstart.cases.format.document import printable
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
    told = _OUTCOMES.get(finished.resolved.scenario.kind, _of_problem)
    return told(finished)


def kept_constraints(finished: Run) -> str:
    """Return how near vehicles came, or whether constraints are kept, in a sentence."""
    if finished.resolved.scenario.kind in ("problem", "python"):
        return _constraints(finished)
    parts = [*_distances(finished), _feasible_plans(finished)]
    said = "; ".join(filter(None, parts))
    return f"{said[:1].upper()}{said[1:]}."


def status_of_plan(finished: Run) -> SolutionStatus | None:
    """Return the status of the one plan of an open loop; None of a closed loop."""
    if not finished.flight.posed.open_loop:
        return None
    found = [one for one in SolutionStatus if one.value in finished.status]
    return found[0] if found else None


def _of_problem(finished: Run) -> str:
    """Return the cost, with what it is worth, of a problem of any system."""
    measures, status = finished.measures, status_of_plan(finished)
    settled = _own_settling(finished)
    if status is not None:
        cost = _cost(finished, "cost")
        if not status.is_confirmed:
            said = printable(finished.status).partition("the plan is ")[2]
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
        f"{word} {quantity(_float(value))}"
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
            when = f"{quantity(_float(value))} s" if is_number(value) else "not settled"
            said.append(f"{name} {when}")
    return f" Settling time: {', '.join(said)}." if said else ""


def _of_formation(finished: Run) -> str:
    """Return whether UAVs stay in their slots."""
    measures = finished.measures
    settle, tail = measures["settle_time_s"], measures["tail_error_m"]
    if is_number(measures.get("plan_cost")):
        cost = quantity(_float(measures["plan_cost"]))
        return f"Cost of the plan {cost}{_polished(finished)}."
    cost = f"closed-loop cost {quantity(_float(measures['closed_loop_cost']))}"
    if is_number(settle):
        said = f"Settled after {quantity(_float(settle))} s"
        return f"{said}: every UAV then stays within 1 m of its slot; {cost}."
    return (
        f"Not settled: in the last 10 s a UAV is up to {quantity(_float(tail), 3)} m "
        f"off its slot (settled: at most 1 m); {cost}."
    )


def _polished(finished: Run) -> str:
    """Return how IPOPT ended for the first plan; empty without a polish."""
    plans = finished.trajectory.decisions[0].plans
    ended = [one.polish_status for one in plans if one.polish_status is not None]
    return f"; IPOPT {ended[0].value}" if ended else ""


def _of_close_formation(finished: Run) -> str:
    """Return whether the wingman stays in its slot."""
    times = [finished.measures.get(name) for name in ("x_settle_s", "y_settle_s")]
    last = finished.measures.get("position_error_late_ft")
    off = f"in the last 5 s it is at most {quantity(_float(last), 3)} ft off"
    if all(map(is_number, times)):
        latest = quantity(max(map(_float, times)))
        return (
            f"Settled {latest} s after the leader's last change: the wingman then "
            f"stays within 1 ft of its slot in x and y; {off}."
        )
    return f"Not settled: the wingman does not stay within 1 ft of its slot; {off}."


def _of_reconfiguration(finished: Run) -> str:
    """Return how far UAVs are from their slots at the end."""
    error = quantity(_float(finished.measures["position_error_m"]), 3)
    return (
        f"At the end every UAV is within {error} m of its slot, relative to the leader."
    )


def _of_transfer(finished: Run) -> str:
    """Return the cost of the plan and how far UAVs are from their goals."""
    said, error = _of_problem(finished), finished.measures.get("goal_error_m")
    if not is_number(error):
        return said
    off = quantity(_float(error), 2)
    return f"{said} At the end every UAV is within {off} m of its goal."


_OUTCOMES: Mapping[str, Callable[[Run], str]] = {
    "formation_flight": _of_formation,
    "close_formation": _of_close_formation,
    "reconfiguration": _of_reconfiguration,
    "transfer": _of_transfer,
}


def _constraints(finished: Run) -> str:
    """Return whether path and terminal constraints are kept, else by how much not."""
    measures, status = finished.measures, status_of_plan(finished)
    along = _float(measures.get("constraint_excess"))
    missed = _float(measures.get("terminal_excess"))
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
        when = quantity(closest_time(finished), 4)
        parts.append(
            f"closest distance of two UAVs {quantity(_float(near), 4)} m, at {when} s"
            f"{_against(_float(near), safe_distance(finished))}"
        )
    clear = measures.get("obstacle_clearance_m")
    if is_number(clear):
        inside = " inside it" if _float(clear) < 0 else ""
        away = quantity(abs(_float(clear)), 3)
        parts.append(f"closest to the edge of an obstacle {away} m{inside}")
    aircraft = measures.get("min_range_ft")
    if is_number(aircraft):
        parts.append(
            f"closest distance of the two aircraft {quantity(_float(aircraft), 4)} ft"
        )
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
    status = status_of_plan(finished)
    if status is None:
        return _plans_in_words(finished)
    said = "the plan is feasible" if status.is_confirmed else ""
    return qualified(said) if breaks_constraint(finished) else said


def _plans_in_words(finished: Run) -> str:
    """Return how many steps found a feasible plan."""
    if len(finished.trajectory.decisions) == 1:
        said = "the plan is feasible" if finished.feasible else "no plan is feasible"
    else:
        status = printable(finished.status)
        said = status.partition("; ")[2] or status
    return qualified(said) if breaks_constraint(finished) else said


def breaks_constraint(finished: Run) -> bool:
    """Return whether a flight or a closed loop breaks a constraint on its way."""
    if finished.resolved.scenario.kind not in ("problem", "python"):
        return bool(collisions(finished))
    if finished.flight.posed.open_loop:
        return False
    return not _float(finished.measures.get("constraint_excess")) <= KEPT


def _float(value: Any) -> float:
    """Return a measure as a number; NaN if it is undefined."""
    return float(value) if is_number(value) else float("nan")
