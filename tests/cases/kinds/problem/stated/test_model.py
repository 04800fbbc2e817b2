"""A file becomes the planning problem that it states, with one or more vehicles."""

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.cases.kinds.problem.stated.members import members_of, shared_of
from swarmstart.cases.kinds.problem.stated.model import model_of, planning_problem
from swarmstart.ocp import Model, OptimalControlProblem
from swarmstart.tests.cases.kinds.problem.conftest import scenario_of, simulated

ALONE = """\
kind: problem
constants: {{slot: 1, width: 5}}
states:
  x: {{start: 0, rate: v, bounds: [null, slot + width]}}
  v: {{start: 0, rate: a - 0.1*v*v}}
controls: {{a: {{bounds: [-width, 5]}}}}
stage_cost: (x - slot)**2 + 0.1*a**2
prediction: {{horizon_s: 2, intervals: 10}}
search: {{name: none}}
{more}
"""
TWO = "  members: [{name: a}, {name: b, start: {x: 30}, constants: {slot: 31}}]\n"
APART = TWO + "  separation: {of: [x], distance: 2, margin: 0.5}\n"
POINT = """\
kind: problem
states: {{x: {{start: {start}, rate: u}}, y: {{start: 0, rate: w}}}}
controls: {{u: {{bounds: [-3, 3]}}, w: {{bounds: [-3, 3]}}}}
stage_cost: {cost}
prediction: {{horizon_s: 1, intervals: 5, tolerance: 1e-8}}
search: {{name: none}}
guess: {{controls: {{u: 0.1, w: 0.1}}}}
{more}
"""


def planned(text: str) -> tuple[Array, Array]:
    """Return controls and states of the plan."""
    plan = simulated(text)[0].decisions[0].plans[0]
    return plan.controls, plan.states


def posed(text: str) -> OptimalControlProblem:
    scenario = scenario_of(text)
    return planning_problem(scenario, members_of(scenario, shared_of(scenario)))


def rates(model: Model, x: list[float], u: list[float], p: list[float]) -> list[float]:
    f = ca.Function("f", [model.states, model.controls, model.parameters], [model.ode])
    return [float(rate) for rate in np.array(f(x, u, p)).ravel()]


@pytest.mark.parametrize("vehicles", [TWO, APART])
def test_vehicles_far_apart_are_planned_as_each_alone(vehicles: str) -> None:
    together, states = planned(ALONE.format(more=f"vehicles:\n{vehicles}"))
    first, its_states = planned(ALONE.format(more=""))
    alone = ALONE.format(more="").replace("slot: 1,", "slot: 31,")
    second, _ = planned(alone.replace("x: {start: 0,", "x: {start: 30,"))
    np.testing.assert_allclose(together, np.vstack([first, second]), atol=1e-6)
    np.testing.assert_allclose(states[:2], its_states, atol=1e-6)


def test_several_vehicles_have_their_own_names_bounds_and_rates() -> None:
    text = ALONE.format(more=f"vehicles:\n{APART}")
    problem = posed(text)
    assert problem.model.state_names == ("x_a", "v_a", "x_b", "v_b")
    assert problem.model.control_names == ("a_a", "a_b")
    bounds = problem.bounds
    assert bounds.states is not None and bounds.controls is not None
    assert np.array(bounds.states[1]).tolist() == [6, np.inf, 36, np.inf]
    assert np.array(bounds.controls[0]).tolist() == [-5, -5]
    found = rates(problem.model, [0, 1, 0, 2], [3, 4], [])
    assert found == pytest.approx([1, 2.9, 2, 3.6])


def test_a_place_bars_what_has_no_value_there_and_definitions_with_it() -> None:
    more = "signals: {s: time}\ndefinitions: {d: a + x, e: 2*d, f: x, g: s}\n"
    scenario = scenario_of(ALONE.format(more=more))
    (member,) = members_of(scenario, shared_of(scenario))
    everything = {"slot", "width", "x", "v", "a", "s", "d", "e", "f", "g", "time"}
    everything |= {"previous(a)"}
    before = {"previous(a)": "previous control"}
    at_end = {"a": "control", "d": "", "e": ""} | before
    for place, barred in (
        ("rate", before),
        ("next", before),
        ("stage_cost", before),
        ("step_cost", {}),
        ("path", {}),
        ("initial_cost", at_end),
        ("terminal_cost", at_end),
        ("terminal", at_end),
    ):
        scope = member.scopes[place]
        said = {
            name: word or "definition with a control" for name, word in barred.items()
        }
        assert scope.names.keys() == everything - barred.keys()
        assert {name: scope.elsewhere[name] for name in barred} == said


def test_the_cost_of_several_is_the_sum_of_theirs() -> None:
    problem = posed(ALONE.format(more=f"vehicles:\n{TWO}"))
    f = ca.Function(
        "f", [problem.model.states, problem.model.controls], [problem.stage_cost]
    )
    assert float(f([3, 0, 30, 0], [1, 2])) == pytest.approx(4 + 0.1 + 1 + 0.4)


def test_every_two_vehicles_and_all_that_are_seen_keep_the_distance() -> None:
    three = "  members: [{name: a}, {name: b}, {name: c}]\n" + APART.split("\n", 1)[1]
    text = ALONE.format(more=f"vehicles:\n{three}")
    names = [str(c.name) for c in posed(text).path_constraints]
    pairs = [name for name in names if name.startswith("distance")]
    assert pairs == ["distance_a_b", "distance_a_c", "distance_b_c"]
    scenario = scenario_of(text)
    a, *others = members_of(scenario, shared_of(scenario))
    seeing = planning_problem(scenario, [a], seen=others)
    pairs = [c.name for c in seeing.path_constraints if c.name.startswith("distance")]
    assert pairs == ["distance_b_a", "distance_c_a"]
    assert [str(one) for one in ca.vertsplit(seeing.signals)] == [
        "position_b",
        "position_c",
    ]


def test_a_disturbed_model_has_its_disturbances_as_last_parameters() -> None:
    text = ALONE.format(more=f"vehicles:\n{TWO}").replace("rate: v,", "rate: k*v,")
    text += "parameters: {k: 2}\nplant: {disturbance: {v: 1}}\n"
    scenario = scenario_of(text)
    members = members_of(scenario, shared_of(scenario))
    model = model_of(scenario, members, disturbed=True)
    found = rates(model, [0, 1, 0, 1], [0, 0], [3, 10, 20])
    assert found == pytest.approx([3, 9.9, 3, 19.9])
    assert model_of(scenario, members).np == 1


def test_the_largest_of_a_value_is_where_its_negative_is_least() -> None:
    least = POINT.format(start=0, cost="x + w**2 + (u - 1)**2", more="")
    largest = least.replace("x + w**2 + (u - 1)**2", "-(x + w**2 + (u - 1)**2)")
    by_value = planned(largest + "maximize: true\nterminal_cost: -y**2\n")
    by_cost = planned(least + "terminal_cost: y**2\n")
    np.testing.assert_allclose(by_value[0], by_cost[0], atol=1e-9)


def test_a_distance_of_at_most_is_kept() -> None:
    cost = "(x - 5)**2 + (y - 5)**2"
    path = "path: [{distance: [x, y - 1], at_most: r, margin: 0.25}]\n"
    text = POINT.format(start=0, cost=cost, more=path + "constants: {r: 1.5}\n")
    _, (x, y) = planned(text)
    far = np.hypot(x, y - 1)
    assert far.max() == pytest.approx(1.25, abs=1e-4)  # The cost pulls it outward.


@pytest.mark.parametrize("along", ["points", "segments"])
def test_a_distance_of_at_least_is_kept_with_its_margin(along: str) -> None:
    cost = "(x - 3)**2 + (y - 0.1)**2"
    path = "path: [{distance: [x - 1.5, y], at_least: 1, along: AS, margin: 0.1}]\n"
    more = path.replace("AS", along) + "feedback: {repair: false}\nlanes: 0\n"
    text = POINT.format(start=0, cost=cost, more=more)
    _, (x, y) = planned(text.replace("u: 0.1, w: 0.1", "u: 2, w: 1"))
    assert np.hypot(x - 1.5, y).min() == pytest.approx(1.1, abs=1e-5)
    assert x[-1] > 2.2


def test_equal_bounds_hold_a_control() -> None:
    text = POINT.format(start=0, cost="(x - 5)**2 + y**2", more="")
    (u, w), _ = planned(text.replace("w: {bounds: [-3, 3]}", "w: {bounds: [0.5, 0.5]}"))
    assert w == pytest.approx(0.5)
    assert u == pytest.approx(3, abs=1e-6)


def test_equal_bounds_hold_a_state() -> None:
    text = POINT.format(start=0.25, cost="(x - 5)**2 + (y - 1)**2", more="")
    (u, _), (x, y) = planned(text.replace("rate: u}", "rate: u, bounds: [1/4, 1/4]}"))
    assert x == pytest.approx(0.25, abs=1e-5) and u == pytest.approx(0, abs=1e-4)
    assert y[-1] > 0.5


@pytest.mark.parametrize(
    ("limits", "end"),
    [
        ("", 0.0),
        (", equals: 0.5", 0.5),
        (", upper: 0.75", 0.75),
        (", lower: 0.25, upper: 0.6", 0.6),
        (", lower: 1.75", 1.75),
    ],
)
def test_a_terminal_constraint_holds_at_the_end(limits: str, end: float) -> None:
    """Without a constraint x goes to 1, and y anywhere."""
    terminal = f"terminal: [{{expression: x{limits}}}]\n"
    text = POINT.format(start=0, cost="u**2 + w**2", more=terminal)
    _, (x, _) = planned(text + "terminal_cost: 1000*(x - 1)**2\n")
    assert x[-1] == pytest.approx(end, abs=1e-5)


def test_a_constraint_is_called_as_named_or_as_its_expression() -> None:
    more = (
        "path: [{expression: 2*x, upper: 9}, {expression: x, upper: 9, name: wall}]\n"
    )
    alone = posed(ALONE.format(more=more))
    assert {"2*x", "wall"} <= {c.name for c in alone.path_constraints}
    several = posed(ALONE.format(more=f"{more}vehicles:\n{TWO}"))
    names = {c.name for c in several.path_constraints}
    assert {"2*x_a", "wall_a", "2*x_b", "wall_b"} <= names


def test_a_path_constraint_holds_between_its_limits() -> None:
    path = "path: [{expression: u + w, lower: -1, upper: 0.5}]\n"
    (u, w), _ = planned(POINT.format(start=0, cost="(x - 5)**2 + u*w", more=path))
    assert (u + w).max() < 0.5 + 1e-6
    assert u.max() > 2.9


def test_a_soft_limit_is_broken_as_far_as_that_pays() -> None:
    """u^2 - 4 u with 1 e + 2 e^2 above 1: least where 2 u - 4 + 1 + 4 (u - 1) = 0."""
    soft = "constants: {k: 2}\npath: [{expression: u, upper: 1, soft: SOFT}]\n"
    text = POINT.format(start=0, cost="u**2 - 4*u + w**2", more=soft)
    both = text.replace("SOFT", "{weight: 1, quadratic: k}")
    np.testing.assert_allclose(planned(both)[0][0], 7 / 6, rtol=1e-6)
    linear = text.replace("SOFT", "{weight: 1}")
    np.testing.assert_allclose(planned(linear)[0][0], 1.5, rtol=1e-6)
    assert not posed(both).stated and posed(both).slacks == 1


@pytest.mark.parametrize(
    ("told", "found"), [("", 1e-6), (", integrator_tolerance: 1.0e-4", 1e-4),
                        (", integrator_tolerance: null", None)],
)  # fmt: skip
def test_tolerance_of_stiff_steps_reaches_the_problem(
    told: str, found: float | None
) -> None:
    text = ALONE.format(more="").replace(
        "intervals: 10", f"intervals: 10, integrator: stiff{told}"
    )
    problem = posed(text)
    assert problem.integrator_tolerance == found
    assert problem.is_adaptive == (found is not None)
