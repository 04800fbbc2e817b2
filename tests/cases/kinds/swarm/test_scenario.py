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
        ("links.range_m=0.5", "links.range_m", "expected radio_range to link all"),
        ("planning.longest_s=0.5", "planning.longest_s", "expected longest_s to be"),
        ("plant.disturbance_m_s2=1", "acceleration", "above the"),
        ("vehicle.speed_m_s=[1, 0, 1]", "goals", "to have the y of the starts"),
        ("vehicle.turn_rate_rad_s=1", "disturbance", "with a turn rate"),
        ("obstacles=[{radius_m: 1.4, place_m: [0, 0, 0]}]", "starts", "obstacle 0"),
        ("obstacles=[{radius_m: 1}]", "obstacles", "place_m or path; found neither"),
        ("starts={formation: cube, count: 500, side_m: 1}", "starts", "room for 500"),
        ("rule=trust", "rule", "acknowledged"),
        ("starts={formation: ring, count: 3}", "starts",
         "expected formation to be one of points, line, v, circle, grid"),
        ("goals=[{formation: opposite}]", "formation", "expected formation to be one"),
        ("starts={formation: grid, counts: [1000, 1000, 1000], spacing_m: 1}", "starts",
         "expected at most 1000 places, found 1000000000"),
        ("starts=[{formation: circle, count: 999, radius_m: 9}, "
         "{formation: grid, counts: [2, 1, 1], spacing_m: 1}]", "starts",
         "expected at most 1000 starts, found 1001"),
        ("links.loss=0.99", "longest_s", "follows from delays and losses"),
        ("obstacles=[{radius_m: 1, path: [{time_s: 1, place_m: [9, 9, 9]}, "
         "{time_s: 0, place_m: [8, 8, 8]}]}]", "obstacles", "times to rise"),
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
