from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from swarmstart.cases.formation.build import build
from swarmstart.cases.formation.figures import draw
from swarmstart.cases.formation.measures import measure
from swarmstart.cases.formation.scenario import FormationScenario
from swarmstart.cases.scenario import (
    InvalidScenarioError,
    read_document,
    resolve,
    shipped,
)
from swarmstart.cases.yaml_reader import parse_yaml
from swarmstart.ocp import Source, simulate

NAME = "formation_obstacle_uav3"
LAST_OF_UAV_2 = "      - [-0.123972, -pi/18]\n"


@pytest.mark.parametrize(
    ("old", "new", "at", "message"),
    [
        (
            "steps: 1 ", "steps: 2 ", "2 ",
            "expected 1, since the plan of UAV 2 is given, for the first step only; "
            "found 2",
        ),
        (
            LAST_OF_UAV_2, "", "- [5, pi/18]",
            "expected controls for each of the 8 intervals of the horizon, found 7",
        ),
        (
            "[1.684068, pi/18]", "[5.5, pi/18]", "5.5",
            "expected a value within vehicle.acceleration_m_s2 [-5, 5], found 5.5",
        ),
        (
            "[-0.123972, -pi/18]", "[-0.123972, -pi/17]", "-pi/17",
            "expected a value within vehicle.turn_rate_rad_s [-0.174533, 0.174533], "
            "found -0.1848",
        ),
        (
            "[1.684068, pi/18]", "[1.684068]", "[1.684068]",
            "expected uavs.1.plan.2 to be a list of at least 2 entries; found "
            "[1.684068]",
        ),
    ],
)  # fmt: skip
def test_a_given_plan_that_cannot_be_flown_is_refused_at_its_place(
    old: str, new: str, at: str, message: str
) -> None:
    text = shipped()[NAME].read_text(encoding="utf-8")
    assert text.count(old) == 1
    changed = text.replace(old, new)
    with pytest.raises(InvalidScenarioError) as caught:
        resolve(parse_yaml(changed, name="mine.yaml"))
    (flaw,) = caught.value.flaws
    assert flaw.what.startswith(message)
    line = changed.splitlines()[flaw.place.line - 1]
    assert line[flaw.place.column - 1 :].startswith(at)


def test_one_uav_has_to_plan() -> None:
    plan = [[0.0, 0.0]] * 8
    with pytest.raises(InvalidScenarioError) as caught:
        resolve(read_document("passing_side"), assignments=[f"uavs.0.plan={plan}"])
    (flaw,) = caught.value.flaws
    assert flaw.what == (
        "expected a UAV without the key 'plan', which plans; found a plan for each of 1"
    )


def test_a_given_plan_is_flown_as_given_and_seen_measured_and_drawn(
    tmp_path: Path,
) -> None:
    settings = ["backend=casadi", "budget.evaluations=40"]
    scenario = resolve(read_document(NAME), assignments=settings).scenario
    assert isinstance(scenario, FormationScenario)
    flight = build(scenario)
    rng = np.random.default_rng(0)
    trajectory = simulate(flight.plant, flight.controller, flight.x0, steps=1, rng=rng)
    (decision,) = trajectory.decisions
    for uav, plan in zip(scenario.uavs[1:], decision.plans[1:], strict=True):
        assert plan.source is Source.GUESS and plan.evaluations == 0
        np.testing.assert_array_equal(plan.controls.T, uav.plan)
        assert plan.feasible
    assert [plan.cost for plan in decision.plans[1:]] == pytest.approx(
        [3171.317, 10700.406], abs=1e-3
    )
    np.testing.assert_array_equal(trajectory.controls[2:4, 0], [5.0, np.pi / 18])
    measures = measure(scenario, flight, trajectory)
    assert measures["evaluations"] == decision.plans[0].evaluations
    assert measures["infeasible_steps"] == 0
    assert len(draw(scenario, flight, trajectory, tmp_path)) == 8
