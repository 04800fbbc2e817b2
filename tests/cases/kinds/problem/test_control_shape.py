"""Linear controls and sizes by name in a file, simulated, measured and recorded."""

from pathlib import Path

import numpy as np
import pytest

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.record.record import Recording
from swarmstart.cases.record.results import load
from swarmstart.ocp import Trajectory
from swarmstart.tests.cases.kinds.problem.conftest import (
    scenario_of,
    simulated,
    stated,
)

CART = """\
kind: problem
constants: {far: 1.5}
states:
  x: {start: 0, rate: v, scale: far}
  v: {start: 0, rate: u, scale: far}
controls: {u: {bounds: [-9, 9], scale: 2*far, previous: 2.25}}
stage_cost: u**2
path: [{expression: u, upper: 2.5, name: gentle}]
terminal: [{expression: x, equals: far}, {expression: v}]
prediction: {horizon_s: 2, intervals: 5, control_shape: linear}
search: {name: none}
"""
BEST = 12 * 1.5**2 / 2**3


def test_open_loop_flies_and_measures_lines() -> None:
    path, found = simulated(CART)
    assert found["cost"] == pytest.approx(BEST, rel=1e-9)
    assert found["flown_cost"] == pytest.approx(BEST, rel=1e-6)
    assert found["terminal_excess"] == pytest.approx(0, abs=1e-8)
    assert found["constraint_excess"] == 0
    np.testing.assert_allclose(path.controls[0], 2.25 * (1 - 0.4 * np.arange(5)))


@pytest.mark.parametrize("shape", ["linear", "continuous"])
def test_step_cost_of_moves_is_measured_as_it_is_planned(shape: str) -> None:
    text = CART.replace(
        "stage_cost: u**2", "step_cost: 0.1*u**2 + (u - previous(u))**2"
    )
    path, found = simulated(text.replace("linear", shape))
    assert found["flown_cost"] == pytest.approx(found["cost"], rel=1e-6)
    assert (path.controls[0, 0] == 2.25) == (shape == "continuous")


def test_rate_limit_holds_along_lines() -> None:
    limit = "expression: u - previous(u), lower: -0.95, upper: 0.95"
    _, found = simulated(CART.replace("expression: u, upper: 2.5", limit))
    assert found["constraint_excess"] == pytest.approx(0, abs=1e-7)
    _, wider = simulated(CART)
    assert found["flown_cost"] == pytest.approx(wider["flown_cost"], rel=1e-6)


def test_continuous_controls_of_a_receding_horizon_do_not_jump() -> None:
    text = (
        CART.replace("linear", "continuous") + "feedback: receding_horizon\nsteps: 3\n"
    )
    path, _ = simulated(text)
    ends = [d.profile.controls[0, 0] for d in path.decisions if d.profile is not None]
    np.testing.assert_allclose(path.controls[0], [2.25, *ends[:2]], atol=1e-12)


def test_record_has_the_lines_and_is_a_guess_of_knots(tmp_path: Path) -> None:
    resolved = stated(CART)
    out = tmp_path / "run"
    run(resolved, seed=0, recording=Recording(folder=out, figures=True))
    kept = load(out).trajectory
    assert isinstance(kept, Trajectory)
    for k, decision in enumerate(kept.decisions):
        profile = decision.profile
        assert profile is not None and profile.start is not None
        expected = 2.25 * (1 - 0.4 * np.array([k, k + 1]))
        np.testing.assert_allclose(
            [profile.start[0], profile.controls[0, 0]], expected, atol=1e-6
        )
    again = pose(scenario_of(f"{CART}guess: {{record: {out}}}\n"))
    first = again.agents[0].first
    assert isinstance(first, np.ndarray)
    np.testing.assert_allclose(first[0], 2.25 * (1 - 0.4 * np.arange(6)), atol=1e-6)


def test_scales_are_those_of_the_problem() -> None:
    problem = pose(scenario_of(CART)).agents[0].problem
    assert problem.scales == {"x": 1.5, "v": 1.5, "u": 3.0}
    assert problem.control_shape == "linear"


@pytest.mark.parametrize(
    ("part", "other", "words"),
    [
        ("scale: 2*far", "scale: -far", "expected a positive number, found -1.5"),
        ("scale: 2*far", "scale: 0", "expected a positive number, found 0"),
        ("scale: 2*far", "scale: fare", "did you mean 'far'"),
        ("shape: linear", "shape: cubic", "'constant', 'linear' or 'continuous'"),
        ("rate: v", "next: v", "discrete-time"),
    ],
)
def test_what_is_wrong_is_said(part: str, other: str, words: str) -> None:
    text = CART.replace(part, other)
    if part == "rate: v":
        text = text.replace("rate: u", "next: u").replace("stage_", "step_")
    with pytest.raises(InvalidScenarioError) as refused:
        stated(text)
    assert words in str(refused.value)


def test_dual_mode_needs_held_controls() -> None:
    with pytest.raises(InvalidScenarioError, match="without linear controls"):
        stated(f"{CART}feedback: receding_horizon\n"
               "dual_mode: {at: {x: 0, v: 0}, Q: {x: 1}, R: {u: 1}}\n")  # fmt: skip
