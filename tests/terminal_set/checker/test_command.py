"""The frame of the check commands: which exit code and which lines a check comes to."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import pytest

from swarmstart.terminal_set.checker.command import Judged, checked, complain, parsed
from swarmstart.terminal_set.checker.file_content import (
    CertificateFileError,
    DigestError,
)
from swarmstart.terminal_set.checker.findings import Finding, Verdict

PROVED = Finding(Verdict.PROVED, "V decreases")
SAMPLED = Finding(Verdict.SAMPLED, "the error is 0", "the error")
REFUSED = Finding(Verdict.REFUSED, "P is indefinite")
UNDECIDED = Finding(Verdict.UNDECIDED, "time ran out")

Judge = Callable[[str], Iterable[Finding]]


def options_of(*arguments: str) -> object:
    return vars(parsed(arguments, program="check"))


def said_of(text: str, sampled: Sequence[str]) -> str:
    return f"as {text}" + "".join(f", sampled: {subject}" for subject in sampled)


def code_of(read: Callable[[str], str], judged: Judge = lambda _: [PROVED]) -> int:
    options = parsed(["a.json"], program="check")

    def judge(file: Path) -> Judged:
        text = read(str(file))
        return judged(text), lambda sampled: said_of(text, sampled)

    return checked(options, judge)


def raising(error: BaseException) -> Callable[[object], NoReturn]:
    def fail(_: object) -> NoReturn:
        raise error

    return fail


def test_the_options_are_a_file_and_ten_minutes_unless_told() -> None:
    alone = {"file": Path("a.json"), "seconds": 600.0, "against": None}
    assert options_of("a.json") == alone
    given = options_of("a.json", "--seconds", "2.5", "--against", "a.c")
    assert given == {"file": Path("a.json"), "seconds": 2.5, "against": Path("a.c")}


@pytest.mark.parametrize("seconds", ["0", "-1", "inf", "nan", "soon"])
def test_seconds_that_are_no_time_are_refused_by_code_2(
    seconds: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        options_of("a.json", "--seconds", seconds)
    assert stop.value.code == 2
    assert "--seconds" in capsys.readouterr().err


def test_what_is_quoted_of_a_wrong_call_is_escaped(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as stop:
        options_of("a.json", "\x1b[31mred")
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert "usage: check" in said
    assert r"\x1b[31mred" in said
    assert "\x1b" not in said


@pytest.mark.parametrize(
    ("findings", "code", "verdict"),
    [
        ([PROVED], 0, "verdict: as proof"),
        ([SAMPLED, PROVED], 0, "verdict: as proof, sampled: the error"),
        ([PROVED, UNDECIDED], 4, "verdict: undecided within 600 s"),
        ([PROVED, REFUSED], 3, "verdict: refused"),
        ([UNDECIDED, REFUSED], 3, "verdict: refused"),
        ([REFUSED, UNDECIDED, PROVED], 3, "verdict: refused"),
    ],
)
def test_the_worst_finding_decides_and_each_has_its_line(
    findings: list[Finding], code: int, verdict: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of(lambda _: "proof", lambda _: findings) == code
    lines = capsys.readouterr().out.splitlines()
    assert lines == [*(f"{f.verdict.value}: {f.text}" for f in findings), verdict]


@pytest.mark.parametrize(
    ("error", "code", "out", "err"),
    [
        (PermissionError(13, "denied"), 5, "", "a.json cannot be read: denied\n"),
        (CertificateFileError("no JSON"), 2, "", "a.json cannot be used: no JSON\n"),
        (DigestError("changed"), 3, "refused: changed\nverdict: refused\n", ""),
        (KeyboardInterrupt(), 130, "", "interrupted\n"),
    ],
)
def test_a_file_that_cannot_be_judged_has_a_code_of_its_own(
    error: BaseException,
    code: int,
    out: str,
    err: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert code_of(raising(error)) == code
    assert capsys.readouterr() == (out, err)


def test_an_interruption_amid_the_findings_keeps_the_lines_before_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    def judged(_: str) -> Iterator[Finding]:
        yield PROVED
        raise KeyboardInterrupt

    assert code_of(lambda _: "proof", judged) == 130
    assert capsys.readouterr() == ("re-proved: V decreases\n", "interrupted\n")


def test_a_report_that_cannot_be_written_is_never_taken_for_a_proof(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", None)
        assert code_of(lambda _: "proof") == 5
    assert "the report cannot be written" in capsys.readouterr().err


def test_a_complaint_without_an_error_stream_is_dropped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    complain("unheard")
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    complain("heard")
    assert stream.getvalue() == "heard\n"
