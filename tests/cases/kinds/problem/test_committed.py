"""Vehicles of a problem in YAML agree on committed plans, and a record proves it."""

from pathlib import Path

import numpy as np
import pytest

from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.commands.front.cli import main
from swarmstart.cases.format.kind import FLIGHT_CERTIFICATE
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.record.record import Recording
from swarmstart.ocp import Source
from swarmstart.terminal_set import check
from swarmstart.tests.cases.kinds.problem.conftest import (
    scenario_of,
    simulated,
    stated,
)

DRONES = """\
kind: problem
constants: {to_x: 0, to_y: 0}
states:
  x: {start: 0, rate: vx}
  y: {start: 0, rate: vy}
  vx: {start: 0, rate: ax - 0.1*vx}
  vy: {start: 0, rate: ay - 0.1*vy}
controls: {ax: {bounds: [-1.5, 1.5]}, ay: {bounds: [-1.5, 1.5]}}
stage_cost: (x - to_x)**2 + (y - to_y)**2 + ax**2 + ay**2
terminal_cost: 10*((x - to_x)**2 + (y - to_y)**2)
terminal: [{expression: vx}, {expression: vy}]
vehicles:
  planning: committed
  members:
    - {name: one, start: {x: -4, y: 0.2}, constants: {to_x: 4}}
    - {name: two, start: {x: 4}, constants: {to_x: -4}}
  separation: {of: [x, y], distance: 1}
  links: {most_delay: 2, loss: 0.3}
prediction: {horizon_s: 4, intervals: 16, checks: 2}
dual_mode:
  at: {x: to_x, y: to_y, vx: 0, vy: 0}
  Q: {x: 1, y: 1, vx: 1, vy: 1}
  R: {ax: 1, ay: 1}
feedback: receding_horizon
search: {name: none}
steps: 40
"""
PLANNING = "planning: committed"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("committed")


@pytest.fixture(scope="module")
def flown(folder: Path) -> Run:
    return run(stated(DRONES), seed=0, recording=Recording(folder=folder / "run"))


def test_they_keep_the_distance_and_arrive(flown: Run) -> None:
    path = flown.trajectory.dense_states
    assert np.hypot(path[0] - path[4], path[1] - path[5]).min() >= 1.0
    np.testing.assert_allclose(path[[0, 4], -1], [4.0, -4.0], atol=1e-2)
    assert flown.measures["infeasible_steps"] == 0
    assert "those of 2 of 2 end in the sets of their goals" in flown.status
    sources = {p.source for d in flown.trajectory.decisions for p in d.plans}
    assert sources == {Source.COMMITTED, Source.LINEAR}


def test_the_record_proves_the_distance_and_becomes_a_page(
    flown: Run, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    del flown
    assert check.main([str(folder / "run" / FLIGHT_CERTIFICATE)]) == 0
    assert "no two of 2 vehicles" in capsys.readouterr().out
    for number in ("", "1"):
        assert (folder / "run" / f"certificate{number}.json").exists()
    assert main(["report", str(folder / "run"), "--quiet"]) == 0
    page = (folder / "run" / "report.html").read_text("utf-8")
    assert "followed its committed plans" in page
    assert "Plans are not drawn" not in page


def test_who_is_farther_off_its_plan_than_said_is_told() -> None:
    pushed = DRONES.replace("  links", "  tracking_error: 0.001\n  links")
    pushed += "plant: {disturbance: {vx: 0.1*sin(time)}}\n"
    told = run(stated(pushed), seed=0).status
    assert "above the tracking_error of 0.001" in told


def test_the_distance_is_kept_with_the_largest_error_of_both() -> None:
    path, _ = simulated(DRONES.replace("  links", "  tracking_error: 0.2\n  links"))
    states = path.dense_states
    assert np.hypot(states[0] - states[4], states[1] - states[5]).min() >= 1.4


@pytest.mark.parametrize(
    ("part", "other", "said"),
    [
        (
            "  separation: {of: [x, y], distance: 1}\n",
            "",
            "expected vehicles.separation",
        ),
        (
            "    - {name: two, start: {x: 4}, constants: {to_x: -4}}\n",
            "",
            "two vehicles",
        ),
        (
            "loss: 0.3",
            "silences: [{vehicle: 2, from_s: 0}]",
            "vehicles 0 to 1; found 2",
        ),
        (
            "loss: 0.3",
            "silences: [{vehicle: 1, from_s: 0}, {vehicle: 1, from_s: 2}]",
            "at most one silence of each vehicle",
        ),
        (
            PLANNING,
            "planning: priority",
            "expected planning: committed with it",
        ),
        ("of: [x, y]", "of: [2*x, y]", "expected a state"),
        (
            "start: {x: 4}",
            "start: {x: -3.5}",
            "starts at least 1 apart; those of",
        ),
        (
            "to_x: -4}}",
            "to_x: 3.5}}",
            "goals at least 1 apart; those of one",
        ),
        (
            "feedback: receding_horizon",
            "feedback: {law: receding_horizon, within_s: 0.1}",
            "expected null with planning: committed",
        ),
        ("feedback: receding_horizon", "feedback: open_loop", "receding_horizon"),
        ("  links", "  tracking_error: -1\n  links", "expected at least 0, found -1"),
        (
            "steps: 40",
            "steps: 40\nplant: {disturbance: {vx: 1}}",
            "above 0 with a plant",
        ),
        (
            "controls: {ax: {bounds: [-1.5, 1.5]}",
            "controls: {ax: {bounds: [-1.5, 1.5], delay_s: 0.25}",
            "planning: committed, unlike joint,",
        ),
    ],
)
def test_what_does_not_fit_is_said_with_its_place(
    part: str, other: str, said: str
) -> None:
    assert part in DRONES
    with pytest.raises(ValueError, match=said.replace("[", r"\[")):
        stated(DRONES.replace(part, other))


def test_signals_of_committed_plans_are_not_held_since_no_state_may_jump() -> None:
    price = "signals: {price: {times: [0, 1], values: [1, 2], between: hold}}\n"
    text = price + DRONES.replace("stage_cost: (x", "stage_cost: price*ax + (x")
    posed = pose(scenario_of(text))
    assert [agent.problem.features for agent in posed.agents] == [(), ()]
    joint = text.replace(PLANNING, "planning: joint").replace("  links: {mo", "  # {mo")
    joint = joint[: joint.index("dual_mode")] + "feedback: receding_horizon\n"
    assert pose(scenario_of(joint)).agents[0].problem.features


def test_committed_plans_need_a_set_in_which_they_end() -> None:
    begin, end = DRONES.index("dual_mode:"), DRONES.index("feedback:")
    with pytest.raises(ValueError, match="expected dual_mode"):
        stated(DRONES[:begin] + DRONES[end:])
