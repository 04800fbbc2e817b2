"""Phases in YAML: a closed form, as in Python, simulated and measured in seconds."""

import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from swarmstart.cases.campaign.running.finished_run import key_of
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.scenario import resolved_again
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.record.record import Recording
from swarmstart.cases.record.results import load
from swarmstart.ocp import (
    Bounds,
    Free,
    Model,
    OptimalControlProblem,
    Start,
    phases,
    solve,
)
from swarmstart.tests.cases.kinds.problem.conftest import (
    scenario_of,
    simulated,
    stated,
)
from swarmstart.tests.cases.kinds.problem.test_same_in_python import assert_same

LEGS = """\
kind: problem
constants: {kept: 0.9}
states: {x: {start: 0, rate: v, unit: m}, v: {start: 0, rate: push}}
controls: {u: {bounds: [-4, 4]}}
definitions: {push: u}
stage_cost: 1 + u**2
path: [{expression: v, upper: 3}]
phases:
  - {horizon_s: {free: [0.2, 3]}, intervals: 6, terminal: [{expression: x, equals: 0.5}], linkage: {v: kept*v}}
  - name: light
    horizon_s: {free: [0.2, 3], guess: 1}
    intervals: 6
    definitions: {push: 2*u}
    path: [{expression: u, upper: 0.4}]
terminal: [{expression: x, equals: 2}, {expression: v}]
search: {name: none}
measures: {energy: integral(u**2), weak: push.start/u.start, strong: push.end/u.end}
"""  # noqa: E501


def test_two_legs_are_those_of_python() -> None:
    x, v, u = (ca.SX.sym(n) for n in ("x", "v", "u"))

    def leg(push: ca.SX, **more: object) -> OptimalControlProblem:
        return OptimalControlProblem(
            Model(states=ca.vertcat(x, v), controls=u, ode=ca.vertcat(v, push)),
            intervals=6,
            stage_cost=1 + u**2,
            bounds=Bounds(controls=(-4, 4)),
            **more,  # type: ignore[arg-type]
        )

    both = phases(
        [
            leg(
                u,
                horizon=Free(0.2, 3),
                constraints=[v <= 3],
                terminal=[(x, 0.5)],
            ),
            leg(
                2 * u,
                horizon=Free(0.2, 3, 1.0),
                constraints=[v <= 3, u <= 0.4],
                terminal=[(x, 2.0), (v, 0.0)],
            ),
        ],
        linkages=[{"v": 0.9 * v}],
    )
    answer = solve(both.problem, both.start([0.0, 0.0]), search=None, seed=0)
    assert_same(LEGS, answer)
    path, found = simulated(LEGS)
    assert found["cost"] == answer.cost
    durations = [answer.decided[f"duration of phase {n}"] for n in (1, 2)]
    assert [found["duration_1"], found["duration_light"]] == durations
    assert found["end_time"] == sum(durations) == pytest.approx(path.times[-1])
    assert path.times[6] == pytest.approx(durations[0])
    assert path.controls[0, 6:].max() == pytest.approx(0.4, abs=1e-6)
    # The cost counts seconds once, and so do own measures.
    assert found["flown_cost"] == pytest.approx(answer.cost, rel=1e-9)
    energy = answer.cost - sum(durations)
    assert found["energy"] == pytest.approx(energy, rel=1e-9)
    assert (found["weak"], found["strong"]) == (1.0, 2.0)


def test_least_time_with_a_stronger_second_engine_is_the_closed_form() -> None:
    text = """\
kind: problem
states: {x: {start: 0, rate: v}, v: {start: 0, rate: u}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: 1
phases:
  - {name: weak, horizon_s: {free: [0.1, 3]}, intervals: 5,
     terminal: [{expression: x, equals: 0.5}]}
  - {name: strong, horizon_s: {free: [0.1, 3]}, intervals: 40,
     states: {v: {rate: 2*u}}}
terminal: [{expression: x, equals: 2}, {expression: v}]
search: {name: none}
"""
    _, found = simulated(text)
    # Full thrust for 1 s; then to the speed p and back: (p² - 1)/4 + p²/4 = 3/2.
    peak = np.sqrt(3.5)
    assert found["duration_weak"] == pytest.approx(1.0, abs=2e-3)
    assert found["duration_strong"] == pytest.approx(peak - 0.5, abs=2e-3)
    assert found["confirmed"] == 1


STAGES = """\
kind: problem
parameters: {tank: {free: [0.1, 1]}, pull: 1.5}
states:
  h: {start: 0, rate: v}
  v: {start: 0, rate: force/mass - pull}
  fuel: {start: 0.3, rate: -u/5, bounds: [0, null]}
controls: {u: {bounds: [0, 4]}}
algebraic: {force: force + 0.1*force*v - 2*u}
definitions: {mass: 1 + fuel}
terminal_cost: tank**2 - h
phases:
  - {name: first, horizon_s: 1, intervals: 4, linkage: {rest: fuel/2 + tank}}
  - name: second
    horizon_s: 0.5
    intervals: 3
    states: {fuel: null, rest: {rate: -u/5, bounds: [0, null]}}
    controls: {u: null, thrust: {bounds: [0, 2]}}
    algebraic: {force: force - 3*thrust}
    definitions: {mass: 0.5 + rest, u: thrust}
plant: {substeps: 8}
search: {name: none}
measures:
  rest: rest.end
  fuel: fuel.end
  forces: force.start + force.end
  masses: mass.start + mass.end
"""


def test_phases_have_states_controls_and_equations_of_their_own() -> None:
    path, found = simulated(STAGES)
    assert path.state_names[:4] == ("h", "v", "fuel", "rest")
    assert path.control_names == ("u", "thrust")
    assert found["confirmed"] == 1
    assert found["flown_cost"] == pytest.approx(found["cost"], rel=1e-6)
    assert found["end_time"] == 1.5 == pytest.approx(path.times[-1])
    measured = [found[n] for n in ("decided_tank", "fuel", "rest")]
    tank, fuel, rest = np.array(measured, dtype=np.float64)
    u, thrust = path.controls
    assert fuel == pytest.approx(0.3 - u[:4].sum() / 20)
    assert rest == pytest.approx(fuel / 2 + tank - thrust[4:].sum() / 30)
    assert found["forces"] == pytest.approx(2 * u[0] + 3 * thrust[-1])
    assert found["masses"] == pytest.approx(1.3 + 0.5 + rest)


def test_plant_may_have_another_parameter_than_is_planned_with() -> None:
    _, found = simulated(STAGES.replace("8}", "8, parameters: {pull: 1.6}}"))
    _, before = simulated(STAGES)
    assert found["cost"] == before["cost"]
    # A pull that is stronger by 0.1 costs about 0.1 t²/2 of height.
    lost = found["flown_cost"] - before["flown_cost"]  # type: ignore[operator]
    assert lost == pytest.approx(0.1 * 1.5**2 / 2, rel=0.2)


def test_guesses_are_in_seconds_of_all_phases() -> None:
    text = LEGS + "guess: {states: {x: time}, controls: {u: time}}\n"
    (agent,) = pose(scenario_of(text)).agents
    start = agent.first
    assert isinstance(start, Start) and start.states is not None
    # The first phase is guessed to last 1.6 s, the second one 1 s.
    times = np.append(np.linspace(0, 1.6, 7), 1.6 + np.linspace(0, 1, 7)[1:])
    np.testing.assert_allclose(start.states[0], times)
    np.testing.assert_allclose(start.states[2:4], [times, np.arange(13)])
    np.testing.assert_allclose(start.controls[0], times[:-1])
    assert simulated(text)[1]["cost"] == pytest.approx(simulated(LEGS)[1]["cost"])


def test_a_search_looks_at_candidates_and_finds_the_same() -> None:
    text = LEGS.replace("search: {name: none}", "budget: {evaluations: 2000}")
    _, found = simulated(text + "candidates: [{u: 0.5}]\n")
    assert found["cost"] == pytest.approx(simulated(LEGS)[1]["cost"], rel=1e-6)


def test_record_and_resolved_settings_are_the_same_run(tmp_path: Path) -> None:
    resolved = stated(LEGS)
    again = resolved_again(resolved.settings, "")
    assert again.settings == resolved.settings
    assert key_of(again, 0) == key_of(resolved, 0)
    done = run(resolved, seed=0, recording=Recording(folder=tmp_path))
    assert {"a_sheet.png", "d_slack.png"} <= {file.name for file in done.figures}
    kept = load(tmp_path)
    assert kept.trajectory is not None
    np.testing.assert_array_equal(kept.trajectory.times, done.trajectory.times)
    repeated = simulated(Path(tmp_path / "scenario.yaml").read_text())[1]
    assert repeated["cost"] == done.measures["cost"]


TWO_AT_END = "    intervals: 6\n    terminal_cost: x\n"


@pytest.mark.parametrize(
    ("part", "other", "place", "words"),
    [
        ("{push: 2*u}", "{push: 2*w}", "13:27", "unknown name 'w'"),
        ("{v: kept*v}", "{w: kept*v}", "9:104", "expected a state of the next phase"),
        ("{v: kept*v}", "{v: kep*v}", "9:104", "did you mean 'kept'?"),
        ("rate: push", "rate: pus", "3:63", "did you mean 'push'?"),
        ("{expression: u, ", "{expression: uu, ", "14:25", "unknown name 'uu'"),
        ("equals: 0.5", "equals: half", "9:84", "unknown name 'half'"),
        ("equals: 2}", "equals: two}", "15:36", "unknown name 'two'"),
        ("guess: 1}", "guess: 4}", "11:16", "a guess within [0.2, 3], found 4"),
        ("intervals: 6\n", "intervals: 0\n", "12:16", "at least 1"),
        ("    horizon_s: {free: [0.2, 3], guess: 1}\n", "", "10:5", "key 'horizon_s'"),
        ("name: light", "name: 1", "10:11", "text"),
        ("search:", "signals: {s: time}\nsearch:", "16:10", "no signals with phases"),
        ("search:", "feedback: receding_horizon\nsearch:", "16:11", "open_loop"),
        ("search:", "prediction: {intervals: 11}\nsearch:", "16:25", "12, or no"),
        ("search:", "parameters: {p: time}\nsearch:", "16:17", "a number with phases"),
        ("    intervals: 6\n", "    intervals: 6\n    linkage: {v: v}\n", "13:14",
         "no linkage in the last phase"),
        ("    intervals: 6\n", "    intervals: 6\n    states: {w: {rate: v}}\n",
         "10:5", "state w of phase 2 must come from phase 1"),
        ("    intervals: 6\n", "    intervals: 6\n    states: {w: null}\n", "13:17",
         "expected a name of the file, found 'w'"),
        ("    intervals: 6\n", "    intervals: 6\n    states: {v: {perodic: true}}\n",
         "13:18", "did you mean 'periodic'?"),
        ("    intervals: 6\n", "    intervals: 6\n    states: {v: {periodic: true}}\n",
         "10:5", "a phase must have no periodic states"),
        ("stage_cost: 1 + u**2\n", "", "1:1", "expected a cost"),
        ("    intervals: 6\n", TWO_AT_END,
         "13:20", "no terminal cost in the last phase"),
        ("integral(u**2)", "integral(w**2)", "17:29", "unknown name 'w'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_where_it_stands(
    part: str, other: str, place: str, words: str
) -> None:
    assert part in LEGS
    text = LEGS.replace(part, other, 1)
    if other == TWO_AT_END:
        text += "terminal_cost: v\n"
    with pytest.raises(ValueError, match=r"^stated\.yaml:") as caught:
        scenario_of(text)
    message = str(caught.value)
    assert words in message, message
    assert f"stated.yaml:{place}: " in message, message


def test_what_is_wrong_in_the_file_is_said_once() -> None:
    text = re.sub("rate: push", "rate: pus", LEGS)
    with pytest.raises(ValueError, match="pus") as caught:
        scenario_of(text)
    assert str(caught.value).count("\n") == 0
