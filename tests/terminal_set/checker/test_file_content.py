"""Only regular files of bounded size are read; all others are refused at once."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from swarmstart.terminal_set.checker.file_content import (
    LARGEST_FILE,
    CertificateFileError,
    DigestError,
    digest,
    read_content,
)
from swarmstart.tests.terminal_set.checker.certificates_by_hand import chen


def fifo(path: Path) -> Path:
    os.mkfifo(path)
    return path


NO_FILES: dict[str, Callable[[Path], Path]] = {
    "a pipe that nothing writes to": fifo,
    "a device without end": lambda _: Path("/dev/zero"),
    "a folder": lambda path: path.parent,
}


@pytest.mark.skipif(os.name == "nt", reason="no pipes in the file system")
@pytest.mark.parametrize("make", NO_FILES.values(), ids=NO_FILES)
def test_what_is_no_regular_file_is_refused_without_waiting(
    make: Callable[[Path], Path], tmp_path: Path
) -> None:
    with pytest.raises(CertificateFileError, match="it is no regular file"):
        read_content(make(tmp_path / "certificate.json"))


def test_files_are_read_where_no_opening_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr(os, "O_NONBLOCK")
    file = tmp_path / "certificate.json"
    file.write_text(json.dumps(chen()))
    assert read_content(file) == chen()


@pytest.mark.parametrize("more", [0, 1])
def test_a_file_may_have_ten_megabytes_and_no_byte_more(
    more: int, tmp_path: Path
) -> None:
    file = tmp_path / "certificate.json"
    text = json.dumps(chen())
    file.write_text(text + " " * (LARGEST_FILE + more - len(text)))
    if not more:
        assert read_content(file) == chen()
        return
    with pytest.raises(CertificateFileError, match="larger than 10 MB"):
        read_content(file)


def nested(depth: int) -> str:
    text = json.dumps(chen() | {"format": "HERE"})
    return text.replace('"HERE"', "[" * depth + "]" * depth)


@pytest.mark.parametrize(
    "text", ["[" * 9_000_000, nested(100_000), nested(900), '{"a":' * 1_000_000]
)
def test_deep_nesting_is_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / "certificate.json"
    file.write_text(text)
    with pytest.raises(CertificateFileError, match=r"nested too deeply|is no"):
        read_content(file)


def test_nesting_that_can_be_read_but_not_written_is_refused(tmp_path: Path) -> None:
    """Between the depths that the reader and the digest can bear."""
    file = tmp_path / "certificate.json"
    for depth in range(700, 1100, 7):
        text = json.dumps(chen() | {"design": "HERE"})
        file.write_text(text.replace('"HERE"', "[" * depth + "]" * depth))
        with pytest.raises((CertificateFileError, DigestError)):
            read_content(file)


def test_a_digest_of_other_content_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "certificate.json"
    file.write_text(json.dumps(chen() | {"alpha": 0.5}))
    with pytest.raises(DigestError, match=digest(chen() | {"alpha": 0.5})):
        read_content(file)


@pytest.mark.parametrize("stated", [None, 7, "", "0" * 63, "0" * 65, "g" * 64])
def test_what_is_no_digest_is_refused_as_none(stated: object, tmp_path: Path) -> None:
    file = tmp_path / "certificate.json"
    file.write_text(json.dumps(chen() | {"sha256": stated}))
    with pytest.raises(CertificateFileError, match="64 hexadecimal digits"):
        read_content(file)
