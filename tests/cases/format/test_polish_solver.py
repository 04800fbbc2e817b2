"""Another NLP solver as the polish, by the same words in a file and on the command."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.format.scenario import (
    InvalidScenarioError,
    read_document,
    resolve,
)
from swarmstart.ocp import NlpOptions


@pytest.mark.parametrize(
    "words",
    [
        ["--polish", "sqpmethod"],
        ["--set", "polish={solver: sqpmethod, options: {max_iter: 40}}"],
    ],
)
def test_a_run_is_polished_by_the_solver_that_is_named(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    run = ["run", "double_integrator", "--no-figures", "--json", "--out", str(out)]
    assert main([*run, *words]) == 0
    assert json.loads(capsys.readouterr().out)["polish"] == "sqpmethod"
    record = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert record["polish"] == "sqpmethod"
    assert record["measures"]["cost"] == pytest.approx(12.0301, rel=1e-5)  # IPOPT's
    assert main(["run", str(out / "scenario.yaml"), "--quiet", "--no-figures",
                 "--out", str(tmp_path / "again")]) == 0  # fmt: skip


def test_the_options_reach_the_solver() -> None:
    text = "polish={solver: sqpmethod, options: {max_iter: 7}}"
    scenario = resolve(read_document("formation_v"), assignments=[text]).scenario
    assert scenario.polish_options() == NlpOptions(
        plugin="sqpmethod", options={"max_iter": 7}
    )
    assert scenario.polish_name == "sqpmethod"


@pytest.mark.parametrize(
    ("polish", "message"),
    [
        (
            "{solver: fatrop}",
            "a solver other than fatrop, which needs the stage struct",
        ),
        ("{solver: ipopt}", "expected polish: ipopt, with its options under ipopt"),
        ("{solver: unheard}", "an NLP solver of CasADi that is installed"),
        ("{solver: ../evil}", "expected polish.solver to be text that matches"),
        ("{solver: sqpmethod, options: {jit: true}}", "nor runs a program, found jit"),
        ("{solver: sqpmethod, options: {qpsol: ../x}}", "nor runs a program, found qp"),
        ("{solver: sqpmethod, options: {max_itr: 3}}", "sqpmethod must take its opti"),
    ],
)
def test_a_solver_that_is_no_polish_is_refused(polish: str, message: str) -> None:
    with pytest.raises(InvalidScenarioError, match=message):
        resolve(read_document("double_integrator"), assignments=[f"polish={polish}"])
