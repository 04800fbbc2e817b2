"""The cache stays within its limit, and removes nothing but its own files.

That only the user's own files are loaded is tested with evaluators, in
`ocp/compiled/test_cache.py`.
"""

import os
import time
from pathlib import Path

import pytest

import swarmstart.machine_code.code_cache as cache

pytestmark = pytest.mark.skipif(os.name == "nt", reason="modes of files are POSIX's")


def aged(file: Path, seconds: float) -> None:
    then = time.time() - seconds
    os.utime(file, (then, then))


def test_least_recently_used_files_leave_when_the_limit_is_passed(
    fresh_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache, "LIMIT_BYTES", 4000)
    for k, name in enumerate("abc"):
        cache.store_code(name, b"x" * 1000)
        aged(fresh_cache / name, 30_000 - 10_000 * k)
    assert cache.load_code("a") is not None  # Its use is noted.
    cache.store_code("d", b"x" * 1000)
    assert sorted(os.listdir(fresh_cache)) == ["a", "d"]
    assert cache.cache_usage().bytes <= cache.KEPT_PART * cache.LIMIT_BYTES


def test_nothing_leaves_below_the_limit(fresh_cache: Path) -> None:
    for k in range(20):
        cache.store_code(f"{k}", b"x" * 1000)
    assert cache.cache_usage().files == 20


def test_code_larger_than_the_limit_does_no_harm(
    fresh_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cache, "LIMIT_BYTES", 100)
    cache.store_code("a", b"x" * 1000)
    assert cache.cache_usage().files == 0


def test_rest_of_a_killed_process_is_removed_but_no_file_being_written(
    fresh_cache: Path,
) -> None:
    cache.store_code("a", b"x")
    old, new = fresh_cache / ".new-old", fresh_cache / ".new-new"
    old.write_bytes(b"x")
    new.write_bytes(b"x")
    aged(old, 7200)
    cache.store_code("b", b"x")
    assert not old.exists()
    assert new.exists()


@pytest.mark.parametrize("umask", [0o000, 0o022, 0o077, 0o777])
def test_modes_do_not_depend_on_the_umask(fresh_cache: Path, umask: int) -> None:
    before = os.umask(umask)
    try:
        cache.store_code("a", b"x")
        loaded = cache.load_code("a")
    finally:
        os.umask(before)
    assert loaded == b"x"
    assert (fresh_cache / "a").stat().st_mode & 0o777 == 0o600
    for folder in (fresh_cache, fresh_cache.parent):
        assert folder.stat().st_mode & 0o777 == 0o700


def test_usage_tells_where_and_how_large(fresh_cache: Path) -> None:
    assert cache.cache_usage() == cache.Usage(
        folder=fresh_cache, files=0, bytes=0, refused=None
    )
    assert not fresh_cache.exists()
    cache.store_code("a", b"x" * 10)
    found = cache.cache_usage()
    assert (found.files, found.bytes) == (1, (fresh_cache / "a").stat().st_size)


def test_usage_tells_why_a_folder_is_not_used(
    fresh_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cache.store_code("a", b"x")
    fresh_cache.chmod(0o755)
    assert "mode 0700" in str(cache.cache_usage().refused)
    assert cache.clear_cache() == 0
    assert (fresh_cache / "a").exists()
    monkeypatch.setattr(os.path, "expanduser", lambda path: path)
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert "home" in str(cache.cache_usage().refused)


def test_usage_tells_that_a_folder_cannot_be_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert cache.cache_usage().refused == "it cannot be created"


def test_clear_removes_the_files_and_says_how_many(fresh_cache: Path) -> None:
    assert cache.clear_cache() == 0
    cache.store_code("a", b"x")
    cache.store_code("b", b"x")
    (fresh_cache / "folder").mkdir()
    assert cache.clear_cache() == 2
    assert cache.load_code("a") is None
    assert os.listdir(fresh_cache) == ["folder"]


def test_a_pipe_in_the_place_of_a_file_does_not_hold_the_reader_up(
    fresh_cache: Path,
) -> None:
    cache.store_code("a", b"x")
    os.mkfifo(fresh_cache / "pipe", 0o600)
    assert cache.load_code("pipe") is None
