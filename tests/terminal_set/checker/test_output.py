"""Output to a terminal: printable, in its encoding, one line."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from pathlib import Path

import pytest

from swarmstart.terminal_set.checker.command import write_line
from swarmstart.tests.terminal_set.checker.certificates_by_hand import chen


def written(text: str, encoding: str) -> bytes:
    raw = io.BytesIO()
    stream = io.TextIOWrapper(raw, encoding=encoding, newline="\n")
    write_line(stream, text)
    return raw.getvalue()


@pytest.mark.parametrize(
    ("text", "encoding", "shown"),
    [
        ("a\x1b[31mb\x07\x9b", "utf-8", b"a\\x1b[31mb\\x07\\x9b\n"),
        ("two\nlines\r", "utf-8", b"two\\nlines\\r\n"),
        ("\u202eright to left", "utf-8", b"\\u202eright to left\n"),
        ("caf\xe9 \udcff", "utf-8", b"caf\xc3\xa9 \\udcff\n"),
        ("caf\xe9", "ascii", b"caf\\xe9\n"),
    ],
)
def test_what_is_not_printable_is_escaped(
    text: str, encoding: str, shown: bytes
) -> None:
    assert written(text, encoding) == shown


def test_a_closed_stream_is_an_error_of_the_system() -> None:
    with pytest.raises(OSError, match="the stream is closed"):
        write_line(None, "text")


def checked(arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = f'exec "{sys.executable}" -m swarmstart.terminal_set.check {arguments}'
    return subprocess.run(
        ["/bin/sh", "-c", command],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device")
@pytest.mark.parametrize("end", ["> /dev/full", ">&-"])
def test_a_report_that_cannot_be_written_has_its_own_exit_code(
    end: str, tmp_path: Path
) -> None:
    pytest.importorskip("flint")
    (tmp_path / "c.json").write_text(json.dumps(chen() | {"alpha": 0.5}))
    result = checked(f"c.json {end}", tmp_path)
    assert result.returncode == 5
    assert "the report cannot be written" in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.skipif(sys.platform == "win32", reason="no such shell")
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("$(printf 'none\\033[31m.json')", "none\\x1b[31m.json cannot be read"),
        ("a $(printf 'b\\033[31m')", "unrecognized arguments: b\\x1b[31m"),
    ],
)
def test_names_of_files_are_escaped(arguments: str, words: str, tmp_path: Path) -> None:
    result = checked(arguments, tmp_path)
    assert result.returncode in (2, 5)
    assert words in result.stderr and "\x1b" not in result.stderr
