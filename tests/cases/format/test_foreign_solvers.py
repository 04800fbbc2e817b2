"""Files are data: no option of a solver in them loads, writes or runs anything."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.foreign_solvers import reaches_beyond
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.format.settings import planning

BEYOND = {
    "hsllib": "/tmp/evil.so", "HSLlib": "evil.so", "pardisolib": "x", "jit": True,
    "output_file": "out.txt", "option_file_name": "x", "compiler": "shell",
    "linear_solver": "../../tmp/evil", "mu_strategy": "a\\b",
}  # fmt: skip


@pytest.mark.parametrize(
    "scenario",
    ["pendulum", "formation_v", "close_formation", "reconfiguration", "swap_5"],
)
def test_no_kind_of_scenario_takes_an_option_that_reaches_beyond(
    scenario: str, tmp_path: Path
) -> None:
    file = tmp_path / "written.txt"
    text = f"ipopt.options={{output_file: {file}}}"
    with pytest.raises(InvalidScenarioError, match="neither names a file nor runs a"):
        resolve(read_document(scenario), assignments=[text])
    assert not file.exists()


@pytest.mark.parametrize(("name", "value"), BEYOND.items())
def test_each_such_option_is_refused_where_it_stands(name: str, value: object) -> None:
    assert reaches_beyond(name, value) and reaches_beyond(f"ipopt.{name}", value)
    text = f"ipopt.options={{mu_init: 0.1, {name}: '{value}'}}"
    with pytest.raises(InvalidScenarioError, match=f"a program, found {name}"):
        resolve(read_document("pendulum"), assignments=[text])


def test_options_of_the_solve_itself_are_taken() -> None:
    text = "ipopt.options={mu_strategy: adaptive, linear_solver: mumps, mu_init: 0.01}"
    resolved = resolve(read_document("pendulum"), assignments=[text])
    assert planning(resolved.scenario).ipopt.options["mu_init"] == 0.01
