"""`report`: of a folder of records the newest is taken, and it is said which."""

import argparse
import os
from pathlib import Path

import pytest

from swarmstart.cases.commands.actions import report
from swarmstart.cases.commands.actions.report import report_command
from swarmstart.cases.record.files import RecordError


def record(folder: Path, *, when: float) -> Path:
    folder.mkdir(parents=True)
    (folder / "run.json").write_text("{}")
    os.utime(folder / "run.json", (when, when))
    return folder


def asked(folder: Path) -> int:
    options = argparse.Namespace(folders=[str(folder)], formats=["md"], out=None)
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


def test_a_folder_without_records_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="found none of them"):
        asked(tmp_path)
