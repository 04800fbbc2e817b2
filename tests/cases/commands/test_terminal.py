"""Streams: a message never fails because of its stream, nor goes to the wrong one."""

from __future__ import annotations

import io
import sys

import pytest

from swarmstart.cases.commands.terminal import OutputError, answer, finish, tell


class Full(io.StringIO):
    """A stream on a full device."""

    def flush(self) -> None:
        raise OSError(28, "No space left on device")


def test_characters_that_a_terminal_obeys_or_cannot_show_are_escaped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    written = io.BytesIO()
    stream = io.TextIOWrapper(written, encoding="ascii")
    monkeypatch.setattr(sys, "stdout", stream)
    monkeypatch.setattr(sys, "stderr", stream)
    for say in (answer, tell):
        say("a\x1b[31m\r\x00\u202e\n\u017c")
    assert written.getvalue() == 2 * b"a\\x1b[31m\\r\\x00\\u202e\n\\u017c\n"


@pytest.mark.parametrize(
    ("stream", "reason"),
    [(Full(), "No space left"), (None, "it is closed")],
    ids=["full", "closed"],
)
def test_an_answer_that_cannot_be_written_is_an_error(
    stream: io.StringIO | None, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdout", stream)
    with pytest.raises(OutputError, match=reason):
        answer("42")


def test_talk_is_never_an_error_nor_an_answer(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for stream in (None, Full()):
        monkeypatch.setattr(sys, "stderr", stream)
        tell("something")
    assert capsys.readouterr().out == ""


def test_what_others_have_left_is_written_or_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, None)
    finish()
    monkeypatch.setattr(sys, "stderr", Full())
    finish()
    monkeypatch.setattr(sys, "stdout", Full())
    with pytest.raises(OutputError, match="No space left"):
        finish()


def test_a_reader_that_has_gone_is_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    class Gone(Full):
        def flush(self) -> None:
            raise BrokenPipeError

    monkeypatch.setattr(sys, "stdout", Gone())
    finish()
    with pytest.raises(BrokenPipeError):
        answer("42")
