"""The one planning problem of a scenario that makes one plan, and its lower bound."""

from __future__ import annotations

from swarmstart.cases.format.kind import PlanningProblem, Posed, SeveralPlansError
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.ocp import LowerBound, Solution
from swarmstart.ocp.answer import bounded
from swarmstart.ocp.common import ProgressCallback


def planned_once(posed: Posed, steps: int) -> PlanningProblem:
    """Return the planning problem of a scenario that makes one plan.

    Args:
        posed: Agents and plant of the scenario.
        steps: Number of control steps.

    Raises:
        SeveralPlansError: If it makes several plans, for several steps or agents.
    """
    if posed.order is not None or posed.nearby is not None:
        raise SeveralPlansError(
            "a lower bound needs one plan, and this scenario has several agents that "
            "plan"
        )
    if not posed.open_loop and steps > 1:
        raise SeveralPlansError(
            f"a lower bound needs one plan, and this scenario plans at {steps} steps "
            "in closed loop"
        )
    return first_problem(posed)


def bound_of(
    posed: Posed, steps: int, answer: Solution, *, seconds: float,
    progress: ProgressCallback,
) -> LowerBound:  # fmt: skip
    """Return a lower bound of the cost of a scenario's one plan.

    Raises:
        BoundInterrupted: On Ctrl-C, with the best bound until then.
    """
    one = planned_once(posed, steps)
    return bounded(
        answer, one.problem, one.x0, one.known, seconds=seconds, progress=progress
    )
