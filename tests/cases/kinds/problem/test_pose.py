"""Guesses, candidates, orders, plants and dual modes do what the file says."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.commands.wording.outcomes import kept_constraints, outcome
from swarmstart.cases.kinds.problem.pose import pose
from swarmstart.cases.kinds.problem.stated.members import ProblemPosed
from swarmstart.cases.record.record import Recording
from swarmstart.cases.record.results import load
from swarmstart.ocp import Start, Trajectory
from swarmstart.ocp.common import Paragraph
from swarmstart.tests.cases.kinds.problem.conftest import (
    PENDULUM,
    scenario_of,
    simulated,
    stated,
)

MOVED = """\
kind: problem
constants: {{slot: 0}}
parameters: {{gain: 1}}
states: {{x: {{start: 1, rate: gain*u}}}}
controls: {{u: {{bounds: [-2, 2]}}}}
stage_cost: (x - slot)**2 + 0.1*u**2
prediction: {{horizon_s: 1, intervals: 5}}
search: {{name: none}}
{more}
"""
FAR_AWAY = """\
kind: problem
constants: {{far: {far}}}
states: {{x: {{start: {start}, rate: v}}, v: {{start: 0.5, rate: u}}}}
controls: {{u: {{bounds: [-2, 2]}}}}
stage_cost: (x - far - 1)**2 + v**2 + 0.1*u**2
path: [{{expression: x - far, upper: 1.5}}]
prediction: {{horizon_s: 2, intervals: 5}}
search: {{name: none}}
polish: ipopt
lanes: 0
{more}
"""
HELD = """\
kind: problem
parameters: {{gain: 1}}
states: {{x: {{start: 0, rate: gain*u}}, y: {{start: 0, rate: u}}}}
controls: {{u: {{bounds: [1, 1]}}}}
stage_cost: u**2
prediction: {{horizon_s: 4, intervals: 4}}
search: {{name: none}}
{more}
"""
"""Return a text in which u is always 1."""
LINE = """\
kind: problem
states: {{x: {{start: -3, rate: 1 + a}}, y: {{start: 0, rate: w}}}}
controls: {{a: {{bounds: [-1, 1]}}, w: {{bounds: [-2, 2]}}}}
stage_cost: 0.1*a**2 + 0.1*w**2
terminal_cost: 10*(x - slot)**2 + 10*y**2
constants: {{slot: 0}}
prediction: {{horizon_s: 3, intervals: 6}}
search: {{name: none}}
guess: {{controls: {{w: 0.05}}}}
{more}
"""
TWO_OPTIMA = """\
kind: problem
states: {{x: {{start: 0.05, rate: u}}}}
controls: {{u: {{bounds: [-3, 3]}}}}
stage_cost: 0.01*u**2
terminal_cost: (x**2 - 1)**2 + 0.05*x
prediction: {{horizon_s: 1, intervals: 5}}
search: {{name: none}}
lanes: 0
{more}
"""


def posed(text: str) -> ProblemPosed:
    return pose(scenario_of(text))


def flown(text: str) -> tuple[Array, dict[str, Any]]:
    """Return the states of the path and the measures."""
    path, measures = simulated(text)
    return path.dense_states, dict(measures)


def test_a_moved_slot_moves_only_its_vehicle() -> None:
    text = "vehicles: {{members: [{{name: a}}, {{name: b, constants: {{slot: {}}}}}]}}"
    here, there = (
        flown(MOVED.format(more=text.format(slot)))[0] for slot in (0.25, -0.5)
    )
    np.testing.assert_allclose(here[0], there[0], atol=1e-6)
    assert here[1, -1] > there[1, -1] + 0.2


PRIORITY = """\
steps: 3
feedback: receding_horizon
vehicles:
  planning: {planning}
  members:
    - {{name: first}}
    - {{name: second, start: {{x: -4.2, y: 0.1}}, constants: {{slot: 0.25}}}}
  separation: {{of: [x, y], distance: 1, margin: 0.05}}
"""


def test_the_second_in_the_order_keeps_its_distance_from_the_plan_of_the_first() -> (
    None
):
    path, _ = simulated(LINE.format(more=PRIORITY.format(planning="priority")))
    alone, _ = simulated(LINE.format(more="feedback: receding_horizon\nsteps: 3\n"))
    for decision, by_itself in zip(path.decisions, alone.decisions, strict=True):
        first, second = decision.plans
        np.testing.assert_allclose(
            first.controls, by_itself.plans[0].controls, atol=1e-5
        )
        distance = np.hypot(*(second.states - first.states))
        assert distance.min() > 1.05 - 1e-4
    first, second = path.decisions[0].plans
    assert np.hypot(*(second.states - first.states)).min() < 1.1


def test_planned_together_both_give_way() -> None:
    together, _ = simulated(LINE.format(more=PRIORITY.format(planning="joint")))
    alone, _ = simulated(LINE.format(more="feedback: receding_horizon\nsteps: 3\n"))
    (plan,) = together.decisions[0].plans
    assert np.hypot(*(plan.states[2:] - plan.states[:2])).min() > 1.05 - 1e-4
    ahead = plan.states[:2] - alone.decisions[0].plans[0].states
    assert np.abs(ahead).max() > 0.05


def test_each_sees_all_before_it_in_the_order() -> None:
    three = PRIORITY.format(planning="priority") + "\n"
    three = three.replace("members:\n", "members:\n    - {name: zeroth}\n")
    found = posed(LINE.format(more=three))
    assert [agent.watches for agent in found.agents] == [(), (0,), (0, 1)]
    assert [agent.shows for agent in found.agents] == [(0, 1)] * 3
    assert found.order == (0, 1, 2)
    assert found.x0.tolist() == [-3, 0, -3, 0, -4.2, 0.1]


def test_own_parameters_of_the_plant_are_used_in_the_plant_only() -> None:
    mismatch = "plant: {parameters: {gain: 2}}\nparameters: {gain: 1}\n"
    path, found = simulated(
        HELD.format(more=mismatch).replace("\nparameters", "\n#", 1)
    )
    assert path.states[:, -1] == pytest.approx([8, 4])
    assert path.decisions[0].plans[0].states[:, -1] == pytest.approx([4, 4])
    assert found["cost"] == pytest.approx(4)


def test_a_held_parameter_switches_in_the_plant_at_its_instant() -> None:
    table = "{times: [0, 1.5], values: [1, 3], between: hold}"
    text = HELD.format(more="").replace("gain: 1", f"gain: {table}")
    path, _ = simulated(text)
    x = path.dense_states[0]
    expected = np.where(
        path.dense_times < 1.5, path.dense_times, 3 * path.dense_times - 3
    )
    np.testing.assert_allclose(x, expected, atol=1e-12)


def test_a_disturbance_is_added_to_the_rate_of_its_state() -> None:
    disturbed = "plant: {disturbance: {y: 2*time}, substeps: 2000}"
    states, _ = flown(HELD.format(more=disturbed))
    assert states[:, -1] == pytest.approx([4, 4 + 16], rel=1e-3)


def noise_of(states: Array, substeps: int) -> Array:
    """Return the values added to the rates, in each of the plant's steps."""
    return np.diff(states, axis=1) * substeps - 1


def correlation(x: Array, y: Array) -> float:
    return abs(float(np.mean((x - x.mean()) * (y - y.mean())) / (x.std() * y.std())))


NOISE = "plant: {{substeps: 500, disturbance: {{x: {x}, y: {y}}}}}"


def test_noise_has_its_deviation_and_is_the_same_for_the_same_seed() -> None:
    more = NOISE.format(x="{deviation: 0.5}", y="{deviation: 0.5, seed: 7}")
    first, again = (flown(HELD.format(more=more))[0] for _ in range(2))
    assert first.tolist() == again.tolist()
    drawn = noise_of(first, 500)
    assert drawn.shape == (2, 2000)
    assert np.unique(drawn.round(6)).size > 3950  # None twice in a row, nor clipped.
    assert np.abs(np.diff(drawn[:, :3])).min() > 1e-6
    assert drawn.std(axis=1) == pytest.approx(0.5, rel=0.08)  # 5 sigma: 1/sqrt(2 n)
    assert np.abs(drawn.mean(axis=1)).max() < 5 * 0.5 / np.sqrt(2000)
    assert correlation(drawn[0, :-1], drawn[0, 1:]) < 0.12  # each step anew
    assert correlation(*drawn) < 0.12


def test_noise_of_two_states_with_one_seed_is_not_the_same() -> None:
    more = NOISE.format(x="{deviation: 1}", y="{deviation: 1}")
    drawn = noise_of(flown(HELD.format(more=more))[0], 500)
    assert correlation(*drawn) < 0.12


def test_noise_of_two_vehicles_is_not_the_same() -> None:
    more = "vehicles: {members: [{name: a}, {name: b}]}\n"
    more += "plant: {substeps: 500, disturbance: {x: {deviation: 1}}}"
    states, _ = flown(HELD.format(more=more))
    drawn = noise_of(states, 500)
    assert correlation(drawn[0], drawn[2]) < 0.12
    assert drawn[[1, 3]] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    ("guess", "end"),
    [
        ("{}", 1),
        ("{states: {x: 1}}", 1),
        ("{states: {x: -1}}", -1),
        ("{states: {x: {times: [0, 1], values: [0, -1]}}}", -1),
        ("{controls: {u: -1}}", -1),
        ("{controls: {u: 1}}", 1),
    ],
)
def test_a_guess_leads_the_polish_to_the_optimum_that_is_near(
    guess: str, end: float
) -> None:
    states, found = flown(TWO_OPTIMA.format(more=f"guess: {guess}"))
    assert states[0, -1] == pytest.approx(end, abs=0.05)
    assert found["converged"] == 1


def test_a_guess_of_controls_has_a_value_for_each_interval() -> None:
    table = "{times: [0, 0.4], values: [1, 2], between: hold}"
    agent = posed(TWO_OPTIMA.format(more=f"guess: {{controls: {{u: {table}}}}}")).agents
    assert isinstance(agent[0].first, np.ndarray)
    assert agent[0].first.tolist() == [[1, 1, 2, 2, 2]]


def test_a_guess_of_states_has_a_value_at_each_check_of_each_vehicle() -> None:
    more = "guess: {states: {x: k*time}}\nconstants: {k: 1}\n"
    more += "vehicles: {members: [{name: a}, {name: b, constants: {k: 2}}]}"
    text = TWO_OPTIMA.format(more=more).replace(
        "intervals: 5", "intervals: 2, checks: 2"
    )
    first = posed(text).agents[0].first
    assert isinstance(first, Start)
    assert first.controls.tolist() == [[0, 0], [0, 0]]
    assert first.states is not None
    assert first.states.tolist() == [
        [0, 0.25, 0.5, 0.75, 1],
        [0, 0.5, 1, 1.5, 2],
    ]


def test_candidates_are_in_the_first_population() -> None:
    """The candidate is the optimum; 30 random ones would not be."""
    text = """\
kind: problem
constants: {{best: 0.625}}
parameters: {{p: 0.5 + time}}
states: {{x: {{start: 0, rate: u}}}}
controls: {{u: {{bounds: [-9, 9]}}, w: {{bounds: [-9, 9]}}}}
stage_cost: (u - 0.5)**2 + (w - best)**2
prediction: {{horizon_s: 1, intervals: 5}}
search: {{name: random}}
budget: {{evaluations: 40}}
polish: none
{more}
"""
    candidate = "candidates: [{w: 3, u: 3}, {w: best + 0*p, u: p}]"
    found = flown(text.format(more=candidate))[1]
    assert found["search_cost"] == pytest.approx(0, abs=1e-15)
    assert flown(text.format(more=""))[1]["search_cost"] > 1
    candidates = posed(text.format(more=candidate)).agents[0].candidates
    assert candidates is not None
    assert candidates(1.0).shape == (2, 5, 2)
    assert candidates(1.0)[:, 4].tolist() == [[3, 1.5], [3, 0.625]]


DUAL = """\
kind: problem
states:
  x: {start: 0.6, rate: v, bounds: [-2, 2]}
  v: {start: 0, rate: a, bounds: [-2, 2]}
controls: {a: {bounds: [-3, 3]}}
stage_cost: x**2 + v**2 + 0.1*a**2
terminal: [{expression: x}, {expression: v}]
prediction: {horizon_s: 2, intervals: 10}
search: {name: none}
feedback: receding_horizon
steps: 20
dual_mode: {at: {x: 0, v: 0}, Q: {x: 1, v: 0.5}, R: {a: 0.1}}
"""


def test_a_dual_mode_switches_and_its_certificate_is_a_document() -> None:
    found = posed(DUAL)
    (certificate,) = found.documents.items()
    assert certificate[0] == "certificate.json"
    assert json.loads(certificate[1])
    states, measured = flown(DUAL.replace("start: 0.6", "start: 1.9"))
    assert 0 < measured["linear_steps"] < 20
    assert np.abs(states[:, -1]).max() < 0.05


def test_a_dual_mode_has_the_weights_and_the_reference_of_the_file() -> None:
    (law,) = (posed(DUAL.replace("at: {x: 0,", "at: {x: 0.25,")).dual_mode,)
    assert law is not None
    assert law.sets[0].x_ref.tolist() == [0.25, 0]
    assert law.targets[0](3.0).tolist() == [0.25, 0]
    (other,) = (posed(DUAL.replace("R: {a: 0.1}", "R: {a: 10}")).dual_mode,)
    assert other is not None
    gains = [np.abs(one.sets[0].K).max() for one in (law, other)]
    assert gains[0] > 2 * gains[1]


def test_vehicles_that_plan_alone_have_a_set_and_a_certificate_each() -> None:
    more = "vehicles: {planning: priority, members: [{name: a}, {name: b}]}\n"
    assert [*posed(DUAL + more).documents] == ["certificate.json", "certificate1.json"]


def test_a_plan_for_another_system_than_the_simulated_one_is_said_to_be_one() -> None:
    short = PENDULUM + "budget: {evaluations: 500}\n"
    pushed = stated(short + "plant: {disturbance: {speed: 1}}")
    finished = run(pushed, seed=0)
    assert "the simulated system is another" in finished.status
    assert Paragraph.OTHER_SYSTEM in finished.ended.paragraphs
    alone = run(stated(short), seed=0)
    assert "another" not in alone.status
    assert Paragraph.OTHER_SYSTEM not in alone.ended.paragraphs


FALLING = """\
kind: problem
signals: {low: {times: [0, 2], values: [2, 0], between: hold}}
states: {x: {start: 2, rate: u, bounds: [low, null]}}
controls: {u: {bounds: [-1, 1]}}
stage_cost: (1 + u)**2 + x
prediction: {horizon_s: 4, intervals: 4}
search: {name: none}
"""


def test_a_limit_that_jumps_between_checks_is_another_for_the_simulated_system() -> (
    None
):
    """Plans keep a ramp from 2 to 0; 0.9 s later x is 0.9 below the true limit."""
    finished = run(stated(FALLING.replace("[0, 2]", "[0, 1.95]", 1)), seed=0)
    words = "the simulated system is another; low jumps or bends between 1 s and 2 s"
    assert words in finished.status and words in outcome(finished)
    assert Paragraph.OTHER_SYSTEM in finished.ended.paragraphs
    assert finished.measures["constraint_excess"] == pytest.approx(0.9, abs=1e-6)
    assert kept_constraints(finished).startswith("Constraints are broken: largest")


def test_a_closed_loop_whose_plans_take_a_ramp_names_it() -> None:
    receding = "feedback: receding_horizon\nsteps: 2\n"
    late = FALLING.replace("[0, 2]", "[0, 1.95]", 1) + receding
    finished = run(stated(late), seed=0)
    words = "found a feasible plan; low jumps or bends between 1 s and 2 s, where plans"
    assert words in finished.status
    assert finished.ended.paragraphs == (Paragraph.RAMP,)
    held = run(stated(FALLING + receding), seed=0)
    assert "jumps" not in held.status and not held.ended.paragraphs


def test_a_limit_that_jumps_at_the_end_of_an_interval_is_kept_until_then() -> None:
    finished = run(stated(FALLING), seed=0)
    assert "another" not in finished.status
    assert finished.measures["constraint_excess"] == pytest.approx(0, abs=1e-6)
    assert finished.measures["flown_cost"] == pytest.approx(
        finished.measures["cost"], rel=1e-9
    )


def test_stiff_problem_is_planned_verified_and_simulated_by_stiff_steps() -> None:
    """A state follows the control ten thousand times faster than the plant's step."""
    path, _ = simulated(
        """\
kind: problem
states:
  slow: {start: 1, rate: fast - slow}
  fast: {start: 0, rate: 2e5*(push - fast)}
controls:
  push: {bounds: [-1, 1]}
stage_cost: slow**2 + 0.1*push**2
prediction: {horizon_s: 2, intervals: 10, integrator: stiff, substeps: 2}
search: {name: none}
plant: {substeps: 4}
"""
    )
    plan = path.decisions[0].plans[0]
    assert plan.feasible
    np.testing.assert_allclose(path.states[1, 1:], path.controls[0], atol=1e-4)
    np.testing.assert_allclose(path.states[0, -1], plan.states[0, -1], atol=1e-4)


@pytest.mark.parametrize(
    ("start", "more"),
    [
        ("far", ""),
        ("{free: [far - 1, far + 0.5]}", ""),
        ("far", "feedback: receding_horizon\nsteps: 4"),
    ],
    ids=["one plan", "decided start", "closed loop"],
)
def test_run_and_record_from_far_away_are_those_from_here(
    start: str, more: str, tmp_path: Path
) -> None:
    runs, records = [], []
    for far in (0.0, 1e9):
        text = FAR_AWAY.format(far=far, start=start, more=more)
        runs.append(
            run(
                stated(text),
                seed=0,
                recording=Recording(folder=tmp_path / f"{far}", figures=True),
            )
        )
        records.append(load(tmp_path / f"{far}").trajectory)
    for here, there in ([one.trajectory for one in runs], records):
        assert isinstance(here, Trajectory)
        assert isinstance(there, Trajectory)
        np.testing.assert_allclose(
            there.states - [[1e9], [0.0]], here.states, atol=1e-5
        )
        np.testing.assert_allclose(there.controls, here.controls, atol=1e-5)
    measured, from_far = (one.measures for one in runs)
    for name, offset in (("cost", 0.0), ("decided_x", 1e9)):
        if name in measured:
            value, expected = from_far[name], measured[name]
            assert isinstance(value, float)
            assert value - offset == pytest.approx(expected, rel=1e-6, abs=1e-6)
