"""Best known values: complete, by the schema, and invalid ones refused with places."""

import json
from pathlib import Path

import jsonschema
import pytest

from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.hard import SHIPPED
from swarmstart.cases.hard.best_known import FILE, best_known, best_known_schema


def test_every_shipped_problem_has_an_entry() -> None:
    assert best_known().keys() == {f"hard/{name}" for name in SHIPPED}


def test_the_file_is_valid_by_its_own_schema() -> None:
    schema = best_known_schema()
    jsonschema.Draft7Validator.check_schema(schema)
    jsonschema.validate(json.loads(FILE.read_text()), schema)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"known_by": "guess"}, "known_by to be 'exact', 'bound', 'runs' or"),
        ({"known_by": "exact", "cost": 1}, "known_by: exact; found no methods"),
        ({"known_by": "runs", "cost": 1}, "found no runs and no agreeing and no meth"),
        ({"known_by": "unknown", "cost": 1}, "expected no cost with known_by: unknown"),
        ({"known_by": "unknown", "seed": 1}, "expected a known key, found 'seed'"),
        ({"known_by": "unknown", "date": "May"}, "expected problems.hard/walls_2.date"),
    ],
)
def test_an_invalid_entry_is_refused_with_its_place(
    entry: dict[str, object], message: str, tmp_path: Path
) -> None:
    file = tmp_path / "mine.json"
    file.write_text(json.dumps({"schema": 1, "problems": {"hard/walls_2": entry}}))
    with pytest.raises(InvalidScenarioError) as refused:
        best_known(file)
    assert message in str(refused.value) and f"{file}:1:" in str(refused.value)


def test_an_unknown_problem_is_answered_by_the_nearest(tmp_path: Path) -> None:
    file = tmp_path / "mine.json"
    content = {"schema": 1, "problems": {"hard/wals_2": {"known_by": "unknown"}}}
    file.write_text(json.dumps(content))
    with pytest.raises(InvalidScenarioError, match="did you mean 'hard/walls_2'"):
        best_known(file)


def test_the_schema_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", "best_known"]) == 0
    assert json.loads(capsys.readouterr().out) == best_known_schema()
