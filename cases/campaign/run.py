"""Run one scenario: fly it, measure it, judge its claims, draw it, record it.

An interrupted run keeps its finished steps in its folder, and the same run again goes
on from there, with the same bits as if it had not been interrupted.
"""

from __future__ import annotations

import contextlib
import logging
import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from swarmstart.cases.campaign.claims import judged
from swarmstart.cases.campaign.planned_once import bound_of, planned_once
from swarmstart.cases.campaign.run_status import status_of
from swarmstart.cases.format.kind import Flight, Measure, Posed, SeveralPlansError
from swarmstart.cases.format.scenario import Resolved
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.record.bound_content import (
    CERTIFICATE,
    bound_content,
    compared_anew,
    kept_bound,
    write_certificate,
)
from swarmstart.cases.record.files import locked, write_arrays, write_json, write_text
from swarmstart.cases.record.multiplier_arrays import (
    multiplier_arrays,
    multipliers_from,
    told,
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
    run_key,
    versions,
    withdraw,
)
from swarmstart.cases.record.trajectory_arrays import (
    trajectory_arrays,
)
from swarmstart.compile_time import Stopwatch, stopwatch
from swarmstart.heuristics.interrupts import heeded, put_off
from swarmstart.ocp import (
    DivergedError,
    LowerBound,
    SearchReport,
    Solution,
    Step,
    Trajectory,
    chosen_backend,
    collected,
    fly,
)
from swarmstart.ocp.account import StartsAccount
from swarmstart.ocp.bounded import BoundInterrupted
from swarmstart.ocp.limits import require_seconds
from swarmstart.ocp.multipliers import Multipliers, multipliers_of
from swarmstart.ocp.progress import ProgressCallback, tell_nothing

logger = logging.getLogger(__name__)

# Work worth keeping even where nobody gets the chance to interrupt, in seconds.
CHECKPOINT_S = 15.0


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a run; what was finished is in its folder.

    Attributes:
        folder: The run's folder; None if none was asked for.
        finished: Number of finished steps.
        run: The finished run, if only its bound was interrupted, with the best bound
            until then if there is one; else None.
    """

    def __init__(
        self, folder: Path | None, finished: int, *, run: Run | None = None
    ) -> None:
        """Keep what is finished and where it is."""
        super().__init__(
            f"{finished} finished steps are kept in {folder}; the same command again "
            "goes on from there"
            if run is None
            else _without_bound(run)
        )
        self.folder = folder
        self.finished = finished
        self.run = run


def _without_bound(run: Run) -> str:
    """Return what is there of a run whose bound was interrupted."""
    kept = "" if run.folder is None else f" and kept in {run.folder}"
    best = "none was proven until then" if run.bound is None else "the best is kept"
    return f"the run is finished{kept}; its bound was interrupted: {best}"


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
        wall_s: Wall time of building, flying and measuring, without that of machine
            code, and without what an interrupted run before had spent [s].
        compile_s: Wall time of loading and compiling machine code meanwhile [s].
        folder: Where the record is; None where none was asked for.
        figures: The figures drawn.
        resumed: Steps that an interrupted run before had finished.
        multipliers: Of the first plan, if one agent plans and a solver has converged.
        bound: How good any plan can be, at most, if it was asked for.
        bound_content: The same as run.json has it; of the same run before, if none was
            asked for and its record has one; else None.
    """

    resolved: Resolved
    seed: int
    flight: Flight[Posed]
    trajectory: Trajectory
    measures: Mapping[str, Measure]
    claims: list[dict[str, Any]]
    status: str
    feasible: bool
    wall_s: float = 0.0
    compile_s: float = 0.0
    folder: Path | None = None
    figures: tuple[Path, ...] = ()
    resumed: int = 0
    multipliers: Multipliers | None = None
    bound: LowerBound | None = None
    bound_content: Mapping[str, Any] | None = None

    def __repr__(self) -> str:
        """Return scenario, seed and how it ended in one line."""
        name = self.resolved.scenario.name
        return f"Run of {name}, seed {self.seed}: {self.status}"

    def summary(self) -> dict[str, Any]:
        """Return what `--json` prints and run.json holds."""
        settings = self.resolved.settings
        return {
            "schema": 1,
            "scenario": settings["name"],
            "kind": settings["kind"],
            "variant": self.resolved.variant,
            "seed": self.seed,
            "key": key_of(self.resolved, self.seed),
            "search": settings["search"]["name"],
            "polish": settings["polish"],
            "status": self.status,
            "measures": dict(self.measures),
            "multipliers": told(self.multipliers),
            "starts": self._starts(),
            "search_lanes": self._search_lanes(),
            "bound": None if self.bound_content is None else dict(self.bound_content),
            "claims": self.claims,
            "evaluations": self.measures.get("evaluations"),
            "wall_s": self.wall_s,
            "compile_seconds": self.compile_s,
            "backend": backend_of(self.resolved),
            "resumed_steps": self.resumed,
            "versions": versions(),
            "figures": [file.name for file in self.figures],
            "documents": [*self.flight.documents, *self._certificates()],
            "out": str(self.folder) if self.folder else None,
        }

    @property
    def starts(self) -> StartsAccount | None:
        """What the starts of the first plan led to; None: there were not many."""
        decisions = self.trajectory.decisions
        return decisions[0].plans[0].starts if decisions else None

    @property
    def search_report(self) -> SearchReport:
        """What the search of the first plan found."""
        decisions = self.trajectory.decisions
        return decisions[0].plans[0].search if decisions else SearchReport()

    def _certificates(self) -> list[str]:
        return [CERTIFICATE] if (self.bound_content or {}).get("certificate") else []

    def _starts(self) -> dict[str, Any] | None:
        agent = self.flight.posed.agents[0]
        return None if self.starts is None else self.starts.told(agent.problem.sense)

    def _search_lanes(self) -> dict[str, Any] | None:
        return self.search_report.told(self.flight.posed.agents[0].problem.sense)


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
    recording: Recording | None = None,
    bound_s: float | None = None,
    progress: ProgressCallback = tell_nothing,
) -> Run:
    """Fly a scenario, measure it, and record it.

    Args:
        resolved: The scenario.
        seed: The seed of all randomness.
        recording: Where and how to record; None means nowhere, and no figures.
        bound_s: Time for a lower bound of the one plan, when all else is done [s]; None
            means that none is sought. It changes nothing else, and is in no key.
        progress: Told after each step.

    Raises:
        InvalidProblemError: If that time is no positive number.
        SeveralPlansError: If a bound is asked for, and there is more than one plan.
        Interrupted: On Ctrl-C; the finished steps are in the folder.
        DivergedError: If the plant leaves the finite numbers; the same of its steps.
        OccupiedFolderError: If the folder holds anything but a record of this run.
        CodeNotAllowedError: If a file of the user's is to be run, and may not.
        FolderInUseError: If another command writes to the folder.
        RecordError: If a file cannot be written.
        SwarmstartError: If the animation cannot be made here.
    """
    require_seconds("bound", bound_s)
    if bound_s is not None:
        planned_once(resolved.posed(), resolved.scenario.steps)  # Else refused now.
    if recording is None:
        return _bounded(_run(resolved, seed, None, progress), bound_s, progress)
    with locked(recording.folder):  # Tried before the flight, not after it.
        if recording.force:
            _keep_original(resolved, recording.folder)
        else:
            key = key_of(resolved, seed)
            require_own(recording.folder, key, _scenario_text(resolved))
        finished = _run(resolved, seed, recording, progress)
        return _bounded(finished, bound_s, progress)


def _keep_original(resolved: Resolved, folder: Path) -> None:
    """Refuse a folder whose file is run: its copy would be written over it."""
    code = resolved.code
    if code is not None and code.parent.resolve() == folder.resolve():
        raise OccupiedFolderError(
            folder,
            f"{code.name} itself",
            expected="another folder than that of the file to be run",
            way="choose another --out",
        )


def _run(
    resolved: Resolved,
    seed: int,
    recording: Recording | None,
    progress: ProgressCallback,
) -> Run:
    """Run, with the folder locked and known to be the run's own."""
    with stopwatch() as watch:
        return _timed(resolved, seed, recording, progress, watch)


def _timed(
    resolved: Resolved,
    seed: int,
    recording: Recording | None,
    progress: ProgressCallback,
    watch: Stopwatch,
) -> Run:
    """Run; the stopwatch was started before."""
    kind, scenario = resolved.kind, resolved.scenario
    if recording is not None and recording.animation:
        kind.check_animation(recording.animation)
    progress(0, scenario.steps, "building")
    with heeded():
        flight = flight_of(resolved.posed(), scenario)
    logger.debug("built after %.2f s", watch.seconds)
    folder = recording.folder if recording else None
    steps, resumed, multipliers = _flown(resolved, flight, seed, folder, progress)
    logger.debug("flown after %.2f s", watch.seconds)
    try:
        with heeded():
            finished = _measured(resolved, flight, collected(flight.plant, steps), seed)
            finished = replace(
                finished,
                wall_s=watch.seconds,
                compile_s=watch.compile_seconds,
                resumed=resumed,
                multipliers=multipliers,
            )
            if recording is None:
                return finished
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
        )  # The commit mark: last.
        remove_partial(recording.folder)
    return finished


def _kept_bound(finished: Run, folder: Path) -> Mapping[str, Any] | None:
    """Return the bound that the record of the same run before has, if it has one.

    Figures of before are kept in the same way.
    """
    kept = kept_bound(folder, key_of(finished.resolved, finished.seed))
    if kept is None:
        return None
    try:  # A record is a user's file, and may claim a bound of several plans.
        planned_once(finished.flight.posed, finished.resolved.scenario.steps)
    except SeveralPlansError:
        return None
    return compared_anew(kept, finished.flight.answer(finished.trajectory))


def _bounded(finished: Run, seconds: float | None, progress: ProgressCallback) -> Run:
    """Return a finished run with its bound; the record has it, too."""
    if seconds is None:
        return finished
    flight, scenario = finished.flight, finished.resolved.scenario
    answer, is_interrupted = flight.answer(finished.trajectory), False
    try:
        bound: LowerBound | None = bound_of(
            flight.posed, scenario.steps, answer, seconds=seconds, progress=progress
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
    """Return a run with its bound; its record gets that, too."""
    folder, beside = finished.folder, answer.beside(bound)
    with put_off():
        file = None if folder is None else write_certificate(folder, bound)
        content = bound_content(bound, beside, certificate=file)
        finished = replace(finished, bound=bound, bound_content=content)
        if folder is not None:
            write_json(folder / MARK, finished.summary())
    return finished


def _measured(
    resolved: Resolved, flight: Flight[Posed], trajectory: Trajectory, seed: int
) -> Run:
    """Return a flight with what is measured of it and said of its claims."""
    scenario = resolved.scenario
    measures = resolved.kind.measure(scenario, flight, trajectory)
    status, feasible = status_of(flight, trajectory)
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
            undefined=resolved.kind.undefined_of(scenario),
        ),
        status=status,
        feasible=feasible,
    )


def _flown(
    resolved: Resolved,
    flight: Flight[Posed],
    seed: int,
    folder: Path | None,
    progress: ProgressCallback,
) -> tuple[list[Step], int, Multipliers | None]:
    """Return all steps, how many an interrupted run had finished, and multipliers.

    These are of the first plan.
    """
    key = key_of(resolved, seed)
    kept, rng, multipliers = _kept(flight, seed, folder, key)
    # A step and the generator's state after it, in one list: an interrupt may come
    # between any two statements.
    flown = [(step, rng.bit_generator.state) for step in kept]
    last = kept[-1] if kept else None
    save = partial(_save, folder, key, flight, flown, multipliers)
    saved = clock.perf_counter()
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
                progress(len(flown), resolved.scenario.steps, "flying")
                if clock.perf_counter() - saved > CHECKPOINT_S:
                    save()
                    saved = clock.perf_counter()
        save()  # What follows may fail, or be interrupted.
    except DivergedError:
        save()
        raise
    except KeyboardInterrupt:
        if folder is None or not flown:
            raise
        with contextlib.suppress(KeyboardInterrupt):  # It is said below.
            save()
        raise Interrupted(folder, len(flown)) from None
    steps = [step for step, _ in flown]
    return steps, len(kept), multipliers if kept else _multipliers(flight, steps)


def _multipliers(flight: Flight[Posed], steps: Sequence[Step]) -> Multipliers | None:
    """Return the multipliers of the first plan; None of several agents' plans."""
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
    """Write the finished steps, if there are any and a folder for them."""
    if folder is not None and flown:
        steps, (*_, state) = zip(*flown, strict=True)
        with put_off():
            first = kept or _multipliers(flight, steps)
            arrays = multiplier_arrays(first)
            save_partial(folder, key, collected(flight.plant, steps), state, arrays)


def _kept(
    flight: Flight[Posed], seed: int, folder: Path | None, key: str
) -> tuple[list[Step], np.random.Generator, Multipliers | None]:
    """Return the steps of an interrupted run, the generator as it left it, multipliers.

    These are of the first plan.
    """
    rng = np.random.default_rng(seed)
    kept = load_partial(folder, key, flight.plant.substeps) if folder else None
    if kept is None:
        return [], rng, None
    steps, rng.bit_generator.state, arrays = kept
    return steps, rng, multipliers_from(arrays)


def _recorded(
    finished: Run, recording: Recording, progress: ProgressCallback
) -> list[Path]:
    """Write all but the mark, which follows when the rest is there; return figures."""
    resolved, flight, folder = finished.resolved, finished.flight, recording.folder
    kind, scenario, steps = resolved.kind, resolved.scenario, resolved.scenario.steps
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
    for name, content in flight.documents.items():
        write_text(folder / name, content)
    drawn: list[Path] = []
    if recording.figures:
        progress(steps, steps, "drawing")
        drawn = kind.figures(scenario, flight, finished.trajectory, folder / FIGURES)
    if recording.animation:
        progress(steps, steps, "animating")
        file = folder / FIGURES / f"flight.{recording.animation}"
        kind.animate(scenario, flight, finished.trajectory, file)
        drawn.append(file)
    return [*drawn, *(file for file in figures or () if file not in drawn)]


def _scenario_text(resolved: Resolved) -> str:
    """Return the resolved scenario as it is recorded."""
    return yaml.safe_dump(dict(resolved.settings), sort_keys=False, allow_unicode=True)
