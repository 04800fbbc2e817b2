"""`run` in this process: exit codes."""

from pathlib import Path

import pytest

from swarmstart.cases.campaign.running.finished_run import key_of
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.commands.terminal import INFEASIBLE
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.record.partial import load_partial

DIVERGES = """\
kind: problem
states: {x: {start: 1, rate: u}}
controls: {u: {bounds: [-1, 1]}}
plant: {disturbance: {x: "exp(400*max(time - 1, 0))**2"}}
stage_cost: x**2
prediction: {horizon_s: 2, intervals: 2}
feedback: receding_horizon
steps: 9
search: {name: none}
"""


def test_a_plant_that_diverges_is_no_invalid_input_and_finished_steps_are_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The disturbance overflows from 1.9 s on: in the second step."""
    file, folder = tmp_path / "diverges.yaml", tmp_path / "run"
    file.write_text(DIVERGES)
    assert main(["run", str(file), "--out", str(folder), "-q"]) == INFEASIBLE
    assert "left the finite numbers in step 1, at 1 s" in capsys.readouterr().err
    kept = load_partial(folder, key_of(resolve(read_document(str(file))), 0), 20)
    assert kept is not None
    assert len(kept[0]) == 1


PLAN = """\
kind: problem
states: {x: {start: 1, rate: u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: x**2 + u**2
prediction: {horizon_s: 2, intervals: 4}
search: {name: none}
lanes: 0
"""


def test_figures_are_drawn_in_the_formats_asked_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, folder = tmp_path / "plan.yaml", tmp_path / "run"
    file.write_text(PLAN)
    words = ["run", str(file), "-q", "--format", "svg", "--format", "svg"]
    assert main([*words, "--out", str(folder)]) == 0
    endings = {drawn.suffix for drawn in (folder / "figures").iterdir()}
    assert endings == {".svg"}
    sheet = folder / "figures" / "a_sheet.svg"
    assert f"Picture: {sheet}" in capsys.readouterr().out


def test_the_path_of_an_animation_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tiny = ["--set", "steps=1", "--set", "budget.evaluations=40"]
    words = ["run", "formation_v", "-q", "--no-figures", "--animation", "gif", *tiny]
    assert main([*words, "--out", str(tmp_path)]) in {0, INFEASIBLE}
    file = tmp_path / "figures" / "flight.gif"
    assert f"\nAnimation: {file}\nRecord: " in capsys.readouterr().out
    assert file.exists()
