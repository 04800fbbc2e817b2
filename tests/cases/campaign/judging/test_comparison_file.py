"""A comparison is read again; other files are refused in one message."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import pytest

from swarmstart.benchmarks.false_claims import made_up
from swarmstart.cases.campaign.judging.content import read_comparison
from swarmstart.cases.record.files import RecordError, write_json

CONTENT = made_up({"s": {"de": [1.0, 2.0], "ipopt": [3.0]}}, resamples=20)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    file = tmp_path / "comparison.json"
    write_json(file, CONTENT)
    assert read_comparison(file) == read_comparison(tmp_path) == CONTENT


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("", "a file that is not JSON"),
        ("{", "a file that is not JSON"),
        ("[" * 100_000, "a file that is not JSON"),
        ('{"record": NaN}', "a file that is not JSON"),
        ("[1]", "other JSON"),
        ('"text"', "other JSON"),
        ('{"record": "run"}', "other JSON"),
        ('{"record": "comparison", "schema": 1}', "found schema 1"),
        ('{"record": "comparison", "schema": 2}', "found no headline"),
    ],
)
def test_another_file_is_refused(text: str, found: str, tmp_path: Path) -> None:
    file = tmp_path / "comparison.json"
    file.write_text(text)
    with pytest.raises(RecordError, match=found) as error:
        read_comparison(file)
    assert "expected a comparison of schema 2" in str(error.value)
    assert str(file) in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("path", "value", "found"),
    [
        (["scenarios"], None, "scenarios = null instead of a list"),
        (["scenarios", 0], 3, r"scenarios\[0\] = 3 instead of a mapping"),
        (["scenarios", 0, "rows", 0, "costs", 1], "1", r"costs\[1\] = .1. instead"),
        (["scenarios", 0, "rows", 0, "costs", 1], True, r"costs\[1\] = true instead"),
        (["scenarios", 0, "rows", 0, "costs"], [1.0], "2 runs and 1 costs of \"de\""),
        (["scenarios", 0, "rows", 0, "near"], [1], "of \"de\" on \"s\" instead of 2"),
        (["scenarios", 0, "rows", 0, "runs"], -1, "runs = -1 instead of a count"),
        (["scenarios", 0, "best_cost"], 10**400, "best_cost = 1000"),
        (["near"], [0.01], "1 distances in near"),
        (["seeds"], [0.5], r"seeds\[0\] = 0.5 instead of a count"),
        (["seeds"], [], "2 runs and 2 costs of \"de\" on \"s\" instead of 0"),
        (["is_noisy"], 0, "is_noisy = 0 instead of true or false"),
        (["headline"], None, "headline = null instead of a text"),
    ],
)  # fmt: skip
def test_damage_is_named_with_its_place(
    path: list[Any], value: Any, found: str, tmp_path: Path
) -> None:
    content = copy.deepcopy(CONTENT)
    place: Any = content
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    (tmp_path / "comparison.json").write_text(json.dumps(content))
    with pytest.raises(RecordError, match=found) as error:
        read_comparison(tmp_path)
    assert len(str(error.value)) < 300 + len(str(tmp_path))


def test_a_missing_file_and_a_name_that_is_none_are_told(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="No such file"):
        read_comparison(tmp_path / "none.json")
    with pytest.raises(RecordError, match="expected a comparison"):
        read_comparison(tmp_path / "a\0b")
    (tmp_path / "comparison.json").write_bytes(b"\xff\xfe")
    with pytest.raises(RecordError, match="a file that is not JSON"):
        read_comparison(tmp_path)
