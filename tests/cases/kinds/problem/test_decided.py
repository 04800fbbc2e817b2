"""Decided end times, parameters and starts, previous controls, and discrete time."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.record.record import Recording
from swarmstart.cases.record.results import load
from swarmstart.ocp import (
    Bounds,
    Free,
    Model,
    OptimalControlProblem,
    Start,
    solve,
)
from swarmstart.tests.cases.kinds.problem.conftest import (
    PENDULUM,
    scenario_of,
    simulated,
    stated,
)

BEAD = """\
kind: problem
constants: {g: 9.8, far: 2}
states:
  x: {start: 0, rate: v*sin(slope)}
  y: {start: 0, rate: v*cos(slope)}
  v: {start: 0, rate: g*cos(slope), bounds: [0, null]}
controls: {slope: {bounds: [0, pi]}}
stage_cost: 1
terminal: [{expression: x, equals: far}, {expression: y, equals: far}]
prediction: {horizon_s: {free: [0.1, 5], guess: far/2}, intervals: 20}
search: {name: none}
"""
FASTEST = """\
kind: problem
states: {x: {start: 1, rate: v}, v: {start: 0, rate: force}}
controls: {force: {bounds: [-1, 1]}}
stage_cost: 1
terminal: [{expression: x}, {expression: v}]
prediction: {horizon_s: {free: [0.05, 5], guess: 3}, intervals: 20}
feedback: {law: receding_horizon, period_s: 0.3}
plant: {substeps: 30}
search: {name: none}
"""
BATCH = """\
kind: problem
states: {level: {start: 0, rate: inflow}}
controls: {inflow: {bounds: [-2, 2]}}
stage_cost: inflow**2
terminal: [{expression: level, equals: 3}]
prediction: {horizon_s: 3, intervals: 6}
feedback: {law: receding_horizon, ends_at_s: 3}
plant: {disturbance: {level: -0.2}}
search: {name: none}
"""
SWING = """\
kind: problem
parameters: {mean: {free: [-2, 2]}, drag: 0.2}
states:
  x: {start: {free: [-3, 3]}, rate: v, periodic: true}
  v: {start: {free: [-3, 3]}, rate: mean + u + sin(time) - x/2 - drag*v, periodic: true}
controls: {u: {bounds: [-2, 2]}}
stage_cost: u**2 + mean**2
initial_cost: 10*(x - 1)**2
prediction: {horizon_s: 2*pi, intervals: 20}
search: {name: none}
measures: {miss: abs(x.end - x.start) + abs(v.end - v.start), drift: mean.end}
"""


def test_decided_end_time_is_measured_and_flown_in_seconds() -> None:
    path, found = simulated(BEAD)
    assert found["end_time"] == pytest.approx(0.824884, abs=1e-6)
    assert found["cost"] == pytest.approx(found["end_time"])
    assert found["flown_cost"] == pytest.approx(found["end_time"])
    assert found["confirmed"] == found["converged"] == 1
    assert path.times[-1] == pytest.approx(found["end_time"])
    assert found["terminal_excess"] == pytest.approx(0, abs=1e-5)


def test_guess_of_the_end_time_stretches_what_is_guessed_over_time() -> None:
    text = BEAD + "guess: {controls: {slope: time}, states: {v: 9.8*time}}\n"
    (agent,) = pose(scenario_of(text)).agents
    start = agent.first
    assert isinstance(start, Start) and start.states is not None
    np.testing.assert_allclose(start.controls[0], np.arange(20) / 20)
    np.testing.assert_allclose(start.states[2], 9.8 * np.arange(21) / 20)


def test_receding_horizon_follows_a_decided_end_time_to_its_end(
    tmp_path: Path,
) -> None:
    resolved = stated(FASTEST)
    assert resolved.scenario.steps == 17  # 5 s in periods of 0.3 s.
    done = run(resolved, seed=0, recording=Recording(folder=tmp_path, figures=True))
    assert done.trajectory.times[-1] == pytest.approx(2.0, abs=2e-2)
    assert len(done.trajectory.decisions) == 7
    assert done.measures["end_time"] == pytest.approx(2.0, abs=1e-3)
    # |force| is 1 all along; its sign changes within a period.
    assert done.measures["flown_cost"] == pytest.approx(done.trajectory.times[-1])
    again = load(tmp_path).trajectory
    assert again is not None
    np.testing.assert_array_equal(again.times, done.trajectory.times)
    for one, other in zip(again.decisions, done.trajectory.decisions, strict=True):
        assert (one.dt, one.is_last) == (other.dt, other.is_last)
        np.testing.assert_array_equal(one.plans[0].x0, other.plans[0].x0)
        assert one.profile is not None and other.profile is not None
        assert one.profile.piece == other.profile.piece
    summary = json.loads((tmp_path / "run.json").read_text())
    assert summary["measures"]["end_time"] == done.measures["end_time"]
    assert "a_sheet.png" in summary["figures"]


def test_own_measures_see_the_controls_that_were_flown_within_a_period() -> None:
    path, found = simulated(FASTEST + "measures: {impulse: integral(force)}\n")
    assert found["impulse"] == pytest.approx(path.states[1, -1], abs=2e-2)


def test_decided_parameter_and_start_are_flown_and_measured() -> None:
    path, found = simulated(SWING)
    assert found["confirmed"] == 1
    assert found["decided_x"] == path.states[0, 0]
    assert found["decided_v"] == path.states[1, 0]
    assert found["decided_mean"] == pytest.approx(found["drift"])
    # The simulation follows the plan only with the decided parameter.
    assert found["miss"] == pytest.approx(0, abs=1e-4)
    assert found["terminal_excess"] == pytest.approx(0, abs=1e-4)
    assert found["flown_cost"] == pytest.approx(found["cost"], rel=1e-5)


def test_file_states_what_the_library_solves(tmp_path: Path) -> None:
    x, v, u, t, mean = (ca.SX.sym(n) for n in ("x", "v", "u", "t", "mean"))
    model = Model(
        states=ca.vertcat(x, v),
        controls=u,
        ode=ca.vertcat(v, mean + u + ca.sin(t) - x / 2 - 0.2 * v),
        parameters=mean,
        time=t,
    )
    problem = OptimalControlProblem(
        model,
        horizon=2 * np.pi,
        intervals=20,
        stage_cost=u**2 + mean**2,
        initial_cost=10 * (x - 1) ** 2,
        bounds=Bounds(controls=(-2, 2)),
        start={"x": Free(-3, 3), "v": Free(-3, 3)},
        periodic=["x", "v"],
        decided={"mean": Free(-2, 2)},
    )
    answer = solve(problem, [np.nan, np.nan], search=None, seed=0)
    found = simulated(SWING)[1]
    assert found["cost"] == pytest.approx(answer.cost, rel=1e-9)
    kept = load(answer.save(tmp_path / "answer")).summary["decided"]
    assert kept == answer.decided
    assert kept["mean"] == pytest.approx(found["decided_mean"], abs=1e-6)


def test_plant_may_have_another_parameter_than_is_decided() -> None:
    path, found = simulated(SWING + "plant: {parameters: {mean: 0.5}}\n")
    assert found["drift"] == 0.5 != found["decided_mean"]
    assert np.abs(path.states[:, -1] - path.states[:, 0]).max() > 0.01


def test_receding_horizon_flies_the_parameter_that_was_decided_last() -> None:
    text = """\
kind: problem
parameters: {gain: {free: [0.5, 2]}}
states: {x: {start: 1, rate: gain*u}}
controls: {u: {bounds: [-2, 2]}}
stage_cost: x**2 + u**2 + (gain - 1)**2
prediction: {horizon_s: 1, intervals: 5}
feedback: receding_horizon
steps: 3
search: {name: none}
measures: {slip: x.end - x.start - integral(gain*u)}
"""
    path, found = simulated(text)
    assert found["slip"] == pytest.approx(0, abs=1e-12)
    gains = [decision.decided["gain"] for decision in path.decisions]
    assert len(set(gains)) == 3
    assert found["decided_gain"] == gains[0]


def test_interrupted_run_with_a_decided_end_time_goes_on(tmp_path: Path) -> None:
    whole = run(stated(BEAD), seed=0)
    folder = Recording(folder=tmp_path, figures=False)
    stop = [0]

    def after_some(done: int, _: int, what: str) -> None:
        stop[0] += what == "solving"
        if stop[0] == 8:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(stated(BEAD), seed=0, recording=folder, progress=after_some)
    again = run(stated(BEAD), seed=0, recording=folder)
    assert again.resumed >= 6
    np.testing.assert_array_equal(
        again.trajectory.dense_states, whole.trajectory.dense_states
    )
    assert again.measures["verified_cost"] == whole.measures["verified_cost"]


MOVES = """\
kind: problem
states: {x: {start: 0, rate: u}}
controls: {u: {bounds: [-2, 2]PREVIOUS}}
stage_cost: (x - 3)**2
path: [{expression: u - previous(u), upper: 0.25, name: moves}]
prediction: {horizon_s: 1, intervals: 5}
plant: {substeps: 2}
search: {name: none}
"""


@pytest.mark.parametrize("law", ["open_loop", "receding_horizon"])
@pytest.mark.parametrize(("first", "given"), [(0.0, ""), (0.5, ", previous: 1/2")])
def test_moves_of_a_control_are_limited_from_the_first_on(
    law: str, first: float, given: str
) -> None:
    text = MOVES.replace("PREVIOUS", given) + f"feedback: {law}\n"
    path, found = simulated(text)
    moves = np.diff(path.controls[0], prepend=first)
    np.testing.assert_allclose(moves, 0.25, atol=1e-4)
    assert found["constraint_excess"] == pytest.approx(0, abs=1e-4)


def test_cost_of_moves_is_counted_once_an_interval() -> None:
    text = MOVES.replace("PREVIOUS", ", previous: 1")
    text += (
        "step_cost: 3*(u - previous(u))**2\nmeasures: {miss: integral((x - 3)**2)}\n"
    )
    path, found = simulated(text)
    moves = np.diff(path.controls[0], prepend=1.0)
    spent = float(found["miss"]) + 3 * float((moves**2).sum())  # type: ignore[arg-type]
    assert found["flown_cost"] == pytest.approx(spent)
    assert found["cost"] == pytest.approx(spent)


STOCK = """\
kind: problem
states: {stock: {start: 5, next: stock + order - 4, bounds: [0, 20]}}
controls: {order: {bounds: [0, 10]}}
step_cost: stock + order**2/8
prediction: {intervals: 6}
search: {name: none}
measures: {mean_stock: mean(stock), last: stock.end, most: max(stock)}
"""


def test_discrete_time_model_steps_once_an_interval() -> None:
    path, found = simulated(STOCK)
    stock = [5.0]
    for order in path.controls[0]:
        stock.append(stock[-1] + order - 4)
    np.testing.assert_allclose(path.states[0], stock)
    np.testing.assert_allclose(path.times, np.arange(7))
    spent = sum(stock[:-1]) + float((path.controls[0] ** 2).sum()) / 8
    assert found["cost"] == pytest.approx(spent)
    assert found["flown_cost"] == pytest.approx(spent)
    assert found["mean_stock"] == pytest.approx(np.mean(stock[:-1]))
    assert found["last"] == stock[-1]
    assert found["confirmed"] == 1


def test_stage_cost_of_a_discrete_time_model_is_a_sum() -> None:
    by_step = simulated(STOCK)[1]
    by_stage = simulated(STOCK.replace("step_cost", "stage_cost"))[1]
    for name in ("cost", "flown_cost", "verified_cost"):
        assert by_stage[name] == pytest.approx(by_step[name])


def test_definition_with_a_previous_control_is_measured() -> None:
    text = MOVES.replace("PREVIOUS", ", previous: 1/4").replace(
        "u - previous(u)", "move"
    )
    text += "definitions: {move: u - previous(u)}\n"
    path, found = simulated(
        text + "measures: {most: max(move), sum: move.start + move.end}\n"
    )
    moves = np.diff(path.controls[0], prepend=0.25)
    assert found["most"] == pytest.approx(moves.max())
    assert found["sum"] == pytest.approx(moves[0] + moves[-1])


def test_state_with_a_rate_may_jump_and_others_may_not() -> None:
    text = """\
kind: problem
states:
  x: {start: 1, rate: -x, next: x + u}
  y: {start: 2, rate: -y}
  last: {start: 0, next: u}
controls: {u: {bounds: [0.5, 0.5]}}
stage_cost: x**2
prediction: {horizon_s: 2, intervals: 2}
search: {name: none}
"""
    path, found = simulated(text)
    kept = np.exp(-1)
    x = [1, kept + 0.5, (kept + 0.5) * kept + 0.5]
    np.testing.assert_allclose(path.states[0], x, rtol=1e-6)
    np.testing.assert_allclose(path.states[1], 2 * kept ** np.arange(3), rtol=1e-6)
    np.testing.assert_allclose(path.states[2], [0, 0.5, 0.5])
    own = sum(v**2 * (1 - kept**2) / 2 for v in x[:2])
    assert found["flown_cost"] == pytest.approx(own, rel=1e-5)


def test_time_and_signals_may_stand_in_rates_and_costs() -> None:
    text = """\
kind: problem
signals: {wind: 2*time}
states: {x: {start: 0, rate: wind + time}}
controls: {u: {bounds: [0, 0]}}
stage_cost: time**2
terminal_cost: x + time
terminal: [{expression: x - time, lower: 0.5}]
path: [{distance: [x + time + 1], at_least: 0.5}, {expression: time, upper: 2}]
prediction: {horizon_s: 2, intervals: 4}
search: {name: none}
"""
    path, found = simulated(text)
    assert path.states[0, -1] == pytest.approx(6)
    assert found["cost"] == pytest.approx(8 / 3 + 6 + 2)
    assert found["flown_cost"] == pytest.approx(8 / 3 + 6 + 2)
    assert found["constraint_excess"] == found["terminal_excess"] == 0


def test_vehicles_that_plan_one_by_one_may_depend_on_time() -> None:
    text = """\
kind: problem
states: {x: {start: 0, rate: u + time}, y: {start: 0, rate: u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: (x - time**2)**2
vehicles:
  members: [{name: a}, {name: b, start: {y: 5}}]
  planning: priority
  separation: {of: [x, y], distance: 1}
prediction: {horizon_s: 1, intervals: 4}
feedback: receding_horizon
steps: 2
search: {name: none}
"""
    path, found = simulated(text)
    assert found["infeasible_steps"] == 0
    expected = path.states[[0, 2], :1] + 0.25**2 / 2 + 0.25 * path.controls[:, :1]
    np.testing.assert_allclose(path.states[[0, 2], 1:2], expected)


def test_several_vehicles_decide_their_own_starts_together() -> None:
    text = """\
kind: problem
parameters: {gap: {free: [0, 3], guess: 1}}
states: {x: {start: {free: [-5, 5]}, rate: u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: u**2 + (gap - 2)**2
initial_cost: (x - slot*gap)**2
constants: {slot: 1}
vehicles: {members: [{name: a}, {name: b, constants: {slot: -1}, start: {x: 0}}]}
prediction: {horizon_s: 1, intervals: 2}
search: {name: none}
"""
    path, found = simulated(text)
    gap = found["decided_gap"]
    assert found["decided_x_a"] == pytest.approx(gap, abs=1e-6)
    assert "decided_x_b" not in found and path.states[1, 0] == 0.0
    # 2 (gap - 2)^2 + gap^2: the other vehicle does not move.
    assert gap == pytest.approx(4 / 3, abs=1e-6)


def test_search_has_bounds_of_its_own() -> None:
    text = PENDULUM.replace("[-8, 8]", "[-8, 8], search_bounds: [-2, 3]")
    (agent,) = pose(scenario_of(text)).agents
    assert [float(v[0]) for v in agent.problem.search_limits] == [-2, 3]
    assert [float(v[0]) for v in agent.problem.control_limits] == [-8, 8]
    stated(PENDULUM.replace("bounds: [-8, 8]", "search_bounds: [-2, 3]"))


def test_resolved_scenario_is_the_same_when_it_is_read_again() -> None:
    for text in (BEAD, FASTEST, SWING, STOCK):
        resolved = stated(text)
        again = stated(json.dumps(dict(resolved.settings)))
        assert again.scenario == resolved.scenario


@pytest.mark.parametrize(
    ("text", "part", "other", "place", "words"),
    [
        (BEAD, "[0.1, 5]", "[5, 0.1]", "10:25", "lower <= upper, found [5, 0.1]"),
        (BEAD, "[0.1, 5]", "[0, 5]", "10:33", "shortest time above 0, found 0"),
        (BEAD, "[0.1, 5]", "[0.1]", "10:32", "at least 2"),
        (BEAD, "far/2", "9", "10:25", "a guess within [0.1, 5], found 9"),
        (BEAD, "far/2", "fra/2", "10:49", "did you mean 'far'?"),
        (BEAD, "guess:", "gues:", "10:42", "did you mean 'guess'?"),
        (BEAD, "search: {name: none}", "feedback: receding_horizon", "11:11",
         "expected the key 'period_s'"),
        (BEAD, "search: {name: none}", "feedback: {period_s: 1}", "11:22",
         "expected no period_s with feedback: open_loop"),
        (BATCH, "law: receding_horizon, ", "", "7:11",
         "expected ends_at_s with law: receding_horizon"),
        (BATCH, "horizon_s: 3", "horizon_s: {free: [0.1, 3]}", "7:46",
         "expected no ends_at_s if the end time is decided"),
        (BATCH, "rate: inflow", "next: inflow", "7:46", "in discrete time"),
        (BATCH, "bounds: [-2, 2]", "bounds: [-2, 2], delay_s: 0.5", "3:47",
         "a receding horizon that ends takes no delay_s"),
        (BATCH, "level: -0.2}}", "level: -0.2}, substeps: 5}", "8:47",
         "if the run ends at a fixed time"),
        (BEAD, "search: {name: none}", "signals: {s: time}", "11:10",
         "expected no signals if the end time is decided"),
        (BEAD, "[0.1, 5]", "[0.1, null]", None, None),
        (BEAD, "search: {name: none}", "plant: {disturbance: {x: {deviation: 1}}}",
         "11:26", "found noise"),
        (FASTEST, "0.05, 5", "0.5, 5", "6:33", "at most one period of 0.3 s"),
        (FASTEST, "{free: [0.05, 5], guess: 3}", "3", "7:45",
         "unless the end time is decided"),
        (FASTEST, "substeps: 30", "substeps: 19", "8:19", "prediction.intervals = 20"),
        (FASTEST, "start: 1", "start: {free: [0, 1]}", "2:21", "is measured"),
        (SWING, "[-2, 2]}, drag", "[-2, null]}, drag", None, None),
        (SWING, "search: {name: none}", "candidates: [{u: mean}]", "10:18",
         "expected no decided parameter in candidates"),
        (SWING, "drift: mean.end", "decided_mean: x.end", "11:77", "what is decided"),
        (SWING, "rate: v,", "", "4:6", "expected the key 'rate', or 'next'"),
        (SWING, "initial_cost: 10*", "initial_cost: previous(u)*", "8:15",
         "expected no previous control in initial_cost"),
        (MOVES, "PREVIOUS", ", previous: a", "3:43", "unknown name 'a'"),
        (MOVES, "previous(u)", "previous(w)", "5:25", "mean 'previous(u)'?"),
        (MOVES, "previous(u)", "previous(u + 1)", "5:25", "the name of one control"),
        (MOVES, "previous(u)", "previos(u)", "5:25", "did you mean 'previous'?"),
        (MOVES, "PREVIOUS", ", search_bounds: [3, 4]", "3:48", "within [-2, 2]"),
        (STOCK, "next: stock", "rate: stock", "5:13", "expected the key 'horizon_s'"),
        (STOCK, "{intervals: 6}", "{intervals: 6, horizon_s: {free: [1, 2]}}", "5:39",
         "expected a number in discrete time"),
        (STOCK, "stock:", "time:", "2:16", "expected a new name, found 'time'"),
        (STOCK, "start: 5", "start: {free: [30, 40]}", "2:25", "within the bounds"),
        (STOCK, "start: 5", "start: a", "2:25", "unknown name 'a'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_where_it_stands(
    text: str, part: str, other: str, place: str | None, words: str | None
) -> None:
    assert part in text
    text = text.replace(part, other, 1).replace("PREVIOUS", "")
    if place is None or words is None:
        stated(text)
        searched = text.replace("search: {name: none}", "")
        with pytest.raises(InvalidScenarioError, match="the search draws between"):
            stated(searched)
        return
    with pytest.raises(InvalidScenarioError) as caught:
        stated(text)
    said = str(caught.value)
    assert words in said
    assert f"stated.yaml:{place}:" in said


@pytest.mark.parametrize(
    ("more", "found"),
    [
        ("step_cost: previous(u)", "previous controls"),
        ("parameters: {p: {free: [0, 1]}}", "decided parameters"),
    ],
)
def test_vehicles_that_plan_one_by_one_decide_no_more_than_controls(
    more: str, found: str
) -> None:
    text = f"""\
kind: problem
states: {{x: {{start: 0, rate: u}}}}
controls: {{u: {{bounds: [-1, 1]}}}}
stage_cost: u**2
vehicles: {{members: [{{name: a}}, {{name: b}}], planning: priority}}
prediction: {{horizon_s: 1, intervals: 2}}
feedback: receding_horizon
{more}
"""
    words = f"5:55: expected planning: joint with {found}; found priority"
    with pytest.raises(InvalidScenarioError, match=words):
        stated(text)
    simulated(text.replace("priority", "joint") + "search: {name: none}\n")


def test_dual_mode_is_of_a_system_that_stays_as_it_is() -> None:
    text = PENDULUM + (
        "feedback: receding_horizon\n"
        "dual_mode: {at: {angle: 0, speed: 0}, Q: {}, R: {torque: 1}}\n"
    )
    text = text.replace("torque - g*sin(angle)", "torque - g*sin(angle) + time")
    with pytest.raises(InvalidScenarioError, match="a problem without time"):
        stated(text)


def test_a_batch_ends_at_its_time_as_the_closed_form_says() -> None:
    """Least effort over the rest: the inflow is what is missing, over the time left."""
    path, _ = simulated(BATCH)
    assert path.times == pytest.approx(np.linspace(0, 3, 7))
    levels, inflows = path.states[0], path.controls[0]
    wanted = (3 - levels[:5]) / (3 - path.times[:5])
    assert inflows[:5] == pytest.approx(wanted, abs=1e-6)
    assert levels[-1] == pytest.approx(3 - 0.2 * 0.5, abs=1e-6)  # The last leak stays.


def test_a_batch_is_planned_every_period_until_its_end() -> None:
    """2.1 / 0.3 is a little more than 7, which are its steps."""
    text = BATCH.replace("ends_at_s: 3", "ends_at_s: 2.1, period_s: 0.3")
    path, _ = simulated(text)
    assert stated(text).scenario.steps == 7
    assert path.times == pytest.approx(np.linspace(0, 2.1, 8))


def test_an_error_in_a_definition_of_a_batch_has_its_place() -> None:
    text = BATCH.replace("inflow**2", "inflow**2 + a") + "definitions: {a: cosine(1)}\n"
    with pytest.raises(InvalidScenarioError, match=r"yaml:10:.*unknown function"):
        stated(text)


def test_a_batch_has_no_dual_mode() -> None:
    text = BATCH + "dual_mode: {Q: {level: 1}, R: {inflow: 1}, at: {level: 3}}\n"
    with pytest.raises(InvalidScenarioError, match="ends_at_s with a dual mode"):
        stated(text)
