"""The command line in this process, and a scenario as its text."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from swarmstart.cases.commands import terminal
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.format.scenario import shipped


@dataclass(frozen=True)
class Said:
    """The answer of a command."""

    code: int
    out: str
    err: str


Command = Callable[..., Said]


@pytest.fixture(autouse=True)
def _no_first_sign(monkeypatch: pytest.MonkeyPatch) -> None:
    """Remove messages of progress, since they depend on the load."""
    monkeypatch.setattr(terminal, "FIRST_SIGN_S", 3600.0)


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Command:
    """Run a command in this process."""

    def run(*arguments: object) -> Said:
        capsys.readouterr()
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as leaving:  # argparse
            code = int(leaving.code or 0)
        captured = capsys.readouterr()
        return Said(code, captured.out, captured.err)

    return run


@pytest.fixture(scope="session")
def shipped_text() -> str:
    return shipped()["formation_v"].read_text(encoding="utf-8")


@pytest.fixture
def changed(tmp_path: Path, shipped_text: str) -> Callable[[str, str], Path]:
    """Write formation_v with one piece of its text replaced; return the file."""

    def write(old: str, new: str) -> Path:
        assert old in shipped_text
        file = tmp_path / "mine.yaml"
        file.write_text(shipped_text.replace(old, new, 1), encoding="utf-8")
        return file

    return write
