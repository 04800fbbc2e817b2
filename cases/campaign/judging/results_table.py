"""The table of all comparisons in a folder: rows are appended, and none is replaced.

A row is a run. The same command again adds no row, unless a failed run was tried again;
its new row follows the old one. A table with the columns of another version is not
changed, and a new one is started: `results-2.csv` and so on.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.judging.entry import Entry
from swarmstart.cases.campaign.judging.runs import NEAR, is_false_success
from swarmstart.cases.record.files import require_ours, write_text
from swarmstart.cases.record.record import RECORDED

FIRST = "scenario,variant,solver,seed,"
"""Beginning of every table of comparisons, of any version."""


class Column(NamedTuple):
    """A column of the table.

    Attributes:
        kind: Type of its entries; an empty entry is not known.
        what: Meaning, with its unit.
    """

    kind: Literal["text", "integer", "number", "flag"]
    what: str


COLUMNS: Mapping[str, Column] = {
    "scenario": Column("text", "Name of the scenario"),
    "variant": Column("text", "Variant of the scenario; empty: it has none"),
    "solver": Column("text", "Name of the solver, with its options"),
    "seed": Column("integer", "Seed of all random numbers"),
    "feasible": Column(
        "flag", "Whether the answer is confirmed along its whole path, ten times finer"
    ),
    "claimed_cost": Column("number", "Cost as the solver says; the less, the better"),
    "claimed_violation": Column("number", "Violation as the solver says, scaled [1]"),
    "verified_cost": Column("number", "Cost of the path simulated ten times finer"),
    "verified_violation": Column("number", "Violation of that path, scaled [1]"),
    "evaluations": Column("integer", "Evaluations, as equivalents of one rollout"),
    "seconds": Column(
        "number", "Wall time of the solver, without building and compiling [s]"
    ),
    "status": Column("text", "Status of the answer, as a sentence"),
    "failure": Column("text", "Why the run failed; empty: it did not"),
    "cell": Column("text", "Key of the run: name of its folder in cells"),
    "claimed_feasible": Column(
        "flag", "Whether the solver says so, at its own checks and tolerance"
    ),
    "false_success": Column(
        "flag",
        "Whether the solver claims a feasible answer that is not confirmed, or a cost "
        f"that is off by more than {NEAR[0]:.0%}",
    ),
    "of": Column("text", "What was solved: a plan or a flight"),
    "sense": Column("integer", "1: the cost is minimised; -1: its negative maximised"),
    "stopped_by": Column(
        "text", "What ended the solver: itself, evaluations, seconds or the hard limit"
    ),
    "cut": Column(
        "flag", "Whether the hard limit ended the process; its last answer counts"
    ),
    "repaired": Column("flag", "Whether the answer was solved again with a margin"),
    "rollouts": Column("integer", "Simulations of the whole horizon"),
    "gradients": Column("integer", "Gradients of the whole problem"),
    "hessians": Column("integer", "Hessians of the whole problem"),
    "build_seconds": Column("number", "Wall time of building the problem [s]"),
    "compile_seconds": Column("number", "Wall time of compiling it [s]"),
    "judge_seconds": Column("number", "Wall time of verifying the answer [s]"),
    "seconds_repair": Column("number", "Wall time of repairing the answer [s]"),
    "wall_seconds": Column("number", "Wall time of the whole run [s]"),
    "cpu_seconds": Column("number", "CPU time of the whole run [s]"),
    "load_begin": Column("number", "Load average of one minute when the run began"),
    "load_end": Column("number", "Load average of one minute when it ended"),
    "date": Column("text", "When the run began, ISO 8601, UTC"),
    "processor": Column("text", "Processor of the machine"),
    "cores": Column("integer", "Cores of the machine"),
    "system": Column("text", "System of the machine"),
    "python": Column("text", "Version of Python"),
    **{name: Column("text", f"Version of {name}") for name in RECORDED},
}
"""The columns in their order."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TabledRun:
    """A run as the table and the curves have it.

    Attributes:
        scenario: Name of the scenario.
        solver: Name of the solver.
        cell: Its cell.
        outcome: Its outcome.
    """

    scenario: str
    solver: str
    cell: Cell
    outcome: Outcome


def tabled_runs(
    entries: Iterable[Entry], outcomes: Mapping[str, Outcome]
) -> Iterator[TabledRun]:
    """Yield the runs of solvers, in their order.

    Args:
        entries: The solvers on their scenarios.
        outcomes: By the cells' keys.
    """
    for entry in entries:
        for cell in entry.cells:
            yield TabledRun(
                scenario=entry.scenario,
                solver=entry.solver.name,
                cell=cell,
                outcome=outcomes[cell.key],
            )


def require_table(path: Path) -> Path:
    """Return the table to which rows of this version are appended.

    Args:
        path: The first table. If it has other columns it is not changed, and the table
            with the next number is taken.

    Returns:
        A table with the columns of this version, or a file that does not exist yet.

    Raises:
        ForeignFileError: If the file is not such a table.
        RecordError: If it cannot be read.
    """
    number, place = 1, path
    while True:
        require_ours(
            place, lambda text: text.startswith(FIRST), "a table of comparisons"
        )
        if not place.exists() or _head(place) == ",".join(COLUMNS):
            return place
        number += 1
        place = path.with_name(f"{path.stem}-{number}{path.suffix}")


def _head(path: Path) -> str:
    with path.open(encoding="utf-8", newline="") as file:
        return file.readline().rstrip("\r\n")


def append_runs(path: Path, runs: Iterable[TabledRun]) -> Path:
    """Append the runs that the table does not have.

    Args:
        path: The table; made if it is missing.
        runs: The runs.

    Returns:
        The table that has them; see `require_table`.

    Raises:
        ForeignFileError: If the file is not such a table.
        RecordError: If it cannot be read or written.
    """
    place = require_table(path)
    is_there = place.exists()
    kept = place.read_text(encoding="utf-8") if is_there else _line(list(COLUMNS))
    if not kept.endswith("\n"):
        kept += "\n"
    known = set(kept.splitlines(keepends=True))
    lines = [line for line in map(_line_of, runs) if line not in known]
    if lines or not is_there:
        write_text(place, kept + "".join(dict.fromkeys(lines)))
    return place


def _line_of(run: TabledRun) -> str:
    content = content_of_run(run)
    return _line([content.get(name) for name in COLUMNS])


def content_of_run(run: TabledRun) -> dict[str, Any]:
    """Return a run as a row: column -> entry; unknown entries are missing or None."""
    outcome = run.outcome
    result = outcome.result or {}
    began, ended = outcome.load or (None, None)
    return {
        **{name: result[name] for name in COLUMNS if name in result},
        **{
            name: count
            for name, count in (result.get("counts") or {}).items()
            if name in COLUMNS
        },
        **dict(outcome.machine),
        **dict(outcome.versions),
        "scenario": run.scenario,
        "variant": run.cell.job.get("variant", ""),
        "solver": run.solver,
        "seed": run.cell.job.get("seed"),
        "failure": " ".join(outcome.failure.split()),
        "cell": run.cell.key,
        "false_success": is_false_success(result),
        "cut": outcome.was_cut,
        "wall_seconds": outcome.seconds,
        "cpu_seconds": outcome.cpu_s,
        "load_begin": began,
        "load_end": ended,
        "date": outcome.date,
    }


def _line(values: Sequence[object]) -> str:
    """Return a line; entries of several lines are put in one."""
    text = io.StringIO()
    entries = [" ".join(v.split()) if isinstance(v, str) else v for v in values]
    csv.writer(text, lineterminator="\n").writerow(entries)
    return text.getvalue()
