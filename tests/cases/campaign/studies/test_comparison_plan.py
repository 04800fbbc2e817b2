"""Plans of comparisons in YAML."""

from pathlib import Path

import pytest

from swarmstart.cases.campaign.studies.comparison_plan import (
    chosen_of,
    is_plan,
    plan_in,
)
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.scenario import read_document
from swarmstart.cases.format.yaml_reader import read_yaml

PLAN = """\
schema: 1
compare:
  scenarios:
    - van_der_pol
    - {scenario: formation_v, of: flight, set: {steps: 5}}
    - own/mine.yaml
    - hard/walls_4
  solvers: ["lshade[size=60]+ipopt", ipopt]
  seeds: 30
  set: {lanes: 0}
"""
WRONG = """\
schema: 1
compare:
  scenarios: [{scenaro: formation_v}, 3]
  solver: ipopt
  seeds: 0
"""


def written(folder: Path, text: str) -> Path:
    file = folder / "plan.yaml"
    file.write_text(text)
    return file


def test_a_plan_is_told_from_a_scenario(tmp_path: Path) -> None:
    assert is_plan(read_yaml(str(written(tmp_path, PLAN))))
    assert not is_plan(read_document("van_der_pol"))


def test_settings_of_the_plan_come_before_a_scenarios_own_and_flags_last(
    tmp_path: Path,
) -> None:
    part = plan_in(read_yaml(str(written(tmp_path, PLAN))))
    first, second, third, fourth = chosen_of(part, ["steps=7"])
    assert (first.source, first.of) == ("van_der_pol", "auto")
    assert first.assignments == ("lanes=0", "steps=7")
    assert (second.of, second.assignments) == (
        "flight",
        ("lanes=0", "steps=5", "steps=7"),
    )
    assert third.source == str(tmp_path / "own" / "mine.yaml")
    assert fourth.source == "hard/walls_4"  # A name, although it has a slash.


def test_everything_wrong_is_said_at_once_with_its_place(tmp_path: Path) -> None:
    with pytest.raises(InvalidScenarioError) as caught:
        plan_in(read_yaml(str(written(tmp_path, WRONG))))
    said = str(caught.value)
    assert "expected the key 'scenario'" not in said  # It is there, misspelt.
    assert "found 'scenaro'; did you mean 'scenario'?" in said
    assert "plan.yaml:4:3: expected a known key, found 'solver'" in said
    assert "expected compare.seeds to be at least 1; found 0" in said
