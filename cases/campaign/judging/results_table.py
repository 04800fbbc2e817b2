"""The table of all comparisons in a folder, and the same as Parquet files.

Each row is a run. Rows are appended, and none is replaced. Repeating a command adds no
row, unless a failed run was tried again; its new row follows the old one. A table with
the columns of another version is not changed; a new table is begun instead:
`results-2.csv` and so on. Parquet files have types and descriptions of the columns.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.judging.runs import NEAR, Entry, is_false_success
from swarmstart.cases.record.files import (
    ForeignFileError,
    RecordError,
    require_ours,
    said,
    write_atomically,
    write_text,
)
from swarmstart.cases.record.record import RECORDED
from swarmstart.errors import load_optional

FIRST = "scenario,variant,solver,seed,"
"""Beginning of every table of comparisons, of any version."""


class Column(NamedTuple):
    """A column of the table.

    Attributes:
        kind: Type of the entries; an empty entry means that the value is not known.
        what: Meaning of the column, with its unit.
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
    """A run in the form that the table and the curves take.

    Attributes:
        scenario: Name of the scenario.
        solver: Name of the solver.
        cell: Cell of the run.
        outcome: Outcome of the cell.
    """

    scenario: str
    solver: str
    cell: Cell
    outcome: Outcome


def tabled_runs(
    entries: Iterable[Entry], outcomes: Mapping[str, Outcome]
) -> Iterator[TabledRun]:
    """Yield the runs of solvers, in their order."""
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
        ForeignFileError: If the file is not a table of comparisons.
        RecordError: If the file cannot be read.
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
    """Append the runs that are not in the table yet.

    Args:
        path: The table; made if it is missing.
        runs: The runs.

    Returns:
        The table that now has the runs; see `require_table`.

    Raises:
        ForeignFileError: If the file is not a table of comparisons.
        RecordError: If the file cannot be read or written.
    """
    place = require_table(path)
    is_there = place.exists()
    kept = place.read_text(encoding="utf-8") if is_there else _line(list(COLUMNS))
    if not kept.endswith("\n"):
        kept += "\n"
    # Whole lines: a failed run that was tried again has another one.
    known = set(kept.splitlines(keepends=True))
    lines = [line for line in map(_line_of, runs) if line not in known]
    # Written again as a whole, so that a crash cannot leave half a line.
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


OURS = b"swarmstart"
"""Key of a file's metadata that identifies its writer: a JSON object of columns."""
CURVES: Mapping[str, Column] = {
    **{
        name: COLUMNS[name]
        for name in ("scenario", "variant", "solver", "seed", "cell")
    },
    "evaluations": Column("integer", "Evaluations until then, in rollouts"),
    "seconds": Column("number", "Wall time of the solver until then [s]"),
    "cost": Column("number", "Cost of the best so far; the less, the better"),
    "violation": Column("number", "Violation of the best so far, scaled [1]"),
}
"""Columns of the curves; each row is a mark of a run's history."""
READ: Mapping[str, Callable[[str], Any]] = {
    "text": str,
    "integer": int,
    "number": float,
    "flag": {"True": True, "False": False}.__getitem__,
}


def write_parquet(rows_file: Path, path: Path) -> None:
    """Write the runs of a table of comparisons as a Parquet file, a row for each run.

    Args:
        rows_file: The table, such as results.csv.
        path: The file to write; an earlier one of this package is replaced.

    Raises:
        MissingPackageError: If pyarrow is not installed.
        ForeignFileError: If another file is there.
        RecordError: If the table is invalid, or a file cannot be read or written.
    """
    # Before the table is read: it raises if the package is missing.
    pyarrow_module()
    _write(path, COLUMNS, _read(rows_file))


def write_curves(runs: Iterable[TabledRun], path: Path) -> None:
    """Write the histories of the best answers, a row for each mark of a run.

    Args:
        runs: The runs; those without a history add no rows.
        path: The file to write; an earlier one of this package is replaced.

    Raises:
        MissingPackageError: If pyarrow is not installed.
        ForeignFileError: If another file is there.
        RecordError: If it cannot be written.
    """
    pyarrow_module()
    columns: dict[str, list[Any]] = {name: [] for name in CURVES}
    for run in runs:
        history = (run.outcome.result or {}).get("history") or {}
        marks = history.get("evaluations", [])
        known = {
            "scenario": run.scenario,
            "variant": run.cell.job.get("variant", ""),
            "solver": run.solver,
            "seed": run.cell.job.get("seed"),
            # A key is a hash of the whole job: made only if a row needs it.
            "cell": run.cell.key if marks else "",
        }
        for name in columns:
            unknown = [known.get(name)] * len(marks)
            columns[name] += history.get(name, unknown)
    _write(path, CURVES, columns)


def pyarrow_module() -> Any:
    """Return the package that writes Parquet.

    Raises:
        MissingPackageError: If it is not installed.
    """
    return load_optional("pyarrow.parquet", extra="parquet", need="a Parquet file")


def _read(rows_file: Path) -> dict[str, list[Any]]:
    """Return the typed columns of a table of this version; None means not known."""
    columns: dict[str, list[Any]] = {name: [] for name in COLUMNS}
    try:
        with rows_file.open(encoding="utf-8", newline="") as file:
            lines = csv.reader(file)
            if next(lines, None) != list(COLUMNS):
                raise RecordError(
                    f"{rows_file}: expected a table of comparisons of this version"
                )
            for line in lines:
                place = f"{rows_file}:{lines.line_num}"
                if len(line) != len(COLUMNS):
                    raise RecordError(
                        f"{place}: expected {len(COLUMNS)} entries, found {len(line)}"
                    )
                for name, text in zip(COLUMNS, line, strict=True):
                    columns[name].append(_entry(text, name, place))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordError(f"{rows_file}: expected a table: {said(error)}") from error
    return columns


def _entry(text: str, name: str, place: str) -> Any:
    kind = COLUMNS[name].kind
    if not text:
        # An empty text is a value; another empty entry is not known.
        return "" if kind == "text" else None
    try:
        return READ[kind](text)
    except (ValueError, LookupError) as error:
        what = {"integer": "an integer", "number": "a number"}.get(
            kind, "True or False"
        )
        raise RecordError(
            f"{place}: expected {name} to be {what}, found {text[:40]!r}"
        ) from error


def _write(
    path: Path, dictionary: Mapping[str, Column], columns: Mapping[str, list[Any]]
) -> None:
    pa = pyarrow_module()
    _require_own(path)
    types = {
        "text": pa.string(), "integer": pa.int64(), "number": pa.float64(),
        "flag": pa.bool_(),
    }  # fmt: skip
    fields = [
        pa.field(name, types[column.kind], metadata={"description": column.what})
        for name, column in dictionary.items()
    ]
    told = {name: column.what for name, column in dictionary.items()}
    schema = pa.schema(fields, metadata={OURS: json.dumps(told).encode()})
    table = pa.table(dict(columns), schema=schema)
    write_atomically(path, lambda file: pa.parquet.write_table(table, file))


def _require_own(path: Path) -> None:
    """Raise if the file to replace was not written by this package."""
    if not path.exists():
        return
    pa = pyarrow_module()
    try:
        is_ours = OURS in (pa.parquet.read_schema(path).metadata or {})
    except (OSError, pa.ArrowException):
        is_ours = False
    if not is_ours:
        raise ForeignFileError(
            f"{path}: expected a Parquet file of this package, found another file; "
            "choose another name"
        )
