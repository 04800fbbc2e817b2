"""`report`: of a folder of records the newest is taken, and it is said which."""

import argparse
import os
from pathlib import Path

import pytest

from swarmstart.cases.commands.actions import report
from swarmstart.cases.commands.actions.report import report_command
from swarmstart.cases.drawing.report.pages.comparison_page import comparison_page
from swarmstart.cases.record.files import RecordError
from swarmstart.tests.cases.drawing.report import contents


def record(folder: Path, *, when: float) -> Path:
    folder.mkdir(parents=True)
    (folder / "run.json").write_text("{}")
    os.utime(folder / "run.json", (when, when))
    return folder


def asked(folder: Path) -> int:
    options = argparse.Namespace(
        folders=[str(folder)], formats=["md"], out=None, charts=None
    )
    return report_command(options)


def test_the_newest_record_below_a_folder_gets_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    new = record(tmp_path / "wedge" / "new", when=2e9)
    record(tmp_path / "wedge" / "old", when=1e9)
    monkeypatch.setattr(report, "page_of", lambda folder, *_: f"of {folder}")
    assert asked(tmp_path / "wedge") == 0
    assert (new / "report.md").read_text() == f"of {new}"
    said = capsys.readouterr()
    assert said.err.endswith(f"wedge: the newest record below is {new}\n")
    assert asked(new) == 0
    assert capsys.readouterr().err == ""


def test_of_several_records_in_a_folder_the_newest_is_shown_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(report, "page_of", lambda _, recorded, __: recorded.file)
    folder = record(tmp_path / "mixed", when=2e9)
    for when, name in enumerate(("replication-9.json", "seeds.json")):
        (folder / name).write_text("{}")
        os.utime(folder / name, (when, when))
    assert asked(folder) == 0
    assert (folder / "report.md").read_text() == "run.json"
    assert capsys.readouterr().err == (
        f"swarmstart: {folder}: shows the newest record, run.json; older: seeds.json, "
        "replication-9.json\n"
    )
    os.utime(folder / "seeds.json", (3e9, 3e9))
    assert asked(folder) == 0
    assert (folder / "report.md").read_text() == "seeds.json"


def test_a_folder_without_records_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="found none of them"):
        asked(tmp_path)


def test_charts_are_files_beside_the_page_if_they_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    content = contents.content(scenarios=1, solvers=2, seeds=3)
    page = comparison_page(content)
    monkeypatch.setattr(report, "page_of", lambda *_: page)
    folder = record(tmp_path / "one", when=1e9)
    options = argparse.Namespace(
        folders=[str(folder)], formats=["md"], out=None, charts=["svg", "pdf", "svg"]
    )
    assert report_command(options) == 0
    charts = folder / "report_charts"
    names = sorted(file.name for file in charts.iterdir())
    assert len({name[:3] for name in names}) == len(names) / 2 > 4
    assert {file.suffix for file in charts.iterdir()} == {".svg", ".pdf"}
    assert capsys.readouterr().out.endswith(f"charts  {charts} ({len(names)} files)\n")
