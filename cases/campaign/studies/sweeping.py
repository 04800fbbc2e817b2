"""A sweep: the first plan of a scenario, solved for all of its instances.

    sweep.json       counts, costs, invalid instances; written last: marks the record
    instances.csv    a row for each instance: data, status, costs
    solutions.npz    all answers, as `Solutions.load` reads them
    scenario.yaml    the scenario as resolved, with the numbers of its CSV file
    figures/         cost over the first two data that differ

Answers found before an interrupt are recorded, too. The search of the scenario is not
used; its polish is the one that `solve_many` uses.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from swarmstart.arguments import (
    FLAG,
    a_count,
    checked,
)
from swarmstart.cases.campaign.running.finished_run import backend_of, determining
from swarmstart.cases.campaign.studies.library import (
    NO_SETTINGS,
    OF_RUNS,
    recording_in,
    resolved_with,
)
from swarmstart.cases.format.document import counted
from swarmstart.cases.format.kind import GivenInstances, unknown_instances
from swarmstart.cases.format.scenario import Resolved
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.cases.record.files import locked, write_json, write_text
from swarmstart.cases.record.instances import columns_of
from swarmstart.cases.record.record import (
    FIGURES,
    PNG,
    SCENARIO,
    SWEEP,
    Recording,
    require_own_sweep,
    run_key,
    versions,
    withdraw,
)
from swarmstart.errors import InvalidArgumentError, Sendable, SwarmstartError
from swarmstart.ocp import (
    InvalidProblemError,
    Solutions,
    SolveManyInterrupted,
    Start,
    solve_many,
)
from swarmstart.ocp.common import ProgressGiven
from swarmstart.ocp.instances import varied_names

TABLE, ANSWERS = "instances.csv", "solutions.npz"
"""Files of a sweep's record besides its mark."""


class NoInstancesError(SwarmstartError, ValueError):
    """A scenario has no instances, or they vary a name that the scenario lacks."""


class SweepInterrupted(Sendable, KeyboardInterrupt):
    """Ctrl-C during a sweep.

    Attributes:
        sweep: The sweep with the answers so far.
    """

    def __init__(self, sweep: Sweep) -> None:
        """Keep the answers so far, and name their folder."""
        kept = "" if sweep.folder is None else f"; they are kept in {sweep.folder}"
        done = int((sweep.solutions.attempts > 0).sum())
        of = f"{done} of {counted(len(sweep.solutions), 'instance')}"
        super().__init__(f"{of} have been tried{kept}")
        self.sweep = sweep


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Sweep:
    """A sweep of a scenario over its instances.

    Attributes:
        resolved: The scenario as it was solved.
        solutions: The answers.
        key: Hash of all that determines the answers.
        folder: Folder of the record; None without a record.
        figures: The figures drawn.
        is_whole: Whether all instances were solved, without an interrupt.
        given: The instances as the scenario has them.
    """

    resolved: Resolved
    solutions: Solutions
    key: str
    folder: Path | None
    is_whole: bool
    given: GivenInstances
    figures: tuple[Path, ...] = ()

    @property
    def invalid(self) -> dict[int, str]:
        """Number of each invalid instance -> its line in a file, if any, and reason."""
        return {
            number: ": ".join(filter(None, (self.given.place(number), reason)))
            for number, reason in sorted(self.solutions.invalid.items())
        }

    def cost_lines(self) -> list[str]:
        """Return a sentence on the range of the confirmed costs, if there are any."""
        solutions = self.solutions
        places = np.flatnonzero(solutions.is_confirmed)
        if not places.size:
            return []
        costs = solutions.cost[places]
        ends = []
        for at in (costs.argmin(), costs.argmax()):
            line = self.given.place(places[at])
            of = f"instance {places[at]}" + (f", {line}" if line else "")
            ends.append(f"{costs[at]:.6g} ({of})")
        return [f"Confirmed costs: {' to '.join(ends)}."]

    def summary(self) -> dict[str, Any]:
        """Return the data that `--json` prints and sweep.json contains."""
        solutions, scenario = self.solutions, self.resolved.scenario
        costs = solutions.cost[solutions.is_confirmed]
        return {
            "schema": 1,
            "scenario": scenario.name,
            "kind": scenario.kind,
            "variant": self.resolved.variant,
            "key": self.key,
            "instances": len(solutions),
            "varied": [*self.given.columns],
            "whole": self.is_whole,
            "statuses": {one.name: n for one, n in solutions.counts.items()},
            "confirmed": int(solutions.is_confirmed.sum()),
            "costs": {
                "lowest": float(costs.min()),
                "median": float(np.median(costs)),
                "highest": float(costs.max()),
            }
            if costs.size
            else None,
            "invalid": {str(number): why for number, why in self.invalid.items()},
            "wall_s": solutions.seconds,
            "versions": versions(),
            "figures": [file.name for file in self.figures],
            "documents": [TABLE, ANSWERS],
            "out": str(self.folder) if self.folder else None,
        }


def sweep_key(resolved: Resolved, seed: int) -> str:
    """Return the hash of all that determines the answers of a sweep."""
    return run_key(determining(resolved), seed, backend_of(resolved))


def swept(
    resolved: Resolved,
    *,
    seed: int,
    recording: Recording | None = None,
    strict: bool = False,
    threads: int | None = None,
    progress: ProgressGiven = False,
) -> Sweep:
    """Solve all instances of a scenario, and record the answers.

    Args:
        resolved: The scenario.
        seed: Seed, as in `solve_many`.
        recording: Folder and options of the record; None means no record.
        strict: Whether invalid instances are an error, as in `solve_many`.
        threads: Largest number of threads and processes, as in `solve_many`.
        progress: As in `solve_many`.

    Raises:
        NoInstancesError: If the scenario has no instances, or they vary a state or
            parameter that is unknown.
        SeveralPlansError: If the scenario has several planning problems a step.
        CodeNotAllowedError: If the scenario runs a user's file, which is not allowed.
        InvalidProblemError: If `strict` is true and an instance is invalid.
        OccupiedFolderError: If the folder holds anything but a record of this sweep.
        FolderInUseError: If another command writes to the folder.
        RecordError: If a file cannot be written.
        SweepInterrupted: On Ctrl-C; the answers so far are in the folder.
    """
    given = resolved.kind.instances(resolved.scenario)
    if given is None:
        raise NoInstancesError(
            f"{resolved.scenario.name}: expected instances, which say what differs: "
            "instances: {grid: {STATE: {lower: 0, upper: 1, points: 11}}}, a file, "
            "values, or drawn; found none"
        )
    key = sweep_key(resolved, seed)

    def solved(folder: Path | None) -> Sweep:
        is_whole = True
        try:
            solutions = _solved(resolved, given, seed, strict, threads, progress)
        except SolveManyInterrupted as interrupted:
            solutions, is_whole = interrupted.partial, False
        return Sweep(
            resolved=resolved,
            solutions=solutions,
            key=key,
            folder=folder,
            is_whole=is_whole,
            given=given,
        )

    if recording is None:
        sweep = solved(None)
    else:
        with locked(recording.folder):
            if not recording.force:
                require_own_sweep(recording.folder, key)
            sweep = _recorded(solved(recording.folder), recording)
    if not sweep.is_whole:
        raise SweepInterrupted(sweep)
    return sweep


def _solved(
    resolved: Resolved,
    given: GivenInstances,
    seed: int,
    strict: bool,
    threads: int | None,
    progress: ProgressGiven,
) -> Solutions:
    """Return the answers to all instances.

    Raises:
        InvalidProblemError: If `strict` is true and an instance is invalid.
        SolveManyInterrupted: On Ctrl-C.
    """
    posed = resolved.posed()
    planning = first_problem(posed)
    problem, known = planning.problem, planning.known
    M = max(map(len, given.columns.values()))
    x0s = np.repeat(np.asarray(planning.x0, dtype=float)[:, None], M, axis=1)
    base = np.asarray(known.parameters, dtype=float).reshape(-1, 1)
    parameters = np.repeat(base, M, axis=1)
    for _, what in unknown_instances(given.columns, problem):
        raise NoInstancesError(f"{resolved.scenario.name}: {what}")
    _, names = varied_names(problem)
    for name, column in given.columns.items():
        if name in names:
            parameters[names.index(name)] = column
        else:
            x0s[problem.model.state_names.index(name)] = column
    guess = planning.guess
    first = given.place(0)
    try:
        return solve_many(
            problem,
            x0s,
            known=known._replace(parameters=parameters),
            guesses=guess.controls if isinstance(guess, Start) else guess,
            starts=given.starts,
            polish=resolved.scenario.polish_options(),
            repair=posed.repair,
            threads=threads,
            strict=strict,
            seed=seed,
            progress=progress,
        )
    except InvalidProblemError as error:
        if not (strict and first):
            raise
        raise InvalidProblemError(f"{error}; instance 0 is {first}") from error


def _recorded(sweep: Sweep, recording: Recording) -> Sweep:
    """Write the record of a sweep; return it with its figures."""
    folder = recording.folder
    withdraw(folder, SWEEP)
    settings = dict(sweep.resolved.settings)
    write_text(
        folder / SCENARIO, yaml.safe_dump(settings, sort_keys=False, allow_unicode=True)
    )
    sweep.solutions.save(folder / ANSWERS, force=True)
    write_text(folder / TABLE, _table(sweep.solutions))
    if recording.figures:
        # Only now: matplotlib takes a second to load.
        from swarmstart.cases.drawing.drawing import write_figures

        figures = [("cost", sweep.solutions.plot())]
        files = write_figures(
            figures, folder / FIGURES, formats=recording.figure_formats
        )
        sweep = replace(sweep, figures=tuple(files))
    write_json(folder / SWEEP, sweep.summary())
    return sweep


def _table(solutions: Solutions) -> str:
    """Return a row for each instance, as CSV."""
    columns = {"instance": np.arange(len(solutions)), **columns_of(solutions)}
    written = io.StringIO()
    table = csv.writer(written, lineterminator="\n")
    table.writerow(columns)
    # Of floats the shortest text that gives the same number.
    table.writerows(zip(*(one.tolist() for one in columns.values()), strict=True))
    return written.getvalue()


@checked(InvalidArgumentError, seed=a_count(), strict=FLAG, **OF_RUNS)
def sweep(  # noqa: PLR0913 - the options of a command
    scenario: str | Path,
    *,
    seed: int,
    out: str | Path | None = None,
    variant: str | None = None,
    polish: str | None = None,
    strict: bool = False,
    figures: bool = True,
    figure_formats: Sequence[str] = PNG,
    force: bool = False,
    allow_code: bool = False,
    threads: int | None = None,
    settings: Mapping[str, Any] = NO_SETTINGS,
    progress: ProgressGiven = True,
) -> Solutions:
    """Solve the instances of a scenario, as `swarmstart sweep` does.

    Args:
        scenario: Name of a shipped scenario, or path of a scenario file, with the key
            `instances`.
        seed: Seed of the random starts.
        out: Folder of the record; None means that nothing is written or drawn.
        variant: As in `run`.
        polish: As in `run`.
        strict: Whether invalid instances are an error, as in `solve_many`.
        figures: Whether the figure is drawn into the record.
        figure_formats: As in `run`.
        force: As in `run`.
        allow_code: As in `run`.
        threads: Largest number of threads and processes, as in `solve_many`.
        settings: As in `run`.
        progress: As in `solve_many`.

    Returns:
        The answers, as `solve_many` returns them.

    Raises:
        NoInstancesError: If the scenario has no instances, or they vary a state or
            parameter that is unknown.
        InvalidScenarioError: If the scenario can be read but not run.
        SeveralPlansError: If the scenario has several planning problems a step.
        OccupiedFolderError: If the folder holds anything but a record of this sweep.
        SweepInterrupted: On Ctrl-C; the answers so far are in the folder.

    Example:
        >>> import swarmstart as ss
        >>> grid = {"position": {"lower": -1, "upper": 1, "points": 3}}
        >>> found = ss.sweep(
        ...     "double_integrator", seed=0, settings={"instances": {"grid": grid}}
        ... )
        >>> found.cost.round(2)
        array([48.47, 12.03,  0.  ])
    """
    resolved = resolved_with(scenario, settings, variant=variant, polish=polish)
    return swept(
        replace(resolved, allow_code=allow_code),
        seed=seed,
        recording=recording_in(out, figures, figure_formats, force=force),
        strict=strict,
        threads=threads,
        progress=progress,
    ).solutions
