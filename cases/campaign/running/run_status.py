"""Status of a run: one sentence on its end, and whether a plan can be used."""

from __future__ import annotations

from swarmstart.cases.format.kind import Flight, Posed
from swarmstart.cases.record.trajectory_arrays import found_plans, planned
from swarmstart.ocp import DualMode, Trajectory


def status_of(flight: Flight[Posed], trajectory: Trajectory) -> tuple[str, bool]:
    """Return one sentence on a run, and whether any of its plans can be used."""
    said, is_usable = _status_of_plans(flight, trajectory)
    controller = flight.controller
    if isinstance(controller, DualMode) and controller.uncertified:
        said += "; the linear law's terminal sets are not certified"
    return said, is_usable


def _status_of_plans(flight: Flight[Posed], trajectory: Trajectory) -> tuple[str, bool]:
    """Return one sentence on the plans of a run, and whether any can be used.

    One plan that is followed to its end must be confirmed along its path.
    """
    if flight.posed.open_loop:
        answer = flight.answer(trajectory)
        said = f"simulated to the end; the plan is {answer.status.value}"
        if flight.posed.plant.differs:
            said += ", for the model it was made with: the simulated system is another"
        if answer.status.is_confirmed:
            return said, True
        return f"{said}: {answer.reason}; {answer.advice}", False
    found = [found_plans(d) for d in trajectory.decisions if planned(d)]
    infeasible, linear = found.count(False), len(trajectory.decisions) - len(found)
    if not infeasible:
        law = f", {linear} steps under the linear law" if linear else ""
        said = "simulated to the end; every planned step found a feasible plan"
        return said + law + _searched(trajectory), True
    if infeasible == len(found):
        return "simulated to the end; no step found a feasible plan", False
    return (
        f"simulated to the end; {infeasible} of {len(found)} planned steps found no "
        f"feasible plan{_searched(trajectory)}",
        True,
    )


def _searched(trajectory: Trajectory) -> str:
    """Return how many plans were searched, if a warm polish was enough for some."""
    plans = [
        plan
        for decision in trajectory.decisions
        if planned(decision)
        for plan in decision.plans
        if plan.polish_status is not None
    ]
    searched = sum(plan.is_searched for plan in plans)
    if searched in {0, len(plans)}:
        return ""
    return f", {searched} of {len(plans)} plans were searched"
