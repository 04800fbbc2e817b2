"""The runs of a comparison: every solver on every scenario, seed by seed, and bounds.

A scenario is compared by its one planning problem, or by whole runs in closed loop. A
run in closed loop needs a solver that a controller can use: a search of this package,
IPOPT, or IPOPT from random starts. On scenarios of kind swarm only rules of swarms are
compared, and rules of swarms on no other scenarios. Solvers that do not fit a scenario
are left out of it, and listed as left out.

Each run is a cell, a unit of work of its own (`engine/cells.py`). Lower bounds have
cells, too, after all runs: a bound does not count in the seconds of any solver, and is
kept and resumed like a run. It concerns one plan, so scenarios that are compared by
whole runs have none.
"""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.judging.runs import Entry, entry_of
from swarmstart.cases.campaign.studies.comparison_plan import Chosen, ComparisonPlan, Of
from swarmstart.cases.campaign.trials.flight_trial import flight_cell, seed_keys
from swarmstart.cases.campaign.trials.solver_names import IPOPT, Solver
from swarmstart.cases.campaign.trials.solvers import search_share
from swarmstart.cases.format.document import Document
from swarmstart.cases.format.kind import SeveralPlansError
from swarmstart.cases.format.registry import RULES
from swarmstart.cases.format.scenario import (
    Resolved,
    hard_problems,
    read_document,
    resolve,
)
from swarmstart.cases.hard.best_known import BestKnown, best_known
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.cases.record.files import to_json
from swarmstart.cases.record.record import MARK, SCENARIO
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import BoundKind

Allow = Callable[[Resolved], Resolved]

LATE, MOMENT_S = 2.0, 120.0
"""Time limit of a bound: a factor of its seconds, and a constant [s]."""

CarriedOut = Callable[[Sequence[Cell]], Sequence[Outcome]]


@dataclass(frozen=True, kw_only=True, slots=True)
class Contest:
    """A scenario with the solvers compared on it.

    Attributes:
        name: Name of the scenario, with a number if several scenarios share it.
        resolved: The scenario, without the settings of the solvers.
        of: "plan" if the one planning problem is compared, "flight" if whole runs in
            closed loop are compared.
        entries: Each solver with its runs (cells), in the order of the solvers.
        left_out: Names of solvers that cannot take part in it.
    """

    name: str
    resolved: Resolved
    of: str
    entries: tuple[Entry, ...]
    left_out: tuple[str, ...] = ()

    @property
    def is_seeded(self) -> bool:
        """True if each seed is a problem of its own, with its own disturbances."""
        return self.of == "flight" and bool(seed_keys(self.resolved.settings))

    def told_of_left_out(self) -> list[str]:
        """Return a sentence for each reason to leave solvers out, with their names."""
        if _has_rules(self.resolved):
            by, reason = "rules of swarms", "they are searches"
        else:
            by = "its plan" if self.of == "plan" else "whole flights"
            reason = "they solve single planning problems only"
        rules = [name for name in self.left_out if name in RULES]
        others = [name for name in self.left_out if name not in RULES]
        return [
            f"{self.name} is compared by {by}; left out, since {why}: "
            f"{', '.join(names)}"
            for why, names in ((reason, others), ("they are rules of swarms", rules))
            if names
        ]


class NoFittingSolverError(SwarmstartError, ValueError):
    """No solver of a comparison fits a scenario."""


def contest_of(
    chosen: Chosen,
    document: Document,
    solvers: Sequence[Solver],
    plan: ComparisonPlan,
    budget: Mapping[str, float | int],
    allow: Allow,
) -> Contest:
    """Check a scenario's settings; return it with the runs (cells) of each solver.

    Args:
        chosen: The scenario.
        document: Document of the scenario's file.
        solvers: The solvers.
        plan: The plan of the comparison.
        budget: Budget of one planning problem, as arguments of `heuristics.Budget`.
        allow: Function that gives a scenario the permissions of the command.

    Raises:
        InvalidScenarioError: If a setting does not fit.
        SeveralPlansError: If a scenario with several plans is to be compared by one
            plan.
        NoFittingSolverError: If all solvers are left out.
        CodeNotAllowedError: If the scenario runs a user's file, which is not allowed.
    """

    def resolved(
        assignments: Sequence[str] = (),
        search: str | None = None,
        polish: str | None = None,
    ) -> Resolved:
        return allow(
            resolve(
                document,
                variant=chosen.variant,
                search=search,
                polish=polish,
                assignments=[*chosen.assignments, *assignments],
            )
        )

    base = resolved()
    of = _of(base, chosen.of)
    fitting = [solver for solver in solvers if _fits(solver, base, of)]
    contest = Contest(
        name=base.scenario.name, resolved=base, of=of, entries=(),
        left_out=tuple(solver.name for solver in solvers if solver not in fitting),
    )  # fmt: skip
    if solvers and not fitting:
        told = "; ".join(contest.told_of_left_out())
        raise NoFittingSolverError(f"expected a solver that fits; found: {told}")
    entries = []
    for solver in fitting:
        if of == "plan":
            search, assignments = _planned_by(solver, budget)
        else:
            search, assignments = _flown_by(solver, budget, base.settings)
        one = resolved(assignments, search=search, polish=_polish(solver))
        entries.append(
            _planned(one, solver, plan, budget)
            if of == "plan"
            else _flown(one, solver, plan)
        )
    return replace(contest, entries=tuple(entries))


def _of(resolved: Resolved, asked: Of) -> str:
    """Return "plan" if a scenario makes one plan only, else "flight"."""
    posed = resolved.posed()  # Raises if it cannot be posed.
    if asked == "flight":
        return "flight"
    if asked == "auto" and not posed.open_loop and resolved.scenario.steps > 1:
        return "flight"
    try:
        first_problem(posed)
    except SeveralPlansError:
        if asked == "plan":
            raise
        return "flight"
    return "plan"


def _planned(
    resolved: Resolved,
    solver: Solver,
    plan: ComparisonPlan,
    budget: Mapping[str, float | int],
) -> Entry:
    return entry_of(
        resolved,
        solver,
        seeds=plan.seeds,
        budget=budget,
        timeout_s=plan.timeout_s,
        repair=plan.repair,
    )


def _has_rules(resolved: Resolved) -> bool:
    """Return whether a scenario is one of a swarm, which plans by a rule."""
    return "rule" in resolved.settings


def _fits(solver: Solver, base: Resolved, of: str) -> bool:
    """Return whether a scenario can be compared by a solver."""
    if _has_rules(base) or solver.family == "rule":
        return _has_rules(base) and solver.family == "rule"
    if of == "plan":
        return True
    is_foreign = solver.peer or solver.family == "own"
    return not is_foreign and solver.plugin in ("", IPOPT)


def _polish(solver: Solver) -> str | None:
    """Return the polish of a solver; None means the scenario's own."""
    if solver.family in ("solve", "own", "rule"):
        return None
    return "ipopt" if solver.polished else "none"


def _changed(solver: Solver) -> tuple[str | None, list[str]]:
    """Return search and settings that `solve` changes; None means the own search."""
    lanes = dict(solver.options).get("lanes")
    return solver.search or None, [] if lanes is None else [f"lanes={lanes}"]


def _planned_by(
    solver: Solver, budget: Mapping[str, float | int]
) -> tuple[str | None, list[str]]:
    """Return the search of a plan, and its settings as texts for --set."""
    if solver.family in ("solve", "own"):
        return _changed(solver)
    # "none" has no budget that can be set.
    has_budget = solver.search != "none"
    share = [f"budget={to_json(search_share(solver, budget))}"] if has_budget else []
    # Lanes belong to `solve`: another solver would get a second search by them.
    return solver.search, ["lanes=0", *share]


def _flown_by(
    solver: Solver, budget: Mapping[str, float | int], settings: Mapping[str, Any]
) -> tuple[str | None, list[str]]:
    """Return the search of a run's plans, and its settings as texts for --set.

    `settings` are those of the scenario, whose budget `solve` keeps.
    """
    if solver.family == "rule":
        return None, [f"rule={solver.name}"]
    if solver.family == "solve":
        own = settings["budget"]
        search, changes = _changed(solver)
        limits = [s for s in (budget.get("seconds"), own["seconds"]) if s is not None]
        kept = {**own, "seconds": min(limits, default=None)}
        return search, [*changes, f"budget={to_json(kept)}"]
    share = [f"budget={to_json(search_share(solver, budget))}"]
    polish = [f"ipopt.{key}={to_json(value)}" for key, value in solver.polish_options]
    if solver.family == "repeated":
        return "multistart", ["search.lanes=false", "lanes=0", *share, *polish]
    if solver.family == "nlp":
        return "none", ["lanes=0", *polish]
    given = [f"search.{key}={to_json(value)}" for key, value in solver.options]
    return solver.search, [*given, "lanes=0", *share, *polish]


def _flown(resolved: Resolved, solver: Solver, plan: ComparisonPlan) -> Entry:
    """Return the cells of closed-loop runs; a seed is also that of disturbances."""
    # With disturbances, each seed is another run for every solver.
    alone = solver.is_deterministic and not seed_keys(resolved.settings)
    cells = [
        flight_cell(resolved, seed, timeout_s=plan.timeout_s, by=solver.name)
        for seed in range(1 if alone else plan.seeds)
    ]
    return Entry(scenario=resolved.scenario.name, solver=solver, cells=tuple(cells))


def interleaved(contests: Sequence[Contest]) -> list[Cell]:
    """Return the runs (cells) of all solvers, by scenario and then by seed.

    The solvers take turns, seed by seed, so that other load of the machine affects all
    solvers of a scenario alike.
    """
    cells = []
    for contest in contests:
        most = max((len(entry.cells) for entry in contest.entries), default=0)
        cells += [
            entry.cells[seed]
            for seed in range(most)
            for entry in contest.entries
            if seed < len(entry.cells)
        ]
    return cells


def with_distinct_names(contests: Sequence[Contest]) -> list[Contest]:
    """Return the contests with distinct names if scenarios share one."""
    seen: dict[str, int] = {}
    named = []
    for contest in contests:
        seen[contest.name] = seen.get(contest.name, 0) + 1
        count = seen[contest.name]
        if count == 1:
            named.append(contest)
            continue
        name = f"{contest.name} ({count})"
        entries = tuple(replace(entry, scenario=name) for entry in contest.entries)
        named.append(replace(contest, name=name, entries=entries))
    return named


class Earlier(NamedTuple):
    """Best answer of earlier runs of the same problem.

    Attributes:
        cost: Verified cost of the answer, as the problem states it.
        folder: Record of the run.
    """

    cost: float
    folder: Path


_OF_METHOD = ("search", "budget", "order", "polish", "ipopt", "basins", "lanes")
_TOLD = ("name", "title", "source", "claims", "measures", "backend")
_UNREADABLE = (
    *(SwarmstartError, OSError, ValueError, LookupError, TypeError),
    *(OverflowError, RecursionError),
)
"""Errors of a file that is no record."""
MOST_RECORDS = 200
"""Number of records that are looked at, the newest first."""


def earlier_best(contest: Contest, root: Path, sense: int = 1) -> Earlier | None:
    """Return the best confirmed answer in records of runs of the same problem.

    The runs may differ in their method, and in settings that do not change the problem.
    Records that cannot be read are ignored.

    Args:
        contest: A scenario that is compared by one plan.
        root: Folder of the runs: root/<scenario>/<key>.
        sense: -1 if the problem is maximised.

    Returns:
        The best answer; None if there is none.
    """
    wanted = _problem(contest.resolved.settings)
    marks = sorted(
        (root / contest.resolved.scenario.name).glob(f"*/{MARK}"),
        key=lambda file: file.stat().st_mtime,
        reverse=True,
    )
    found = []
    for mark in marks[:MOST_RECORDS]:
        with contextlib.suppress(*_UNREADABLE):
            measures = json.loads(mark.read_text(encoding="utf-8"))["measures"]
            cost = measures["verified_cost"]
            if measures["confirmed"] != 1 or not math.isfinite(cost):
                continue
            stated = resolve(read_document(str(mark.with_name(SCENARIO))))
            if _problem(stated.settings) == wanted:
                found.append(Earlier(float(cost), mark.parent))
    return min(found, key=lambda one: sense * one.cost, default=None)


def listed_best(contest: Contest) -> BestKnown | None:
    """Return the listed best known value of a hard problem that is compared as shipped.

    The scenario may differ from the shipped file in settings of its method, and in
    settings that do not change the problem.

    Args:
        contest: A scenario that is compared by one plan.

    Returns:
        The value; None if the scenario has the name of no hard problem, if it states
        another problem than that of its name, or if no value is known.
    """
    name = f"hard/{contest.resolved.scenario.name}"
    if name not in hard_problems():
        return None
    shipped = resolve(read_document(name))
    found = best_known().get(name)
    if _problem(shipped.settings) != _problem(contest.resolved.settings):
        return None
    return None if found is None or found.cost is None else found


def _problem(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings that state the problem."""
    return {k: v for k, v in settings.items() if k not in (*_OF_METHOD, *_TOLD)}


def bounds_of(
    contests: Sequence[Contest],
    outcomes: Mapping[str, Outcome],
    seconds: float | None,
    carried_out: CarriedOut,
) -> dict[str, dict[str, Any]]:
    """Return the lower bound of each scenario that has one plan.

    Args:
        contests: The scenarios; their solvers have run.
        outcomes: Outcomes of the solvers' cells, by their keys.
        seconds: Work for each bound, in units of about a second; None means that no
            bound is sought.
        carried_out: Function of cells that returns their outcomes in the same order.

    Returns:
        The bound of each scenario by its name, in the form of `About.bound`. If a value
        is maximised, the bound is one of the negative value, which is minimised.
    """
    if seconds is None:
        return {}
    cells = {
        contest.name: bound_cell_of(contest, outcomes, seconds)
        for contest in contests
        if contest.of == "plan"
    }
    found = carried_out([*cells.values()])
    return {name: _about(outcome) for name, outcome in zip(cells, found, strict=True)}


def bound_cell_of(
    contest: Contest, outcomes: Mapping[str, Outcome], seconds: float
) -> Cell:
    """Return the cell (a unit of work) that seeks the lower bound of a scenario."""
    resolved = contest.resolved
    return Cell(
        work="swarmstart.cases.campaign.trials.bounds:bound_cell",
        job={
            "settings": resolved.planning_settings(),
            "variant": resolved.variant,
            "seconds": seconds,
            "known": _best(contest, outcomes),
        },
        label=f"{contest.name}, lower bound",
        timeout_s=LATE * seconds + MOMENT_S,
        permissions=resolved.permissions(),
    )


def _best(contest: Contest, outcomes: Mapping[str, Outcome]) -> float | None:
    """Return the best confirmed cost, as the problem states it; None without one."""
    found = [outcomes[cell.key].result for e in contest.entries for cell in e.cells]
    known = [one for one in found if one is not None and one.get("feasible")]
    costs = [one for one in known if one.get("verified_cost") is not None]
    best = min(costs, key=lambda one: float(one["verified_cost"]), default=None)
    return None if best is None else float(best["sense"] * best["verified_cost"])


def _about(outcome: Outcome) -> dict[str, Any]:
    """Return a bound as in `About`; that of a failed cell is the reason only."""
    result = outcome.result
    if result is None:
        none = {"kind": BoundKind.NONE.value, "value": None}
        return {**none, "reason": outcome.failure, "cell": outcome.folder.name}
    value = result["value"]
    is_finite = value is not None and math.isfinite(value)
    return {
        **{key: one for key, one in result.items() if key != "sense"},
        "value": float(result["sense"] * value) if is_finite else None,
        "cell": outcome.folder.name,
    }
