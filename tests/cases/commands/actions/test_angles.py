"""Warnings about angles that look like degrees."""

import math
from pathlib import Path

import pytest

from swarmstart.cases.commands.actions.checking import angle_warnings
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.format.scenario import read_document, resolve, shipped


def test_numbers_and_lists_of_angles_are_judged_and_nothing_else() -> None:
    settings = {
        "uavs": [{"heading_rad": -90.0, "x_m": 90.0}],
        "bank_rad": [-math.pi, 45.0],
        "turn_rate_rad_s": 90.0,
        "heading_rad": 2 * math.pi,
    }
    said = angle_warnings(settings)
    assert [one.partition(" ")[0] for one in said] == [
        "uavs.0.heading_rad",
        "bank_rad.1",
    ]
    assert said[0].endswith(
        "; is it in degrees? radians(-90) (more: docs/messages.md#degrees)"
    )


@pytest.mark.parametrize("name", ["formation_v", "close_formation", "swap_5"])
def test_no_shipped_scenario_is_warned_of(name: str) -> None:
    assert angle_warnings(resolve(read_document(name)).settings) == []


def test_check_and_run_warn_on_standard_error(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = tmp_path / "turned.yaml"
    text = shipped()["formation_v"].read_text()
    file.write_text(text.replace("heading_rad: 0,", "heading_rad: 90,", 1))
    assert main(["check", str(file)]) == 0
    assert "_rad = 90 is more than a full turn; is it in" in capsys.readouterr().err
    words = ["run", "formation_v", "--set", "leader.heading_rad=90", "--print-config"]
    assert main(words) == 0
    assert "warning: leader.heading_rad = 90 is more than a" in capsys.readouterr().err
