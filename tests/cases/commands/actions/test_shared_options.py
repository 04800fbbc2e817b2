"""Conditions of --fail-on: every measure can be named; wrong ones are refused."""

from pathlib import Path

import pytest

from swarmstart.cases.commands.actions.shared_options import (
    InvalidConditionError,
    condition_of,
    met_conditions,
)
from swarmstart.cases.format.scenario import Resolved, read_document, resolve

SCENARIO = """\
kind: problem
states: {x: {start: 1, rate: u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: x**2 + u**2
prediction: {horizon_s: 2, intervals: 4}
measures: {Top_2: max(x)}
"""


@pytest.fixture
def resolved(tmp_path: Path) -> Resolved:
    file = tmp_path / "tiny.yaml"
    file.write_text(SCENARIO)
    return resolve(read_document(str(file)))


@pytest.mark.parametrize(
    "name", ["passing_side", "close_formation", "reconfiguration", "swap_5", "pendulum"]
)
def test_every_measure_of_a_scenario_can_be_named(name: str) -> None:
    shipped = resolve(read_document(name))
    for measure in shipped.kind.measures_of(shipped.scenario):
        assert condition_of(f"{measure}<=-1e-3", shipped) == (measure, "<=", -1e-3)
        assert condition_of(f"{measure} == null", shipped)[2] is None


def test_own_measures_may_have_capitals(resolved: Resolved) -> None:
    condition = condition_of("Top_2 > 1", resolved)
    assert condition == ("Top_2", ">", 1.0)
    assert met_conditions([condition], {"Top_2": 2.0}, resolved) == [
        "Top_2 = 2.0 > 1.0"
    ]
    assert met_conditions([condition], {"Top_2": 0.5}, resolved) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("cost", "expected --fail-on 'MEASURE RELATION NUMBER', found 'cost'"),
        ("cost = 3", "MEASURE RELATION NUMBER"),
        ("cost > 3 m", "MEASURE RELATION NUMBER"),
        ("cost > x", "found 'x' as the number"),
        ("cost > nan", "found 'nan' as the number"),
        ("cost > null", "expected == with null"),
        ("cst > 1", "did you mean 'cost'"),
        ("zzz > 1", "see swarmstart list measures"),
        ("x" * 5000, r"found 'x{40}\.\.\.'"),
        ("\x1b[2J > 1", r"found '\\x1b\[2J > 1'"),
    ],
)
def test_a_wrong_condition_is_refused(
    text: str, words: str, resolved: Resolved
) -> None:
    with pytest.raises(InvalidConditionError, match=words):
        condition_of(text, resolved)
