"""Algebraic variables in YAML: as in Python, as eliminated by hand, and on the path."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    AlgebraicEquations,
    Bounds,
    Model,
    OptimalControlProblem,
    solve,
)
from swarmstart.tests.cases.kinds.problem.conftest import scenario_of, simulated
from swarmstart.tests.cases.kinds.problem.test_same_in_python import assert_same

NONLINEAR = """\
kind: problem
constants: {size: 0.5}
states: {x: {start: 1, rate: z - x}, w: {start: 0.5, rate: y - w}}
controls: {u: {bounds: [-2, 2]}}
algebraic:
  z: {equation: z + exp(z) - x - u, start: x/2, scale: size}
  y: y + z - w
stage_cost: x**2 + u**2 + z**2
path: [{expression: z, lower: -0.3}]
prediction: {horizon_s: 2, intervals: 10, newton_iterations: 8}
search: {name: none}
measures:
  left: max(abs(z + exp(z) - x - u))
  first: y.start + z.start - w.start
"""
# 2 i + i v - v = 0: the current of a source with a load, linear in i.
LINEAR = """\
kind: problem
states: {v: {start: 1, rate: u - current}}
controls: {u: {bounds: [-1, 1]}}
signals: {load: 1 + time/2}
algebraic: {current: 2*current + load*current - v}
stage_cost: v**2 + u**2 + current**2
terminal_cost: v*current
prediction: {horizon_s: 1, intervals: 8}
search: {name: none}
measures: {charge: integral(current), most: max(current)}
"""


def test_equations_that_are_not_linear_are_those_of_python() -> None:
    x, w, z, y, u = (ca.SX.sym(n) for n in "xwzyu")
    model = Model(
        states=ca.vertcat(x, w),
        controls=u,
        ode=ca.vertcat(z - x, y - w),
        algebraic=AlgebraicEquations(
            symbols=ca.vertcat(z, y),
            residual=ca.vertcat(z + ca.exp(z) - x - u, y + z - w),
            start=ca.vertcat(x / 2, 0),
            scale=[0.5, 1.0],
            iterations=8,
        ),
    )
    problem = OptimalControlProblem(
        model,
        horizon=2.0,
        intervals=10,
        stage_cost=x**2 + u**2 + z**2,
        constraints=[z >= -0.3],
        bounds=Bounds(controls=(-2, 2)),
    )
    answer = solve(problem, [1.0, 0.5], search=None, seed=0)
    assert_same(NONLINEAR, answer)
    _, found = simulated(NONLINEAR)
    assert found["cost"] == answer.cost
    # The variables along the simulated path fulfil their equations.
    assert found["left"] == pytest.approx(0, abs=1e-12)
    assert found["first"] == pytest.approx(0, abs=1e-12)


def test_a_linear_equation_gives_what_elimination_by_hand_gives() -> None:
    by_hand = LINEAR.replace(
        "algebraic: {current: 2*current + load*current - v}",
        "definitions: {current: v/(2 + load)}",
    )
    path, found = simulated(LINEAR)
    other, expected = simulated(by_hand)
    np.testing.assert_allclose(path.states, other.states, rtol=1e-9)
    for name in ("cost", "flown_cost", "charge", "most"):
        assert found[name] == pytest.approx(expected[name], rel=1e-9)
    assert found["confirmed"] == 1


def test_each_vehicle_has_variables_of_its_own() -> None:
    two = LINEAR.replace("measures: {charge: integral(current), ", "measures: {")
    two = two.replace("max(current)", "max(current_a) - max(current_b)")
    two += "vehicles: {members: [{name: a}, {name: b, start: {v: 2}}]}\n"
    path, found = simulated(two)
    assert found["most"] == pytest.approx(-1 / 3)  # (1 - 2) / (2 + load), at the start
    alone, _ = simulated(LINEAR)
    np.testing.assert_allclose(path.states[0], alone.states[0], atol=1e-6)


@pytest.mark.parametrize(
    ("part", "other", "place", "words"),
    [
        ("- v}", "- vv}", "5:49", "did you mean 'v'?"),
        ("{current: 2*", "{v: 2*", "2:13", "expected a new name"),
        ("2*current + load*current - v", "v - load", "5:12", "no equation has current"),
        ("- v}", "- v - u}", "7:16", "no algebraic variable that depends on controls"),
        ("u - current", "u - curent", "2:34", "did you mean 'current'?"),
        ("2*current +", "previous(u)*current +", "5:22", "no previous control in"),
        ("{current: 2*current + load*current - v}",
         "{current: {equation: current - v, scale: -1}}", "5:53", "a scale above 0"),
        ("{current: 2*current + load*current - v}",
         "{current: {equation: current - v, start: current}}", "5:53", "no algebraic"),
        ("{current: 2*current + load*current - v}",
         "{current: {eqation: current - v}}", "5:23", "did you mean 'equation'?"),
        ("{current: 2*current + load*current - v}", "{current: }", "5:22", "number"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_where_it_stands(
    part: str, other: str, place: str, words: str
) -> None:
    assert part in LINEAR
    with pytest.raises(ValueError, match=r"^stated\.yaml:") as caught:
        scenario_of(LINEAR.replace(part, other, 1))
    message = str(caught.value)
    assert words in message, message
    assert f"stated.yaml:{place}: " in message, message
