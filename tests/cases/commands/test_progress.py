"""Progress on standard error: lines without a terminal, silence at first."""

import pytest

from swarmstart.cases.commands import terminal
from swarmstart.cases.commands.terminal import Progress


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal, "QUIET_S", 0.0)
    monkeypatch.setattr(terminal, "LINE_EVERY_S", 0.0)


def test_a_line_says_what_is_done_and_how_far_it_is(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Progress("swing-up") as shown:
        shown.update(300, 2000, "searching")
        shown.update(0, 0, "polishing")
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["swing-up: searching, step 300 of 2000", "swing-up: polishing"]


def test_what_is_counted_has_its_name_and_nothing_done_is_not_counted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Progress("slow", of="run") as shown:
        shown.update(0, 3, "drawing")
        shown.update(1, 3, "seed 0")
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["slow: drawing", "slow: seed 0, run 1 of 3"]


def test_a_bar_takes_work_of_a_length_that_cannot_be_told(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(terminal, "fancy", lambda: True)
    with Progress("swing-up") as shown:
        shown.update(300, 2000, "searching")
        shown.update(0, 0, "polishing")
        shown.update(1, 2, "verifying")


def test_nothing_is_said_of_short_work(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(terminal, "QUIET_S", 60.0)
    with Progress("swing-up") as shown:
        shown.update(1, 2, "searching")
    assert capsys.readouterr().err == ""
