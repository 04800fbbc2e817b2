from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from swarmstart.cases.drawing.drawing import colour
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.scenario import read_document, resolve, shipped
from swarmstart.cases.format.yaml_reader import parse_yaml
from swarmstart.cases.kinds.formation_flight.figures import draw, sheet_figure
from swarmstart.cases.kinds.formation_flight.measures import measure
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.formation_flight.shown_path import planned_paths
from swarmstart.ocp import Source, simulate
from swarmstart.tests.cases.drawing.reading import legend, named, words
from swarmstart.tests.cases.kinds.flights import build

NAME = "formation_obstacle_uav3"
LAST_OF_UAV_4 = "      - [-0.123972, -pi/18]\n"


@pytest.mark.parametrize(
    ("old", "new", "at", "message"),
    [
        (
            "steps: 1 ", "steps: 2 ", "2 ",
            "expected 1, since the plan of UAV 4 is given, for the first step only; "
            "found 2",
        ),
        (
            LAST_OF_UAV_4, "", "- [5, pi/18]",
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
        ("number: 5", "number: 3", "", "expected a number of its own, found 3 again"),
        (
            "planning_order: highest_first", "planning_order: [3, 4, 1]", "[3, 4, 1]",
            "expected the number of each of the 3 UAVs once, found [3, 4, 1]",
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
    assert len(draw(scenario, flight, trajectory, tmp_path)) == 2  # no dual mode
    assert measures["plan_cost"] == decision.plans[0].cost


def test_the_plan_is_drawn_to_its_end_under_the_uavs_own_numbers() -> None:
    """Each path ends where the plan's states do, eight seconds on, not one."""
    settings = ["backend=casadi", "budget.evaluations=40"]
    scenario = resolve(read_document(NAME), assignments=settings).scenario
    assert isinstance(scenario, FormationScenario)
    flight = build(scenario)
    rng = np.random.default_rng(0)
    trajectory = simulate(flight.plant, flight.controller, flight.x0, steps=1, rng=rng)
    times, paths = planned_paths(scenario, flight, trajectory)
    assert times[-1] == 8.0 and paths.shape == (3, 4, 8 * 20 + 1)
    for path, plan in zip(paths, trajectory.decisions[0].plans, strict=True):
        np.testing.assert_allclose(path[:, -1], plan.states[:, -1], atol=1e-4)
    figure = sheet_figure(scenario, flight, trajectory)
    assert {"UAV 3", "UAV 4", "UAV 5"} < {*legend(figure)}
    assert "UAV 1" not in legend(figure)
    # The second panel of that name enlarges where two come near.
    tracks = next(axes for axes in figure.axes if words(axes) == "y [m]")
    (track,) = named(tracks, "UAV 3")
    np.testing.assert_allclose(np.asarray(track.get_data()), paths[0, 2:])
    assert track.get_color() == colour(2)
    cost = trajectory.decisions[0].plans[0].cost
    assert f"UAV 3: J = {cost:.6g}" in figure.get_suptitle()


def test_the_uavs_plan_in_the_order_of_their_own_numbers() -> None:
    document = read_document(NAME)
    orders = {"highest_first": [2, 1, 0], "lowest_first": [0, 1, 2]}
    orders |= {"[4, 5, 3]": [1, 2, 0]}
    for given, expected in orders.items():
        scenario = resolve(document, assignments=[f"planning_order={given}"]).scenario
        assert isinstance(scenario, FormationScenario)
        assert scenario.order_of_planning() == expected
    swapped = resolve(document, assignments=["uavs.0.number=9"]).scenario
    assert isinstance(swapped, FormationScenario)
    assert swapped.order_of_planning() == [0, 2, 1]
