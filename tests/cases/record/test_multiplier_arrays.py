"""Multipliers are kept in records, and come back; also of an interrupted run."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import swarmstart.cases.campaign.running.run as campaign
from swarmstart.cases.campaign.running.finished_run import Interrupted
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.record.files import read_arrays
from swarmstart.cases.record.multiplier_arrays import (
    multiplier_arrays,
    multipliers_from,
    told,
)
from swarmstart.cases.record.record import Recording
from swarmstart.cases.record.results import load
from swarmstart.ocp import Step, fly
from swarmstart.tests.cases.kinds.problem.conftest import stated

# The least cost is the square of the way over the time, 2² / 1.
WAY = """\
kind: problem
states: {x: {start: 0, rate: u}}
controls: {u: {bounds: [-9, 9]}}
stage_cost: u**2
path: [{expression: u - 1.5*time, upper: 2, name: limit}]
terminal: [{expression: x, equals: 2, name: "way, all of it"}]
prediction: {horizon_s: 1, intervals: 5}
search: {name: none}
"""


def test_record_of_a_run_tells_what_limits_are_worth(tmp_path: Path) -> None:
    done = run(stated(WAY), seed=0, recording=Recording(folder=tmp_path, figures=False))
    kept = load(tmp_path)
    assert kept.multipliers is not None and done.multipliers is not None
    # The optimal cost changes by -multiplier for a longer way: dJ = 2 u dx.
    (worth,) = kept.multipliers.terminal["way, all of it"]
    assert worth == pytest.approx(-4.0, rel=1e-6)
    np.testing.assert_array_equal(kept.multipliers.costates, done.multipliers.costates)
    assert kept.multipliers.path["limit"].shape == (1, 5)
    assert kept.summary["multipliers"] == told(done.multipliers)
    assert kept.summary["multipliers"]["terminal"] == {"way, all of it": [worth]}
    assert repr(kept.multipliers) == repr(done.multipliers)
    assert kept.member_costs.size == 0


def test_run_that_is_searched_only_keeps_none(tmp_path: Path) -> None:
    searched = "polish: none\nbudget: {evaluations: 100}"
    text = WAY.replace("search: {name: none}", searched)
    run(stated(text), seed=0, recording=Recording(folder=tmp_path, figures=False))
    kept = load(tmp_path)
    assert kept.multipliers is None and kept.summary["multipliers"] is None
    assert multipliers_from(multiplier_arrays(None)) is None


def test_interrupted_run_keeps_those_of_its_first_plan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    resolved = stated(WAY + "feedback: receding_horizon\nsteps: 3\n")
    whole = Recording(folder=tmp_path / "whole", figures=False)
    broken = Recording(folder=tmp_path / "broken", figures=False)
    run(resolved, seed=0, recording=whole)

    def stopped(*arguments: object, **more: object) -> Iterator[Step]:
        for step in fly(*arguments, **more):  # type: ignore[arg-type]
            yield step
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(campaign, "fly", stopped)
        for _ in range(2):
            with pytest.raises(Interrupted):
                run(resolved, seed=0, recording=broken)
    assert run(resolved, seed=0, recording=broken).resumed == 2
    expected, found = (
        read_arrays(one.folder / "trajectory.npz") for one in (whole, broken)
    )
    assert expected.keys() == found.keys()
    for name in expected:
        if name.startswith("multipliers"):
            assert found[name].tobytes() == expected[name].tobytes(), name
    assert load(broken.folder).multipliers is not None


def test_member_costs_are_read_again(tmp_path: Path) -> None:
    text = WAY.replace("rate: u}", "rate: gain*u}") + "parameters: {gain: 1}\n"
    text = text.replace("equals: 2, ", "lower: 1, ")
    text += "uncertain: {values: {gain: [1, 2]}, risk: worst}\n"
    done = run(
        stated(text), seed=0, recording=Recording(folder=tmp_path, figures=False)
    )
    kept = load(tmp_path)
    assert kept.member_costs.tolist() == done.measures["member_costs"]
    assert kept.summary["measures"]["member_costs"] == done.measures["member_costs"]
    assert list(kept.multipliers.terminal) == [  # type: ignore[union-attr]
        "way, all of it_0", "way, all of it_1"
    ]  # fmt: skip
