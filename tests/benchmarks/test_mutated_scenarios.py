"""A few mutated scenarios; `benchmarks/mutated_scenarios.py` tries ten thousand."""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path

import pytest

from swarmstart.benchmarks import mutated_scenarios
from swarmstart.benchmarks.mutated_scenarios import assay, judged, mutated, originals
from swarmstart.cases.format.scenario import shipped


@pytest.mark.parametrize(("kind", "count"), [("", 60), ("problem", 150)])
def test_each_runs_or_is_refused_in_sentences(
    tmp_path: Path, kind: str, count: int
) -> None:
    counted: Counter[str] = Counter()
    for number, text in enumerate(mutated(count, random.Random(3), kind)):
        assert not assay(text, tmp_path, counted=counted), number
    assert counted["resolved: 2"] > 20 and counted["resolved: 0"] > 10


def test_what_problems_are_mutated_from_is_valid(tmp_path: Path) -> None:
    counted: Counter[str] = Counter()
    for text in originals("problem"):
        assert not assay(text, tmp_path, counted=counted)
    assert counted == {"resolved: 0": len(originals("problem"))}


def test_a_valid_one_is_checked_and_run(tmp_path: Path) -> None:
    counted: Counter[str] = Counter()
    text = shipped()["passing_side"].read_text("utf-8")
    assert not assay(text, tmp_path, to_check=True, to_run=True, counted=counted)
    assert counted == {"checked: 0": 1, "run: 0": 1}


def test_what_is_wrong_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mutated_scenarios, "LIMIT_S", 1)

    def broken() -> tuple[int, str]:
        raise ZeroDivisionError("by nothing")

    def endless() -> tuple[int, str]:
        while True:
            pass

    assert judged(broken, (0,))[1] == "ZeroDivisionError: by nothing"
    assert judged(endless, (0,))[1] == "more than 1 s"
    assert judged(lambda: (1, "internal"), (0, 2))[1] == "exit code 1: internal"
    assert judged(lambda: (2, "\n"), (0, 2))[1] == "refused without a word"
    assert judged(lambda: (2, "expected"), (0, 2))[1] == ""
