from __future__ import annotations

import copy
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft7Validator

import swarmstart
from swarmstart.cases.format.overrides import overlay
from swarmstart.cases.format.parts import DIALECT, scenario_schema
from swarmstart.cases.format.registry import KINDS
from swarmstart.cases.format.scenario import read_document, shipped
from swarmstart.cases.format.yaml_reader import parse_yaml

SCHEMA = scenario_schema("formation_flight")
VALIDATOR = Draft7Validator(SCHEMA)


def merged(name: str, variant: str) -> Any:
    document = overlay(read_document(name), ("variants", variant))
    return copy.deepcopy(document.data)


def flaws(instance: Any) -> list[str]:
    return [error.message for error in VALIDATOR.iter_errors(instance)]


@pytest.mark.parametrize("kind", KINDS)
def test_the_schema_is_valid_draft_7(kind: str) -> None:
    schema = scenario_schema(kind)
    assert schema["$schema"] == DIALECT
    Draft7Validator.check_schema(schema)
    text = yaml.safe_dump(schema)
    assert "$defs" not in text and "discriminator" not in text


def properties(node: Any, place: str = "") -> Iterator[tuple[str, str, Any]]:
    """Yield the place, the key and the schema of every property at every depth."""
    if isinstance(node, dict):
        for key, found in node.get("properties", {}).items():
            yield place, key, found
    below = enumerate(node) if isinstance(node, list) else ()
    for key, found in node.items() if isinstance(node, dict) else below:
        yield from properties(found, f"{place}/{key}")


@pytest.mark.parametrize("kind", KINDS)
def test_every_property_is_described_by_a_sentence(kind: str) -> None:
    found = list(properties(scenario_schema(kind)))
    assert len(found) > len(SCHEMA["properties"])
    for place, key, schema in found:
        said = schema.get("description", "")
        at = f"{place}/{key}: {said!r}"
        assert said[:1].isupper() or said[:1] == '"', at
        assert said.endswith("."), at
        assert "\n" not in said and "Attributes:" not in said, at
        words = re.sub(r"\W", "", said).casefold()
        assert words != re.sub(r"[\W_]", "", key).casefold() and " " in said, at


@pytest.mark.parametrize("name", shipped())
def test_the_shipped_scenarios_fit_the_schema(name: str) -> None:
    data: Any = read_document(name).data
    validator = Draft7Validator(scenario_schema(data["kind"]))
    instances = [data, *(merged(name, v) for v in data.get("variants", {}))]
    for instance in instances:
        assert not [error.message for error in validator.iter_errors(instance)]


@pytest.mark.parametrize("path", [(), ("leader",), ("prediction",), ("uavs", 0)])
def test_a_misspelt_key_does_not_fit(path: tuple[str | int, ...]) -> None:
    scenario = merged("formation_v", "corrected")
    part = scenario
    for key in path:
        part = part[key]
    part["mispelt"] = 1
    assert any("mispelt" in flaw for flaw in flaws(scenario))


def test_numbers_may_be_expressions_and_whole_numbers_not() -> None:
    scenario = merged("formation_v", "corrected")
    scenario["prediction"]["horizon_s"] = "1/2"
    scenario["leader"]["heading_rad"] = "pi/4"
    assert not flaws(scenario)
    scenario["steps"] = "2 * 30"
    assert flaws(scenario) == ["'2 * 30' is not of type 'integer'"]


def test_a_range_is_a_list_of_two() -> None:
    scenario = merged("formation_v", "corrected")
    for wrong in ([1], [1, 2, 3], {"lower": 1, "upper": 2}, 3):
        scenario["vehicle"]["acceleration_m_s2"] = wrong
        assert flaws(scenario)


def test_documented_problems_and_mutated_ones_fit_the_schema() -> None:
    validator = Draft7Validator(scenario_schema("problem"))
    root = Path(swarmstart.__file__).parent
    page = (root / "docs" / "problem.md").read_text(encoding="utf-8")
    texts = re.findall(r"^```yaml\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    bases = sorted((root / "benchmarks" / "mutation_bases").glob("*.yaml"))
    texts += [path.read_text(encoding="utf-8") for path in bases]
    for text in texts:
        if "kind: problem" in text:
            data = parse_yaml(text.encode(), name="text").data
            assert not [error.message for error in validator.iter_errors(data)], text
