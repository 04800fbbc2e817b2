"""A command prints at once; the cache of machine code can be listed and cleared."""

from __future__ import annotations

import json
import subprocess
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from swarmstart.cases.commands import terminal
from swarmstart.heuristics.running.ahead import _IN_HELPER
from swarmstart.machine_code.clocks import announce
from swarmstart.tests.processes import python

if TYPE_CHECKING:
    from swarmstart.tests.system.conftest import Command

FIRST_SIGN_S = terminal.FIRST_SIGN_S  # Before tests put it off.
AT_WORK = f"swarmstart: {terminal.AT_WORK}"


def run(cache: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the command line with a cache of its own, alone."""
    variables = {"XDG_CACHE_HOME": str(cache), _IN_HELPER: "1"}
    return python("-m", "swarmstart", *arguments, variables=variables)


def test_a_first_run_says_that_it_compiles_and_how_long_that_took(
    tmp_path: Path,
) -> None:
    options = ["--no-figures", "--set", "steps=1", "--out", str(tmp_path / "out")]
    cheap = ["--search", "random", "--set", "dual_mode.enabled=false"]
    done = run(tmp_path / "cache", "run", "formation_v", *options, *cheap)
    assert "swarmstart: compiling the search for this machine, once" in done.stderr
    record = json.loads((tmp_path / "out" / "run.json").read_text())
    assert record["compile_seconds"] > record["measures"]["step_seconds_max"]
    told = json.loads(run(tmp_path / "cache", "cache", "--json").stdout)
    assert told["folder"] == str(tmp_path / "cache" / "swarmstart" / "machine-code")
    assert told["files"] > 0 and told["refused"] is None


def test_the_first_sign_comes_within_a_second() -> None:
    assert FIRST_SIGN_S < 1.0


def test_a_command_that_takes_a_while_says_that_it_is_at_work(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Due:
        """A timer that ends at once, if it is started."""

        def __init__(self, delay: float, call: object, arguments: list[str]) -> None:
            assert delay == terminal.FIRST_SIGN_S
            self.call, self.arguments, self.daemon = call, arguments, False

        def start(self) -> None:
            self.call(*self.arguments)  # type: ignore[operator]

        def cancel(self) -> None: ...

    monkeypatch.setattr(threading, "Timer", Due)
    announce.cache_clear()
    with terminal.first_sign(quiet=False):
        announce("the search", "about 10 s")
    compiling = "swarmstart: compiling the search for this machine, once, about 10 s"
    assert capsys.readouterr().err.splitlines() == [AT_WORK, compiling]
    announce.cache_clear()
    with terminal.first_sign(quiet=True):
        announce("the search", "about 10 s")
    assert capsys.readouterr().err == ""


def test_cache_tells_and_clears(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = tmp_path / "swarmstart" / "machine-code"
    folder.mkdir(parents=True, mode=0o700)
    (folder / "code").write_bytes(bytes(3_000_000))
    told = command("cache").out.splitlines()
    assert told == [f"folder   {folder}", "files    1, 3.0 MB of at most 268 MB"]
    told = command("cache", "--clear").out.splitlines()
    assert told[-1] == "removed  1 file"
    assert not list(folder.iterdir())


def test_cache_says_why_it_is_not_used(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = tmp_path / "swarmstart" / "machine-code"
    folder.mkdir(parents=True)
    folder.chmod(0o755)
    (folder / "mine").write_text("not code")
    told = command("cache", "--clear").out
    assert "not used: it must be a folder of the user's own with mode 0700" in told
    assert (folder / "mine").exists()
