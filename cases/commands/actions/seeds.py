"""`swarmstart run --seeds`: one scenario run with many seeds, measures with spread."""

from __future__ import annotations

import argparse
import functools
import hashlib
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from swarmstart.cases.campaign.engine.cells import Cell, Outcome, carried_out
from swarmstart.cases.campaign.running.seeds import SEEDS, seeds_content, spread_of
from swarmstart.cases.campaign.trials.flight_trial import flight_cell
from swarmstart.cases.commands.options.conditions import Condition, met_conditions
from swarmstart.cases.commands.options.figure_formats import figure_formats
from swarmstart.cases.commands.terminal.output import (
    DONE,
    GATE,
    INFEASIBLE,
    answer,
    say,
    table_lines,
)
from swarmstart.cases.commands.terminal.progress import Progress
from swarmstart.cases.commands.wording.failing_seeds import failing_lines, failing_seeds
from swarmstart.cases.commands.wording.measure_lines import measure_table
from swarmstart.cases.commands.wording.words_of_seeds import sentences_of_seeds
from swarmstart.cases.drawing.drawing import write_figures
from swarmstart.cases.drawing.naming.quantities import plural
from swarmstart.cases.drawing.seed_figures import seed_figures
from swarmstart.cases.format.document import printable
from swarmstart.cases.format.scenario import Resolved
from swarmstart.cases.record.files import (
    is_record,
    locked,
    require_ours,
    to_json,
    write_json,
)
from swarmstart.cases.record.record import FIGURES

HEAD = ("measure", "lowest", "median", "highest", "unit", "meaning")
CELLS = "cells"


def run_seeds(
    resolved: Resolved,
    options: argparse.Namespace,
    root: Path,
    conditions: Sequence[Condition],
) -> int:
    """Run a scenario with seeds 0 to N - 1; return the exit code.

    Args:
        resolved: The scenario.
        options: The options of the command `run`.
        root: The default folder of results.
        conditions: Those of --fail-on: the gate fails if one is true in any run.
    """
    cells = [flight_cell(resolved, seed, named=True) for seed in range(options.seeds)]
    folder = Path(options.out) if options.out else root / _name(resolved, cells)
    require_ours(
        folder / SEEDS, functools.partial(is_record, name="seeds"), "runs over seeds"
    )
    with Progress(resolved.scenario.name, quiet=options.quiet) as progress:
        outcomes = carried_out(
            cells,
            folder / CELLS,
            workers=options.workers,
            told=progress.update,
        )
    command = shlex.join(["swarmstart", *options.words])
    content = seeds_content(resolved, outcomes, command=command)
    with locked(folder):
        figures = [] if options.no_figures else [*seed_figures(content)]
        drawn = write_figures(
            figures, folder / FIGURES, formats=figure_formats(options)
        )
        content["figures"] = [file.name for file in drawn]
        write_json(folder / SEEDS, content)
    if options.json:
        answer(to_json(content))
    else:
        failing = failing_lines(resolved, outcomes, options.words)
        answer(_report(content, folder, resolved, failing, measures=options.measures))
    return _exit_code(content, outcomes, resolved, conditions)


def _name(resolved: Resolved, cells: Sequence[Cell]) -> Path:
    """Return <scenario>/seeds-<key>, with a hash of all that determines the runs."""
    keys = hashlib.sha256("".join(cell.key for cell in cells).encode()).hexdigest()
    return Path(resolved.scenario.name) / f"seeds-{keys[:16]}"


def _report(
    content: Mapping[str, Any],
    folder: Path,
    resolved: Resolved,
    failing: Sequence[str],
    *,
    measures: bool,
) -> str:
    """Return the text that a person reads.

    Args:
        content: As seeds.json has it.
        folder: The folder of the record.
        resolved: The scenario.
        failing: Lines on the seeds in which a claim fails.
        measures: Whether all measures are told.
    """
    lines = sentences_of_seeds(content, folder / FIGURES)
    failed = [(n, text) for n, text in enumerate(content["failures"]) if text]
    lines += [f"Seed {number} failed: {printable(text)}" for number, text in failed]
    claims = [row for row in map(_claim_row, content["claims"]) if row]
    if measures:
        spreads = {name: spread_of(v) for name, v in content["measures"].items()}
        values = {name: cells for name, (*cells, _) in spreads.items()}
        notes = {name: note for name, (*_, note) in spreads.items() if note}
        lines += ["", *measure_table(resolved, values, HEAD, notes), ""]
    if claims:
        lines += ["Claims:", *table_lines(claims), *failing]
    return "\n".join([*lines, f"Record: {folder}"])


def _claim_row(claim: Mapping[str, Any]) -> tuple[str, ...]:
    """Return a claim and in how many runs it holds; empty if no run can judge it."""
    known = [held for held in claim["holds"] if held is not None]
    if not known:
        return ()
    return claim["id"], f"holds in {sum(known)} of {len(known)}", claim["text"]


def _exit_code(
    content: Mapping[str, Any],
    outcomes: Sequence[Outcome],
    resolved: Resolved,
    conditions: Sequence[Condition],
) -> int:
    if not any(content["feasible"]):
        return INFEASIBLE
    failed = [
        f"{claim['id']} in {plural(claim['holds'].count(False), 'run')} "
        f"({', '.join(f'seed {seed}' for seed in failing_seeds(outcomes, number))}): "
        f"{claim['text']}"
        for number, claim in enumerate(content["claims"])
        if claim["gate"] and False in claim["holds"]
    ]
    for seed, outcome in enumerate(outcomes):
        if outcome.result is not None:
            met = met_conditions(conditions, outcome.result["measures"], resolved)
            failed += [f"seed {seed}: {text}" for text in met]
    for failure in failed:
        say(f"gate failed: {printable(failure)}")
    return GATE if failed else DONE
