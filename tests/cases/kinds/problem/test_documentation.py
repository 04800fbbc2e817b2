"""Examples of docs/problem.md are valid and run; its reference has all keys."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml
from pydantic import BaseModel

import swarmstart
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.scenario import shipped
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario
from swarmstart.docs._extensions.scenario_keys import keys_page
from swarmstart.tests.cases.kinds.problem.conftest import simulated, stated

DOCS = Path(swarmstart.__file__).parent / "docs"
PAGE = (DOCS / "problem.md").read_text(encoding="utf-8")
REFERENCE = "reference/yaml/problem.md"
BLOCKS = re.findall(r"^```yaml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
(INCLUDED,) = re.findall(r"^```\{literalinclude\} (\S+)$", PAGE, re.MULTILINE)
LAST = (DOCS / INCLUDED).read_text(encoding="utf-8")
FIRST = BLOCKS[0]
FILES = [b if "kind: problem" in b else FIRST + b for b in [*BLOCKS, LAST]]
FROM_ELSEWHERE = {"kind", "name"}
"""Keys that a scenario needs and that the name of its file, or its kind, gives."""


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
    assert (DOCS / INCLUDED).resolve() == shipped()["two_drones"].resolve()


def test_the_keys_are_listed_in_the_reference_to_which_the_page_links() -> None:
    assert f"]({REFERENCE})" in PAGE and "| key |" not in PAGE
    made = "<!-- generated: keys of problem -->"
    assert made in (DOCS / REFERENCE).read_text(encoding="utf-8")


def test_the_reference_describes_every_key_with_its_default() -> None:
    page, seen = keys_page("problem"), 0
    parts: set[type[BaseModel]] = {*_parts(ProblemScenario, set())}
    for part in parts:
        rows = _rows(_section(page, part))
        for name, field in part.model_fields.items():
            key = field.alias or name
            default_cell, meaning = rows[key]
            assert meaning.endswith("."), (part, key)
            if field.is_required():
                is_said = "required" in (default_cell, *meaning.rstrip(".").split())
                assert is_said or "by default" in meaning or key in FROM_ELSEWHERE, key
            else:
                default = field.get_default(call_default_factory=True)
                assert _says(default_cell, meaning, default), (part, key)
            seen += 1
    assert "record" in page and seen > len(ProblemScenario.model_fields)


def test_the_reference_tells_expressions_from_numbers() -> None:
    page = keys_page("problem")
    for key in ("stage_cost", "algebraic.*.equation", "path[].expression"):
        assert re.search(
            rf"^\| `{re.escape(key)}` \| expression \|", page, re.MULTILINE
        )
    assert re.search(r"^\| `uncertain.level` \| number \|", page, re.MULTILINE)


def _says(cell: str, meaning: str, default: Any) -> bool:
    """Return whether a row says a default, in its cell or in its meaning."""
    if isinstance(default, BaseModel):
        default = default.model_dump(exclude_defaults=True)
    if cell == "those of its keys":
        return all(str(value) in meaning for value in default.values())
    if not cell:
        return not default
    return bool(_plain(yaml.safe_load(cell.strip("`"))) == _plain(default))


def _section(page: str, part: type[BaseModel]) -> str:
    """Return the section of a part, which an anchor with its name begins."""
    if part is ProblemScenario:
        return page.partition("\n(keys-of-")[0]
    name = part.__name__.lower().replace("_", "-")
    _, anchor, rest = page.partition(f"(keys-of-problem-{name})=\n")
    assert anchor, name
    return rest.partition("\n(keys-of-")[0]


def _rows(section: str) -> dict[str, tuple[str, str]]:
    """Return the default and the meaning of each key of a section."""
    rows = [
        [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        for line in section.splitlines()
        if line.startswith("| `")
    ]
    return {
        key.strip("`").rpartition(".")[2]: (default, meaning)
        for key, _, default, meaning in rows
    }


def _parts(kind: Any, seen: set[type[BaseModel]]) -> Iterator[type[BaseModel]]:
    """Yield the parts of which a type consists, at every depth."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if kind in seen:
            return
        seen.add(kind)
        yield kind
        for field in kind.model_fields.values():
            yield from _parts(field.annotation, seen)
    for one in get_args(kind):
        yield from _parts(one, seen)


def _plain(value: Any) -> Any:
    """Return a default in one form for texts and numbers."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return value
