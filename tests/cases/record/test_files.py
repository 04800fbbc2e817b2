"""Files appear whole or not at all; folders belong to one command at a time."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import BinaryIO

import pytest

from swarmstart.cases.record import files
from swarmstart.cases.record.files import (
    FolderInUseError,
    ForeignFileError,
    RecordError,
    is_temporary,
    locked,
    remove_rests,
    replacing,
    require_ours,
    to_json,
    write_atomically,
    write_json,
)

HOLDING = """
import sys, time
from pathlib import Path
from swarmstart.cases.record.files import locked
with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_what_is_not_finite_becomes_null() -> None:
    content = {"a": float("nan"), "b": [float("inf"), 1.5, (float("-inf"),)], "c": "x"}
    assert json.loads(to_json(content)) == {
        "a": None,
        "b": [None, 1.5, [None]],
        "c": "x",
    }


def test_a_file_appears_whole_and_alone(tmp_path: Path) -> None:
    file = tmp_path / "deep" / "file.json"
    write_json(file, {"a": 1})
    assert json.loads(file.read_text()) == {"a": 1}
    assert list(file.parent.iterdir()) == [file]


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt()])
def test_a_failure_keeps_the_old_file_and_leaves_no_other(
    error: BaseException, tmp_path: Path
) -> None:
    file = tmp_path / "file"
    file.write_text("old")

    def fail(opened: BinaryIO) -> None:
        opened.write(b"new, but hal")
        raise error

    expected = RecordError if isinstance(error, OSError) else KeyboardInterrupt
    with pytest.raises(expected):
        write_atomically(file, fail)
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_a_signal_waits_until_the_file_is_whole(tmp_path: Path) -> None:
    file = tmp_path / "file.json"

    def signalled(opened: BinaryIO) -> None:
        opened.write(b"ne")
        signal.raise_signal(signal.SIGINT)
        opened.write(b"w")

    with pytest.raises(KeyboardInterrupt):
        write_atomically(file, signalled)
    assert file.read_text() == "new"
    assert list(tmp_path.iterdir()) == [file]


def test_a_folder_is_made_and_tried_and_left_as_it_was(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "probe").write_text("mine")
    with locked(tmp_path / "a"), locked(tmp_path / "a" / "b"):
        pass
    assert list((tmp_path / "a" / "b").iterdir()) == []
    assert (tmp_path / "a" / "probe").read_text() == "mine"


@pytest.mark.parametrize("name", ["file", "file/in", "x" * 5000, "a\0b"])
def test_a_folder_that_cannot_be_one_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RecordError, match="expected a folder to write files to"):
        with locked(tmp_path / name):
            raise AssertionError("entered")


def test_a_folder_without_room_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "ROOM", 1 << 60)
    monkeypatch.setattr(files, "bytes", full_device, raising=False)
    with pytest.raises(RecordError, match="No space left on device"):
        with locked(tmp_path):
            raise AssertionError("entered")
    assert list(tmp_path.iterdir()) == []


def full_device(size: int) -> bytes:
    """Raise an error like that of the system."""
    raise OSError(28, os.strerror(28))


def test_two_commands_do_not_write_to_one_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "PATIENCE_S", 0.1)
    with locked(tmp_path):
        with pytest.raises(FolderInUseError, match="another command is writing"):
            with locked(tmp_path):
                raise AssertionError("entered")
    with locked(tmp_path):
        pass


def test_the_lock_of_a_killed_command_is_gone(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLDING, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(files, "PATIENCE_S", 0.1)
            with pytest.raises(FolderInUseError), locked(tmp_path):
                pass
        process.kill()
    with locked(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_what_a_kill_left_under_temporary_names_is_removed_and_nothing_else(
    tmp_path: Path,
) -> None:
    figures = tmp_path / "figures"
    figures.mkdir()
    with (
        replacing(figures / "a.png") as one,
        replacing(figures / "flight.gif", suffix=".gif") as other,
    ):
        one.touch()
        other.touch()
        left = [figures / one.name, figures / other.name]
        assert all(is_temporary(file.name) for file in left)
        remove_rests(tmp_path)
        assert not any(file.exists() for file in left)
        one.touch()
        other.touch()
    mine = [".hidden.tmp", ".notes.txt.7.tmp", "a.png.7.tmp", ".a.png.tmp", ".7.tmp"]
    for name in mine:
        (tmp_path / name).touch()
    for place in (tmp_path, figures):
        (place / ".left.png.7.tmp").touch()
    with locked(tmp_path):
        pass
    remove_rests(tmp_path / "nowhere")
    assert {file.name for file in tmp_path.iterdir()} == {*mine, "figures"}
    assert {file.name for file in figures.iterdir()} == {"a.png", "flight.gif"}


@pytest.mark.parametrize("content", [b"mine", b"\xff", b""])
def test_a_file_of_another_program_is_not_replaced(
    content: bytes, tmp_path: Path
) -> None:
    file = tmp_path / "table"
    require_ours(file, lambda text: text.startswith("ours"), "a table")
    file.write_bytes(content)
    with pytest.raises(ForeignFileError, match="expected a table, found another"):
        require_ours(file, lambda text: text.startswith("ours"), "a table")
    file.write_text("ours")
    require_ours(file, lambda text: text.startswith("ours"), "a table")
    with pytest.raises(RecordError, match="expected a table: Is a directory"):
        require_ours(tmp_path, lambda text: True, "a table")
