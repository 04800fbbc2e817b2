"""Constants of a file may stand in its lengths in seconds and in its tables."""

from typing import Any

import pytest

from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.kinds.problem.stated.constants import with_constants
from swarmstart.tests.cases.kinds.problem.conftest import scenario_of, stated

FILE = """
kind: problem
constants: {T: 3.0, half: T/2}
states:
  x: {start: 0, rate: u + w}
controls:
  u: {bounds: [-1, 1]}
signals:
  w: {times: [0, half, T], values: [0, 1/T, 0]}
stage_cost: u**2
prediction: {horizon_s: 2*half, intervals: 6}
feedback: {law: receding_horizon, ends_at_s: 2*T}
plant: {substeps: 6}
"""


def test_lengths_and_tables_are_those_with_the_constants_written_out() -> None:
    written = FILE.replace("2*half", "3.0").replace("2*T", "6.0")
    written = written.replace("[0, half, T]", "[0, 1.5, 3.0]").replace("1/T", "1/3.0")
    assert stated(FILE).settings == stated(written).settings
    assert scenario_of(FILE).steps == 12


def test_phases_have_their_own_constants() -> None:
    given = {
        "constants": {"T": 3.0},
        "phases": [{"horizon_s": "T"}, {"constants": {"T": "T/2"}, "horizon_s": "T"}],
    }
    first, second = with_constants(given)["phases"]
    assert (first["horizon_s"], second["horizon_s"]) == (3.0, 1.5)


def test_a_name_that_is_no_constant_is_refused_at_its_place() -> None:
    with pytest.raises(InvalidScenarioError, match="unknown name 'halve'"):
        stated(FILE.replace("2*half", "2*halve"))


@pytest.mark.parametrize(
    "given",
    [
        {"constants": [1], "prediction": {"horizon_s": "T"}},
        {"constants": {"T": "1/0"}, "prediction": {"horizon_s": "T"}},
        {"constants": {"T": float("nan")}, "prediction": {"horizon_s": "T"}},
        {"constants": {"T": 1}, "prediction": {"integrator": "T", "horizon_s": [None]}},
        {"constants": {1: 2}, "prediction": "T", "phases": {"horizon_s": {"free": 1}}},
    ],
)
def test_what_is_no_expression_stays_as_it_is(given: dict[str, Any]) -> None:
    assert with_constants(given) == given
