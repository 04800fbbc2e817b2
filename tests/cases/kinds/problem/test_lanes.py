"""Many starts in YAML: on the screen, in the record, and switched off."""

import json
from pathlib import Path

import pytest

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.commands.front.cli import main
from swarmstart.tests.cases.kinds.problem.conftest import scenario_of, stated

SWING = """\
kind: problem
states:
  angle: {start: 0, rate: speed}
  speed: {start: 0, rate: torque - 9.81*sin(angle)}
controls: {torque: {bounds: [-8, 8]}}
stage_cost: torque**2
terminal: [{expression: angle - pi}, {expression: speed}]
prediction: {horizon_s: 3, intervals: 20}
search: {name: none}
polish: ipopt
lanes: 16
"""


def test_account_is_in_the_record_and_on_the_screen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "swing.yaml"
    file.write_text(SWING)
    folder = tmp_path / "out"
    assert (
        main(["run", str(file), "--no-figures", "--measures", "--out", str(folder)])
        == 0
    )
    said = capsys.readouterr().out
    assert "  won         zero controls" in said
    assert "  lanes       33 starts, 16 of them variations: " in said
    assert "at most 18% of such starts end in others (95% interval)" in said
    starts = json.loads((folder / "run.json").read_text())["starts"]
    assert starts["won"] == "zero controls"
    origins = {one["origin"] for one in starts["tried"]}
    assert origins == {"zero controls", "a straight way to the end", "the lanes"}
    assert starts["lanes"]["optima"][0]["count"] >= 17
    assert starts["lanes"]["varied"] == 16
    assert starts["lanes"]["unseen"]["most"] == pytest.approx(3 / 17)


def test_gains_are_told_as_gains() -> None:
    text = SWING.replace("stage_cost: torque**2", "stage_cost: -torque**2")
    done = run(stated(f"{text}maximize: true\n"), seed=0)
    summary = done.summary()["starts"]
    assert summary["tried"][0]["cost"] == pytest.approx(done.measures["cost"])
    assert summary["tried"][0]["cost"] < 0


def test_reason_is_told_where_there_are_none() -> None:
    blocks = SWING.replace("intervals: 20", "intervals: 20, blocks: [10, 10]")
    summary = run(stated(blocks), seed=0).summary()["starts"]
    assert summary["lanes"] is None
    assert summary["without_lanes"] == "it has blocks of intervals"


def test_only_the_first_plan_of_a_flight_has_many_starts() -> None:
    free = SWING.replace("terminal:", "terminal_cost: cos(angle)  #")
    text = f"{free}feedback: receding_horizon\nsteps: 2\n"
    decisions = run(stated(text), seed=0).trajectory.decisions
    assert [d.plans[0].starts is not None for d in decisions] == [True, False]


def test_without_lanes_nothing_is_told() -> None:
    done = run(stated(SWING.replace("lanes: 16", "lanes: 0")), seed=0)
    assert done.summary()["starts"] is None


def test_lanes_are_used_unless_the_scenario_says_otherwise() -> None:
    done = run(stated(SWING.replace("lanes: 16\n", "")), seed=0)
    assert done.summary()["starts"]["lanes"]["starts"] == 65


def test_lanes_want_a_polish() -> None:
    text = SWING.replace("polish: ipopt", "polish: none").replace("none}", "lshade}")
    with pytest.raises(ValueError, match="expected lanes with polish: ipopt"):
        scenario_of(text)
