"""Seeds in which a claim fails: named, with the value and a command to see one."""

from __future__ import annotations

from pathlib import Path

from swarmstart.cases.campaign.engine.cells import Outcome
from swarmstart.cases.commands.actions.seeds import failing_lines, words_of_one
from swarmstart.cases.format.scenario import read_document, resolve

CLAIMED = """\
kind: problem
states: {x: {start: 1, rate: u, unit: m}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: x**2
prediction: {horizon_s: 1, intervals: 2}
search: {name: none}
polish: ipopt
claims:
  - {id: "2", text: T, source: S, measure: cost, relation: "<=", bound: 3}
"""


def outcome(cost: float | None, *, holds: bool | None) -> Outcome:
    result = {"measures": {"cost": cost}, "claims": [{"holds": holds}]}
    return Outcome(result=result, failure="", seconds=1.0, folder=Path("f"))


def test_each_failing_seed_is_named_with_its_value_and_a_command(
    tmp_path: Path,
) -> None:
    file = tmp_path / "a.yaml"
    file.write_text(CLAIMED)
    resolved = resolve(read_document(str(file)))
    failed = Outcome(result=None, failure="no", seconds=1.0, folder=Path("f"))
    outcomes = [outcome(2.0, holds=True), failed, outcome(4.25, holds=False)]
    words = ["run", "a.yaml", "--seeds", "3", "--search", "ga"]
    assert failing_lines(resolved, outcomes, words) == [
        "Claim 2 fails in seed 2 (4.25); see it: "
        "swarmstart run a.yaml --search ga --seed 2"
    ]
    assert failing_lines(resolved, outcomes[:2], words) == []


def test_many_failing_seeds_are_counted(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text(CLAIMED)
    resolved = resolve(read_document(str(file)))
    outcomes = [outcome(None, holds=False) for _ in range(7)]
    said = failing_lines(resolved, outcomes, ["run", "a.yaml"])[0]
    assert "seed 0 (undefined), " in said and "seed 4 (undefined) and 2 more;" in said


def test_options_of_many_runs_are_left_out_of_the_command_for_one() -> None:
    words = ["run", "a", "--seeds=9", "--workers", "2", "-q", "--set", "steps=3"]
    assert words_of_one(words, 4) == ["run", "a", "--set", "steps=3", "--seed", "4"]
