"""Whether a control step found the plan it looked for."""

from swarmstart.ocp import Decision, Mode, Source


def planned(decision: Decision) -> bool:
    """Return whether a step was planned, not flown under the linear law."""
    return decision.mode is Mode.PLANNED


def found_plans(decision: Decision) -> bool:
    """Return whether planning found a feasible plan for every agent.

    Where the shifted last plan is flown, it did not, feasible as that plan may be.
    """
    return all(
        plan.feasible and plan.source is not Source.SHIFTED for plan in decision.plans
    )
