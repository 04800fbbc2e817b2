"""Another NLP solver as the polish, by the same words in a file and on the command."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from swarmstart.cases.campaign.trials.solver_names import solver_of
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.ocp import InvalidProblemError, NlpOptions


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


@pytest.mark.parametrize("solver", ["feasiblesqpmethod", "qrsqp"])
def test_a_start_that_breaks_limits_ends_a_polish_with_a_status(
    solver: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The first QP of CasADi's SQP then has an empty region: an error by default."""
    out = ["--set", "steps=1", "--no-figures", "--quiet", "--out", str(tmp_path / "o")]
    assert main(["run", "formation_v", *out, "--polish", solver]) in (0, 4)
    said = capfd.readouterr()
    assert "could not be run" not in said.err and "IPOPT" not in said.out


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


@pytest.mark.parametrize(
    "words",
    [
        ["run", "double_integrator", "--polish", "sqpmethod"],
        ["run", "double_integrator", "--polish", "absent"],
        ["compare", "double_integrator", "--solvers", "sqpmethod", "--seeds", "1"],
    ],
)
def test_no_solver_is_looked_for_where_others_could_have_left_native_code(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    solver_of("sqpmethod")  # It was fine in the folder of before.
    # CasADi would load it from here, since its own needs a library that is absent.
    (tmp_path / "libcasadi_linsol_ma27.so").touch()
    monkeypatch.chdir(tmp_path)
    assert main([*words, "--out", "run"]) == 2
    assert "expected no files libcasadi_* in the present folder" in (
        capsys.readouterr().err
    )


def test_ipopt_alone_looks_nowhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "libcasadi_nlpsol_ipopt.so").touch()
    monkeypatch.chdir(tmp_path)
    assert main(["run", "double_integrator", "--no-figures", "--polish", "ipopt"]) == 0


def test_a_folder_that_cannot_be_listed_is_not_trusted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def forbidden(*_: object) -> list[str]:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.listdir", forbidden)
    with pytest.raises(InvalidProblemError, match="work in another folder"):
        NlpOptions(plugin="sqpmethod")
