"""Costs of the plans of a flight: in J, and in evaluations and time to find them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.format.kind import Measure
from swarmstart.ocp import Decision, Trajectory

Array = NDArray[np.float64]


def plan_costs(trajectory: Trajectory) -> Array:
    """Return J of each step, summed over those who plan, shape (T,)."""
    return np.array([sum(p.cost for p in d.plans) for d in trajectory.decisions])


def new_plans(decisions: Sequence[Decision]) -> NDArray[np.bool_]:
    """Return whether each plan was made at its step, shape (T, agents).

    A plan that is flown for several steps is the same object in each of them.
    """
    last = [(None,) * len(decisions[0].plans), *[d.plans for d in decisions[:-1]]]
    return np.array(
        [
            [now is not then for now, then in zip(d.plans, before, strict=True)]
            for d, before in zip(decisions, last, strict=True)
        ]
    )


def effort(trajectory: Trajectory) -> dict[str, Measure]:
    """Return the measures of what deciding took, over all steps."""
    evaluations = [[p.evaluations for p in d.plans] for d in trajectory.decisions]
    seconds = trajectory.step_seconds
    return {
        "evaluations": int(np.sum(evaluations, where=new_plans(trajectory.decisions))),
        "steps_starting_outside": sum(
            any(plan.start_excess > 0 for plan in decision.plans)
            for decision in trajectory.decisions
        ),
        "step_seconds_median": float(np.median(seconds)),
        "step_seconds_max": float(np.max(seconds)),
    }
