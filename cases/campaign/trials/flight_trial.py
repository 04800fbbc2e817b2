"""A whole closed-loop run as a trial, for `compare` and `run --seeds`.

The answer is judged by the simulated path and not by the plans: by the cost of the
path, and the largest excess over a constraint along it (`Kind.whole_run`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.cases.campaign.engine.cells import Cell
from swarmstart.cases.campaign.running.run import Run, run
from swarmstart.cases.campaign.trials.result import FlightResult
from swarmstart.cases.campaign.trials.seeding import seeded
from swarmstart.cases.format.scenario import Resolved, resolved_again

FLOWN_TOLERANCE = 1e-2
"""Allowed excess of a simulated path: disturbances move it off the plan."""
MOST_POINTS = 201
"""Number of instants of the path that a trial keeps."""


def flight_cell(
    resolved: Resolved,
    seed: int,
    *,
    timeout_s: float | None = None,
    named: bool = False,
    by: str = "",
) -> Cell:
    """Return the cell of one closed-loop run.

    Args:
        resolved: The scenario, with the search and polish of its plans.
        seed: The number of the run: seed of all random numbers, see seeding.py.
        timeout_s: Time limit [s]; None means no limit.
        named: Whether its claims are judged; else runs that differ in name and claims
            only are one cell.
        by: The solver, for the label; empty means the scenario's own search.
    """
    settings = dict(resolved.settings) if named else resolved.anonymous_settings()
    solver = f", {by}" if by else ""
    return Cell(
        work="swarmstart.cases.campaign.trials.flight_trial:fly_cell",
        job={"settings": settings, "variant": resolved.variant, "seed": seed},
        label=f"{resolved.scenario.name}{solver}, seed {seed}",
        timeout_s=timeout_s,
        permissions=resolved.permissions(),
    )


def fly_cell(
    job: Mapping[str, Any], folder: Path, *, python_in: str | None = None
) -> dict[str, Any]:
    """Return the result of a scenario with a seed; called in a worker.

    Files of the folder `python_in` may be run only if the command has given it.
    """
    del folder
    settings = seeded(job["settings"], job["seed"])
    resolved = resolved_again(settings, job["variant"], python_in=python_in)
    return flown_trial(run(resolved, seed=job["seed"])).as_json()


def flown_trial(finished: Run) -> FlightResult:
    """Return the result of a run."""
    trajectory, measures = finished.trajectory, finished.measures
    resolved, flight = finished.resolved, finished.flight
    found = resolved.kind.whole_run(resolved.scenario, flight, trajectory, measures)
    seconds = np.asarray(trajectory.step_seconds)
    claimed = finished.feasible and not measures.get("infeasible_steps")
    holds = found.excess <= FLOWN_TOLERANCE and math.isfinite(found.cost)
    return FlightResult(
        sense=int(flight.posed.agents[0].problem.sense),
        claimed_feasible=bool(claimed),
        verified_cost=found.cost,
        verified_violation=found.excess,
        feasible=bool(claimed and holds),
        status=finished.status,
        evaluations=int(measures.get("evaluations") or 0),  # type: ignore[arg-type]
        seconds=float(seconds.sum()),
        build_seconds=max(0.0, finished.wall_s - float(seconds.sum())),
        compile_seconds=finished.compile_s,
        step_seconds={
            "p50": float(np.quantile(seconds, 0.5)),
            "p99": float(np.quantile(seconds, 0.99)),
            "max": float(seconds.max()),
            "dt": float(flight.plant.dt),
        },
        measures=dict(measures),
        claims=[
            {name: claim[name] for name in ("id", "text", "gate", "holds")}
            for claim in finished.claims
        ],
        track=_track(finished),
    )


def _track(finished: Run) -> dict[str, Any]:
    """Return the path at some instants: times [s], and the states by name."""
    trajectory = finished.trajectory
    count = trajectory.dense_times.size
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).astype(int))
    states = trajectory.dense_states[:, chosen]
    return {
        "time": [float(t) for t in trajectory.dense_times[chosen]],
        "states": {
            name: row.tolist()
            for name, row in zip(trajectory.state_names, states, strict=True)
        },
    }
