"""Solvers of one planning problem, by name: what `compare` sets side by side.

    lshade             a population search (any of `swarmstart list`)
    lshade+ipopt       the same with nine tenths of the budget, then IPOPT from there
    multistart-ipopt   IPOPT from random starts until the budget is spent; the best
    ipopt              IPOPT once, from zero controls: deterministic

All have one budget for the planning problem. Evaluations are those of the objective,
IPOPT's included; a limit of seconds holds for search and polish, not for compiling.
"""

from __future__ import annotations

import re
import time as clock
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.cases.format.kind import PlanningProblem
from swarmstart.cases.format.registry import SEARCHES
from swarmstart.cases.format.scenario import resolved_again
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.errors import SwarmstartError
from swarmstart.heuristics import Budget
from swarmstart.ocp import (
    IpoptOptions,
    Plan,
    Planner,
    SearchSettings,
    multistart,
    verified,
)
from swarmstart.ocp.improving import repaired

IPOPT, MULTISTART = "ipopt", "multistart-ipopt"
SEARCHED = tuple(name for name in SEARCHES if name != "none")
SEARCH_SHARE = 0.9
"""Of the budget, where a polish follows."""
MOST_ITERATIONS = 300
LARGEST = 1e12
"""Budgets are below it."""
_BUDGET = re.compile(r"(?P<number>[0-9.]+(?:e[0-9]+)?) *(?P<unit>evals|s|m)")


class UnknownSolverError(SwarmstartError, LookupError):
    """A name that is no solver."""


class InvalidBudgetTextError(SwarmstartError, ValueError):
    """The text after --budget is not a budget."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Solver:
    """A solver of one planning problem.

    Attributes:
        name: As given.
        search: A key of SEARCHES; "none" for IPOPT without one.
        polished: Whether IPOPT goes on from the search's answer.
        starts: "one" or "many", of IPOPT without a search.
    """

    name: str
    search: str
    polished: bool
    starts: str = "one"

    @property
    def is_deterministic(self) -> bool:
        """Return whether every seed gives the same."""
        return self.search == "none" and self.starts == "one"


def solver_of(name: str) -> Solver:
    """Return the solver of a name; see the head of this module.

    Raises:
        UnknownSolverError: If no solver has that name.
    """
    if name == IPOPT:
        return Solver(name=name, search="none", polished=True)
    if name == MULTISTART:
        return Solver(name=name, search="none", polished=True, starts="many")
    search, plus, polish = name.partition("+")
    if search not in SEARCHED or (plus and polish != IPOPT):
        known = ", ".join((*SEARCHED, IPOPT, MULTISTART))
        raise UnknownSolverError(
            f"expected a solver: one of {known}, or a search with +ipopt; "
            f"found {name!r}"
        )
    return Solver(name=name, search=search, polished=bool(plus))


def budget_of(text: str) -> dict[str, float | int]:
    """Return a budget as `heuristics.Budget` takes it.

    Args:
        text: "4000evals", "5s", "2m", or two of them with "|" between.

    Raises:
        InvalidBudgetTextError: If it is not one of these.
    """
    budget: dict[str, float | int] = {}
    for part in text.split("|"):
        match = _BUDGET.fullmatch(part.strip())
        key = "evaluations" if match and match["unit"] == "evals" else "seconds"
        number = _number(match["number"]) if match else 0.0
        whole = key == "seconds" or number.is_integer()
        if match is None or not 0 < number < LARGEST or not whole or key in budget:
            raise InvalidBudgetTextError(
                "expected a budget such as 4000evals, 5s or 4000evals|5s, "
                f"found {text!r}"
            )
        scale = 60 if match["unit"] == "m" else 1
        budget[key] = int(number) if key == "evaluations" else number * scale
    return budget


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return 0.0


Answered = tuple[Planner, Plan, float]
"""A plan, the planner that made it, and when that began [s]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Trial:
    """A solver with a budget and a seed.

    Attributes:
        solver: The solver.
        budget: Of one planning problem, as `heuristics.Budget` takes it.
        seed: Seed of all randomness.
        search: The search that the solver names; its own budget is not used.
        repair: Whether an answer that breaks a constraint between the checks is solved
            again with a margin, whatever the solver.
        backend: What evaluates populations.
    """

    solver: Solver
    budget: Mapping[str, Any]
    seed: int
    search: SearchSettings | None
    repair: bool = False
    backend: str | None = None


def solve_cell(
    job: Mapping[str, Any], folder: Path, *, python_in: str | None = None
) -> dict[str, Any]:
    """Solve a scenario's planning problem; called in a worker.

    Only where the command has given `python_in` may a file of that folder be run.
    """
    del folder
    resolved = resolved_again(job["settings"], job["variant"], python_in=python_in)
    posed = first_problem(resolved.posed())
    trial = Trial(
        solver=solver_of(job["solver"]),
        budget=job["budget"],
        seed=job["seed"],
        search=resolved.scenario.search_settings(),
        repair=job["repair"],
        backend=resolved.scenario.backend,
    )
    return answered(posed, trial)


def answered(posed: PlanningProblem, trial: Trial) -> dict[str, Any]:
    """Solve a planning problem, and return what `comparison` looks at.

    The answer is simulated again ten times finer: "claimed" is what the solver says of
    it, "verified" what the one reference says.
    """
    rng = np.random.default_rng(trial.seed)
    solve = _many_starts if trial.solver.starts == "many" else _planned
    planner, plan, began = solve(posed, trial, rng)
    x0, known, _ = planner.posed(posed.x0, posed.known)
    found = verified(posed.problem, plan, x0, known)
    if trial.repair:
        found = repaired(planner, found, x0, known, rng=rng).solution
    seconds, plan = clock.perf_counter() - began, found.plan
    return {
        "claimed_cost": plan.cost,
        "claimed_violation": plan.violation,
        "verified_cost": found.path.cost,  # The less, the better.
        "verified_violation": found.verified_violation,
        "feasible": found.status.is_confirmed,
        "status": found.status.value,
        "evaluations": plan.evaluations,
        "seconds": seconds,
        "controls": found.controls.tolist(),
    }


def _planned(
    posed: PlanningProblem, trial: Trial, rng: np.random.Generator
) -> Answered:
    """Return the plan of a search, a polish or both, its planner and when it began."""
    solver, search = trial.solver, trial.search
    if search is not None:
        share = Budget(**search_share(solver, trial.budget))
        search = SearchSettings(
            algorithm=search.algorithm,
            budget=share,
            order=search.order,
            sampling=search.sampling,
        )
    polish = _ipopt(trial.budget, 1.0 if search is None else 1 - SEARCH_SHARE)
    planner = Planner(
        posed.problem,
        search=search,
        polish=polish if solver.polished else None,
        family=posed.family,
        backend=trial.backend,
    )
    began = clock.perf_counter()
    x0, known, _ = planner.posed(posed.x0, posed.known)
    return planner, planner.plan(x0, known=known, rng=rng), began


def search_share(solver: Solver, budget: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of a budget the search has: all, or less where a polish follows."""
    share = SEARCH_SHARE if solver.polished else 1.0
    parts = {name: share * value for name, value in budget.items()}
    if "evaluations" in parts:
        parts["evaluations"] = max(1, int(parts["evaluations"]))
    return parts


def _ipopt(budget: Mapping[str, Any], share: float) -> IpoptOptions:
    """Return IPOPT with a share of the budget; an iteration counts as an evaluation."""
    evaluations, seconds = budget.get("evaluations"), budget.get("seconds")
    most = MOST_ITERATIONS
    if evaluations is not None:
        most = max(1, min(most, int(share * evaluations)))
    return IpoptOptions(
        max_iterations=most, max_seconds=None if seconds is None else share * seconds
    )


def _many_starts(
    posed: PlanningProblem, trial: Trial, rng: np.random.Generator
) -> Answered:
    """Return the best of IPOPT from random points until the budget is spent."""
    polish = _ipopt(trial.budget, 1.0)
    planner = Planner(posed.problem, search=None, polish=polish, backend=trial.backend)
    began = clock.perf_counter()
    plan = multistart(
        planner,
        posed.x0,
        budget=Budget(**trial.budget),
        known=posed.known,
        family=posed.family,
        rng=rng,
    )
    return planner, plan, began
