"""A file whose tape takes for ever is undecided when its time is up, not later."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from swarmstart.ocp.lower_bound import check as command
from swarmstart.terminal_set.checker.file_content import digest
from swarmstart.terminal_set.checker.findings import Deadline
from swarmstart.tests.ocp.lower_bound import evidence_by_hand as by_hand
from swarmstart.tests.ocp.lower_bound.test_check import content_of

LENGTH = 15_000
Links = Callable[[int], list[Any]]
"""Number of the last value -> the next instruction."""

LINKS: dict[str, Links] = {
    name: lambda k, name=name: [name, k]
    for name in ("tan", "exp", "sin", "tanh", "atan", "sqrt", "fabs", "sq", "log")
} | {
    "products": lambda k: ["mul", k, 1],
    "powers": lambda k: ["pow", k, 1],
    "quotients": lambda k: ["div", 1, k],
    "sums": lambda k: ["add", k, 1],
    "largest": lambda k: ["fmax", k, 1],
    "product of the control": lambda k: ["mul", k, 0],
    "sums of the control": lambda k: ["add", k, 0],
}


class Counted(Deadline):
    """A deadline after a number of looks at the clock, the same on every machine."""

    looks = 0
    most = 200

    @property
    def has_passed(self) -> bool:
        type(self).looks += 1
        return type(self).looks > self.most


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Iterator[type[Counted]]:
    Counted.looks = 0
    monkeypatch.setattr(
        Deadline, "after", classmethod(lambda cls, seconds: Counted(0.0))
    )
    yield Counted


def hostile(link: Links) -> dict[str, Any]:
    """x' = u + 1e-9 times the end of a long chain that begins at x."""
    content: dict[str, Any] = json.loads(json.dumps(content_of(by_hand.quadratic())))
    problem = content["problem"]
    tape = problem["tape"]
    last = 1
    for _ in range(LENGTH):
        tape.append(link(last))
        last = len(tape) - 1
    tape += [["const", 1e-9], ["mul", last, len(tape)]]
    tape.append(["add", 0, len(tape) - 1])
    problem["rate"] = [len(tape) - 1]
    content["sha256"] = digest(content)
    return content


@pytest.mark.parametrize("most", [200, LENGTH + 150], ids=["read", "evaluated"])
@pytest.mark.parametrize("name", LINKS)
def test_the_time_is_looked_at_within_a_tape(
    name: str,
    most: int,
    counted: type[Counted],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It is read in one look an instruction, then evaluated in one for each 32."""
    counted.most = most
    file = tmp_path / "hostile.json"
    file.write_text(json.dumps(hostile(LINKS[name])), encoding="utf-8")
    code = command.main([str(file), "--seconds", "1"])
    said = capsys.readouterr().out
    assert code in (3, 4), said  # A chain may be refused before.
    ends = ("undecided: the rest: time was up", "boxes left in the queue")
    assert code == 3 or any(end in said for end in ends)
    assert code == 3 or counted.looks == most + 1
