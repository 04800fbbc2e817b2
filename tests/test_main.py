"""The program itself, before any command is known."""

import importlib

import pytest

from swarmstart.__main__ import program
from swarmstart.cases.commands.terminal import INTERRUPTED


def test_an_interruption_before_signals_are_handled_ends_as_any_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(name: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(importlib, "import_module", interrupted)
    assert program() == INTERRUPTED
