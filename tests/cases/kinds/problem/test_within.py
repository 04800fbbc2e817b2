"""A time for one plan in a scenario: measured, told, recorded, and refused."""

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.record.record import Recording
from swarmstart.cases.record.results import load
from swarmstart.ocp.loop import controller
from swarmstart.tests.cases.kinds.problem.conftest import PENDULUM, stated

LOOP = PENDULUM + "search: {name: none}\nsteps: 2\n"


def in_loop(text: str, feedback: str = "within_s: 0.1") -> str:
    return f"{text}feedback: {{law: receding_horizon, {feedback}}}\n"


def test_a_run_measures_tells_and_records_its_stopped_steps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def over() -> Iterator[SimpleNamespace]:
        yield SimpleNamespace(seconds=math.inf)

    monkeypatch.setattr(controller, "stopwatch", over)
    resolved = stated(in_loop(LOOP))
    assert resolved.scenario.random_starts() == 0
    done = run(resolved, seed=0, recording=Recording(folder=tmp_path, figures=False))
    assert done.measures["stopped_steps"] == 2
    told = ", 2 of 2 steps were stopped in time (within_s)"
    assert told in done.status
    assert told in json.loads((tmp_path / "run.json").read_text())["status"]
    again = load(tmp_path).trajectory
    assert again is not None and again.stopped_steps == 2


def test_a_long_time_stops_nothing(tmp_path: Path) -> None:
    resolved = stated(in_loop(LOOP, "within_s: 1e6"))
    done = run(resolved, seed=0, recording=Recording(folder=tmp_path, figures=False))
    assert done.measures["stopped_steps"] == 0 and "stopped" not in done.status
    again = load(tmp_path).trajectory
    assert again is not None and again.stopped_steps == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            in_loop(LOOP, "within_s: 0"),
            "13:45: expected feedback.within_s to be greater than 0; found 0",
        ),
        (in_loop(LOOP, "within_s: soon"), "13:45: .*unknown name 'soon'"),
        (
            PENDULUM + "feedback: {within_s: 0.1}\n",
            "expected within_s with law: receding_horizon.*found open_loop",
        ),
        (
            in_loop(PENDULUM + "lanes: 4\n"),
            "11:8: expected no lanes with feedback.within_s.*found 4",
        ),
        (
            in_loop(PENDULUM + "search: {name: memetic}\n"),
            "11:9: expected a search that can be stopped.*found memetic",
        ),
        (
            in_loop(PENDULUM + "search: {name: multistart}\n"),
            "11:9: expected a search that can be stopped.*found multistart",
        ),
    ],
)
def test_a_time_is_refused_at_its_key(text: str, message: str) -> None:
    with pytest.raises(InvalidScenarioError, match=message):
        stated(text)


def test_searches_without_lanes_are_taken() -> None:
    stated(in_loop(PENDULUM + "search: {name: multistart, lanes: false}\n"))
    stated(in_loop(PENDULUM + "search: {name: lshade}\n"))
