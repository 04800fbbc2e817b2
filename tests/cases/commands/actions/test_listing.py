"""`list`: an overview, topics, filters; the same as JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from swarmstart.cases.commands.actions.listing import (
    RUN_TIMES_S,
    Asked,
    NothingListedError,
    listing,
    scenario_entry,
)
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.commands.front.options import TOPICS
from swarmstart.cases.format.scenario import hard_problems, shipped
from swarmstart.cases.format.yaml_reader import parse_yaml


def said(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(["list", *words]) == 0
    return capsys.readouterr().out


def test_without_a_topic_it_is_an_overview_of_commands(
    capsys: pytest.CaptureFixture[str],
) -> None:
    told = said(capsys)
    assert all(f"swarmstart list {topic}" in told for topic in TOPICS)
    assert [*listing(Asked("", ""))] == [*TOPICS]
    assert f"{len(shipped())} scenarios" in told and len(told.splitlines()) < 12


def test_every_line_fits_80_columns(capsys: pytest.CaptureFixture[str]) -> None:
    for words in ([], ["scenarios"], ["measures"], ["kinds"], ["searches"]):
        told = said(capsys, *words)
        assert max(map(len, told.splitlines())) <= 80, words


@pytest.mark.parametrize("name", [*shipped()])
def test_what_is_found_in_the_text_of_a_scenario_is_what_a_parser_finds(
    name: str,
) -> None:
    file = shipped()[name]
    entry, data = scenario_entry(file), parse_yaml(file.read_bytes(), name=name).data
    variants = data.get("variants")
    assert entry["title"] == data["title"] and entry["kind"] == data["kind"]
    assert entry["variants"] == ([*variants] if isinstance(variants, dict) else [])


def test_scenarios_are_filtered_by_kind_and_by_a_part_of_a_name(
    capsys: pytest.CaptureFixture[str],
) -> None:
    told = said(capsys, "scenarios", "--kind", "transfer")
    assert "  swap_5 " in told and "pendulum" not in told
    assert "  pendulum_on_cart " in said(capsys, "scenarios", "pendulum")
    found = json.loads(said(capsys, "scenarios", "pend", "--kind", "problem", "--json"))
    assert {"pendulum", "pendulum_on_cart"} <= found["scenarios"].keys()
    entry = found["scenarios"]["pendulum"]
    assert entry.keys() == {"title", "kind", "variants", "run_time_s"}


def test_hard_problems_are_listed_by_their_option_only(
    capsys: pytest.CaptureFixture[str],
) -> None:
    found = json.loads(said(capsys, "scenarios", "--hard", "--json"))["scenarios"]
    assert found.keys() == hard_problems().keys()
    assert all(one["title"] and one["kind"] == "problem" for one in found.values())
    told = said(capsys, "--hard")
    assert "  hard/gears_8 " in told and " (exact) " in told
    assert max(map(len, told.splitlines())) <= 80
    assert "hard/" not in said(capsys, "scenarios")
    assert [*listing(Asked("scenarios", "walls_4", hard=True))["scenarios"]] == [
        "hard/walls_4"
    ]


def test_measures_of_a_scenario_begin_with_its_own(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    told = said(capsys, "measures", "pendulum").splitlines()
    assert told[0] == "measures of pendulum" and told[1].split()[0] == "final_angle"
    file = tmp_path / "mine.yaml"
    file.write_text("kind: problem\nmeasures: {far_m: max(x)}\n")
    found = json.loads(said(capsys, "measures", str(file), "--json"))["measures"]
    assert found[str(file)]["far_m"] == {"unit": "m", "meaning": "max(x)"}
    assert "cost" in found[str(file)]


def test_measures_of_a_kind_have_units() -> None:
    measures = listing(Asked("measures", "formation_flight"))["measures"]
    assert [*measures] == ["formation_flight"]
    assert measures["formation_flight"]["min_distance_m"]["unit"] == "m"
    assert measures["formation_flight"]["step_seconds_max"]["unit"] == "s"
    assert not measures["formation_flight"]["step_seconds_max"]["meaning"].endswith("]")


@pytest.mark.parametrize(
    ("asked", "hint"),
    [
        (Asked("", "pendulim"), "did you mean 'pendulum'?"),
        (Asked("scenarios", "zzz"), "the list of scenarios contains, found 'zzz'; see"),
        (Asked("scenarios", "zzz", "problem"), "of kind problem contains"),
        (Asked("", "\x1b[2J" + "x" * 5000), r"found '\\x1b\[2Jxxx"),
    ],
)
def test_a_text_that_nothing_contains_is_answered_by_a_hint(
    asked: Asked, hint: str
) -> None:
    with pytest.raises(NothingListedError, match=hint.replace("?", r"\?")):
        listing(asked)


def test_every_scenario_has_a_run_time() -> None:
    assert RUN_TIMES_S.keys() == shipped().keys()
    assert all(0 < seconds < 3600 for seconds in RUN_TIMES_S.values())
