"""Examples of docs/problem.md are valid and run; it lists all keys and defaults."""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_args, get_origin

import pytest
import yaml
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

import swarmstart
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.scenario import shipped
from swarmstart.cases.format.settings import PlanningScenario
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.cases.kinds.problem.stated.values import Table
from swarmstart.tests.cases.kinds.problem.conftest import simulated, stated

ROOT = Path(swarmstart.__file__).parent
PAGE = (ROOT / "docs" / "problem.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```yaml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
FIRST = BLOCKS[0]
FILES = [b if "kind: problem" in b else FIRST + b for b in BLOCKS]
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in PAGE.partition("## Keys")[2].partition("\n## ")[0].splitlines()
    if line.startswith("| `")
]
MENTIONED = {"schema", "order", "ipopt", "basins", "backend", "claims"}
"""Keys that docs/scenario.md describes."""


@pytest.mark.parametrize("text", FILES)
def test_a_documented_problem_runs(text: str) -> None:
    path, found = simulated(text)
    assert found["infeasible_steps"] == 0
    measures = stated(text).scenario.model_dump()["measures"]
    assert all(found[name] is not None for name in measures)
    assert len(path.decisions) == stated(text).scenario.steps


def test_the_numbers_that_are_shown_come_out() -> None:
    assert simulated(FIRST)[1]["cost"] == pytest.approx(36.7126, abs=1e-4)
    (rocket,) = [text for text in FILES if "name: second" in text]
    _, found = simulated(rocket)
    for name in ("duration_first", "duration_second"):
        (shown,) = re.findall(rf"^ +{name} +([0-9.]+)$", PAGE, re.MULTILINE)
        assert found[name] == pytest.approx(float(shown), rel=1e-4)
    _, found = simulated(FILES[-1])
    for name in ("settled", "nearest", "clear_of_mast", "effort"):
        (shown,) = re.findall(rf"^ +{name} +([0-9.]+)$", PAGE, re.MULTILINE)
        assert found[name] == pytest.approx(float(shown), rel=1e-3)


def test_the_error_that_is_shown_is_said() -> None:
    with pytest.raises(InvalidScenarioError) as caught:
        stated(FIRST.replace("sin(angle)", "sin(angel)"))
    assert str(caught.value).replace("stated", "swing_up") in PAGE


def test_the_second_example_is_the_one_that_is_shipped() -> None:
    assert BLOCKS[-1] == shipped()["two_drones"].read_text(encoding="utf-8")


def test_every_key_is_in_the_table_with_its_default() -> None:
    listed = dict(_listed())
    keys = dict(_keys(ProblemScenario, ""))
    missing = keys.keys() - listed.keys() - MENTIONED
    assert not missing
    for key, default in keys.items():
        cell = listed.get(key, "")
        if default is PydanticUndefined:
            assert not cell.startswith("`"), key
        elif cell.startswith("`") and not isinstance(default, BaseModel):
            assert _plain(yaml.safe_load(cell.strip("`"))) == _plain(default), key


def _listed() -> Iterator[tuple[str, str]]:
    """Yield each key of the table with the text of its default."""
    for key, default, *_ in ROWS:
        keys, defaults = re.findall(r"`([^`]+)`", key), default.split(", ")
        if len(defaults) != len(keys):
            defaults = [default] * len(keys)
        yield from zip(keys, defaults, strict=True)


def _keys(model: type[BaseModel], place: str) -> Iterator[tuple[str, Any]]:
    """Yield the keys of a part and of those in it, with their defaults."""
    for name, field in model.model_fields.items():
        key = f"{place}{field.alias or name}"
        default = field.get_default(call_default_factory=True)
        yield key, default
        if place == "" and (
            name in PlanningScenario.model_fields or name == "terminal"
        ):
            continue
        if place == "phases[]." and name in ProblemScenario.model_fields:
            continue  # As of the file.
        for part, mark in _parts(field.annotation, ""):
            yield from _keys(part, f"{key}{mark}.")


def _parts(kind: Any, mark: str) -> Iterator[tuple[type[BaseModel], str]]:
    """Yield the parts that a type consists of, [] after a list and .* after names."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if kind is not Table:
            yield kind, mark
        return
    mark += {list: "[]", Mapping: ".*"}.get(get_origin(kind), "")
    for one in get_args(kind):
        yield from _parts(one, mark)


def _plain(value: Any) -> Any:
    """Return a default in one form for texts and numbers."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return value
