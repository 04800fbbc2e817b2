"""`check`: every variant is looked at, and what they share is said once."""

from importlib.resources import files
from pathlib import Path

import pytest

from swarmstart.cases.commands.actions.checking import angle_warnings, check
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
