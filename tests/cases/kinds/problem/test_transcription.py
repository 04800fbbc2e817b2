"""Collocation in YAML: as in Python, and its error messages."""

import casadi as ca
import pytest

from swarmstart.cases.format.document import shown
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.ocp import Bounds, Model, OptimalControlProblem, Radau, solve
from swarmstart.ocp.integration.radau import Transcription
from swarmstart.tests.cases.kinds.problem.conftest import stated
from swarmstart.tests.cases.kinds.problem.test_same_in_python import assert_same

CART = """\
kind: problem
states: {x: {start: 1, rate: v}, v: {start: 0, rate: u - v**3}}
controls: {u: {bounds: [-2, 2]}}
stage_cost: x**2 + u**2
prediction: {horizon_s: 2, intervals: 8, transcription: radau}
search: {name: none}
"""


@pytest.mark.parametrize(
    ("text", "transcription"),
    [
        ("radau", "radau"),
        ("shooting", "shooting"),
        ("{points: 2, elements: 3}", Radau(points=2, elements=3)),
        ("{elements: 1}", Radau(elements=1)),
    ],
)
def test_it_is_that_of_python(text: str, transcription: Transcription | Radau) -> None:
    x, v, u = (ca.SX.sym(name) for name in "xvu")
    problem = OptimalControlProblem(
        Model(states=ca.vertcat(x, v), controls=u, ode=ca.vertcat(v, u - v**3)),
        horizon=2.0,
        intervals=8,
        stage_cost=x**2 + u**2,
        bounds=Bounds(controls=(-2, 2)),
        transcription=transcription,
    )
    answer = solve(problem, [1.0, 0.0], search=None, seed=0)
    assert_same(CART.replace("radau", text), answer)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gauss", "'shooting' or 'radau'"),
        ("{points: 12}", "points to be at most 9; found 12"),
        ("{order: 3}", "order"),
        ("{points: 9, elements: 1000}", "operations in an interval"),
    ],
)
def test_what_is_none_is_refused(text: str, message: str) -> None:
    with pytest.raises(InvalidScenarioError) as caught:
        stated(CART.replace("radau", text))
    assert message in str(caught.value), shown(str(caught.value))
