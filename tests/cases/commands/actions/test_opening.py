"""`open`: the page of a record, else its first figure, of the newest record."""

import argparse
import os
import stat
import sys
from pathlib import Path

import pytest

from swarmstart.cases.commands.actions.report import newest_file, open_command, opener
from swarmstart.cases.record.files import RecordError


def record(folder: Path, *names: str, when: float = 1e9) -> Path:
    """Write a record with some files."""
    for name in ("run.json", *names):
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("{}")
    os.utime(folder / "run.json", (when, when))
    return folder


def test_a_page_is_shown_before_figures_and_the_sheet_before_others(
    tmp_path: Path,
) -> None:
    names = ("figures/a_sheet.svg", "figures/a_sheet.png", "figures/A.png")
    folder = record(tmp_path / "r", *names)
    assert newest_file(folder) == folder / "figures" / "a_sheet.png"
    record(folder, "report.html")
    assert newest_file(folder) == folder / "report.html"


def test_the_page_of_single_claims_is_shown(tmp_path: Path) -> None:
    for name in ("replication-9.json", "replication-9.html"):
        (tmp_path / name).write_text("{}")
    assert newest_file(tmp_path) == tmp_path / "replication-9.html"
    assert newest_file(tmp_path.parent) == tmp_path / "replication-9.html"


def test_of_several_records_the_newest_with_a_figure_is_shown(tmp_path: Path) -> None:
    record(tmp_path / "s" / "old", "figures/a.png", when=1e9)
    new = record(tmp_path / "s" / "new", "figures/a.png", when=2e9)
    record(tmp_path / "s" / "bare", when=3e9)
    assert newest_file(tmp_path) == new / "figures" / "a.png"


def test_without_a_record_or_a_figure_the_way_to_one_is_told(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="there is no such folder"):
        newest_file(tmp_path / "away")
    with pytest.raises(RecordError, match="expected a folder that run, sweep"):
        newest_file(tmp_path)
    record(tmp_path / "r")
    with pytest.raises(RecordError, match="swarmstart report makes a page"):
        newest_file(tmp_path)


def test_without_a_display_the_path_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    folder = record(tmp_path / "r", "figures/a.png")
    assert open_command(argparse.Namespace(folder=str(folder))) == 0
    said = capsys.readouterr()
    assert said.out == f"{folder / 'figures' / 'a.png'}\n"
    assert "no display was found" in said.err


@pytest.mark.skipif(os.name != "posix", reason="a program of a shell")
@pytest.mark.parametrize(("code", "words"), [(0, ""), (3, "could not open it")])
def test_with_a_display_the_program_of_the_system_gets_the_path(
    code: int,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    program = tmp_path / "bin" / "xdg-open"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\necho "$1" > "{tmp_path}/opened"\nexit {code}\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setenv("PATH", str(program.parent), prepend=os.pathsep)
    folder = record(tmp_path / "r", "figures/-a b.png")
    assert opener() == [str(program)]
    assert open_command(argparse.Namespace(folder=str(folder))) == 0
    opened = (tmp_path / "opened").read_text().strip()
    assert opened == str(folder / "figures" / "-a b.png")
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("name", ["x" * 5000, "a\0b"])
def test_a_path_that_no_folder_has_is_refused(name: str) -> None:
    with pytest.raises(RecordError, match="expected the path of a folder"):
        newest_file(Path(name))
