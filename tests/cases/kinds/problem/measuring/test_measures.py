"""Own measures equal closed forms on paths that are known."""

import math

import numpy as np
import pytest

from swarmstart.cases.format.kind import NEVER
from swarmstart.cases.kinds.problem.measuring.measures import own_values
from swarmstart.tests.cases.kinds.problem.conftest import PENDULUM, simulated, stated

RAMP = """\
kind: problem
constants: {{half: 1/2}}
parameters: {{gain: 2}}
signals: {{wind: time}}
states:
  x: {{start: 1, rate: gain*u}}
controls:
  u: {{}}
stage_cost: {stage}
terminal_cost: x
path: [{{expression: x, upper: 4, name: ceiling}}]
terminal: [{{expression: x, equals: 4}}]
prediction: {{horizon_s: 2, intervals: 2, quadrature: left}}
guess: {{controls: {{u: {{times: [0, 1], values: [1, 0.5], between: hold}}}}}}
search: {{name: none}}
lanes: 0
ipopt: {{max_iterations: 1}}
budget: {{evaluations: 1}}
{more}
"""
"""x' = 2u with u = 1, then 0.5: x = 1 + 2t up to 3, then 2 + t up to 4."""


def measured(measure: str, *, stage: str = "0", more: str = "") -> float | None:
    own = f"measures:\n  own: {measure}\n{more}"
    _, found = simulated(_held(RAMP.format(stage=stage, more=own)))
    value = found["own"]
    assert value is None or isinstance(value, float)
    return value


def _held(text: str) -> str:
    """Return the problem with a cost that keeps the controls at their guess."""
    return text.replace(
        "stage_cost: 0", "stage_cost: (u - 1 + 0.5*wind_step)**2"
    ).replace(
        "signals: {wind: time}",
        "signals:\n  wind: time\n"
        "  wind_step: {times: [0, 1], values: [0, 1], between: hold}",
    )


@pytest.mark.parametrize(
    ("measure", "expected"),
    [
        ("x.end", 4.0),
        ("x.start", 1.0),
        ("u.start", 1.0),
        ("u.end", 0.5),
        ("integral(u**2)", 1.25),
        ("integral(x)", 5.5),
        ("integral(1)", 2.0),
        ("integral(wind)", 2.0),
        ("integral(gain*u)", 3.0),
        ("mean(u)", 0.75),
        ("max(x)", 4.0),
        ("min(x - u)", 0.0),
        ("max(x, 2).start", 2.0),
        ("half*max(x)**2", 8.0),
        ("time.end", 2.0),
        ("settling(x, 4, 0.47)", 1.55),
        ("settling(x, 4, 5)", 0.0),
        ("overshoot(x, 3.5)", 0.5),
        ("overshoot(x, 5)", 0.0),
        ("overshoot(x, 0.5)", 0.0),
        ("overshoot(x - 2, 1.5)", 0.5),
        ("overshoot(-x, -3)", 1.0),
        ("sqrt(x.end)", 2.0),
    ],
)
def test_a_measure_is_its_closed_form(measure: str, expected: float) -> None:
    assert measured(f'"{measure}"') == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    "measure", ["settling(x, 9, 1)", "sqrt(-x.end)", "1/(x.end - 4)"]
)
def test_a_measure_without_a_finite_value_is_null(measure: str) -> None:
    value = measured(f'"{measure}"')
    assert value is None or abs(value) > 1e5  # x.end is 4 up to rounding.


def test_what_never_settles_is_above_every_bound() -> None:
    resolved = stated(
        RAMP.format(stage="u**2", more='measures: {s: "settling(x, 9, 1)"}')
    )
    assert resolved.kind.undefined_of(resolved.scenario)["s"] == "never"


def test_the_cost_of_the_path_is_integrated_between_the_checks() -> None:
    _, found = simulated(RAMP.format(stage="x*u + u", more=""))
    path, _ = simulated(RAMP.format(stage="x*u + u", more=""))
    t = path.dense_times
    u = np.repeat(path.controls[0], 20)
    x = path.dense_states[0]
    mean = (x[1:] + x[:-1]) / 2  # exact: x is linear in each step
    expected = float(np.sum((mean * u + u) * np.diff(t)) + x[-1])
    assert found["flown_cost"] == pytest.approx(expected, rel=1e-12)


def test_a_maximum_is_told_as_one() -> None:
    text = RAMP.format(stage="-u**2", more="maximize: true")
    _, largest = simulated(text)
    _, least = simulated(
        RAMP.format(stage="u**2", more="").replace("cost: x", "cost: -x")
    )
    for name in ("cost", "verified_cost", "flown_cost"):
        assert largest[name] == pytest.approx(-least[name])  # type: ignore[operator]


def test_excesses_are_those_of_the_flown_path() -> None:
    """The plant has twice the gain: x ends at 7, 3 above the ceiling and the end."""
    _, found = simulated(
        _held(RAMP.format(stage="0", more="plant: {parameters: {gain: 4}}"))
    )
    assert found["constraint_excess"] == pytest.approx(3.0, abs=1e-4)
    assert found["terminal_excess"] == pytest.approx(3.0, abs=1e-4)
    assert math.isclose(float(found["cost"]), 4.0, rel_tol=1e-4)  # type: ignore[arg-type]


def test_constants_of_a_vehicle_end_with_its_name() -> None:
    text = RAMP.format(
        stage="u**2",
        more="vehicles:\n"
        "  members: [{name: a, constants: {half: 3, own: 7}}, {name: b}]\n"
        "measures: {a: half_a*x_a.start, b: half_b, file: half, own: own_a}\n",
    )
    _, found = simulated(text)
    own = [found[name] for name in ("a", "b", "file", "own")]
    assert own == [3.0, 0.5, 0.5, 7.0]


def test_what_holds_has_no_excess() -> None:
    _, found = simulated(_held(RAMP.format(stage="0", more="")))
    assert found["constraint_excess"] == pytest.approx(0, abs=1e-4)
    assert found["terminal_excess"] == pytest.approx(0, abs=1e-4)


def test_a_value_that_is_not_a_number_is_not_settled_and_not_within() -> None:
    assert measured("settling(sqrt(2 - x), 0, 9)") is None
    assert measured("overshoot(sqrt(2 - x), 0)") is None


def test_only_a_settling_time_itself_is_above_every_bound_if_it_is_never() -> None:
    """`9 - settling(...)` would hold any lower bound by not being defined."""
    text = (
        PENDULUM
        + "measures: {a: 'settling(angle, 0, 1)', b: '9 - settling(angle, 0, 1)'}"
    )
    resolved = stated(text)
    reasons = resolved.kind.own_measures(resolved.scenario)
    assert reasons["a"] == NEVER != reasons["b"]


def test_claims_are_of_as_many_steps_as_the_prediction_has_unless_given() -> None:
    """A shorter flight judges none of them."""
    claim = (
        "claims: [{id: a, text: a, source: a, measure: cost, relation: <, bound: 1}]"
    )
    (judged,) = stated(PENDULUM + claim, "steps=2").scenario.claims
    assert judged.when == {"steps": 50}


def test_own_and_decided_measures_have_a_meaning() -> None:
    text = PENDULUM.replace("speed: {start: 0", "speed: {start: {free: [0, 1]}")
    text += "measures: {late: angle.end +\n  1}\n"
    resolved = stated(text)
    found = resolved.kind.meanings_of(resolved.scenario)
    assert list(found) == resolved.kind.measures_of(resolved.scenario)
    assert found["decided_speed"] == (
        "Initial value of the state speed that the first plan decides [rad/s]"
    )
    assert found["late"] == "Measure of this scenario: angle.end + 1"


def test_measures_of_a_flight_that_begins_later_are_of_its_own_time() -> None:
    """From 3 s to 5 s: the mean of time is 4, and settling counts from 3 on."""
    times = np.array([[3.0, 3.5, 4.0], [4.0, 4.5, 5.0]])
    path = {"time": times, "x": np.where(times < 4.2, 1.0, 0.0)}
    asked = {"m": "mean(time)", "i": "integral(time)", "s": "settling(x, 0, 0.1)"}
    assert own_values(asked, path) == {"m": 4.0, "i": 8.0, "s": 4.5}
