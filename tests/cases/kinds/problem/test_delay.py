"""Delays of controls in a file: simulated, measured, recorded, refused."""

from pathlib import Path

import numpy as np
import pytest

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.record.record import Recording
from swarmstart.cases.record.results import load
from swarmstart.ocp import Trajectory, TransportDelay
from swarmstart.tests.cases.kinds.problem.conftest import (
    scenario_of,
    simulated,
    stated,
)

CART = """\
kind: problem
constants: {lag: 0.2}
states: {x: {start: 1, rate: v}, v: {start: 0, rate: u - 0.5*v}}
controls: {u: {bounds: [-2, 2], delay_s: 2*lag, previous: 0.5}}
stage_cost: x**2 + v**2 + 0.1*u**2
prediction: {horizon_s: 2, intervals: 10}
search: {name: none}
"""
LOOP = "feedback: receding_horizon\nsteps: 6\n"


def test_file_states_the_feature() -> None:
    (feature,) = pose(scenario_of(CART)).agents[0].problem.features
    assert isinstance(feature, TransportDelay)
    assert feature.seconds == {"u": 0.4}
    assert pose(scenario_of(CART.replace("delay_s: 2*lag, ", ""))).agents[
        0
    ].problem.features == ()  # fmt: skip


@pytest.mark.parametrize("more", ["", LOOP])
def test_flown_cost_is_that_of_the_commanded_controls(more: str) -> None:
    path, found = simulated(CART + more)
    steps = path.dense_states[:, :-1].shape[1] // path.controls.shape[1]
    u = np.repeat(path.controls[0], steps)
    rates = (path.dense_states[:, :-1] ** 2).sum(axis=0) + 0.1 * u**2
    ends = (path.dense_states[:, 1:] ** 2).sum(axis=0) + 0.1 * u**2
    by_hand = float((rates + ends).sum()) / 2 * path.dense_times[1]
    assert found["flown_cost"] == pytest.approx(by_hand, rel=1e-3)
    if not more:
        assert found["flown_cost"] == pytest.approx(found["cost"], rel=1e-6)
    # The cart is pushed by the control before, then by the first of the plan.
    speed = path.states[1]
    assert speed[1] > 0 and speed[2] > 0 > speed[3] - speed[2]


def test_record_has_the_controls_that_acted(tmp_path: Path) -> None:
    out = tmp_path / "run"
    run(stated(CART + LOOP), seed=0, recording=Recording(folder=out, figures=True))
    kept = load(out).trajectory
    assert isinstance(kept, Trajectory)
    acted = [d.acting for d in kept.decisions if d.acting is not None]
    expected = [0.5, 0.5, *kept.controls[0, :-2]]
    np.testing.assert_allclose(np.ravel(acted), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("part", "other", "words"),
    [
        ("2*lag", "0.5", "whole number of intervals of 0.2 s, got 0.5 s: the nearest"),
        ("2*lag", "2", "must be shorter than the horizon"),
        ("2*lag", "late", "late"),
    ],
)
def test_impossible_delays_are_refused_at_their_key(
    part: str, other: str, words: str
) -> None:
    with pytest.raises(InvalidScenarioError) as caught:
        pose(scenario_of(CART.replace(f"delay_s: {part}", f"delay_s: {other}")))
    told = str(caught.value)
    assert words in told
    assert told.startswith("stated.yaml:4:")


VEHICLES = "vehicles: {planning: priority, members: [{name: a}, {name: b}]}\n"
DUAL_MODE = "dual_mode: {at: {x: 0, v: 0}, Q: {x: 1, v: 1}, R: {u: 1}}\n"
PHASES = "phases: [{horizon_s: 1, intervals: 5}, {horizon_s: 1, intervals: 5}]\n"
WITHOUT_DELAYS = {
    "planning: priority, unlike joint,": CART + LOOP + VEHICLES,
    "dual_mode": CART + LOOP + DUAL_MODE,
    "a phase": CART.replace("{horizon_s: 2, intervals: 10}", "{}") + PHASES,
}


@pytest.mark.parametrize(("what", "text"), WITHOUT_DELAYS.items())
def test_delay_is_refused_at_its_key_by_parts_that_take_none(
    what: str, text: str
) -> None:
    with pytest.raises(InvalidScenarioError) as caught:
        pose(scenario_of(text))
    place = f"4:{CART.splitlines()[3].index('2*lag') + 1}"
    assert str(caught.value) == (
        f"stated.yaml:{place}: {what} takes no delay_s: expected null or 0, found 2*lag"
    )
    none = pose(scenario_of(text.replace("delay_s: 2*lag, ", "")))
    zero = pose(scenario_of(text.replace("2*lag", "0*lag")))
    assert len(zero.agents) == len(none.agents)


def test_delay_of_one_vehicle_is_refused_with_priority() -> None:
    late = (CART + LOOP + VEHICLES).replace("lag: 0.2", "lag: 0")
    late = late.replace("{name: b}", "{name: b, constants: {lag: 0.2}}")
    with pytest.raises(InvalidScenarioError, match="takes no delay_s"):
        pose(scenario_of(late))


def test_linear_controls_are_refused_with_a_delay() -> None:
    text = CART.replace("intervals: 10", "intervals: 10, control_shape: linear")
    with pytest.raises(InvalidScenarioError, match="control_shape must be constant"):
        pose(scenario_of(text))
