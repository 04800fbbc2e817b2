"""`swarmstart compare`: solvers on planning problems, same budget, paired seeds."""

from __future__ import annotations

import argparse
import functools
import os
import statistics
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from swarmstart.cases.campaign.cells import carried_out
from swarmstart.cases.campaign.comparison import Entry, Row, entry_of, rows_of
from swarmstart.cases.campaign.results_table import append_rows, require_table
from swarmstart.cases.campaign.solvers import Solver, budget_of, search_share, solver_of
from swarmstart.cases.commands.output import DONE, INFEASIBLE, answer, say
from swarmstart.cases.commands.progress import Progress
from swarmstart.cases.commands.run import allowing
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.flight import first_problem
from swarmstart.cases.record.files import locked, to_json
from swarmstart.cases.record.record import versions

RESULTS = Path("results") / "compare"
TABLE = "results.csv"
HEAD = (
    "solver",
    "feasible",
    "near the best",
    "95 %",
    "best",
    "median",
    "worst",
    "evals",
)


def compare_command(options: argparse.Namespace) -> int:
    """Compare what the options ask for; return the exit code."""
    names = dict.fromkeys(name.strip() for name in options.solvers.split(","))
    solvers = [solver_of(name) for name in names]
    budget = budget_of(options.budget)
    said_once = functools.cache(say)
    entries = [
        [_entry(name, solver, budget, options, said_once) for solver in solvers]
        for name in dict.fromkeys(options.scenarios)
    ]
    root = Path(options.out) if options.out else RESULTS
    require_table(root / TABLE)
    cells = [cell for each in entries for entry in each for cell in entry.cells]
    workers = options.workers or os.cpu_count() or 1
    with Progress("compare", quiet=options.quiet) as progress:
        outcomes = carried_out(
            cells, root / "cells", workers=workers, told=progress.update
        )
    by_key = {cell.key: one for cell, one in zip(cells, outcomes, strict=True)}
    rows = [rows_of(each, by_key, seeds=options.seeds) for each in entries]
    with locked(root):
        append_rows(root / TABLE, [row for each in rows for row in each])
    answer(
        to_json(_content(rows, options))
        if options.json
        else _report(rows, options, root)
    )
    unsolved = any(not any(row.feasible for row in each) for each in rows)
    return INFEASIBLE if unsolved else DONE


def _entry(
    name: str,
    solver: Solver,
    budget: dict[str, Any],
    options: argparse.Namespace,
    told: Callable[[str], object],
) -> Entry:
    resolved = resolve(
        read_document(name),
        variant=options.variant,
        search=solver.search,
        polish="ipopt" if solver.polished else "none",
        assignments=[*options.assignments, *_budget_of_search(solver, budget)],
    )
    resolved = allowing(resolved, options, told)
    first_problem(resolved.posed())  # Refused here, not later.
    return entry_of(
        resolved,
        solver,
        seeds=options.seeds,
        budget=budget,
        timeout_s=options.timeout,
        repair=options.repair,
    )


def _budget_of_search(solver: Solver, budget: dict[str, Any]) -> list[str]:
    """Return the search's share of the budget as a setting, to be checked as one."""
    if solver.search == "none":
        return []
    return [f"budget={to_json(search_share(solver, budget))}"]


def _content(rows: Sequence[Sequence[Row]], options: argparse.Namespace) -> Any:
    return {
        "schema": 1,
        "budget": options.budget,
        "seeds": options.seeds,
        "versions": versions(),
        "rows": [_row_content(row) for each in rows for row in each],
    }


def _row_content(row: Row) -> dict[str, Any]:
    return {
        "scenario": row.entry.scenario,
        "solver": row.entry.solver.name,
        "runs": len(row.outcomes),
        "deterministic": row.entry.solver.is_deterministic,
        "feasible": row.feasible,
        "near_best": row.successes,
        "near_best_interval": row.success_interval,
        "verified_costs": list(row.costs),
        "evaluations_median": row.evaluations,
        "against_first": row.against_first,
        "failures": _failures(row),
    }


def _failures(row: Row) -> list[str]:
    return [o.failure for o in row.outcomes if o.failure]


def _report(
    rows: Sequence[Sequence[Row]], options: argparse.Namespace, root: Path
) -> str:
    """Return what a person reads; without wall times, so that all see the same."""
    seeds = f"seeds 0 to {options.seeds - 1}"
    lines = [f"budget {options.budget} a planning problem, {seeds}"]
    for each in rows:
        lines += ["", each[0].entry.scenario]
        table = [HEAD, *[_cells(row) for row in each]]
        widths = [max(len(line[k]) for line in table) for k in range(len(HEAD))]
        for line, said in zip(
            table, ["", *[r.against_first for r in each]], strict=True
        ):
            cells = [
                text.ljust(width) for text, width in zip(line, widths, strict=True)
            ]
            lines.append(("  " + "  ".join(cells) + f"  {said}").rstrip())
        first = each[0].entry.solver.name
        lines.append(f"  the last column compares each with {first}, seed by seed")
        lines += [
            f"  {row.entry.solver.name}: {f}" for row in each for f in _failures(row)
        ]
    return "\n".join([*lines, "", f"results  {root / TABLE}"])


def _cells(row: Row) -> tuple[str, ...]:
    count = len(row.outcomes)
    interval = row.success_interval
    costs = row.costs
    shown = ["-"] * 3
    if costs:
        shown = [f"{c:.6g}" for c in (costs[0], statistics.median(costs), costs[-1])]
    return (
        row.entry.solver.name,
        f"{row.feasible} of {count}",
        f"{row.successes} of {count}",
        "one run" if interval is None else f"{interval[0]:.2f} to {interval[1]:.2f}",
        *shown,
        "-" if row.evaluations is None else f"{row.evaluations:g}",
    )
