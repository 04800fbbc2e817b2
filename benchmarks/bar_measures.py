"""Runs of the bars, with measures that only the bars need.

`name[k]`: entry k of a list. `wall_s`: wall time of the run. `settled`: 1 if x and y
both settle. `error_in_turn_ft`: largest distance from the slot while the leader turns.
`best_cost_per_horizon[k]`: the best known J from the states of the run;
`search_gap_max`: the largest gap of the search's own answers to it, before the polish.
`steps_worse_than_search`: number of plans worse than the search's answer that they were
polished from.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.kind import Measure
from swarmstart.cases.format.scenario import read_document, resolve, resolved_again
from swarmstart.cases.kinds.close_formation.measures import deviations
from swarmstart.cases.kinds.close_formation.scenario import CloseFormationScenario
from swarmstart.ocp import Source
from swarmstart.ocp.nlp.polish import is_better

FEASIBLE = 1e-6
"""Largest violation that counts as feasible: the problems' tolerance."""
TURN_S = (25.0, 125.0)
"""Interval in which the full turn is on and the wingman follows it [s]."""
REPEATED = 10
"""Number of seeds that are run twice."""


def fly(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Simulate a run of a bar, in a worker."""
    del folder
    finished = run(resolved_again(job["settings"], job["variant"]), seed=job["seed"])
    measures: dict[str, Measure] = {**finished.measures, "wall_s": finished.wall_s}
    if "x_settle_s" in measures:
        settled = None not in (measures["x_settle_s"], measures["y_settle_s"])
        measures["settled"] = int(settled)
        measures["error_in_turn_ft"] = _error_in_turn(finished)
    if measures.get("gap_per_horizon") is not None:
        costs, gaps = (
            np.array(measures[name]) for name in ("cost_per_horizon", "gap_per_horizon")
        )
        plans = [decision.plans[0] for decision in finished.trajectory.decisions]
        missed = np.array([plan.search.cost for plan in plans]) - (costs - gaps)
        measures["best_cost_per_horizon"] = (costs - gaps).tolist()
        measures["search_gap_max"] = float(missed.max())
    measures["steps_worse_than_search"] = _worse_than_search(finished)
    for name, values in list(measures.items()):
        if isinstance(values, list):
            measures |= {f"{name}[{k}]": value for k, value in enumerate(values)}
    return {"status": finished.status, "measures": measures}


def _error_in_turn(finished: Run) -> float | None:
    """Return the largest distance from the slot during the full turn [ft]."""
    scenario, trajectory = finished.resolved.scenario, finished.trajectory
    begin, end = TURN_S
    if not isinstance(scenario, CloseFormationScenario) or trajectory.times[-1] < end:
        return None
    within = (trajectory.times >= begin) & (trajectory.times <= end)
    off = deviations(scenario, trajectory.states[:, within])
    return float(np.linalg.norm(off, axis=0).max())


def _worse_than_search(finished: Run) -> int:
    return sum(
        is_better(
            (plan.search.cost, plan.search.violation),
            (plan.cost, plan.violation),
            tolerance=FEASIBLE,
        )
        for decision in finished.trajectory.decisions
        for plan in decision.plans
        if plan.source in (Source.SEARCH, Source.POLISH)
    )


def same_again(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the share of seeds whose second run equals the first, to the bit."""
    del job, folder
    resolved = resolve(read_document("close_formation"))
    same = 0
    for seed in range(REPEATED):
        first, second = (
            trajectory.dense_states.tobytes() + trajectory.controls.tobytes()
            for trajectory in (run(resolved, seed=seed).trajectory for _ in range(2))
        )
        same += first == second
    return {"measures": {"same_again": same / REPEATED}}
