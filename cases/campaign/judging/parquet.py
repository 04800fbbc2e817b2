"""Tables of comparisons as Parquet files, with types and descriptions of columns."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from swarmstart.cases.campaign.judging.results_table import COLUMNS, Column, TabledRun
from swarmstart.cases.record.files import (
    ForeignFileError,
    RecordError,
    said,
    write_atomically,
)
from swarmstart.cases.record.tables import MissingPackageError

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
    pyarrow_module()
    _write(path, COLUMNS, _read(rows_file))


def write_curves(runs: Iterable[TabledRun], path: Path) -> None:
    """Write the histories of the best answers, a row for each mark of a run.

    Args:
        runs: The runs; those without a history add no rows.
        path: The file to be written. One of this package is replaced.

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
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise MissingPackageError(
            "a Parquet file needs pyarrow, which is not installed: "
            "pip install 'swarmstart[parquet]'"
        ) from error
    return pyarrow


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
