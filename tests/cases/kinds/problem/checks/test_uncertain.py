"""Uncertain parameters in YAML: closed forms, as in Python, one system simulated."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.record.record import Recording
from swarmstart.ocp import (
    Bounds,
    Known,
    Model,
    OptimalControlProblem,
    ensemble,
    solve,
)
from swarmstart.tests.cases.kinds.problem.conftest import (
    scenario_of,
    simulated,
    stated,
)
from swarmstart.tests.cases.kinds.problem.test_same_in_python import assert_same

# One interval: x is gain u at the end.
ONE = """\
kind: problem
parameters: {gain: 1}
states: {x: {start: 0, rate: gain*u}}
controls: {u: {bounds: [-3, 3]}}
terminal_cost: (x - 1)**2
prediction: {horizon_s: 1, intervals: 1}
uncertain: {values: {gain: [0.5, 1.5]}, risk: mean}
search: {name: none}
"""
LAG = """\
kind: problem
constants: {most: 1.4}
parameters: {gain: 1, tau: 1.1}
states: {x: {start: 0.1, rate: (gain*u - x)/tau, bounds: [-1, 1.2]}}
controls: {u: {bounds: [-3, 3]}}
stage_cost: (x - 1)**2
prediction: {horizon_s: 2, intervals: 8}
uncertain: {values: {gain: [0.8, 1, most]}, weights: [1, 2, 1], risk: worst}
search: {name: none}
"""


def lag() -> OptimalControlProblem:
    x, u, gain, tau = (ca.SX.sym(n) for n in ("x", "u", "gain", "tau"))
    return OptimalControlProblem(
        Model(
            states=x,
            controls=u,
            ode=(gain * u - x) / tau,
            parameters=ca.vertcat(gain, tau),
        ),
        horizon=2.0,
        intervals=8,
        stage_cost=(x - 1) ** 2,
        bounds=Bounds(controls=(-3, 3), states=(-1, 1.2)),
    )


@pytest.mark.parametrize(
    ("risk", "control"),
    [
        ("mean", 2 / 2.5),  # sum of g / sum of g²
        ("worst", 1.0),  # 1 - u/2 = 3/2 u - 1
        ("cvar, level: 0.5", 1.0),  # the worse half of two members
        ("cvar, level: 0", 2 / 2.5),
    ],
)
def test_the_control_is_that_of_the_closed_form(risk: str, control: float) -> None:
    path, found = simulated(ONE.replace("mean", risk))
    assert path.controls[0, 0] == pytest.approx(control, abs=1e-6)
    costs = [(gain * control - 1) ** 2 for gain in (0.5, 1.5)]
    assert found["member_costs"] == pytest.approx(costs, abs=1e-6)
    expected = np.mean(costs) if control < 1 else max(costs)
    assert found["cost"] == pytest.approx(expected, abs=1e-6)
    # One system is simulated, with the gain of the parameters.
    assert path.states[:, -1] == pytest.approx([control], abs=1e-6)
    assert found["flown_cost"] == pytest.approx((control - 1) ** 2, abs=1e-6)


def test_values_of_the_file_give_what_python_gives() -> None:
    many = ensemble(lag(), {"gain": [0.8, 1, 1.4]}, weights=[1, 2, 1], risk="worst")
    answer = solve(many, [0.1], known=Known([1.1]), search=None, seed=0)
    assert_same(LAG, answer)
    _, found = simulated(LAG)
    assert found["cost"] == answer.cost
    assert found["member_costs"] == answer.member_costs.tolist()


def test_drawn_members_are_those_of_the_seed_of_the_file() -> None:
    drawn = "drawn: {gain: {normal: [1, 0.1]}, tau: {uniform: [1, most]}}, samples: 5"
    text = LAG.replace("values: {gain: [0.8, 1, most]}, weights: [1, 2, 1]", drawn)
    rng = np.random.default_rng(7)
    many = ensemble(
        lag(),
        lambda rng: {"gain": rng.normal(1, 0.1), "tau": rng.uniform(1, 1.4)},
        samples=5,
        rng=rng,
        risk="worst",
    )
    answer = solve(many, [0.1], search=None, seed=0)
    assert_same(text.replace("risk:", "seed: 7, risk:"), answer)
    assert simulated(text, seed=0)[1]["cost"] == simulated(text, seed=1)[1]["cost"]
    assert simulated(text)[1]["cost"] != answer.cost


def test_plans_in_receding_horizon_are_for_all_members() -> None:
    text = LAG.replace("[-1, 1.2]", "[-1, 1.02]")
    text += "feedback: receding_horizon\nsteps: 5\nplant: {parameters: {gain: most}}\n"
    path, found = simulated(text)
    assert path.states.shape == (1, 6)
    assert found["infeasible_steps"] == 0
    # One member has the gain of the plant.
    assert found["constraint_excess"] == pytest.approx(0, abs=1e-6)
    alone = text.partition("uncertain")[0] + text.partition("risk: worst}\n")[2]
    assert simulated(alone)[1]["constraint_excess"] > 1e-3  # type: ignore[operator]


def test_members_have_controls_of_their_own_after_the_robust_horizon() -> None:
    """The answer is that of Python; the controls that all members share are applied."""
    text = LAG.replace("risk: worst", "risk: worst, robust_horizon: 2")
    text += "feedback: receding_horizon\nsteps: 3\n"
    flown = run(stated(text), seed=0)
    many = ensemble(
        lag(), {"gain": [0.8, 1, 1.4]}, weights=[1, 2, 1], risk="worst",
        robust_horizon=2,
    )  # fmt: skip
    answer = solve(many, [0.1], known=Known([1.1]), search=None, seed=0)
    plan = flown.trajectory.decisions[0].plans[0]
    np.testing.assert_array_equal(plan.controls, answer.plan.controls)
    assert np.ptp(plan.controls[:, :2], axis=0).max() < 1e-9
    assert np.ptp(plan.controls[:, 2]) > 0.1
    assert flown.trajectory.controls.shape == (1, 3)
    assert flown.trajectory.controls[0, 0] == plan.controls[0, 0]
    assert flown.measures["member_costs"] == answer.member_costs.tolist()


def test_all_members_start_at_one_decided_state() -> None:
    text = LAG.replace("start: 0.1", "start: {free: [0, 0.3]}")
    path, found = simulated(text)
    assert found["decided_x"] == path.states[0, 0] == pytest.approx(0.3)
    assert "decided_x" in stated(text).kind.own_measures(stated(text).scenario)


def test_guessed_states_are_those_of_every_member_and_vehicles_share_them() -> None:
    text = f"{LAG}guess: {{states: {{x: 0.5}}}}\n"
    assert simulated(text)[1]["cost"] == pytest.approx(simulated(LAG)[1]["cost"])
    both = text + "vehicles: {members: [{name: a}, {name: b, start: {x: 0.2}}]}\n"
    path, found = simulated(both)
    assert path.states.shape[0] == 2 and len(found["member_costs"]) == 3  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("feedback", "more"),
    [
        ("open_loop", ""),
        ("receding_horizon", ""),
        ("receding_horizon", ", robust_horizon: 1"),
    ],
)
def test_figures_show_the_system_and_the_members(
    tmp_path: Path, feedback: str, more: str
) -> None:
    text = LAG.replace("risk: worst", f"risk: worst{more}")
    text += f"feedback: {feedback}\nsteps: 3\n"
    done = run(stated(text), seed=0, recording=Recording(folder=tmp_path))
    names = [file.name for file in done.figures]
    assert names[0] == "a_sheet.png"
    assert names[-1] == "g_members.png"


@pytest.mark.parametrize(
    ("other", "column", "words"),
    [
        ("{values: {gian: [1]}}", 28, "expected a parameter, found 'gian'"),
        ("{values: {gain: [1, 2], tau: [1]}}", 41, "for each of 2 members; found 1"),
        ("{values: {gain: []}}", 21, "expected at least one value"),
        ("{values: {gain: [1, lost]}}", 32, "unknown name 'lost'"),
        ("{values: {gain: [1, 2]}, weights: [1]}", 46, "found 1"),
        ("{values: {gain: [1]}, weights: [-1]}", 44, "a weight above 0, found -1"),
        ("{values: {gain: [1]}, risk: best}", 40, "'mean', 'worst' or 'cvar'"),
        ("{values: {gain: [1]}, risk: cvar, level: 1}", 53, "below 1, found 1"),
        ("{values: {gain: [1]}, samples: 3}", 12, "with drawn and only then"),
        ("{drawn: {gain: {normal: [1, 0]}}, samples: 3}", 40, "above 0, found 0"),
        ("{drawn: {gain: {uniform: [1, 0]}}, samples: 3}", 37, "lower < upper"),
        ("{drawn: {gain: {norml: [1, 1]}}, samples: 3}", 27, "did you mean 'normal'?"),
        ("{drawn: {gain: {normal: [1, 1]}}}", 12, "expected samples"),
        ("{}", 12, "found neither"),
        ("{values: {gain: [1]}, robust_horizon: 0}", 50, "to be at least 1; found 0"),
        ("{values: {gain: [1]}, robust_horizon: 9}", 50, "at most 8, the intervals"),
        ("{values: {gain: [1]}, robust_horizon: 2}", 50, "found open_loop"),
    ],
)
def test_what_is_wrong_is_said_where_it_stands(
    other: str, column: int, words: str
) -> None:
    head, _, rest = LAG.partition("uncertain: ")
    text = f"{head}uncertain: {other}{rest[rest.index(chr(10)) :]}"
    with pytest.raises(ValueError, match=r"^stated\.yaml:") as caught:
        scenario_of(text)
    message = str(caught.value)
    assert words in message, message
    assert message.startswith(f"stated.yaml:8:{column}: "), message


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("path: [{expression: x, upper: 1, soft: {weight: 1}}]", "without soft"),
        ("initial_cost: x", "risk must be 'mean' for a problem with an initial cost"),
        ("dual_mode: {at: {x: 0}, Q: {}, R: {u: 1}}", "no dual mode with uncertain"),
        (
            "feedback: receding_horizon\nvehicles: {planning: priority, members: "
            "[{name: a}, {name: b}]}",
            "expected planning: joint with uncertain; found priority",
        ),
    ],
)
def test_what_does_not_go_with_members_is_refused(more: str, words: str) -> None:
    with pytest.raises(ValueError, match=r"^stated\.yaml:") as caught:
        scenario_of(f"{LAG}{more}\n")
    assert words in str(caught.value)
