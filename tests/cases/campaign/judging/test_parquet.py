"""A Parquet file has every run of a table, with types and descriptions of columns."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.judging.results_table import (
    COLUMNS,
    CURVES,
    TabledRun,
    append_runs,
    write_curves,
    write_parquet,
)
from swarmstart.cases.record.files import ForeignFileError, RecordError, is_temporary
from swarmstart.errors import MissingPackageError

HISTORY = {
    "evaluations": [1, 10],
    "seconds": [0.1, 0.2],
    "cost": [None, 0.1 + 0.2],
    "violation": [2.0, 0.0],
}


def run(seed: int, **result: object) -> TabledRun:
    return TabledRun(
        scenario="s",
        solver="de",
        cell=Cell(work="a:b", job={"variant": "", "seed": seed}, label=""),
        outcome=Outcome(
            result=result, failure="", seconds=1.5, folder=Path(), load=(0.5, 1.0)
        ),
    )


RUNS = [
    run(0, verified_cost=0.1 + 0.2, feasible=True, evaluations=10, history=HISTORY),
    run(1, feasible=False, status="späte Antwort", history=None),
]


def test_types_and_values_are_those_of_the_runs(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    table = append_runs(tmp_path / "results.csv", RUNS)
    for _ in range(2):  # One of this package is replaced.
        write_parquet(table, tmp_path / "runs.parquet")
    read = parquet.read_table(tmp_path / "runs.parquet")
    assert read.column_names == list(COLUMNS)
    first, second = read.to_pylist()
    assert first["verified_cost"] == 0.1 + 0.2 and first["evaluations"] == 10
    assert (first["feasible"], second["feasible"]) == (True, False)
    assert second["verified_cost"] is None and second["status"] == "späte Antwort"
    assert (first["seed"], first["load_begin"], first["wall_seconds"]) == (0, 0.5, 1.5)
    told = json.loads(read.schema.metadata[b"swarmstart"])
    assert told == {name: column.what for name, column in COLUMNS.items()}
    field = read.schema.field("wall_seconds")
    assert field.metadata[b"description"].endswith(b"[s]")


def test_curves_have_a_row_a_mark(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    write_curves(RUNS, tmp_path / "curves.parquet")
    read = parquet.read_table(tmp_path / "curves.parquet")
    assert read.column_names == list(CURVES)
    assert read.column("evaluations").to_pylist() == [1, 10]
    assert read.column("cost").to_pylist() == [None, 0.1 + 0.2]
    assert read.column("seed").to_pylist() == [0, 0]
    assert read.column("cell").to_pylist() == [RUNS[0].cell.key] * 2
    write_curves([], tmp_path / "curves.parquet")
    assert parquet.read_table(tmp_path / "curves.parquet").num_rows == 0


def test_a_file_of_another_program_is_left(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    table = append_runs(tmp_path / "results.csv", RUNS)
    mine, text = tmp_path / "mine.parquet", tmp_path / "text.parquet"
    parquet.write_table(pa.table({"a": [1]}), mine)
    text.write_text("mine")
    for file in (mine, text):
        before = file.read_bytes()
        with pytest.raises(ForeignFileError, match="found another file"):
            write_parquet(table, file)
        assert file.read_bytes() == before
    with pytest.raises(RecordError, match="expected a file to write to"):
        write_parquet(table, text / "below.parquet")
    assert not any(is_temporary(file.name) for file in tmp_path.iterdir())


def test_what_is_wrong_with_a_table_is_said_with_its_line(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    file, out = tmp_path / "results.csv", tmp_path / "runs.parquet"
    for text, said in (
        ("", "expected a table of comparisons of this version"),
        ("mine\n", "expected a table of comparisons of this version"),
        (",".join(COLUMNS) + "\nshort\n", f":2: expected {len(COLUMNS)} entries"),
        (_edited("seed", "x"), r":2: expected seed to be an integer, found 'x'"),
        (_edited("seconds", "x"), r":2: expected seconds to be a number, found 'x'"),
        (_edited("feasible", "1"), r":2: expected feasible to be True or False"),
    ):
        file.write_text(text)
        with pytest.raises(RecordError, match=said):
            write_parquet(file, out)
    with pytest.raises(RecordError, match="expected a table"):
        write_parquet(tmp_path / "missing.csv", out)
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(RecordError, match="expected a table"):
        write_parquet(file, out)
    assert not out.exists()


def _edited(column: str, text: str) -> str:
    line = [text if name == column else "" for name in COLUMNS]
    return ",".join(COLUMNS) + "\n" + ",".join(line) + "\n"


def test_without_pyarrow_one_sentence_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = append_runs(tmp_path / "results.csv", RUNS)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    said = r"a Parquet file needs pyarrow, .* 'swarmstart\[parquet\]'"
    with pytest.raises(MissingPackageError, match=said):
        write_parquet(table, tmp_path / "runs.parquet")
    with pytest.raises(MissingPackageError, match=said):
        write_curves(RUNS, tmp_path / "curves.parquet")


def test_every_number_with_a_unit_has_it_told() -> None:
    for name, column in {**COLUMNS, **CURVES}.items():
        assert column.what and not column.what.endswith(".")
        assert ("seconds" in name) == column.what.endswith("[s]"), name
