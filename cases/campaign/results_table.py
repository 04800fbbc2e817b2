"""The table of all comparisons in a folder: rows are appended, and none is replaced.

A row is a run. The same command again adds no row, unless a run that had failed was
tried again; its new row follows the old one.
"""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from swarmstart.cases.campaign.comparison import Row
from swarmstart.cases.record.files import require_ours, write_text

COLUMNS = (
    "scenario", "variant", "solver", "seed", "feasible", "claimed_cost",
    "claimed_violation", "verified_cost", "verified_violation", "evaluations",
    "seconds", "status", "failure", "cell",
)  # fmt: skip


def require_table(path: Path) -> None:
    """Refuse a file that is no such table.

    Raises:
        ForeignFileError: If its first line names other columns.
    """
    head = ",".join(COLUMNS)
    require_ours(path, lambda text: text.startswith(head), "a table of comparisons")


def append_rows(path: Path, rows: Sequence[Row]) -> None:
    """Append the runs of solvers that the table does not have.

    Args:
        path: The table; made if it is missing.
        rows: What the solvers have shown.

    Raises:
        ForeignFileError: If the file is no such table.
        RecordError: If it cannot be read or written.
    """
    require_table(path)
    kept = path.read_text(encoding="utf-8") if path.exists() else _line(COLUMNS)
    if not kept.endswith("\n"):
        kept += "\n"
    known = set(kept.splitlines(keepends=True))
    lines = [line for row in rows for line in _lines(row) if line not in known]
    if lines or not path.exists():
        write_text(path, kept + "".join(dict.fromkeys(lines)))


def _lines(row: Row) -> list[str]:
    """Return a line of the table for each run of a solver."""
    lines = []
    for cell, outcome in zip(row.entry.cells, row.outcomes, strict=True):
        result = outcome.result or {}
        content = {
            "scenario": row.entry.scenario,
            "variant": cell.job["variant"],
            "solver": row.entry.solver.name,
            "seed": cell.job["seed"],
            "failure": " ".join(outcome.failure.split()),
            "cell": cell.key,
            **{name: result[name] for name in COLUMNS if name in result},
        }
        lines.append(_line([content.get(name, "") for name in COLUMNS]))
    return lines


def _line(values: Sequence[object]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(values)
    return text.getvalue()
