"""Run of a scenario: simulate, measure, judge the claims, draw, record, seek a bound.

An interrupted run keeps its finished steps in its folder. The same run again continues
from there, with the same bits as without the interruption. A lower bound is sought for
a scenario that makes one plan. `run_cell` does a run as a cell of a campaign. This
module does not import engine/cells.py, so that an edit there changes no cell's key.
"""

from __future__ import annotations

import contextlib
import logging
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from swarmstart.cases.campaign.engine.cell_keys import modules_of_settings
from swarmstart.cases.campaign.running.finished_run import (
    Interrupted,
    Run,
    key_of,
    measured_run,
)
from swarmstart.cases.format.document import printable
from swarmstart.cases.format.kind import (
    Flight,
    PlanningProblem,
    Posed,
    SeveralPlansError,
)
from swarmstart.cases.format.registry import words_of
from swarmstart.cases.format.scenario import Resolved, resolved_again
from swarmstart.cases.kinds.flight import first_problem, flight_of
from swarmstart.cases.record.bound_content import (
    bound_content,
    compared_anew,
    kept_bound,
    write_certificate,
)
from swarmstart.cases.record.files import (
    locked,
    write_arrays,
    write_bytes,
    write_json,
    write_text,
)
from swarmstart.cases.record.multiplier_arrays import (
    multiplier_arrays,
    multipliers_from,
)
from swarmstart.cases.record.partial import load_partial, remove_partial, save_partial
from swarmstart.cases.record.record import (
    FIGURES,
    MARK,
    SCENARIO,
    TRAJECTORY,
    OccupiedFolderError,
    Recording,
    kept_figures,
    require_own,
    withdraw,
)
from swarmstart.cases.record.trajectory_arrays import (
    STEPS,
    step_table,
    trajectory_arrays,
)
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics.running import heeded, put_off
from swarmstart.machine_code import Stopwatch, stopwatch
from swarmstart.ocp import (
    LowerBound,
    Solution,
    Step,
    collected,
    fly,
)
from swarmstart.ocp.answer import BoundInterrupted, bounded
from swarmstart.ocp.common import ProgressCallback, require_seconds, tell_nothing
from swarmstart.ocp.loop import SimulatedPlant, flown_again
from swarmstart.ocp.nlp import Multipliers, multipliers_of
from swarmstart.silence import silenced

logger = logging.getLogger(__name__)

# Work of this duration is kept even if no interrupt is handled, in seconds.
CHECKPOINT_S = 15.0


def run(
    resolved: Resolved,
    *,
    seed: int,
    recording: Recording | None = None,
    bound_s: float | None = None,
    threads: int | None = 1,
    progress: ProgressCallback = tell_nothing,
) -> Run:
    """Simulate a scenario, measure and record it.

    Args:
        resolved: The scenario.
        seed: The seed of all randomness.
        recording: Folder and options of the record; None means no record and no
            figures.
        bound_s: Work for a lower bound of the one plan, after all other work, in units
            of about a second; None means no bound. It changes neither other results nor
            the hash by which the run is recognised.
        threads: Largest number of threads and processes, as in `solve`.
        progress: Callback after each step.

    Raises:
        InvalidProblemError: If `bound_s` is not a positive number.
        SeveralPlansError: If a bound is asked for and there is more than one plan.
        Interrupted: On Ctrl-C; the finished steps are in the folder.
        DivergedError: If states of the plant become infinite or NaN; the finished steps
            are in the folder.
        OccupiedFolderError: If the folder holds anything but a record of this run.
        CodeNotAllowedError: If the scenario runs a user's file, which is not allowed.
        FolderInUseError: If another command writes to the folder.
        RecordError: If a file cannot be written.
        SwarmstartError: If the animation cannot be made on this machine.
    """
    require_seconds("bound", bound_s)
    if bound_s is not None:
        _planned_once(resolved.posed(), resolved.scenario.steps)  # Else raises now.
    if recording is None:
        finished = _run(resolved, seed, None, threads, progress)
        return _bounded(finished, bound_s, progress)
    with locked(recording.folder):  # Tried before the simulation, not after it.
        if recording.force:
            _keep_original(resolved, recording.folder)
        else:
            key = key_of(resolved, seed)
            require_own(recording.folder, key, _scenario_text(resolved))
        finished = _run(resolved, seed, recording, threads, progress)
        return _bounded(finished, bound_s, progress)


def run_cell(job: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Run a scenario in a worker process; return status, measures and wall time.

    If figures are drawn, the record of the run is kept in the folder.
    """
    resolved = resolved_again(job["settings"], job["variant"])
    finished = run(
        resolved,
        seed=job["seed"],
        # The folder belongs to the cell, also if an earlier attempt left files there.
        recording=Recording(folder=folder, force=True) if job["figures"] else None,
    )
    summary = finished.summary()
    kept = ("status", "measures", "wall_s", "backend", "figures")
    return {name: summary[name] for name in kept}


def modules_of(job: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the modules that a run imports by the names in its settings.

    If their code is edited, an earlier result of the same run is not used again.
    """
    settings = job["settings"]
    named = modules_of_settings(settings)
    if not job["figures"]:
        return named
    drawn_by: str = resolve_name(words_of(settings["kind"]).kind).drawn_by
    return (*named, drawn_by.partition(":")[0])


def _keep_original(resolved: Resolved, folder: Path) -> None:
    """Raise if the folder contains a file to run, which its copy would replace."""
    if resolved.code is not None and resolved.folder.resolve() == folder.resolve():
        raise OccupiedFolderError(
            folder,
            f"the files of {printable(resolved.code)}",
            expected="another folder than that of the file to be run",
            way="choose another --out",
        )


def _run(
    resolved: Resolved,
    seed: int,
    recording: Recording | None,
    threads: int | None,
    progress: ProgressCallback,
) -> Run:
    """Return the run, in a folder that is locked and the run's own."""
    # IPOPT is quiet by its options; other solvers print from native code.
    is_loud = resolved.scenario.polish_name not in ("none", "ipopt")
    with silenced(is_needed=is_loud), stopwatch() as watch:
        return _timed(resolved, seed, recording, threads, progress, watch)


def _timed(
    resolved: Resolved,
    seed: int,
    recording: Recording | None,
    threads: int | None,
    progress: ProgressCallback,
    watch: Stopwatch,
) -> Run:
    """Return the run, timed by a running stopwatch."""
    kind, scenario = resolved.kind, resolved.scenario
    if recording is not None and recording.animation:
        kind.check_animation(recording.animation)
    progress(0, scenario.steps, "building")
    with heeded():
        flight = flight_of(resolved.posed(), scenario, threads=threads)
    logger.debug("built after %.2f s", watch.seconds)
    folder = recording.folder if recording else None
    if flight.posed.begins_anew:
        folder = None
    steps, resumed, multipliers = _flown(resolved, flight, seed, folder, progress)
    logger.debug("simulated after %.2f s", watch.seconds)
    try:
        with heeded():
            finished = measured_run(
                resolved, flight, collected(flight.plant, steps), seed
            )
            finished = replace(
                finished,
                wall_s=watch.seconds,
                compile_s=watch.compile_seconds,
                resumed=resumed,
                multipliers=multipliers,
            )
            if recording is None:
                return finished
            further = kind.documents(scenario, flight, finished.trajectory)
            finished = replace(finished, documents={**finished.documents, **further})
            drawn = _recorded(finished, recording, progress)
            logger.debug("drawn after %.2f s", watch.seconds)
    except KeyboardInterrupt:
        if folder is None:
            raise
        raise Interrupted(folder, len(steps)) from None
    finished = replace(
        finished,
        folder=recording.folder,
        figures=tuple(drawn),
        bound_content=_kept_bound(finished, recording.folder),
    )
    with put_off():
        write_json(
            recording.folder / MARK, finished.summary()
        )  # Last: it marks a complete record.
        remove_partial(recording.folder)
    return finished


def _planned_once(posed: Posed, steps: int) -> PlanningProblem:
    """Return the planning problem of a scenario that makes one plan.

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


def _kept_bound(finished: Run, folder: Path) -> Mapping[str, Any] | None:
    """Return the bound in the record of an earlier, equal run, if it has one.

    Earlier figures are kept in the same way.
    """
    kept = kept_bound(folder, key_of(finished.resolved, finished.seed))
    if kept is None:
        return None
    try:  # A user's record can claim a bound of several plans.
        _planned_once(finished.flight.posed, finished.resolved.scenario.steps)
    except SeveralPlansError:
        return None
    return compared_anew(kept, finished.flight.answer(finished.trajectory))


def _bounded(finished: Run, seconds: float | None, progress: ProgressCallback) -> Run:
    """Return a finished run with its bound, and add the bound to its record."""
    if seconds is None:
        return finished
    flight, scenario = finished.flight, finished.resolved.scenario
    answer, is_interrupted = flight.answer(finished.trajectory), False
    try:
        one = _planned_once(flight.posed, scenario.steps)
        bound: LowerBound | None = bounded(
            answer, one.problem, one.x0, one.known, work=seconds, progress=progress
        )
    except BoundInterrupted as stopped:
        bound, is_interrupted = stopped.partial, True
    if bound is not None:
        finished = _with_bound(finished, bound, answer)
    if is_interrupted:
        steps = len(finished.trajectory.decisions)
        raise Interrupted(finished.folder, steps, run=finished)
    return finished


def _with_bound(finished: Run, bound: LowerBound, answer: Solution) -> Run:
    """Return a run with its bound, and write the bound to its record."""
    folder, beside = finished.folder, answer.beside(bound)
    with put_off():
        file = None if folder is None else write_certificate(folder, bound)
        content = bound_content(bound, beside, certificate=file)
        finished = replace(finished, bound=bound, bound_content=content)
        if folder is not None:
            write_json(folder / MARK, finished.summary())
    return finished


def _flown(
    resolved: Resolved,
    flight: Flight[Posed],
    seed: int,
    folder: Path | None,
    progress: ProgressCallback,
) -> tuple[list[Step], int, Multipliers | None]:
    """Return all steps, the number kept from an interrupted run, and multipliers.

    The multipliers are those of the first plan.
    """
    key = key_of(resolved, seed)
    kept, rng, multipliers = _kept(flight, seed, folder, key)
    # A step and the generator's state after it are in one list, since an interrupt can
    # come between any two statements.
    flown = [(step, rng.bit_generator.state) for step in kept]
    last = kept[-1] if kept else None
    save = partial(_save, folder, key, flight, flown, multipliers)
    saved = clock.perf_counter()
    total, what = resolved.scenario.steps, "simulating"
    if flight.posed.open_loop:
        # Nearly all the time goes to the one plan, before the first step is finished.
        total, what = 0, "solving"
        progress(0, total, what)
    try:
        with heeded() as asked_to_stop:
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
                progress(len(flown) if total else 0, total, what)
                if clock.perf_counter() - saved > CHECKPOINT_S:
                    save()
                    saved = clock.perf_counter()
        save()  # The code below can fail or be interrupted.
    except SwarmstartError:  # The plant has failed, or left the finite numbers.
        save()
        raise
    except KeyboardInterrupt:
        if folder is None or not flown:
            raise
        with contextlib.suppress(KeyboardInterrupt):  # The message follows below.
            save()
        raise Interrupted(folder, len(flown)) from None
    steps = [step for step, _ in flown]
    return steps, len(kept), multipliers if kept else _multipliers(flight, steps)


def _multipliers(flight: Flight[Posed], steps: Sequence[Step]) -> Multipliers | None:
    """Return the multipliers of the first plan; None if several agents plan."""
    first, agents = steps[0].decision.plans, flight.posed.agents
    if len(agents) != 1 or first[0].point is None:
        return None
    return multipliers_of(first[0].point, agents[0].problem)


def _save(
    folder: Path | None,
    key: str,
    flight: Flight[Posed],
    flown: list[tuple[Step, Any]],
    kept: Multipliers | None,
) -> None:
    """Write the finished steps, if there are any and the run has a folder."""
    if folder is not None and flown:
        steps, (*_, state) = zip(*flown, strict=True)
        with put_off():
            first = kept or _multipliers(flight, steps)
            arrays = multiplier_arrays(first)
            save_partial(folder, key, collected(flight.plant, steps), state, arrays)


def _kept(
    flight: Flight[Posed], seed: int, folder: Path | None, key: str
) -> tuple[list[Step], np.random.Generator, Multipliers | None]:
    """Return steps, generator and multipliers of an interrupted run.

    The multipliers are those of the first plan.
    """
    rng = np.random.default_rng(seed)
    kept = load_partial(folder, key, flight.plant.substeps) if folder else None
    if kept is None:
        return [], rng, None
    steps, rng.bit_generator.state, arrays = kept
    plant = flight.plant
    if isinstance(plant, SimulatedPlant) and not flown_again(plant, steps):
        return [], np.random.default_rng(seed), None
    return steps, rng, multipliers_from(arrays)


def _recorded(
    finished: Run, recording: Recording, progress: ProgressCallback
) -> list[Path]:
    """Write all files but the mark, which is written last; return the figures."""
    resolved, flight, folder = finished.resolved, finished.flight, recording.folder
    kind, scenario = resolved.kind, resolved.scenario
    figures = kept_figures(folder, key_of(resolved, finished.seed))
    if figures is None:
        withdraw(folder)
    write_text(folder / SCENARIO, _scenario_text(resolved))
    arrays: dict[str, NDArray[Any]] = trajectory_arrays(finished.trajectory)
    arrays |= multiplier_arrays(finished.multipliers)
    costs = finished.measures.get("member_costs")
    if isinstance(costs, list):
        arrays["member_costs"] = np.array(costs, dtype=np.float64)
    write_arrays(folder / TRAJECTORY, arrays)
    write_text(folder / STEPS, step_table(finished.trajectory))
    for name, content in finished.documents.items():
        write_text(folder / name, content)
    for name, file in flight.posed.files.items():
        write_bytes(folder / name, file.read_bytes())
    drawn: list[Path] = []
    if recording.figures:
        progress(0, 0, "drawing")
        drawn = kind.figures(
            scenario,
            flight,
            finished.trajectory,
            folder / FIGURES,
            formats=recording.figure_formats,
            progress=progress,
        )
    if recording.animation:
        progress(0, 0, "animating")
        file = folder / FIGURES / f"flight.{recording.animation}"
        kind.animate(scenario, flight, finished.trajectory, file, progress=progress)
        drawn.append(file)
    return [*drawn, *(file for file in figures or () if file not in drawn)]


def _scenario_text(resolved: Resolved) -> str:
    """Return the resolved scenario as it is recorded."""
    return yaml.safe_dump(dict(resolved.settings), sort_keys=False, allow_unicode=True)
