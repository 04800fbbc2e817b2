"""Searches by local solves in lanes in YAML, on the command line, and in `compare`."""

import json
from pathlib import Path

import pytest

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.campaign.studies.library import compare
from swarmstart.cases.campaign.trials.solvers import solver_of
from swarmstart.cases.commands.front.cli import main
from swarmstart.tests.cases.kinds.problem.conftest import scenario_of, stated
from swarmstart.tests.ocp.lanes.problems import cart

SWING = """\
kind: problem
states:
  angle: {start: 0, rate: speed}
  speed: {start: 0, rate: torque - 9.81*sin(angle)}
controls: {torque: {bounds: [-8, 8]}}
stage_cost: torque**2
terminal: [{expression: angle - pi}, {expression: speed}]
prediction: {horizon_s: 3, intervals: 20}
search: {name: multistart, size: 8, unseen: 1}
polish: ipopt
budget: {evaluations: 50000}
lanes: 0
"""


def test_what_lanes_found_is_in_the_record_and_on_the_screen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "swing.yaml"
    file.write_text(SWING)
    folder = tmp_path / "out"
    plain = ["run", str(file), "--no-figures", "--measures"]
    assert main([*plain, "--out", str(folder)]) == 0
    assert "  searched    8 starts: " in capsys.readouterr().out
    found = json.loads((folder / "run.json").read_text())
    assert found["search"] == "multistart"
    assert found["search_lanes"]["lanes"]["starts"] == 8
    assert found["starts"] is None
    searched = ["run", str(file), "--search", "memetic", "--no-figures", "--json"]
    assert main([*searched, "--out", str(tmp_path / "other")]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["search_lanes"]["lanes"]["unseen"] is None
    assert found["search_lanes"]["lanes"]["starts"] > 0


def test_other_searches_tell_nothing_of_lanes() -> None:
    text = SWING.replace("{name: multistart, size: 8, unseen: 1}", "{name: lshade}")
    done = run(stated(text.replace("50000", "100")), seed=0)
    assert done.summary()["search_lanes"] is None


def test_sampling_has_no_meaning_for_a_multistart() -> None:
    with pytest.raises(ValueError, match="expected no sampling with multistart"):
        scenario_of(SWING.replace("size: 8", "sampling: uniform"))


def test_rival_of_compare_remains_ipopt_alone() -> None:
    """`repeated-ipopt` is the null hypothesis; `multistart` has lanes."""
    rival, own = solver_of("repeated-ipopt"), solver_of("multistart+ipopt")
    assert (rival.search, rival.family) == ("none", "repeated")
    assert (own.search, own.family) == ("multistart", "search")
    rows = compare(
        {"cart": (cart(), [0.0, 1.0])},
        solvers=["repeated-ipopt", "multistart+ipopt", "memetic+ipopt"],
        budget="300evals", seeds=1,
    )  # fmt: skip
    assert [row.costs[0] for row in rows] == pytest.approx([2.0] * 3)
