"""`check`: every variant is looked at, and what they share is said once."""

import argparse
from importlib.resources import files
from pathlib import Path

import pytest

from swarmstart.cases.commands.actions.checking import (
    angle_warnings,
    check,
    check_command,
)
from swarmstart.cases.format.flaws import InvalidScenarioError

V = (files("swarmstart.cases") / "scenarios" / "formation_v.yaml").read_text()


def flaws(tmp_path: Path, old: str, new: str) -> list[str]:
    assert V.count(old) == 1
    path = tmp_path / "changed.yaml"
    path.write_text(V.replace(old, new))
    with pytest.raises(InvalidScenarioError) as told:
        check(str(path))
    return [flaw.what for flaw in told.value.flaws]


def test_valid_scenario_is_named_with_its_variants() -> None:
    assert check("formation_v").endswith(": valid (literal, corrected)")
    assert check("passing_side").endswith(": valid")


def test_flaw_of_both_variants_is_told_once(tmp_path: Path) -> None:
    (told,) = flaws(tmp_path, "\nsteps: 60 ", "\nsteps: -60 ")
    assert "-60" in told


@pytest.mark.parametrize("variant", ["literal", "corrected"])
def test_flaw_of_either_variant_is_found(tmp_path: Path, variant: str) -> None:
    (told,) = flaws(tmp_path, f"\n  {variant}:\n", f"\n  {variant}:\n    steps: -7\n")
    assert "-7" in told


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize(
    ("angle", "is_doubtful"),
    [(0.5, False), (6.0, False), (6.5, True), (7.0, True), (7.25, False), (90.0, True)],
)
def test_an_angle_of_more_than_a_turn_in_halves_may_be_in_degrees(
    angle: float, is_doubtful: bool, sign: int
) -> None:
    settings = {"heading_rad": sign * angle, "speed": 90.0}
    assert len(angle_warnings(settings)) == is_doubtful


def test_angle_is_told_with_its_place_and_only_below_an_angles_key() -> None:
    settings = {
        "uavs": [{"heading_rad": 1.0}, {"heading_rad": 90, "x_m": 90.0}],
        "limits_rad": [-45.5, 0.5, True],
        "turn_rad": {"width": 90.0, "end_rad": -8.0},
    }
    assert [text.split(" is more")[0] for text in angle_warnings(settings)] == [
        "uavs.1.heading_rad = 90",
        "limits_rad.0 = -45.5",
        "turn_rad.end_rad = -8",
    ]


def test_exit_code_of_several_files_is_the_worst_of_theirs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """2 for an invalid file, 5 for one that cannot be read."""
    invalid = tmp_path / "invalid.yaml"
    invalid.write_text("schema: 1\n")
    missing = tmp_path / "missing.yaml"
    cases: tuple[tuple[list[Path | str], int], ...] = (
        (["passing_side"], 0),
        ([invalid, "passing_side"], 2),
        ([invalid, missing], 5),
        ([missing, invalid, "passing_side"], 5),
    )
    for names, code in cases:
        options = argparse.Namespace(scenarios=[str(name) for name in names])
        assert check_command(options) == code
        assert capsys.readouterr().out.count(": valid") == names.count("passing_side")


def test_units_that_contradict_each_other_are_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = (
        files("swarmstart.cases") / "scenarios" / "double_integrator.yaml"
    ).read_text()
    path = tmp_path / "pushed.yaml"
    for text, words in (
        (good, ""),
        (
            good.replace("unit: m/s^2", "unit: N"),
            "the rate of speed is in N, expected (m/s)/s: speed is in m/s",
        ),
    ):
        path.write_text(text)
        assert check(str(path)).endswith("valid")
        told = capsys.readouterr().err
        assert words in told and bool(words) == ("warning" in told)


JUMP = """\
kind: problem
signals: {low: {times: [0, 1.5], values: [2, 0], between: hold}}
states: {x: {start: START, rate: u, bounds: [low, null]}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: u**2
prediction: {horizon_s: 4, intervals: 4}
"""


@pytest.mark.parametrize(("start", "outside"), [("2", False), ("1", True)])
def test_jumps_between_checks_and_a_start_outside_a_limit_are_warned_of(
    start: str, outside: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "jump.yaml"
    path.write_text(JUMP.replace("START", start))
    assert check(str(path)).endswith("valid")
    told = capsys.readouterr().err
    assert (
        "low jumps or bends between 1 s and 2 s, where plans take it as linear" in told
    )
    said = "the start is outside: 'moving bounds of the states' is broken by 1 "
    assert (said in told) is outside
    assert told.count("warning") == 1 + outside
