"""What the plans of a flight cost: in J, and in evaluations and time to find them."""

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.kind import Measure
from swarmstart.ocp import Trajectory

Array = NDArray[np.float64]


def plan_costs(trajectory: Trajectory) -> Array:
    """Return J of each step, summed over those who plan, shape (T,)."""
    return np.array([sum(p.cost for p in d.plans) for d in trajectory.decisions])


def effort(trajectory: Trajectory) -> dict[str, Measure]:
    """Return the measures of what deciding took, over all steps."""
    plans = [plan for decision in trajectory.decisions for plan in decision.plans]
    seconds = trajectory.step_seconds
    return {
        "evaluations": sum(plan.evaluations for plan in plans),
        "steps_starting_outside": sum(
            any(plan.start_excess > 0 for plan in decision.plans)
            for decision in trajectory.decisions
        ),
        "step_seconds_median": float(np.median(seconds)),
        "step_seconds_max": float(np.max(seconds)),
    }
