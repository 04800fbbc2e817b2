"""Files of others are below the scenario, plain, of limited size, and hashed."""

import hashlib
import os
from pathlib import Path

import pytest

from swarmstart.cases.format import foreign_files
from swarmstart.cases.format.foreign_files import file_below, foreign_file, hash_of


@pytest.mark.parametrize(
    "given",
    ["../a.fmu", "b/../../a.fmu", "/a.fmu", "a\\b.fmu", "a\0.fmu", "", "a" * 301, 3,
     None, "a.txt"],
)  # fmt: skip
def test_other_places_are_refused(given: object, tmp_path: Path) -> None:
    assert file_below(given, tmp_path, ".fmu") is None


def test_a_file_below_is_found_and_hashed(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "A.FMU").write_bytes(b"content")
    found = foreign_file("sub/A.FMU", tmp_path, key="fmu", suffix=".fmu")
    assert found.file == tmp_path / "sub" / "A.FMU" and str(found) == "A.FMU"
    assert found.sha256 == hashlib.sha256(b"content").hexdigest()


def test_what_is_no_plain_file_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    os.mkfifo(tmp_path / "pipe.fmu")
    (tmp_path / "folder.fmu").mkdir()
    (tmp_path / "large.fmu").write_bytes(b"123")
    for name in ("pipe.fmu", "folder.fmu", "missing.fmu"):
        with pytest.raises(ValueError, match="can be read: no such file"):
            hash_of(tmp_path / name)
    monkeypatch.setattr(foreign_files, "MOST_BYTES", 2)
    with pytest.raises(ValueError, match="more than 2 bytes"):
        hash_of(tmp_path / "large.fmu")
