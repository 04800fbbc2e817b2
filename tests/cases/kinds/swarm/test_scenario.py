"""Invalid swarms are refused before the flight, with place and numbers."""

from pathlib import Path

import pytest

from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.registry import RULES
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.swarm.scenario import SwarmScenario


@pytest.mark.parametrize(
    ("assignment", "place", "message"),
    [
        ("safe_distance_m=2", "starts", "vehicles 0 and 1 to be 2 m apart (scaled)"),
        ("goals={formation: line, count: 5, spacing_m: 1}", "goals",
         "expected as many goals as starts, 6; found 5"),
        ("goals={formation: line, count: 6, spacing_m: 0.1}", "goals", "to be 0.3"),
        ("links.silences=[{vehicle: 6, from_s: 0}]", "links.silences",
         "expected silences to name vehicles 0 to 5; found [6]"),
        ("links.silences=[{vehicle: 1, from_s: 5, to_s: 2}]", "links.silences", ""),
        ("links.silences=[{vehicle: 1, from_s: 0}, {vehicle: 1, from_s: 5}]",
         "links.silences", "expected at most one silence of each vehicle"),
        ("planning.longest_s=0.5", "planning.longest_s", "expected longest_s to be"),
        ("plant.disturbance_m_s2=1", "acceleration", "above the"),
        ("vehicle.speed_m_s=[1, 0, 1]", "goals", "to have the y of the starts"),
        ("vehicle.turn_rate_rad_s=1", "disturbance", "with a turn rate"),
        ("obstacles=[{radius_m: 1.4, place_m: [0, 0, 0]}]", "starts", "obstacle 0"),
        ("obstacles=[{radius_m: 1}]", "obstacles", "place_m or path; found neither"),
        ("starts={formation: cube, count: 500, side_m: 1}", "starts", "room for 500"),
        ("rule=trust", "rule", "acknowledged"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named_with_its_place(
    six: Path, assignment: str, place: str, message: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr("swarmstart.cases.kinds.swarm.formations.MOST_TRIES", 2000)
    with pytest.raises(InvalidScenarioError) as refused:
        resolve(read_document(str(six)), assignments=[assignment])
    said = str(refused.value)
    assert place in said
    assert message in said
    assert "expected" in said


def test_keys_of_planned_kinds_are_unknown(six: Path) -> None:
    with pytest.raises(InvalidScenarioError, match="search"):
        resolve(read_document(str(six)), assignments=["search={name: lshade}"])


def test_the_rules_are_those_that_can_be_compared() -> None:
    hint = SwarmScenario.model_fields["rule"].annotation
    assert getattr(hint, "__args__", ()) == tuple(RULES)


def test_assigned_goals_have_the_shortest_ways(six: Path) -> None:
    nearest = "goals={formation: circle, count: 6, radius_m: 1.6, phase_rad: pi}"
    resolved = resolve(
        read_document(str(six)), assignments=[nearest, "assignment=shortest"]
    )
    scenario = resolved.scenario
    assert isinstance(scenario, SwarmScenario)
    swarm = scenario.controller().swarm
    assert abs(swarm.goals - swarm.starts).max() < 0.11
