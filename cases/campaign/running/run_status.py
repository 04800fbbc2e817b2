"""Status of a run: one sentence on its end, and whether a plan can be used."""

from __future__ import annotations

from typing import NamedTuple

from swarmstart.cases.format.kind import Flight, Posed
from swarmstart.cases.record.trajectory_arrays import found_plans, planned
from swarmstart.ocp import DualMode, SolutionStatus, Trajectory


class RunStatus(NamedTuple):
    """The end of a run.

    Attributes:
        is_usable: Whether any of its plans can be used.
        plan: Status of the one plan that was followed to its end; None of other runs.
        found: What was found, in words: how many planned steps found a feasible plan,
            or what the one plan is.
        more: What follows those words; empty or beginning with a comma or semicolon.
        all_found: Whether every plan is feasible.
    """

    is_usable: bool
    plan: SolutionStatus | None
    found: str
    more: str
    all_found: bool

    def sentence(self, remark: str = "") -> str:
        """Return one sentence on the end, with a remark on what was found."""
        return f"simulated to the end; {self.found}{remark}{self.more}"


def status_of(flight: Flight[Posed], trajectory: Trajectory) -> RunStatus:
    """Return how a run ended."""
    controller = flight.controller
    unproven = ""
    if isinstance(controller, DualMode) and controller.uncertified:
        unproven = "; the linear law's terminal sets are not certified"
    if flight.posed.open_loop:
        return _of_one_plan(flight, trajectory, unproven)
    found = [found_plans(d) for d in trajectory.decisions if planned(d)]
    infeasible, linear = found.count(False), len(trajectory.decisions) - len(found)
    more = _searched(trajectory) + unproven
    if not infeasible:
        more = (f", {linear} steps under the linear law" if linear else "") + more
        said = "every planned step found a feasible plan"
    elif infeasible == len(found):
        more = unproven
        said = "no step found a feasible plan"
    else:
        said = f"{infeasible} of {len(found)} planned steps found no feasible plan"
    return RunStatus(
        infeasible < len(found) or not infeasible,
        plan=None,
        found=said,
        more=more,
        all_found=not infeasible,
    )


def _of_one_plan(
    flight: Flight[Posed], trajectory: Trajectory, unproven: str
) -> RunStatus:
    """Return the status of a plan followed to its end, confirmed along its path."""
    answer = flight.answer(trajectory)
    is_confirmed = answer.status.is_confirmed
    said = f"the plan is {answer.status.value}"
    more = ""
    if flight.posed.plant.differs:
        more = ", for the model it was made with: the simulated system is another"
    if not is_confirmed:
        more += f": {answer.reason}; {answer.advice}"
    more += unproven
    return RunStatus(
        is_confirmed,
        plan=answer.status,
        found=said,
        more=more,
        all_found=is_confirmed,
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
