"""Run one scenario: fly it, measure it, judge its claims, draw it, record it.

An interrupted run keeps its finished steps in its folder, and the same run again goes
on from there, with the same bits as if it had not been interrupted.
"""

from __future__ import annotations

import json
import logging
import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from swarmstart.cases.claims import judged
from swarmstart.cases.feasibility import found_plans, planned
from swarmstart.cases.kind import Flight, Measure
from swarmstart.cases.record import (
    load_partial,
    prepare_folder,
    remove_partial,
    run_key,
    save_partial,
    trajectory_arrays,
    write_arrays,
    write_json,
    write_text,
)
from swarmstart.cases.scenario import Resolved
from swarmstart.cases.versions import versions
from swarmstart.ocp import Step, Trajectory, chosen_backend, collected, fly
from swarmstart.ocp.interrupts import noticed

logger = logging.getLogger(__name__)

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
        super().__init__(
            f"{finished} finished steps are kept in {folder}; the same command again "
            "goes on from there"
        )
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
        wall_s: Wall time of building, flying and measuring, without what an
            interrupted run before had spent [s].
        folder: Where the record is; None where none was asked for.
        figures: The figures drawn.
        resumed: Steps that an interrupted run before had finished.
    """

    resolved: Resolved
    seed: int
    flight: Flight
    trajectory: Trajectory
    measures: Mapping[str, Measure]
    claims: list[dict[str, Any]]
    status: str
    feasible: bool
    wall_s: float = 0.0
    folder: Path | None = None
    figures: tuple[Path, ...] = ()
    resumed: int = 0

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
            "backend": backend_of(self.resolved),
            "resumed_steps": self.resumed,
            "versions": versions(),
            "figures": [file.name for file in self.figures],
            "documents": list(self.flight.documents),
            "out": str(self.folder) if self.folder else None,
        }


def default_folder(resolved: Resolved, seed: int, root: Path) -> Path:
    """Return root/<scenario>/<key>, where a run is recorded by default."""
    return root / resolved.scenario.name / key_of(resolved, seed)


def key_of(resolved: Resolved, seed: int) -> str:
    """Return the hash of what determines a run's result."""
    settings = dict(resolved.settings)
    for told_only in ("claims", "title", "source", "backend"):
        settings.pop(told_only)
    return run_key(settings, seed, backend_of(resolved))


def backend_of(resolved: Resolved) -> str:
    """Return what evaluates populations in a run."""
    return chosen_backend(resolved.scenario.backend)


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
        SwarmstartError: If the animation cannot be made here.
    """
    began = clock.perf_counter()
    kind, scenario = resolved.kind, resolved.scenario
    if folder is not None:
        prepare_folder(folder)  # Before the flight, not after it.
    if animation:
        kind.check_animation(animation)
    progress(0, scenario.steps, "building")
    flight = kind.build(scenario)
    logger.debug("built after %.2f s", clock.perf_counter() - began)
    steps, resumed = _flown(resolved, flight, seed, folder, progress)
    logger.debug("flown after %.2f s", clock.perf_counter() - began)
    try:
        finished = _measured(resolved, flight, collected(flight.plant, steps), seed)
        wall_s = clock.perf_counter() - began
        finished = replace(finished, wall_s=wall_s, resumed=resumed)
        if folder is None:
            return finished
        drawn = _recorded(finished, folder, figures, animation, progress)
        logger.debug("drawn after %.2f s", clock.perf_counter() - began)
        finished = replace(finished, folder=folder, figures=tuple(drawn))
        write_json(folder / "run.json", finished.summary())  # The commit mark: last.
        remove_partial(folder)
    except KeyboardInterrupt:
        if folder is None:
            raise
        raise Interrupted(folder, len(steps)) from None
    return finished


def _measured(
    resolved: Resolved, flight: Flight, trajectory: Trajectory, seed: int
) -> Run:
    """Return a flight with what is measured of it and said of its claims."""
    scenario = resolved.scenario
    measures = resolved.kind.measure(scenario, flight, trajectory)
    status, feasible = _status(flight, trajectory)
    return Run(
        resolved=resolved,
        seed=seed,
        flight=flight,
        trajectory=trajectory,
        measures=measures,
        claims=judged(
            scenario.claims,
            resolved.settings,
            measures,
            variant=resolved.variant,
            undefined=resolved.kind.undefined,
        ),
        status=status,
        feasible=feasible,
    )


def _flown(
    resolved: Resolved,
    flight: Flight,
    seed: int,
    folder: Path | None,
    progress: Progress,
) -> tuple[list[Step], int]:
    """Return all steps, and how many an interrupted run before had finished."""
    key = key_of(resolved, seed)
    kept, rng = _kept(flight, seed, folder, key)
    # A step and the generator's state after it, in one list: an interrupt may come
    # between any two statements.
    flown = [(step, rng.bit_generator.state) for step in kept]
    last = kept[-1] if kept else None
    saved = clock.perf_counter()

    def save() -> None:
        if folder is not None and flown:
            steps, (*_, state) = zip(*flown, strict=True)
            save_partial(folder, key, collected(flight.plant, steps), state)

    try:
        with noticed() as asked_to_stop:
            for step in fly(
                flight.plant,
                flight.controller,
                flight.x0 if last is None else last.dense_states[:, -1],
                steps=resolved.scenario.steps,
                rng=rng,
                done=len(kept),
                previous=None if last is None else last.decision,
            ):
                if asked_to_stop():
                    raise KeyboardInterrupt
                flown.append((step, rng.bit_generator.state))
                progress(len(flown), resolved.scenario.steps, "flying")
                if clock.perf_counter() - saved > CHECKPOINT_S:
                    save()
                    saved = clock.perf_counter()
        save()  # What follows may fail, or be interrupted.
    except KeyboardInterrupt:
        if folder is None or not flown:
            raise
        save()
        raise Interrupted(folder, len(flown)) from None
    return [step for step, _ in flown], len(kept)


def _kept(
    flight: Flight, seed: int, folder: Path | None, key: str
) -> tuple[list[Step], np.random.Generator]:
    """Return the steps of an interrupted run, and the generator as it left it."""
    rng = np.random.default_rng(seed)
    kept = load_partial(folder, key, flight.plant.substeps) if folder else None
    if kept is None:
        return [], rng
    steps, rng.bit_generator.state = kept
    return steps, rng


def _status(flight: Flight, trajectory: Trajectory) -> tuple[str, bool]:
    """Return one sentence on the plans of a flight, and whether any can be used.

    One plan that is flown to its end must be confirmed along its path.
    """
    answer = flight.answer(trajectory)
    if answer is not None:
        said = f"flown to the end; the plan is {answer.status.value}"
        if answer.status.is_confirmed:
            return said, True
        return f"{said}: {answer.reason}; {answer.advice}", False
    found = [found_plans(d) for d in trajectory.decisions if planned(d)]
    infeasible, linear = found.count(False), len(trajectory.decisions) - len(found)
    if not infeasible:
        law = f", {linear} steps under the linear law" if linear else ""
        return f"flown to the end; every planned step found a feasible plan{law}", True
    if infeasible == len(found):
        return "flown to the end; no step found a feasible plan", False
    return (
        f"flown to the end; {infeasible} of {len(found)} planned steps found no "
        "feasible plan",
        True,
    )


def _recorded(
    finished: Run,
    folder: Path,
    figures: bool,
    animation: str | None,
    progress: Progress,
) -> list[Path]:
    """Write all but run.json, which follows when the rest is there; return figures."""
    resolved, flight = finished.resolved, finished.flight
    kind, scenario, steps = resolved.kind, resolved.scenario, resolved.scenario.steps
    _record(finished, folder)
    drawn: list[Path] = []
    if figures:
        progress(steps, steps, "drawing")
        drawn = kind.figures(scenario, flight, finished.trajectory, folder / "figures")
    if animation:
        progress(steps, steps, "animating")
        file = folder / "figures" / f"flight.{animation}"
        kind.animate(scenario, flight, finished.trajectory, file)
        drawn.append(file)
    return drawn


def _withdraw(folder: Path) -> None:
    """Remove the commit mark of an earlier run in the folder, and what it wrote.

    Only what that run says it drew and wrote is removed: the folder may be anybody's.
    """
    mark = folder / "run.json"
    try:
        earlier = json.loads(mark.read_text())
        drawn, written = earlier["figures"], earlier.get("documents", [])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        drawn, written = [], []
    mark.unlink(missing_ok=True)
    for place, names in ((folder / "figures", drawn), (folder, written)):
        for name in names:
            (place / Path(str(name)).name).unlink(missing_ok=True)


def _record(finished: Run, folder: Path) -> None:
    """Write the scenario, the trajectory, and what else belongs to the flight."""
    _withdraw(folder)
    text = yaml.safe_dump(
        dict(finished.resolved.settings), sort_keys=False, allow_unicode=True
    )
    write_text(folder / "scenario.yaml", text)
    write_arrays(folder / "trajectory.npz", trajectory_arrays(finished.trajectory))
    for name, content in finished.flight.documents.items():
        write_text(folder / name, content)
