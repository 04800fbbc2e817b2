"""A table of comparisons grows, and keeps what it has."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from swarmstart.cases.campaign.cells import Cell, Outcome
from swarmstart.cases.campaign.comparison import Entry, Row
from swarmstart.cases.campaign.results_table import COLUMNS, append_rows, require_table
from swarmstart.cases.campaign.solvers import solver_of
from swarmstart.cases.record.files import ForeignFileError


def row(name: str, *costs: float | str) -> Row:
    """Return what a solver has shown; a text is the reason of a failure."""
    cells, outcomes = [], []
    for seed, cost in enumerate(costs):
        job = {"variant": "", "seed": seed, "solver": name}
        cells.append(Cell(work="a:b", job=job, label=name))
        failed = isinstance(cost, str)
        result = None if failed else {"feasible": True, "verified_cost": cost}
        failure = str(cost) if failed else ""
        outcomes.append(
            Outcome(result=result, failure=failure, seconds=1.0, folder=Path())
        )
    entry = Entry(scenario="s", solver=solver_of(name), cells=tuple(cells))
    return Row(
        entry=entry,
        outcomes=tuple(outcomes),
        feasible=0,
        successes=0,
        success_interval=None,
        costs=(),
        evaluations=None,
        against_first="",
    )


def content(file: Path) -> list[tuple[str, ...]]:
    with file.open(encoding="utf-8", newline="") as opened:
        rows = list(csv.DictReader(opened))
    assert all(tuple(each) == COLUMNS for each in rows)
    names = ("solver", "seed", "verified_cost", "failure")
    return [tuple(each[name] for name in names) for each in rows]


def test_rows_are_appended_once_and_none_is_replaced(tmp_path: Path) -> None:
    file = tmp_path / "results.csv"
    append_rows(file, [row("de", 1.5, "it died\nearly")])
    first = file.read_bytes()
    kept = [("de", "0", "1.5", ""), ("de", "1", "", "it died early")]
    assert content(file) == kept
    append_rows(file, [row("de", 1.5, "it died\nearly")])
    assert file.read_bytes() == first
    append_rows(file, [row("ga", 2.5), row("de", 1.5, 3.5)])
    assert file.read_bytes().startswith(first)
    assert content(file) == [*kept, ("ga", "0", "2.5", ""), ("de", "1", "3.5", "")]


def test_a_last_line_without_an_end_is_ended(tmp_path: Path) -> None:
    file = tmp_path / "results.csv"
    append_rows(file, [row("de", 1.5)])
    file.write_text(file.read_text().rstrip("\n"))
    append_rows(file, [row("ga", 2.5)])
    assert [each[0] for each in content(file)] == ["de", "ga"]


def test_a_table_of_something_else_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "results.csv"
    file.write_text("mine,yours\n1,2\n")
    with pytest.raises(ForeignFileError, match="expected a table of comparisons"):
        require_table(file)
    with pytest.raises(ForeignFileError, match="expected a table of comparisons"):
        append_rows(file, [])
    assert file.read_text() == "mine,yours\n1,2\n"
