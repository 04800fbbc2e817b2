"""A problem's file needs little, and means the same in each way of writing it."""

from pathlib import Path

import numpy as np
import pytest

from swarmstart.cases.campaign.running.finished_run import Run
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.kinds.problem.stated.scenario import EVALUATIONS
from swarmstart.cases.record.record import Recording
from swarmstart.tests.cases.kinds.problem.conftest import (
    PENDULUM,
    scenario_of,
    simulated,
    stated,
)

LINE = """\
kind: problem
states: {x: {start: 0, rate: u}}
controls: {u: {bounds: [-2, 2]}}
stage_cost: (u - sin(3*x) - 1)**2
prediction: {horizon_s: 1, intervals: 4}
budget: {evaluations: 200}
"""


def recorded(folder: Path) -> Run:
    recording = Recording(folder=folder, figures=False)
    return run(stated(LINE), seed=0, recording=recording)


def test_what_is_not_given_has_a_default() -> None:
    scenario = scenario_of(PENDULUM)
    assert (scenario.search.name, scenario.polish) == ("lshade", "ipopt")
    assert scenario.budget.evaluations == EVALUATIONS
    assert (scenario.steps, scenario.title) == (50, "")
    assert scenario.feedback.law == "open_loop"


def test_feedback_may_be_its_law_alone() -> None:
    short = scenario_of(PENDULUM + "feedback: receding_horizon")
    long = scenario_of(PENDULUM + "feedback: {law: receding_horizon}")
    assert short == long
    assert short.feedback.law == "receding_horizon"


def test_numbers_are_expressions_with_the_same_bits() -> None:
    text = "constants: {a: 0.1, b: 1e-320, c: 3, d: -7.25e10}"
    given = scenario_of(LINE + text).constants
    assert [float(one) for one in given.values()] == [0.1, 1e-320, 3.0, -7.25e10]


@pytest.mark.parametrize("value", ["true", "1e400*1", "1e301", "[1]", '"1 +"'])
def test_what_is_no_finite_number_or_expression_is_refused(value: str) -> None:
    with pytest.raises(InvalidScenarioError):
        stated(f"{LINE}constants: {{a: {value}}}")


NUMBER = "a number, or an expression such as pi/18"
EXPRESSION = "a number, or an expression such as 2*x"


@pytest.mark.parametrize(
    ("part", "other", "key", "what", "found"),
    [
        ("start: 0", "start: [1]", "states.x.start", NUMBER, "[1]"),
        ("start: 0", "start: {a: 1}", "states.x.start", NUMBER, '{"a": 1}'),
        ("2]}", "2], delay_s: [0.4]}", "controls.u.delay_s", NUMBER, "[0.4]"),
        ("2]}", "2], scale: true}", "controls.u.scale", NUMBER, "true"),
        ("2]}", "2], previous: 2e30}", "controls.u.previous", "at most 1e+30", "2e+30"),
        ("[-2, 2]", "[-2, -2e30]", "controls.u.bounds.1", "at least -1e+30", "-2e+30"),
        ("rate: u", "rate: [u]", "states.x.rate", EXPRESSION, '["u"]'),
        ("[-2, 2]", "[true, 2]", "controls.u.bounds.0", EXPRESSION, "true"),
        ("kind:", "measures: {a: 3}\nkind:", "measures.a",
         "an expression such as max(x)", "3"),
        ("rate: u", "rate: u, unit: 5", "states.x.unit", "text: put it in quotes", "5"),
    ],
)  # fmt: skip
def test_what_a_key_takes_is_said(
    part: str, other: str, key: str, what: str, found: str
) -> None:
    with pytest.raises(InvalidScenarioError) as caught:
        scenario_of(LINE.replace(part, other, 1))
    assert f": expected {key} to be {what}; found {found}" in str(caught.value)


def test_a_record_as_guess_is_the_same_as_its_plan_as_a_table(tmp_path: Path) -> None:
    done = run(
        stated(LINE), seed=0, recording=Recording(folder=tmp_path, figures=False)
    )
    plan = done.trajectory.decisions[0].plans[0].controls[0]
    table = f"{{times: [0, 0.25, 0.5, 0.75], values: {plan.tolist()}}}"
    from_record = scenario_of(f"{LINE}guess: {{record: {tmp_path}}}")
    from_table = scenario_of(f"{LINE}guess: {{controls: {{u: {table}}}}}")
    assert from_record == from_table
    assert np.ptp(plan) > 0.1


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("guess: {record: FOLDER, states: {x: 0}}", "expected record alone"),
        ("guess: {record: FOLDER}\nvehicles: {members: [{name: a}]}", "record alone"),
        ("guess: {record: 3}", "to be a folder, found 3"),
    ],
)
def test_a_record_that_cannot_be_the_guess_is_refused(
    tmp_path: Path, more: str, words: str
) -> None:
    recorded(tmp_path)
    with pytest.raises(InvalidScenarioError, match=words):
        stated(LINE + more.replace("FOLDER", str(tmp_path)))


def test_a_record_of_other_controls_is_refused(tmp_path: Path) -> None:
    recorded(tmp_path)
    two = LINE.replace("controls: {u:", "controls: {w: {bounds: [0, 1]}, u:")
    with pytest.raises(InvalidScenarioError, match="plan of 2 controls; found 1"):
        stated(f"{two}guess: {{record: {tmp_path}}}")


def test_a_grid_set_on_the_command_line_has_as_many_steps() -> None:
    assert stated(LINE, "prediction.intervals=8").scenario.steps == 8


def test_the_same_file_and_seed_give_the_same_path() -> None:
    first, second = (simulated(LINE, seed=3)[0].dense_states for _ in range(2))
    assert first.tolist() == second.tolist()
