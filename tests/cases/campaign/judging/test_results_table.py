"""A table of comparisons grows and keeps its rows."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.judging.results_table import (
    COLUMNS,
    TabledRun,
    append_runs,
    content_of_run,
    require_table,
    tabled_runs,
)
from swarmstart.cases.campaign.judging.runs import Entry
from swarmstart.cases.campaign.trials.solvers import solver_of
from swarmstart.cases.record.files import ForeignFileError


def runs(name: str, *costs: float | str) -> list[TabledRun]:
    """Return the runs of a solver; a text is the reason of a failure."""
    cells, outcomes = [], {}
    for seed, cost in enumerate(costs):
        job = {"variant": "", "seed": seed, "solver": name}
        cells.append(Cell(work="a:b", job=job, label=name))
        failed = isinstance(cost, str)
        result = None if failed else {"feasible": True, "verified_cost": cost}
        failure = str(cost) if failed else ""
        outcomes[cells[-1].key] = Outcome(
            result=result, failure=failure, seconds=1.0, folder=Path()
        )
    entry = Entry(scenario="s", solver=solver_of(name), cells=tuple(cells))
    return list(tabled_runs([entry], outcomes))


def content(file: Path) -> list[tuple[str, ...]]:
    with file.open(encoding="utf-8", newline="") as opened:
        rows = list(csv.DictReader(opened))
    assert all(list(each) == list(COLUMNS) for each in rows)
    names = ("solver", "seed", "verified_cost", "failure")
    return [tuple(each[name] for name in names) for each in rows]


def test_rows_are_appended_once_and_none_is_replaced(tmp_path: Path) -> None:
    file = tmp_path / "results.csv"
    append_runs(file, runs("de", 1.5, "it died\nearly"))
    first = file.read_bytes()
    kept = [("de", "0", "1.5", ""), ("de", "1", "", "it died early")]
    assert content(file) == kept
    append_runs(file, runs("de", 1.5, "it died\nearly"))
    assert file.read_bytes() == first
    append_runs(file, [*runs("ga", 2.5), *runs("de", 1.5, 3.5)])
    assert file.read_bytes().startswith(first)
    assert content(file) == [*kept, ("ga", "0", "2.5", ""), ("de", "1", "3.5", "")]


def test_a_last_line_without_an_end_is_ended(tmp_path: Path) -> None:
    file = tmp_path / "results.csv"
    append_runs(file, runs("de", 1.5))
    file.write_text(file.read_text().rstrip("\n"))
    append_runs(file, runs("ga", 2.5))
    assert [each[0] for each in content(file)] == ["de", "ga"]


def test_a_table_of_something_else_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "results.csv"
    file.write_text("mine,yours\n1,2\n")
    with pytest.raises(ForeignFileError, match="expected a table of comparisons"):
        require_table(file)
    with pytest.raises(ForeignFileError, match="expected a table of comparisons"):
        append_runs(file, [])
    assert file.read_text() == "mine,yours\n1,2\n"


def judged(**result: object) -> dict[str, object]:
    """Return a row of one run with a result."""
    outcome = Outcome(
        result=result,
        failure="",
        seconds=2.5,
        folder=Path(),
        date="2026-01-02T03:04:05+00:00",
        machine={"processor": "P", "cores": 2, "system": "Linux", "python": "3"},
        load=(0.5, 1.5),
        cpu_s=2.0,
        versions={"casadi": "3.7"},
        was_cut=True,
    )
    cell = Cell(work="a:b", job={"variant": "", "seed": 7}, label="")
    run = TabledRun(scenario="s", solver="de", cell=cell, outcome=outcome)
    return content_of_run(run)


def test_round_off_beside_what_a_search_began_with_is_no_false_success() -> None:
    """A cost of 1e-25 by one way of summing up and 0 by another, at first 4."""
    claim = {"claimed_feasible": True, "feasible": True, "claimed_cost": 1e-25}
    began = {"history": {"cost": [None, 4.0, 1e-25]}}
    assert judged(**claim, verified_cost=0.0, **began)["false_success"] is False
    assert judged(**claim, verified_cost=1e-9, **began)["false_success"] is True


def test_a_row_says_where_when_and_how_it_ended() -> None:
    found = judged(counts={"rollouts": 5, "gradient_ratio": 2.0}, stopped_by="seconds")
    assert (found["rollouts"], found["stopped_by"], found["cut"]) == (
        5,
        "seconds",
        True,
    )
    assert (found["load_begin"], found["load_end"]) == (0.5, 1.5)
    assert (found["wall_seconds"], found["cpu_seconds"]) == (2.5, 2.0)
    assert (found["processor"], found["casadi"]) == ("P", "3.7")
    assert set(found) <= set(COLUMNS)


@pytest.mark.parametrize(
    ("claimed_feasible", "feasible", "claimed", "verified", "is_false"),
    [
        (True, True, 1.0, 1.009, False),
        (True, True, 1.0, 1.02, True),
        (True, True, -1.0, -1.02, True),
        (True, False, 1.0, 1.0, True),
        (False, False, 1.0, 9.0, False),
        (False, True, 1.0, 9.0, False),
        (True, True, None, 1.0, False),
        (True, False, None, None, True),
        (None, False, None, None, None),
    ],
)
def test_a_false_success_is_claimed_and_not_confirmed(
    claimed_feasible: bool | None,
    feasible: bool,
    claimed: float | None,
    verified: float | None,
    is_false: bool | None,
) -> None:
    found = judged(
        claimed_feasible=claimed_feasible,
        feasible=feasible,
        claimed_cost=claimed,
        verified_cost=verified,
    )
    assert found["false_success"] is is_false


def test_a_table_of_a_former_version_is_left_and_the_next_goes_on(
    tmp_path: Path,
) -> None:
    file, second = tmp_path / "results.csv", tmp_path / "results-2.csv"
    former = (
        "scenario,variant,solver,seed,feasible,claimed_cost,claimed_violation,"
        "verified_cost,verified_violation,evaluations,seconds,status,failure,cell\n"
        "s,,de,0,True,1.0,0.0,1.0,0.0,400,0.1,solved,,0123456789abcdef\n"
    )
    file.write_text(former)
    assert require_table(file) == second
    assert append_runs(file, runs("de", 1.5)) == second
    assert append_runs(file, [*runs("de", 1.5), *runs("ga", 2.5)]) == second
    assert file.read_text() == former
    assert [each[0] for each in content(second)] == ["de", "ga"]
    second.write_text(former)
    assert require_table(file) == tmp_path / "results-3.csv"
    second.write_text("mine\n")
    with pytest.raises(ForeignFileError, match=r"results-2.csv: expected a table"):
        append_runs(file, runs("ga", 2.5))
    assert second.read_text() == "mine\n"


def test_a_row_is_one_line_whatever_a_status_says(tmp_path: Path) -> None:
    file = tmp_path / "results.csv"
    outcome = Outcome(
        result={"status": 'one, "two"\r\nthree', "stopped_by": None},
        failure="",
        seconds=1.0,
        folder=Path(),
    )
    cell = Cell(work="a:b", job={"variant": "", "seed": 0}, label="")
    run = TabledRun(scenario="s", solver="a[b=1,c=2]", cell=cell, outcome=outcome)
    append_runs(file, [run])
    append_runs(file, [run])
    with file.open(encoding="utf-8", newline="") as opened:
        (found,) = csv.DictReader(opened)
    assert found["solver"] == "a[b=1,c=2]" and found["stopped_by"] == ""
    assert found["status"] == 'one, "two" three'
