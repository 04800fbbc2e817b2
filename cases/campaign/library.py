"""Functions of the library that do what the commands `run` and `compare` do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.judging.comparison import Entry, Row, rows_of
from swarmstart.cases.campaign.run import Run
from swarmstart.cases.campaign.run import run as run_resolved
from swarmstart.cases.campaign.trials.building import Built, Trial, built
from swarmstart.cases.campaign.trials.solvers import (
    Solver,
    budget_of,
    search_share,
    solvers_of,
)
from swarmstart.cases.campaign.trials.trial import answer_of
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.cases.format.scenario import Resolved, read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.cases.record.files import to_json
from swarmstart.cases.record.record import Recording
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import Budget
from swarmstart.ocp import Known, OptimalControlProblem
from swarmstart.ocp.progress import ProgressCallback, tell_nothing
from swarmstart.ocp.search_settings import search_settings

Scenario = str | Path
Compared = Scenario | tuple[OptimalControlProblem, ArrayLike, *tuple[Known, ...]]
"""A scenario; or a problem, its initial state and, where it has any, what is known."""
NO_SETTINGS: Mapping[str, Any] = MappingProxyType({})


def run(  # noqa: PLR0913 - the options of a command
    scenario: Scenario,
    *,
    seed: int,
    out: str | Path | None = None,
    variant: str | None = None,
    search: str | None = None,
    polish: str | None = None,
    figures: bool = True,
    force: bool = False,
    allow_python: bool = False,
    settings: Mapping[str, Any] = NO_SETTINGS,
    progress: ProgressCallback = tell_nothing,
) -> Run:
    """Fly a scenario, measure it and judge its claims, as `swarmstart run` does.

    Args:
        scenario: The name of a shipped scenario, or the path of a file.
        seed: The seed of all randomness.
        out: The record's folder; None: nothing is written, and nothing drawn.
        variant: As --variant.
        search: As --search.
        polish: As --polish.
        figures: Whether the record has figures.
        force: As --force: whether files of the record's names are replaced.
        allow_python: As --allow-python: whether the file that a scenario of kind python
            names is run.
        settings: As --set, such as {"steps": 2, "budget.evaluations": 600}.
        progress: Told (finished steps, all steps, what is being done).

    Returns:
        Measures, claims, trajectory and all else.

    Raises:
        InvalidScenarioError: If the scenario can be read but not run.
        UnknownScenarioError: If no scenario has that name.
        UnreadableFileError: If its file cannot be read.
        YamlError: If its file is not the format.
        OccupiedFolderError: If the folder holds anything but a record of this run.
        RecordError: If a file cannot be written.
        CodeNotAllowedError: If a file is to be run, and may not.
        UserCodeError: If that file gives no problem.
    """
    resolved = _resolved(
        scenario, settings, variant=variant, search=search, polish=polish
    )
    resolved = replace(resolved, allow_python=allow_python)
    recording = None
    if out is not None:
        recording = Recording(folder=Path(out), figures=figures, force=force)
    return run_resolved(resolved, seed=seed, recording=recording, progress=progress)


def compare(  # noqa: PLR0913 - the options of a command
    problems: Compared | Sequence[Compared] | Mapping[str, Compared],
    solvers: str | Sequence[str],
    *,
    seeds: int = 10,
    budget: str | int = "4000evals",
    repair: bool = True,
    allow_python: bool = False,
    settings: Mapping[str, Any] = NO_SETTINGS,
    progress: ProgressCallback = tell_nothing,
) -> list[Row]:
    """Solve problems by several solvers and seeds under equal budgets, side by side.

    All is done here, one after the other, and nothing is kept; `swarmstart compare`
    takes processes and goes on where it was interrupted. The same seeds give the same
    answers in both.

    Args:
        problems: Scenarios; or (problem, x0) or (problem, x0, known); one, several, or
            several by names.
        solvers: Names such as "lshade[size=60]+ipopt", "multistart-ipopt", "solve" or
            "scipy-de", as `swarmstart compare --solvers` takes them, several in one
            text with commas between; the others are compared with the first.
        seeds: Their number, from 0 on.
        budget: Of one planning problem: "4000evals", "5s" or a number of evaluations.
        repair: Whether an answer that breaks a constraint between the checks is solved
            again with a margin.
        allow_python: As in `run`.
        settings: Of the scenarios, as in `run`.
        progress: Told (finished, all, the next one's name).

    Returns:
        A row for each problem and solver, in this order.

    Raises:
        UnknownSolverError: If there is no such solver.
        InvalidBudgetTextError: If the budget is invalid.
        SeveralPlansError: If a step of a scenario has several planning problems.
        CodeNotAllowedError: If a file is to be run, and may not.
        UserCodeError: If that file gives no problem.
    """
    given = [solvers] if isinstance(solvers, str) else solvers
    listed = [one for text in given for one in solvers_of(text)]
    chosen = list({solver.name: solver for solver in listed}.values())
    share = budget_of(f"{budget}evals" if isinstance(budget, int) else budget)
    named = _named(problems)
    ways = {  # All are refused here, before any is solved.
        (name, solver.name): _way(problem, solver, share, settings, allow_python)
        for name, problem in named.items()
        for solver in chosen
    }
    entries = [[_entry(name, solver, seeds) for solver in chosen] for name in named]
    every = [entry for each in entries for entry in each]
    count = sum(len(entry.cells) for entry in every)
    outcomes: dict[str, Outcome] = {}
    for entry in every:
        posed, first = ways[entry.scenario, entry.solver.name]
        made = cache(partial(built, posed, first))  # Once for all seeds.
        for cell in entry.cells:
            progress(len(outcomes), count, cell.label)
            trial = replace(first, seed=cell.job["seed"], repair=repair)
            outcomes[cell.key] = _outcome(made, trial)
    return [row for each in entries for row in rows_of(each, outcomes, seeds=seeds)]


def _resolved(
    scenario: Scenario, settings: Mapping[str, Any], **given: Any
) -> Resolved:
    """Return a scenario with settings laid over it, arrays of NumPy among them."""
    plain = {
        key: value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        for key, value in settings.items()
    }
    assignments = [f"{key}={to_json(value)}" for key, value in plain.items()]
    return resolve(read_document(str(scenario)), assignments=assignments, **given)


def _named(
    problems: Compared | Sequence[Compared] | Mapping[str, Compared],
) -> Mapping[str, Compared]:
    """Return problems by names: those of the scenarios, else their numbers."""
    if isinstance(problems, Mapping):
        return problems
    is_one = isinstance(problems, str | Path) or (
        isinstance(problems, tuple) and isinstance(problems[0], OptimalControlProblem)
    )
    several = cast(Sequence[Compared], [problems] if is_one else problems)
    return {
        f"problem {number}" if isinstance(one, tuple) else str(one): one
        for number, one in enumerate(several, 1)
    }


def _way(
    problem: Compared,
    solver: Solver,
    budget: Mapping[str, float | int],
    settings: Mapping[str, Any],
    allow_python: bool,
) -> tuple[PlanningProblem, Trial]:
    """Return what is solved, and the solver's trial with seed 0."""
    searched = solver.search != "none"
    share = search_share(solver, budget)
    trial = Trial(solver=solver, budget=budget, seed=0, search=None)
    if isinstance(problem, tuple):
        ocp, x0, *known = problem
        state = np.asarray(x0, dtype=np.float64)
        posed = PlanningProblem(
            problem=ocp, x0=state, known=known[0] if known else Known()
        )
        named = search_settings(solver.search, Budget(**share)) if searched else None
        return posed, replace(trial, search=named)
    resolved = _resolved(
        problem,
        {**settings, "budget": share} if searched else settings,
        search=solver.search,
        polish="ipopt" if solver.polished else "none",
    )
    scenario = resolved.scenario
    posed = first_problem(replace(resolved, allow_python=allow_python).posed())
    return posed, replace(
        trial,
        search=scenario.search_settings(),
        backend=scenario.backend,
        order=None if scenario.order is None else scenario.order.order(),
    )


def _entry(name: str, solver: Solver, seeds: int) -> Entry:
    """Return the cells of a solver on a problem, which are not kept."""
    cells = [
        Cell(
            work="swarmstart.cases.campaign.library:compare",
            job={"problem": name, "solver": solver.name, "seed": seed},
            label=f"{name}, {solver.name}, seed {seed}",
        )
        for seed in range(1 if solver.is_deterministic else seeds)
    ]
    return Entry(scenario=name, solver=solver, cells=tuple(cells))


def _outcome(made: Callable[[], Built], trial: Trial) -> Outcome:
    """Return a solver's answer, or why it failed."""
    result, failure = None, ""
    try:
        result = answer_of(made(), trial)
    except SwarmstartError as error:
        failure = str(error)
    seconds = result["seconds"] if result else 0.0
    return Outcome(result=result, failure=failure, seconds=seconds, folder=Path())
