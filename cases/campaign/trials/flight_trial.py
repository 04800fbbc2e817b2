"""A whole closed-loop run as a trial, for `compare` and `run --seeds`.

The answer is judged by the simulated path and not by the plans: by the cost of the
path, and the largest excess over a constraint along it (`Kind.whole_run`).

The number s of a run is the seed of the solver. A scenario draws gusts and noise with
seeds of its own (any key called `seed`), and run s of a campaign adds s to each of
them. Thus run 0 is the scenario as it is written, and all solvers have the same
disturbances in runs of the same number.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.cases.campaign.engine.cells import Cell
from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.campaign.trials.result import FlightResult
from swarmstart.cases.format.scenario import Resolved, resolved_again

FLOWN_TOLERANCE = 1e-2
"""Allowed excess of a simulated path: disturbances move it off the plan."""
MOST_POINTS = 201
"""Number of instants of the path that a trial keeps."""

SEED = "seed"


def flight_cell(
    resolved: Resolved,
    seed: int,
    *,
    timeout_s: float | None = None,
    named: bool = False,
    by: str = "",
) -> Cell:
    """Return one closed-loop run as a cell, a unit of work for a worker process.

    Args:
        resolved: The scenario, with the search and polish of its plans.
        seed: The number of the run. It is the seed of the solver, and is added to the
            seeds that the scenario has (`seeded`).
        timeout_s: Time limit [s]; None means no limit.
        named: Whether the scenario's claims are judged. If not, scenarios that differ
            only in name, title, source or claims share one cell, and are run once.
        by: The solver, for the label; empty means the scenario's own search.

    Raises:
        CodeNotAllowedError: If the scenario runs code of the user's that may not be
            run.
    """
    resolved.require_allowed()
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
    job: Mapping[str, Any], folder: Path, *, code_in: str | None = None
) -> dict[str, Any]:
    """Return the result of a scenario with a seed; called in a worker.

    Files of the folder `code_in` may be run; without it no file may be run.
    """
    del folder
    settings = seeded(job["settings"], job["seed"])
    resolved = resolved_again(settings, job["variant"], code_in=code_in)
    return flown_trial(run(resolved, seed=job["seed"])).as_json()


def flown_trial(finished: Run) -> FlightResult:
    """Return the result of a finished run in the form of a trial's result."""
    trajectory, measures = finished.trajectory, finished.measures
    resolved, flight = finished.resolved, finished.flight
    found = resolved.kind.whole_run(resolved.scenario, flight, trajectory, measures)
    seconds = np.asarray(trajectory.step_seconds)
    counted = measures.get("evaluations")  # Rules of swarms evaluate no problem.
    # One step without a feasible plan is enough for "no".
    claimed = finished.feasible and not measures.get("infeasible_steps")
    holds = found.excess <= FLOWN_TOLERANCE and math.isfinite(found.cost)
    return FlightResult(
        sense=flight.sense,
        claimed_feasible=bool(claimed),
        verified_cost=found.cost,
        verified_violation=found.excess,
        feasible=bool(claimed and holds),
        status=finished.status,
        evaluations=int(counted) if isinstance(counted, int | float) else None,
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
        reason=finished.ended.reason,
        advice=finished.ended.advice,
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


def seed_keys(settings: Mapping[str, Any]) -> list[str]:
    """Return the dotted keys of all seeds of a resolved scenario."""
    parts = {name: part for name, part in settings.items() if name != "claims"}
    return [".".join(path) for path, _ in _seeds(parts, ())]


def seeded(settings: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Return a resolved scenario's settings with a number added to each of its seeds.

    Args:
        settings: Plain data; not changed.
        seed: The number of the run, from 0 on.
    """
    return {
        name: part if name == "claims" else _raised(part, seed)
        for name, part in settings.items()
    }


def _seeds(
    part: object, path: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], int]]:
    named: Sequence[tuple[str, object]] = ()
    if isinstance(part, Mapping):
        named = [(str(name), inner) for name, inner in part.items()]
    elif isinstance(part, list):
        named = [(str(number), inner) for number, inner in enumerate(part)]
    for name, inner in named:
        if _is_seed(name, inner):
            yield (*path, name), inner  # type: ignore[misc]
        else:
            yield from _seeds(inner, (*path, name))


def _raised(part: object, seed: int) -> object:
    if isinstance(part, Mapping):
        return {
            name: inner + seed if _is_seed(name, inner) else _raised(inner, seed)
            for name, inner in part.items()
        }
    return [_raised(inner, seed) for inner in part] if isinstance(part, list) else part


def _is_seed(name: object, value: object) -> bool:
    return name == SEED and isinstance(value, int) and not isinstance(value, bool)
