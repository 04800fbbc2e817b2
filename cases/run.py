"""Run one scenario: fly it, measure it, judge its claims, draw it, record it.

An interrupted run keeps its finished steps in its folder, and the same run again goes
on from there, with the same bits as if it had not been interrupted.
"""

from __future__ import annotations

import json
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from swarmstart.cases.claims import judged
from swarmstart.cases.kind import Flight, Measure
from swarmstart.cases.record import (
    load_partial,
    remove_partial,
    run_key,
    save_partial,
    trajectory_arrays,
    versions,
    write_arrays,
    write_atomically,
    write_json,
)
from swarmstart.cases.scenario import Resolved
from swarmstart.ocp import Step, Trajectory, collected, fly

BACKEND = "casadi"
# Work worth keeping even where nobody gets the chance to interrupt, in seconds.
CHECKPOINT_S = 15.0

Progress = Callable[[int, int, str], None]
"""(finished steps, all steps, what is being done) -> None."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a run; what was finished is in its folder.

    Attributes:
        folder: The run's folder.
        finished: Number of finished steps.
    """

    def __init__(self, folder: Path, finished: int) -> None:
        """Keep where the finished steps are."""
        super().__init__(f"{finished} finished steps are kept in {folder}")
        self.folder = folder
        self.finished = finished


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Run:
    """A finished run.

    Attributes:
        resolved: The scenario as it was run.
        seed: The seed.
        flight: What was flown.
        trajectory: The flight.
        measures: What was measured.
        claims: Every claim of the scenario, judged where this run can.
        status: One sentence on how it ended.
        feasible: Whether at least one planned step found a feasible plan.
        wall_s: Wall time of building, flying and measuring, all sessions [s].
        folder: Where the record is; None where none was asked for.
        figures: The figures drawn.
    """

    resolved: Resolved
    seed: int
    flight: Flight
    trajectory: Trajectory
    measures: Mapping[str, Measure]
    claims: list[dict[str, Any]]
    status: str
    feasible: bool
    wall_s: float
    folder: Path | None
    figures: tuple[Path, ...] = ()

    def summary(self) -> dict[str, Any]:
        """Return what `--json` prints and run.json holds."""
        settings = self.resolved.settings
        return {
            "schema": 1,
            "scenario": settings["name"],
            "kind": settings["kind"],
            "variant": self.resolved.variant,
            "seed": self.seed,
            "search": settings["search"]["name"],
            "polish": settings["polish"],
            "status": self.status,
            "measures": dict(self.measures),
            "claims": self.claims,
            "evaluations": self.measures.get("evaluations"),
            "wall_s": self.wall_s,
            "backend": BACKEND,
            "versions": versions(),
            "figures": [file.name for file in self.figures],
            "out": str(self.folder) if self.folder else None,
        }


def default_folder(resolved: Resolved, seed: int, root: Path) -> Path:
    """Return root/<scenario>/<key>, where a run is recorded by default."""
    return root / resolved.scenario.name / key_of(resolved, seed)


def key_of(resolved: Resolved, seed: int) -> str:
    """Return the hash of what determines a run's result."""
    settings = dict(resolved.settings)
    for told_only in ("claims", "title", "source"):
        settings.pop(told_only)
    return run_key(settings, seed, BACKEND)


def run(
    resolved: Resolved,
    *,
    seed: int,
    folder: Path | None = None,
    figures: bool = True,
    animation: str | None = None,
    progress: Progress = lambda done, steps, what: None,
) -> Run:
    """Fly a scenario, measure it, and record it.

    Args:
        resolved: The scenario.
        seed: The seed of all randomness.
        folder: Where to record; None means nowhere, and no figures.
        figures: Whether to draw.
        animation: "gif" or "mp4" for an animation beside the figures.
        progress: Told after each step.

    Raises:
        Interrupted: On Ctrl-C; the finished steps are in the folder.
        RecordError: If a file cannot be written.
    """
    began = clock.perf_counter()
    kind, scenario = resolved.kind, resolved.scenario
    progress(0, scenario.steps, "building")
    flight = kind.build(scenario)
    steps = _flown(resolved, flight, seed, folder, progress)
    trajectory = collected(flight.plant, steps)
    measures = kind.measure(scenario, flight, trajectory)
    status, feasible = _status(trajectory)
    finished = Run(
        resolved=resolved,
        seed=seed,
        flight=flight,
        trajectory=trajectory,
        measures=measures,
        claims=judged(scenario.claims, resolved.settings, measures),
        status=status,
        feasible=feasible,
        wall_s=clock.perf_counter() - began,
        folder=folder,
    )
    if folder is None:
        return finished
    _record(finished, folder)
    drawn: list[Path] = []
    if figures:
        progress(scenario.steps, scenario.steps, "drawing")
        drawn = kind.figures(scenario, flight, trajectory, folder / "figures")
    if animation:
        progress(scenario.steps, scenario.steps, "animating")
        file = folder / "figures" / f"flight.{animation}"
        kind.animate(scenario, flight, trajectory, file)
        drawn.append(file)
    finished = replace(finished, figures=tuple(drawn))
    write_json(folder / "run.json", finished.summary())  # The commit mark: last.
    remove_partial(folder)
    return finished


def _flown(
    resolved: Resolved,
    flight: Flight,
    seed: int,
    folder: Path | None,
    progress: Progress,
) -> list[Step]:
    """Fly all steps, those of an interrupted run included."""
    rng = np.random.default_rng(seed)
    key = key_of(resolved, seed)
    kept = load_partial(folder, key, flight.plant.substeps) if folder else None
    steps: list[Step] = []
    if kept is not None:
        steps, rng.bit_generator.state = kept
    state = rng.bit_generator.state
    last = steps[-1] if steps else None
    saved = clock.perf_counter()
    try:
        for step in fly(
            flight.plant,
            flight.controller,
            flight.x0 if last is None else last.dense_states[:, -1],
            steps=resolved.scenario.steps,
            rng=rng,
            done=len(steps),
            previous=None if last is None else last.decision,
        ):
            steps.append(step)
            state = rng.bit_generator.state
            progress(len(steps), resolved.scenario.steps, "flying")
            if folder and clock.perf_counter() - saved > CHECKPOINT_S:
                save_partial(folder, key, collected(flight.plant, steps), state)
                saved = clock.perf_counter()
    except KeyboardInterrupt:
        if folder is None or not steps:
            raise
        save_partial(folder, key, collected(flight.plant, steps), state)
        raise Interrupted(folder, len(steps)) from None
    return steps


def _status(trajectory: Trajectory) -> tuple[str, bool]:
    """Return one sentence on the plans of a flight, and whether any was feasible."""
    planned = [
        all(plan.feasible for plan in decision.plans)
        for decision in trajectory.decisions
    ]
    infeasible = planned.count(False)
    if not infeasible:
        return "flown to the end; every step found a feasible plan", True
    steps = "step" if infeasible == 1 else "steps"
    if infeasible == len(planned):
        return "flown to the end; no step found a feasible plan", False
    return (
        f"flown to the end; {infeasible} of {len(planned)} {steps} found no feasible "
        "plan and flew the shifted last one",
        True,
    )


def _withdraw(folder: Path) -> None:
    """Remove the commit mark of an earlier run in the folder, and its figures.

    Only what that run says it drew is removed: the folder may be anybody's.
    """
    mark = folder / "run.json"
    try:
        drawn = json.loads(mark.read_text())["figures"]
    except (OSError, ValueError, KeyError, TypeError):
        drawn = []
    mark.unlink(missing_ok=True)
    for name in drawn:
        (folder / "figures" / Path(str(name)).name).unlink(missing_ok=True)


def _record(finished: Run, folder: Path) -> None:
    """Write all but run.json, which follows when the rest is there."""
    _withdraw(folder)
    text = yaml.safe_dump(
        dict(finished.resolved.settings), sort_keys=False, allow_unicode=True
    )
    write_atomically(
        folder / "scenario.yaml", lambda file: file.write(text.encode("utf-8"))
    )
    write_arrays(folder / "trajectory.npz", trajectory_arrays(finished.trajectory))
