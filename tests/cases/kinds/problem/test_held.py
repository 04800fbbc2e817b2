"""Tables that jump where intervals begin are held, in plans and in the simulation."""

from collections.abc import Sequence
from inspect import unwrap
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.optimize import linprog

from swarmstart.arrays import Array
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.drawing.slack import moving_bounds, slacks
from swarmstart.cases.kinds.problem.figures import Planned, draw
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.kinds.problem.stated.members import ProblemPosed
from swarmstart.cases.record.record import Recording
from swarmstart.cases.record.results import load
from swarmstart.ocp import HeldSignals, Known
from swarmstart.ocp.loop import rows_before_jumps
from swarmstart.tests.cases.kinds.problem.conftest import (
    scenario_of,
    simulated,
    stated,
)

NIGHT: dict[str, Any] = {
    "kind": "problem",
    "constants": {"hour": 3600},
    "signals": {
        "price": {
            "times": [0, "7*hour", "19*hour"], "values": [2, 4, 2], "between": "hold",
        },
        "lowest": {
            "times": [0, "6*hour", "21*hour"], "values": [17, 20, 17],
            "between": "hold",
        },
    },
    "states": {
        "room": {
            "start": 18, "rate": "(heat - 0.1*(room - 5))/hour",
            "bounds": ["lowest", 24],
        }
    },
    "controls": {"heat": {"bounds": [0, 4]}},
    "stage_cost": "price*heat/hour",
    "prediction": {"horizon_s": "24*hour", "intervals": 24},
    "budget": {"evaluations": 100},
    "measures": {"paid": "integral(price*heat/hour)", "least": "min(room - lowest)"},
}  # fmt: skip


def features(**changes: Any) -> Sequence[Any]:
    scenario = scenario_of(yaml.safe_dump(NIGHT | changes))
    return pose(scenario).agents[0].problem.features


def test_tables_that_jump_where_intervals_begin_are_held() -> None:
    (held,) = features()
    assert isinstance(held, HeldSignals)
    assert set(held.names) == {"price", "lowest"}


def test_others_are_linear_between_checks() -> None:
    hours = {"horizon_s": "24*hour", "intervals": 16}  # Of 1.5 hours.
    assert features(prediction=hours) == (HeldSignals(["lowest"]),)
    partly = {"times": [0, "6*hour", "20*hour"], "values": [1, 2, 1], "between": "hold"}
    low = {"times": [0], "values": [17]}
    assert features(prediction=hours, signals={"price": partly, "lowest": low}) == ()
    shrinking = {"law": "receding_horizon", "ends_at_s": "24*hour"}
    more = {"steps": 24, "plant": {"substeps": 24}}
    assert features(feedback=shrinking, **more) == ()
    constant = {"times": [0, "6*hour"], "values": [1, 1], "between": "hold"}
    moved = {"times": [0, "6*hour"], "values": [17, 18]}
    assert features(signals={"price": constant, "lowest": moved}) == ()


def cheapest() -> float:
    """Return the least price of the day, by a linear programme with exact steps."""
    a, hours = float(np.exp(-0.1)), np.arange(25)
    price = np.where((hours >= 7) & (hours < 19), 4.0, 2.0)
    low = np.where((hours >= 6) & (hours < 21), 20.0, 17.0)
    rows: list[Array] = []
    limits = list[float]()
    for k in range(1, 25):
        gain = np.zeros(24)
        gain[:k] = a ** np.arange(k - 1.0, -1.0, -1.0) * (1 - a) / 0.1
        rows += [-gain, gain]
        free = 5 + a**k * 13
        limits += [free - max(low[k - 1], low[k]), 24 - free]
    return float(linprog(price[:24], rows, limits, bounds=(0, 4)).fun)


@pytest.mark.parametrize("law", ["open_loop", "receding_horizon"])
def test_simulated_day_costs_what_the_plan_does_and_keeps_the_limits(law: str) -> None:
    more = {"feedback": law, "steps": 24, "plant": {"substeps": 6}}
    _, found = simulated(yaml.safe_dump(NIGHT | more))
    paid, least = found["paid"], found["least"]
    assert isinstance(paid, float) and isinstance(least, float)
    assert paid == pytest.approx(cheapest(), rel=1e-5)
    assert least >= -1e-5


TEAM = """\
kind: problem
constants: {goal: 0}
signals: {wind: {times: [0, 1, 2], values: [0, 0.5, -0.3], between: hold}}
states: {x: {rate: u + wind}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: (x - goal)**2 + 0.1*u**2
vehicles:
  planning: priority
  separation: {of: [x], distance: 0.5}
  members:
    - {name: a, start: {x: 0}, constants: {goal: 1}}
    - {name: b, start: {x: 2}, constants: {goal: 2}}
prediction: {horizon_s: 3, intervals: 6}
feedback: receding_horizon
steps: 6
search: {name: none}
"""
DUAL = """\
kind: problem
signals: {wind: {times: [0, 1, 2], values: [0, 0.5, -0.3], between: hold}}
states: {x: {start: 1, rate: u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: x**2 + u**2 + wind*u
prediction: {horizon_s: 3, intervals: 6}
feedback: receding_horizon
dual_mode: {at: {x: 0}, Q: {x: 1}, R: {u: 1}}
steps: 6
search: {name: none}
"""


@pytest.mark.parametrize("text", [TEAM, DUAL])
def test_each_step_is_the_one_that_was_planned(text: str) -> None:
    (path, _), dt = simulated(text), 0.5
    for k, decision in enumerate(path.decisions):
        for i, plan in enumerate(decision.plans):
            assert plan.states[0, 1] == pytest.approx(path.states[i, k + 1], abs=1e-9)
            wind = [0.0, 0.0, 0.5, 0.5, -0.3, -0.3][k] if text == TEAM else 0.0
            after = path.states[i, k] + dt * (path.controls[i, k] + wind)
            assert path.states[i, k + 1] == pytest.approx(after, abs=1e-12)


@pytest.mark.parametrize("text", [TEAM, TEAM.replace("0.1*u", "(1 + time)*u")])
def test_plans_of_a_record_are_drawn_as_they_were_made(
    text: str, tmp_path: Path
) -> None:
    made = run(stated(text), seed=0, recording=Recording(folder=tmp_path / "run"))
    kept, posed = load(tmp_path / "run").trajectory, made.flight.posed
    assert kept is not None and isinstance(posed, ProblemPosed)
    assert not kept.decisions[1].plans[0].states.size  # A record keeps controls only.
    seen = np.asarray(Planned(posed, kept).known(1, 1).signals)
    shown = made.trajectory.decisions[1].plans[0].states[:1]
    np.testing.assert_allclose(seen[-1:], shown, atol=1e-12)


@pytest.mark.parametrize("law", ["open_loop", "receding_horizon"])
def test_distance_to_a_limit_is_that_to_the_value_that_is_held(law: str) -> None:
    more = {"steps": 24, "plant": {"substeps": 4}, "feedback": law}
    made = run(stated(yaml.safe_dump(NIGHT | more)), seed=0)
    posed, path = made.flight.posed, made.trajectory

    def known(step: int) -> Known:
        return posed.known_by(0, float(path.times[step]))

    (row,) = slacks(posed.agents[0].problem, path, known)
    ((_, _, bound),) = moving_bounds(posed.agents[0].problem, path, known)
    hours = np.repeat(np.arange(24), 5)
    low = np.where((hours >= 6) & (hours < 21), 20.0, 17.0)
    np.testing.assert_array_equal(bound.values, low)
    assert not bound.is_upper
    room = np.interp(row.times, path.dense_times, path.dense_states[0])
    np.testing.assert_allclose(row.values, room - low, atol=1e-9)


def test_distance_to_a_limit_is_that_to_its_true_value_if_plans_take_a_ramp() -> None:
    off = {"times": [0, "6.5*hour", "21*hour"], "values": [17, 20, 17]}
    low = NIGHT["signals"] | {"lowest": off | {"between": "hold"}}
    made = run(stated(yaml.safe_dump(NIGHT | {"signals": low})), seed=0)
    figures = unwrap(draw)(made.resolved.scenario, made.flight, made.trajectory)
    (axes,) = dict(figures)["d_slack"].axes
    least = min(float(np.min(line.get_ydata())) for line in axes.lines)
    excess = made.measures["constraint_excess"]
    assert isinstance(excess, float) and excess > 0.1
    assert least == pytest.approx(-excess, abs=1e-9)


def test_values_at_the_end_of_an_interval_are_those_before_a_jump() -> None:
    times = np.array([[0.0, 0.5, 1.0], [1.0, 1.5, 2.0]])
    jump = lambda at: np.where(at < 1.0, 1.0, 3.0)  # noqa: E731
    found = rows_before_jumps(jump, times).reshape(2, 3)
    np.testing.assert_array_equal(found, [[1, 1, 1], [3, 3, 3]])
    # With a state that jumps, the last column is after the jump.
    more = np.concatenate([times, times[:, -1:]], axis=1)
    found = rows_before_jumps(jump, more).reshape(2, 4)
    np.testing.assert_array_equal(found, [[1, 1, 1, 3], [3, 3, 3, 3]])
    # What does not jump stays as it is.
    found = rows_before_jumps(np.sin, times).reshape(2, 3)
    np.testing.assert_array_equal(found, np.sin(times))
