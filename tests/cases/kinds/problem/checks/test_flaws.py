"""Every error of a problem is reported at its place, in the file's own words."""

import re
from collections.abc import Callable

import pytest

from swarmstart.tests.cases.kinds.problem.conftest import PENDULUM, stated

Refused = Callable[[str, str], str]


@pytest.mark.parametrize(
    ("part", "other", "place", "words"),
    [
        ("rate: speed", "rate: sped", "4:27", "did you mean 'speed'?"),
        ("torque - g*", "torqe - g*", "5:27", "did you mean 'torque'?"),
        ("g*sin(angle)", "g*sine(angle)", "5:38", "did you mean 'sin'?"),
        ("stage_cost", "stagecost", "8:1", "did you mean 'stage_cost'?"),
        ("expression: speed", "expression: torque", "9:51", "no control in terminal"),
        ("[-8, 8]", "[8, -8]", "7:20", "lower <= upper, found [8, -8]"),
        ("{bounds: [-8, 8]}", "{}", "7:11", "expected bounds of the control"),
        ("[-8, 8]", "[-8, null]", "7:20", "expected bounds of the control"),
        ("[-8, 8]", "[-8, 8, 9]", "7:20", "at most 2"),
        ("[-8, 8]", "[-8,5, 8]", "7:20", "if -8,5 is one number, write -8.5"),
        ("stage_cost", "lagrange", "8:1", "did you mean 'stage_cost'?"),
        ("stage_cost", "objective", "8:1", "'stage_cost' or 'terminal_cost'?"),
        ("{start: 0, rate: speed", "{x0: 0, rate: speed", "4:11", "mean 'start'?"),
        ("rate: speed", "ode: speed", "4:21", "did you mean 'rate'?"),
        ("rate: speed", "end: 0", "4:21", "'terminal' at the top of the file?"),
        ("intervals: 50", "N: 50", "10:28", "did you mean 'intervals'?"),
        ("g: 9.81", "g: 9.81, angle: 2", "4:10", "it is among the constants"),
        ("g: 9.81", "g: 9.81, time: 2", "2:28", "it has a meaning of its own"),
        ("g: 9.81", "g: 9.81/0", "2:16", "finite real value"),
        ("g: 9.81", "g: h, h: 2", "2:16", "unknown name 'h'"),
        ("stage_cost: torque**2\n", "", "1:1", "expected a cost, one of stage_cost"),
        ("{start: 0, rate: speed", "{rate: speed", "4:10", "expected the key 'start'"),
        ("unit: rad/s", "bounds: [1, 2]", "5:18", "within the bounds [1, 2], found 0"),
        ("unit: rad/s", "bounds: [-2, -1]", "5:18", "within the bounds [-2, -1]"),
        ("intervals: 50", "intervals: 50.5", "10:39", "an integer"),
        ("vals: 50", "vals: 50, checks: 99, substeps: 99", "10:13", "at most 40000 op"),
        ("vals: 50", "vals: 5000, checks: 3", "10:13", "at most 10000 checks"),
    ],
)
def test_what_is_wrong_is_said_where_it_stands(
    refused: Refused, part: str, other: str, place: str, words: str
) -> None:
    message = refused(part, other)
    assert message.startswith(f"stated.yaml:{place}: ")
    assert words in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("constraints: []", "did you mean 'path' or 'terminal'?"),
        ("dynamics: 3", "did you mean 'rate' of 'states'?"),
        ("horizon: 3", "did you mean 'horizon_s' of 'prediction'?"),
        ("path: [speed <= 1]", "with the key 'distance' or 'expression'; found"),
        ("steps: 60", "at most prediction.intervals = 50"),
        ("guess: {controls: {torq: 1}}", "did you mean 'torque'?"),
        ("guess: {controls: {zzz: 1}}", "found 'zzz'; known: torque"),
        ("path: [{expression: torque, lower: 2, upper: 1}]", "lower"),
        ("path: [{distance: [angle], at_least: -1}]", "distance"),
        ("guess: {states: {angel: 1}}", "did you mean 'angle'?"),
        ("plant: {parameters: {g: 3}}", "expected a parameter, found 'g'"),
        ("plant: {disturbance: {torque: 3}}", "expected a state, found 'torque'"),
        ("candidates: [{}]", "expected the key 'torque'"),
        ("candidates: [{torque: speeed}]", "unknown name 'speeed'"),
        ("candidates: [{torque: 1/time}]", "finite real value"),
        ("vehicles: {members: [{name: a, constants: {h: 1}}]}\nsignals: {s: h}", "'h'"),
        ("dual_mode: {at: {angle: 0}, Q: {}, R: {torque: 1}}", "the key 'speed'"),
        ("measures: {a: angle}", "expected one number, such as x.end"),
        ("measures: {a: max(speeed)}", "did you mean 'speed'?"),
        ("measures: {cost: angle.end}", "a measure of any problem"),
        ("definitions: {a: b, b: angle}", "unknown name 'b'"),
        (
            "definitions: {energy: torque*speed}\nterminal_cost: energy",
            "no definition with a control",
        ),
        ("signals: {s: time}\nparameters: {p: s}", "unknown name 's'"),
        ("guess: {record: nowhere}", "folder of a run, found 'nowhere'"),
        ("parameters: {p: {times: [0, 0], values: [1, 2]}}", "times that increase"),
        ("parameters: {p: {times: [0, 1], values: [1]}}", "as many values as times"),
        ("path: [{expression: angle, equals: 1, lower: 0}]", "found both"),
        ("path: [{expression: angle, upper: 1, soft: {}}]", "found neither"),
        ("path: [{expression: angle, upper: 1, soft: {weight: -1}}]", "at least 0"),
        ("path: [{expression: angle, upper: 1, soft: {quadratic: kk}}]", "'kk'"),
        ("path: [{distance: [angle, speed]}]", "either at_least or at_most"),
        (
            "path: [{expression: angle, at_most: 1}]",
            "'at_most'; of an expression write upper",
        ),
        (
            "path: [{distances: [angle], at_least: 1}]",
            "'at_least'; it goes with other keys than those that are given",
        ),
        (
            "claims: [{id: a, text: a, source: a, measure: b, relation: <, bound: 1}]",
            "b",
        ),
    ],
)
def test_parts_that_do_not_go_together_are_refused(more: str, words: str) -> None:
    with pytest.raises(ValueError, match=r"^stated\.yaml:") as caught:
        stated(PENDULUM + more)
    assert words in str(caught.value)


def test_a_control_at_the_end_is_refused_as_one() -> None:
    text = PENDULUM + "initial_cost: torque"
    words = "expected no control in initial_cost, found 'torque'"
    with pytest.raises(ValueError, match=words):
        stated(text)


def test_a_definition_may_stand_where_all_that_it_uses_may() -> None:
    text = PENDULUM + "definitions: {sway: sin(angle)}\nterminal_cost: sway"
    stated(text)


@pytest.mark.parametrize("limit", ["at_least: 0.1", "at_most: 9, margin: 0.5"])
def test_a_distance_may_be_of_any_expressions(limit: str) -> None:
    stated(PENDULUM + f"path: [{{distance: [angle + 1, torque - 20], {limit}}}]")


def test_everything_wrong_with_names_is_said_at_once() -> None:
    text = PENDULUM.replace("rate: speed", "rate: a").replace("torque**2", "b")
    with pytest.raises(ValueError, match="'a'") as caught:
        stated(text)
    assert "'b'" in str(caught.value)


def test_a_control_may_be_unbounded_without_a_search() -> None:
    stated(PENDULUM.replace("{bounds: [-8, 8]}", "{}") + "search: {name: none}")


def test_a_problem_is_called_as_its_file_unless_it_says_otherwise() -> None:
    assert stated(PENDULUM).scenario.name == "stated"
    assert stated(PENDULUM + "name: swing").scenario.name == "swing"


def test_steps_are_those_of_the_prediction_unless_given() -> None:
    assert stated(PENDULUM).scenario.steps == 50
    assert stated(PENDULUM + "steps: 3").scenario.steps == 3


VEHICLES = """\
kind: problem
constants: {slot: 1}
states: {x: {start: 0, rate: u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: u**2
prediction: {horizon_s: 1, intervals: 2}
vehicles: {members: [{name: a, constants: {own: 2, slot: 5}}, {name: b}]}
"""


@pytest.mark.parametrize(
    "more",
    [
        "parameters: {p: own}",
        "guess: {controls: {u: own}}",
        "guess: {states: {x: own}}",
        "plant: {disturbance: {x: own}}",
        "candidates: [{u: own}]",
        "candidates: [{u: x}]",
        "measures: {m: own*x_a.end}",
    ],
)
def test_a_constant_of_one_vehicle_is_unknown_where_others_need_it(more: str) -> None:
    with pytest.raises(ValueError, match=r"^stated\.yaml:8:\d+: .* unknown name"):
        stated(VEHICLES + more)


def test_a_candidate_may_use_what_its_vehicles_know() -> None:
    stated(f"{VEHICLES}parameters: {{p: time}}\ncandidates: [{{u: slot*p + time}}]")


@pytest.mark.parametrize("planning", ["joint", "priority"])
def test_others_see_states_and_no_expressions(planning: str) -> None:
    more = "feedback: receding_horizon"
    text = VEHICLES.replace(
        "vehicles: {", f"vehicles: {{planning: {planning}, separation: SEPARATION, "
    )
    stated(text.replace("SEPARATION", "{of: [x], distance: 1}") + more)
    twice = text.replace("SEPARATION", "{of: [2*x], distance: 1}") + more
    if planning == "joint":
        stated(twice)
    else:
        with pytest.raises(ValueError, match=r"expected a state, found '2\*x'"):
            stated(twice)


def test_an_interval_has_as_many_operations_as_are_allowed_and_no_more() -> None:
    def with_substeps(count: int) -> str:
        return PENDULUM.replace("intervals: 50", f"intervals: 50, substeps: {count}")

    with pytest.raises(ValueError, match="operations in an interval") as caught:
        stated(with_substeps(1000))
    found = re.search(r"at most (\d+) operations.*found (\d+):", str(caught.value))
    assert found is not None
    allowed, needed = map(int, found.groups())
    most = allowed // (needed // 1000)
    stated(with_substeps(most))
    with pytest.raises(ValueError, match="operations in an interval"):
        stated(with_substeps(most + 1))
    assert allowed == 40_000


def test_operations_of_stiff_steps_count_their_linear_equations() -> None:
    def stiff(substeps: int) -> str:
        own = f"intervals: 50, integrator: stiff, substeps: {substeps}"
        return PENDULUM.replace("intervals: 50", own)

    stated(stiff(100))
    with pytest.raises(ValueError, match="operations in an interval"):
        stated(stiff(1000))
