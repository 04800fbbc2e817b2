from __future__ import annotations

import copy
import math
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from swarmstart.cases import hard
from swarmstart.cases.format.document import UnreadableFileError, YamlError
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.parts import GridPart
from swarmstart.cases.format.scenario import (
    Resolved,
    UnknownScenarioError,
    read_document,
    resolve,
    resolved_again,
    shipped,
)
from swarmstart.cases.format.settings import PlanningScenario, planning
from swarmstart.cases.format.yaml_reader import parse_yaml
from swarmstart.cases.kinds.problem.stated.parts import Prediction
from swarmstart.cases.record.record import run_key

VARIANTS = ("literal", "corrected")


def variants_of(name: str) -> list[str | None]:
    data: Any = read_document(name).data
    return list(data.get("variants", {})) or [None]


def resolved(name: str = "formation_v", **how: Any) -> Resolved:
    return resolve(read_document(name), **how)


SEARCH = {  # the chapter's
    "formation_flight": "cpso",
    "close_formation": "de",
    "reconfiguration": "de",
}
EVERY = [(n, v) for n in shipped() for v in variants_of(n)]


@pytest.mark.parametrize(("name", "variant"), EVERY)
def test_every_shipped_scenario_is_valid_in_every_variant(
    name: str, variant: str | None
) -> None:
    scenario = resolved(name, variant=variant).scenario
    assert scenario.name == name
    if scenario.source.startswith("Chapter 5"):  # With the search of the text.
        assert scenario.polish_name == "none"
        assert scenario.search_name == SEARCH[scenario.kind]


@pytest.mark.parametrize(("name", "variant"), EVERY)
def test_settings_of_every_shipped_scenario_are_read_again(
    name: str, variant: str | None
) -> None:
    """By each run of a comparison, and from a record: they give every key."""
    one = resolved(name, variant=variant)
    again = resolved_again(one.settings, one.variant)
    assert again.settings == {**one.settings, "name": again.scenario.name}


def test_settings_of_every_hard_problem_are_read_again() -> None:
    """Among them those of vehicles that are planned jointly."""
    for file in sorted(Path(hard.__file__).parent.glob("problems/*.yaml")):
        one = resolved(str(file))
        assert resolved_again(one.settings, one.variant).scenario.kind == "problem"


def test_corrected_is_the_default_variant() -> None:
    assert resolved().variant == "corrected"
    assert resolved().settings == resolved(variant="corrected").settings


def test_a_variant_changes_what_it_names_and_nothing_else() -> None:
    literal, corrected = (resolved(variant=v).settings for v in VARIANTS)
    assert literal["vehicle"]["speed_m_s"] is None
    assert corrected["vehicle"]["speed_m_s"] == [1.0, 40.0]
    assert literal["vehicle"]["name"] == corrected["vehicle"]["name"]
    assert literal["search"]["velocity_max"] == corrected["search"]["velocity_max"]
    assert "variants" not in literal
    differ = {key for key in literal if literal[key] != corrected[key]}
    assert differ == {
        *("vehicle", "search", "prediction", "terminal_cost", "avoidance"),
        *("dual_mode", "last_plan"),
    }


def test_expressions_become_numbers() -> None:
    vehicle = resolved().settings["vehicle"]
    assert vehicle["turn_rate_rad_s"] == [-math.pi / 18, math.pi / 18]


def test_assignments_come_last_and_in_order() -> None:
    settings = resolved(
        variant="literal",
        assignments=[
            "steps=3",
            "steps=4",
            "dual_mode.enabled=true",
            "uavs.1.slot.x_m=9",
        ],
    ).settings
    assert settings["steps"] == 4
    assert settings["dual_mode"]["enabled"] is True
    assert settings["uavs"][1]["slot"]["x_m"] == 9.0


def test_another_search_comes_with_its_defaults_and_the_same_keeps_its_settings() -> (
    None
):
    assert resolved(search="cpso").settings == resolved().settings
    search = resolved(search="ga", assignments=["search.size=30"]).settings["search"]
    assert search == {
        **{"name": "ga", "warm_start": "none", "sampling": "uniform", "size": 30},
        "when": "needed",
        **{"crossover": 0.8, "mutation": None, "elitism": True},
    }


def test_the_order_of_the_keys_does_not_matter(tmp_path: Path) -> None:
    data = yaml.safe_load(shipped()["formation_v"].read_text(encoding="utf-8"))

    def turned(node: Any) -> Any:
        if isinstance(node, dict):
            return {key: turned(node[key]) for key in reversed(node)}
        return [turned(item) for item in node] if isinstance(node, list) else node

    file = tmp_path / "turned.yaml"
    file.write_text(yaml.safe_dump(turned(data), sort_keys=False), encoding="utf-8")
    one, other = resolved(), resolved(str(file))
    assert one.settings == other.settings
    assert run_key(one.settings, 0, "x") == run_key(other.settings, 0, "x")


def test_flaws_carry_their_places_in_the_order_of_the_file() -> None:
    text = shipped()["formation_v"].read_text(encoding="utf-8")
    text = text.replace("steps: 60", "steps: 0").replace(
        "horizon_s: 8 ", "horizon_s: none "
    )
    document = parse_yaml(text, name="mine.yaml")
    with pytest.raises(InvalidScenarioError) as caught:
        resolve(document)
    steps, dt = caught.value.flaws
    lines = text.splitlines()
    assert lines[steps.place.line - 1][steps.place.column - 1 :].startswith("0")
    assert lines[dt.place.line - 1][dt.place.column - 1 :].startswith("none")
    assert steps.place < dt.place and steps.place.name == "mine.yaml"
    assert str(caught.value) == f"{steps}\n{dt}"
    assert steps.frame.splitlines()[1].endswith("^")


def test_a_flaw_of_an_assignment_is_placed_there() -> None:
    with pytest.raises(InvalidScenarioError) as caught:
        resolved(assignments=["steps=many"])
    (flaw,) = caught.value.flaws
    assert str(flaw.place) == "--set steps" and "many" in flaw.frame


def test_no_value_is_shown_for_a_wrong_key_of_an_assignment() -> None:
    with pytest.raises(InvalidScenarioError, match="did you mean 'search'") as caught:
        resolved(assignments=["serch.name=ga"])
    (flaw,) = caught.value.flaws
    assert str(flaw.place) == "--set serch.name" and not flaw.frame


def test_a_scenario_without_variants_needs_none_and_has_none() -> None:
    text = yaml.safe_dump(dict(resolved().settings))
    document = parse_yaml(text, name="mine.yaml")
    assert resolve(document).variant == ""
    with pytest.raises(YamlError, match="expected a scenario with variants"):
        resolve(document, variant="literal")


def test_without_a_default_variant_one_must_be_named() -> None:
    document = parse_yaml("variants: {a: {}, b: {}}", name="mine.yaml")
    with pytest.raises(YamlError, match="--variant to be one of a, b; found none"):
        resolve(document)


def test_what_looks_like_a_path_is_one(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFileError, match="No such"):
        read_document(str(tmp_path / "missing.yaml"))
    with pytest.raises(UnknownScenarioError, match="did you mean formation_v"):
        read_document("formation")


def test_a_mistyped_file_is_answered_with_the_nearest_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "wedge.yaml").touch()
    question = r"found: No such file or directory; did you mean .*wedge\.yaml\?$"
    with pytest.raises(UnreadableFileError, match=question):
        read_document(str(tmp_path / "wegde.yaml"))
    with pytest.raises(UnreadableFileError, match=r"directory$"):
        read_document(str(tmp_path / "other.yaml"))
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnknownScenarioError, match=r"mean wedge\.yaml\? \d+ scenar"):
        read_document("wedgee")


def test_every_claim_of_a_shipped_scenario_says_where_it_is_made() -> None:
    for name in shipped():
        claims = resolved(name).scenario.claims
        assert len({claim.id for claim in claims}) == len(claims)
        assert all(claim.source and claim.text for claim in claims)


def test_a_claim_is_of_flights_as_long_as_the_file_says() -> None:
    """Except a claim whose `when` names other steps."""

    def wanted(*assignments: str) -> dict[str, int]:
        scenario = resolved("reconfiguration", assignments=assignments).scenario
        return {claim.id: claim.when["steps"] for claim in scenario.claims}

    longer = wanted("steps=7")
    assert longer == wanted()
    assert (longer["21"], longer["22"]) == (4, 10)
    assert wanted("claims.2.when={steps: 9}", "steps=7")["21"] == 9


@pytest.mark.parametrize(
    ("name", "old", "said"),
    [
        (
            "reconfiguration",
            "prediction.dt_s=1",
            "expected prediction.horizon_s (dt_s times intervals), found dt_s",
        ),
        (
            "close_formation",
            "integrator=euler",
            "expected prediction.integrator, found integrator",
        ),
        (
            "reconfiguration",
            "search.bounds=clip",
            "expected search.bound_handling, found bounds",
        ),
        (
            "reconfiguration",
            "claims.0.when={search.bounds: clip}",
            "expected search.bound_handling, found 'search.bounds'",
        ),
    ],
)
def test_old_keys_are_refused_with_the_new(name: str, old: str, said: str) -> None:
    with pytest.raises(InvalidScenarioError, match=re.escape(said)):
        resolve(read_document(name), assignments=[old])


def test_a_key_that_is_not_missed_is_not_said_to_be_missing() -> None:
    text = shipped()["passing_side"].read_text(encoding="utf-8")
    text = text.replace("  horizon_s: 8", "  dt_s: 1")
    with pytest.raises(InvalidScenarioError) as caught:
        resolve(parse_yaml(text, name="mine.yaml"))
    (flaw,) = caught.value.flaws
    assert "expected prediction.horizon_s" in str(flaw)


def test_a_claim_under_a_key_that_is_no_more_is_refused_with_the_new() -> None:
    text = shipped()["close_formation"].read_text(encoding="utf-8")
    text = text.replace("{prediction.integrator: euler}", "{integrator: euler}")
    with pytest.raises(InvalidScenarioError, match=r"expected prediction\.integrator"):
        resolve(parse_yaml(text, name="mine.yaml"))


@pytest.mark.parametrize("name", shipped())
def test_every_kind_that_plans_has_the_keys_of_the_grid(name: str) -> None:
    scenario = resolved(name).scenario
    if not isinstance(scenario, PlanningScenario):
        assert scenario.way()
        return
    prediction = vars(scenario)["prediction"]
    assert {"horizon_s", "intervals", "substeps"} <= prediction.model_dump().keys()
    if not isinstance(prediction, GridPart):
        assert isinstance(prediction, Prediction)
        return
    assert prediction.grid()["horizon"] == prediction.horizon_s
    assert prediction.dt == prediction.horizon_s / prediction.intervals


CHAPTER = (
    "formation_v",
    "formation_obstacle",
    "reconfiguration",
    "reconfiguration_reverse",
    "close_formation",
    "close_formation_fast",
    "close_formation_vortex",
)


@pytest.mark.parametrize("name", CHAPTER)
def test_the_chapters_searches_search_at_every_step_whatever_the_polish(
    name: str,
) -> None:
    """Another search comes with the library's default."""
    for search, when in ((None, "always"), ("default", "undecided")):
        scenario = resolve(read_document(name), search=search, polish="ipopt").scenario
        settings = scenario.search_settings()
        assert settings is not None and settings.when == when


def test_settings_of_an_older_record_that_do_not_say_when_are_read() -> None:
    settings = copy.deepcopy(dict(resolved().settings))
    del settings["search"]["when"]
    again = resolved_again(settings, "corrected").scenario
    assert planning(again).search.when == "needed"


@pytest.mark.parametrize("old", ["schema", "steps", "kind"])
def test_a_misspelt_required_key_gives_one_error(old: str) -> None:
    text = shipped()["formation_v"].read_text().replace(f"\n{old}:", f"\n{old}s:", 1)
    assert f"{old}s:" in text
    with pytest.raises(InvalidScenarioError) as caught:
        resolve(parse_yaml(text, name="f.yaml"))
    (flaw,) = caught.value.flaws
    assert flaw.what.endswith(f"did you mean {old!r}?")
