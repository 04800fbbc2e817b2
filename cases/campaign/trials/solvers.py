"""Cells of `compare` on planning problems: a solver, a budget and a seed each.

Names of solvers are in solver_names.py, trials in trial.py. A worker keeps what it has
built for the next seeds, for at most KEPT scenarios with solvers. Budgets and lengths
of time, on the command line and in plans, are texts such as 4000evals, 120s, 2m or 1h.
"""

from __future__ import annotations

import functools
import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

from swarmstart.cases.campaign.trials.building import SEARCH_SHARE, Built, Trial, built
from swarmstart.cases.campaign.trials.own_solver import installed_solver
from swarmstart.cases.campaign.trials.peer_names import PEERS, installed_solvers
from swarmstart.cases.campaign.trials.solver_names import (
    IPOPT,
    NULL_HYPOTHESIS,
    REPEATED,
    SEARCHED,
    Solver,
    UnknownSolverError,
    solver_of,
    solvers_of,
)
from swarmstart.cases.campaign.trials.trial import (
    answer_of,
    answered,
    judged_checkpoint,
)
from swarmstart.cases.format.document import shown
from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.cases.format.registry import SEARCHES, words_of
from swarmstart.cases.format.scenario import resolved_again
from swarmstart.cases.format.settings import planning
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.errors import SwarmstartError

__all__ = [
    "IPOPT",
    "NULL_HYPOTHESIS",
    "REPEATED",
    "SEARCHED",
    "InvalidBudgetTextError",
    "Solver",
    "Trial",
    "UnknownSolverError",
    "answered",
    "budget_of",
    "judge_checkpoint",
    "modules_of",
    "search_share",
    "solve_cell",
    "solver_of",
    "solvers_of",
]
LARGEST = 1e12
"""Upper limit for a budget."""
KEPT = 16
"""Number of built solvers that a worker keeps, the last ones used."""
UNITS = {"s": 1, "m": 60, "h": 3600}
"""Names of units -> seconds."""
_DURATION = re.compile(r"(?P<number>[0-9.]+(?:e[0-9]+)?) *(?P<unit>[smh]?)")
_LONGEST_S = 1e9
_BUDGET = re.compile(r"(?P<number>[0-9.]+(?:e[0-9]+)?) *(?P<unit>evals|s|m|h|)")
_UNITS = {"evals": 1, "": 1, **UNITS}


class InvalidDurationError(SwarmstartError, ValueError):
    """A text is not a length of time."""


class InvalidBudgetTextError(SwarmstartError, ValueError):
    """The text after --budget is not a budget."""


def budget_of(text: str) -> dict[str, float | int]:
    """Return a budget as arguments of `heuristics.Budget`.

    Args:
        text: "4000evals" or "4000", "5s", "2m", "1h", or two of them with "|" between.

    Raises:
        InvalidBudgetTextError: If the text is not one of these.
    """
    budget: dict[str, float | int] = {}
    for part in text.split("|"):
        match = _BUDGET.fullmatch(part.strip())
        # A number alone counts evaluations, as in the library.
        is_count = match is not None and match["unit"] in ("evals", "")
        key = "evaluations" if is_count else "seconds"
        number = _number(match["number"]) if match else 0.0
        whole = key == "seconds" or number.is_integer()
        if match is None or not 0 < number < LARGEST or not whole or key in budget:
            raise InvalidBudgetTextError(
                "expected a budget such as 4000evals, 5s or 4000evals|5s, "
                f"found {shown(text)}"
            )
        scale = _UNITS[match["unit"]]
        budget[key] = int(number) if key == "evaluations" else number * scale
    return budget


def with_unit(text: str) -> str:
    """Return a budget that `budget_of` reads, with the unit of each number.

    Example:
        >>> with_unit("500"), with_unit("4000evals|5s")
        ('500evals', '4000evals|5s')
    """
    parts = [part.strip() for part in text.split("|")]
    return "|".join(f"{p}evals" if p[-1:].isdigit() else p for p in parts)


def seconds_of(text: str) -> float:
    """Return a length of time [s].

    Args:
        text: "120s", "2m", "1h"; a number alone is seconds.

    Raises:
        InvalidDurationError: If the text is anything else, 0, or above 10^9 seconds.

    Example:
        >>> seconds_of("2m"), seconds_of("0.5")
        (120.0, 0.5)
    """
    match = _DURATION.fullmatch(text.strip())
    seconds = _number(match["number"]) * UNITS[match["unit"] or "s"] if match else 0.0
    if not 0.0 < seconds <= _LONGEST_S or not math.isfinite(seconds):
        raise InvalidDurationError(
            f"expected a length of time such as 120s, 2m or 1h, found {shown(text)}"
        )
    return seconds


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:  # Two points: 0, which no budget and no time may be.
        return 0.0


def search_share(solver: Solver, budget: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of a budget that a scenario's settings give to the search.

    The scenario is checked with this part. A trial gives the search less if the NLP
    solver needs more; see `share_of` in building.py.
    """
    share = SEARCH_SHARE if solver.polished else 1.0
    parts = {name: share * value for name, value in budget.items()}
    if "evaluations" in parts:
        parts["evaluations"] = max(1, int(parts["evaluations"]))
    return parts


def solve_cell(
    job: Mapping[str, Any], folder: Path, *, code_in: str | None = None
) -> dict[str, Any]:
    """Return the answer of a solver to a scenario's problem; called in a worker.

    Files of the folder `code_in` may be run; without it no file may be run.

    Args:
        job: "settings" and "variant" of the scenario, "solver" (its name), "budget",
            "seed", "repair".
        folder: Folder of the checkpoints.
        code_in: The folder whose files may be run; None if no file may be run.
    """
    text = _common(job)
    trial = _trial(text, code_in, job)
    return answer_of(_built(text, code_in), trial, folder).as_json()


def judge_checkpoint(
    job: Mapping[str, Any], folder: Path, *, code_in: str | None = None
) -> dict[str, Any]:
    """Return the result of a run that the system has ended, since it took too long.

    The last checkpoint of the run is judged. The arguments are those of `solve_cell`.
    """
    text = _common(job)
    posed, _ = _posed(text, code_in)
    return judged_checkpoint(posed, _trial(text, code_in, job), folder).as_json()


def modules_of(job: Mapping[str, Any]) -> tuple[str, ...]:
    """Return further modules whose code is used: of the kind, solver and search."""
    solver = solver_of(job["solver"])
    named = [words_of(job["settings"]["kind"]).kind]
    if solver.peer:
        named.append(PEERS[solver.peer].minimize)
    if solver.family == "own":
        named.append(installed_solvers()[solver.name].value)
    modules = [name.partition(":")[0] for name in named]
    search = job["settings"]["search"]["name"]
    settings = SEARCHES[search].settings if search in SEARCHES else ""
    if settings:
        modules.append(resolve_name(settings).__module__)
    return tuple(sorted(set(modules)))


def _common(job: Mapping[str, Any]) -> str:
    """Return the part of a job that all seeds have in common, as text.

    Its order is kept, since definitions of a scenario can depend on earlier ones.
    """
    keys = ("settings", "variant", "solver", "budget")
    return json.dumps({key: job[key] for key in keys})


def _trial(text: str, code_in: str | None, job: Mapping[str, Any]) -> Trial:
    _, first = _posed(text, code_in)
    return replace(first, seed=job["seed"], repair=first.repair and job["repair"])


# Keyed by JSON text, since a mapping cannot be a key.
@functools.lru_cache(maxsize=KEPT)
def _posed(text: str, code_in: str | None) -> tuple[PlanningProblem, Trial]:
    """Return the planning problem of jobs, and the trial with seed 0."""
    job = json.loads(text)
    resolved = resolved_again(job["settings"], job["variant"], code_in=code_in)
    scenario, solver = planning(resolved.scenario), solver_of(job["solver"])
    posed = resolved.posed()
    is_own = solver.family == "solve"
    trial = Trial(
        solver=solver,
        budget=job["budget"],
        seed=0,
        search=scenario.search_settings(),
        polish=scenario.polish_options() if is_own else None,
        lanes=scenario.random_starts() if is_own else 0,
        # A scenario that is run without repair is run so here, too.
        repair=posed.repair or not is_own,
        own=installed_solver(solver.name) if solver.family == "own" else None,
        backend=scenario.backend,
        order=None if scenario.order is None else scenario.order.order(),
    )
    return first_problem(posed), trial


@functools.lru_cache(maxsize=KEPT)
def _built(text: str, code_in: str | None) -> Built:
    return built(*_posed(text, code_in))
