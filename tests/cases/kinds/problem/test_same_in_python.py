"""A problem in YAML and the same one in Python have the same answer, to all digits."""

from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.kinds.flight import first_problem
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.ocp import (
    Bounds,
    Free,
    Known,
    Model,
    OptimalControlProblem,
    Solution,
    solve,
)
from swarmstart.tests.cases.kinds.problem.conftest import scenario_of, simulated

x, v, u, t, most = (ca.SX.sym(n) for n in ("x", "v", "u", "time", "most"))
CART = Model(states=ca.vertcat(x, v), controls=u, ode=ca.vertcat(v, u))
IN_YAML = """\
kind: problem
states: {x: {start: 1, rate: v}, v: {start: 0, rate: u}}
controls: {u: {bounds: [-4, 4]}}
stage_cost: u**2
terminal: [{expression: x}, {expression: v}]
prediction: {horizon_s: 2, intervals: 12}
search: {name: none}
"""


def cart(**more: Any) -> OptimalControlProblem:
    stated: dict[str, Any] = {
        "horizon": 2.0,
        "intervals": 12,
        "stage_cost": u**2,
        "bounds": Bounds(controls=(-4, 4)),
        "terminal": [x, v],
    }
    return OptimalControlProblem(more.pop("model", CART), **(stated | more))


def from_yaml(text: str) -> Solution:
    """Return the answer of the library to the problem that a text poses."""
    posed = first_problem(pose(scenario_of(text)))
    return solve(posed.problem, posed.x0, known=posed.known, search=None, seed=0)


def assert_same(text: str, answer: Solution) -> Solution:
    ours = from_yaml(text)
    np.testing.assert_array_equal(ours.controls, answer.controls)
    np.testing.assert_array_equal(ours.states, answer.states)
    assert ours.cost == answer.cost
    assert ours.status.is_confirmed
    return ours


def test_blocks_hold_their_controls() -> None:
    blocks = [1, 1, 2, 8]
    text = IN_YAML.replace("intervals: 12", f"intervals: 12, blocks: {blocks}")
    answer = solve(cart(blocks=blocks), [1.0, 0.0], search=None, seed=0)
    assert np.unique(assert_same(text, answer).controls).size == len(blocks)
    path, found = simulated(text)
    assert found["cost"] == answer.cost
    np.testing.assert_array_equal(path.controls, answer.controls)


def test_whole_numbers_are_flown() -> None:
    text = """\
kind: problem
states: {x: {start: 0, rate: heat - x}}
controls: {heat: {bounds: [0, 1], integer: true}}
stage_cost: (x - 0.55)**2
prediction: {horizon_s: 3, intervals: 12}
search: {name: none}
"""
    heat = ca.SX.sym("heat")
    problem = OptimalControlProblem(
        Model(states=x, controls=heat, ode=heat - x),
        horizon=3.0,
        intervals=12,
        stage_cost=(x - 0.55) ** 2,
        bounds=Bounds(controls=(0, 1), integer=["heat"]),
    )
    answer = solve(problem, [0.0], search=None, seed=0)
    assert set(assert_same(text, answer).controls.ravel()) == {0.0, 1.0}
    path, found = simulated(text)
    assert set(path.controls.ravel()) == {0.0, 1.0}
    assert found["cost"] == answer.cost


def test_bounds_follow_signals_time_and_parameters() -> None:
    text = IN_YAML.replace(
        "bounds: [-4, 4]", "bounds: [-most*cap, 3 - time/2], search_bounds: [-4, 4]"
    ).replace("rate: v}", "rate: v, bounds: [null, 1 + most]}")
    text += "signals: {most: 2 - time/4}\nparameters: {cap: 0.6}\n"
    cap = ca.SX.sym("cap")
    model = Model(states=CART.states, controls=u, ode=CART.ode, parameters=cap, time=t)
    problem = cart(
        model=model,
        signals=most,
        bounds=Bounds(
            controls=([-most * cap], [3 - t / 2]),
            states=([-np.inf, -np.inf], [1 + most, np.inf]),
            search=(-4, 4),
        ),
    )
    falling = 2 - np.linspace(0, 2, 13)[None, :] / 4
    known = Known(parameters=[0.6], signals=falling)
    answer = solve(problem, [1.0, 0.0], known=known, search=None, seed=0)
    assert_same(text, answer)
    path, found = simulated(text)
    # The first control is at its bound, which falls until the interval ends.
    assert path.controls[0, 0] == pytest.approx(-0.6 * (2 - 1 / 24), abs=1e-6)
    assert found["constraint_excess"] == pytest.approx(0, abs=1e-6)


def test_a_search_needs_numbers_beside_bounds_that_move() -> None:
    text = IN_YAML.replace("[-4, 4]", "[-4, 3 - time]")
    scenario_of(text)
    searched = text.replace("name: none", "name: de")
    with pytest.raises(ValueError, match=r"yaml:3:24: expected search_bounds, two"):
        scenario_of(searched)
    scenario_of(searched.replace("time]", "time], search_bounds: [-4, 3]"))


def test_tied_starts_have_one_value() -> None:
    text = """\
kind: problem
states:
  x: {start: {free: [-3, 3]}, rate: u}
  y: {start: {same_as: x}, rate: -y, bounds: [-1, 0.5]}
controls: {u: {bounds: [-1, 1]}}
stage_cost: u**2
terminal_cost: (x - 2)**2 + (y - 1)**2
prediction: {horizon_s: 1, intervals: 4}
search: {name: none}
"""
    y = ca.SX.sym("y")
    problem = OptimalControlProblem(
        Model(states=ca.vertcat(x, y), controls=u, ode=ca.vertcat(u, -y)),
        horizon=1.0,
        intervals=4,
        stage_cost=u**2,
        terminal_cost=(x - 2) ** 2 + (y - 1) ** 2,
        bounds=Bounds(controls=(-1, 1), states=([-np.inf, -1.0], [np.inf, 0.5])),
        start={("x", "y"): Free(-3, 3)},
    )
    answer = solve(problem, [0.0, 0.0], search=None, seed=0)
    assert_same(text, answer)
    path, found = simulated(text)
    # The bound of y holds of x, too: it wants to start as high as it may.
    assert path.states[0, 0] == path.states[1, 0] == pytest.approx(0.5)
    assert found["decided_x"] == found["decided_y"] == path.states[0, 0]


@pytest.mark.parametrize(
    ("part", "other", "place", "words"),
    [
        ("intervals: 12", "intervals: 12, blocks: [5, 6]", "6:51", "found the sum 11"),
        ("intervals: 12", "intervals: 12, blocks: [12, 0]", "6:56", "at least 1"),
        ("intervals: 12", "intervals: 12, blocks: 12", "6:51", "to be a list"),
        ("[-4, 4]}", "[-4, 4.5], integer: true}", "3:24", "found [-4, 4.5]"),
        ("[-4, 4]", "[-4, 4], integer: 1", "3:42", "true or false"),
        ("[-4, 4]", "[-4, 4*tme]", "3:31", "did you mean 'time'?"),
        ("[-4, 4]", "[-x, 4]", "3:26", "no state in bounds, found 'x'"),
        ("start: 1", "start: {same_as: v}", "2:31", "found 'v'"),
        ("start: 1", "start: {same_as: w}", "2:31", "found 'w'"),
        ("start: 1", "start: {same_as: x}", "2:31", "found 'x'"),
        ("start: 1", "start: {same_sa: v}", "2:21", "to be a number, or"),
    ],
)
def test_what_is_wrong_with_them_is_said_where_it_stands(
    part: str, other: str, place: str, words: str
) -> None:
    assert part in IN_YAML
    with pytest.raises(ValueError, match=r"^stated.yaml:") as caught:
        scenario_of(IN_YAML.replace(part, other))
    message = str(caught.value)
    assert message.startswith(f"stated.yaml:{place}: "), message
    assert words in message, message
