"""Table of the steps of a run, for a spreadsheet: steps.csv."""

import numpy as np

from swarmstart.ocp import Trajectory

STEPS = "steps.csv"


def step_table(trajectory: Trajectory) -> str:
    """Return the steps of a run as CSV text, a line each.

    Columns: the step from 0 on, its beginning [s], the wall time of its plans [s]
    (empty if it is not known), and for each agent the origin of its plan,
    named as `plan_source` in trajectory.npz.
    """
    agents = len(trajectory.decisions[0].plans)
    head = ["step", "time_s", "step_seconds"]
    lines = [head + [f"plan_{agent}" for agent in range(1, agents + 1)]]
    for step, decision in enumerate(trajectory.decisions):
        seconds = float(trajectory.step_seconds[step])
        lines.append([
            str(step),
            f"{float(trajectory.times[step]):.9g}",
            f"{seconds:.6g}" if np.isfinite(seconds) else "",
            *(plan.source.name for plan in decision.plans),
        ])  # fmt: skip
    return "".join(",".join(line) + "\n" for line in lines)
