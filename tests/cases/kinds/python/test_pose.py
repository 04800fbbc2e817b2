"""A problem from a function is solved, simulated and measured like any other."""

from __future__ import annotations

import numpy as np
import pytest

from swarmstart.cases.campaign.running.finished_run import key_of
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.flaws import InvalidScenarioError
from swarmstart.cases.format.kind import CodeNotAllowedError, Posed
from swarmstart.cases.format.scenario import resolved_again
from swarmstart.cases.kinds.python.scenario import UserCodeError
from swarmstart.ocp import InvalidProblemError
from swarmstart.ocp.loop.controller import known_at
from swarmstart.tests.cases.kinds.problem.conftest import PENDULUM, stated
from swarmstart.tests.cases.kinds.python.conftest import MODEL, Project, allowed

KNOWN = """\
import casadi as ca
import numpy as np
import swarmstart as ss

def build():
    x, u, gain, target = (ca.SX.sym(n) for n in ("x", "u", "gain", "target"))
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=gain * u, parameters=gain),
        horizon=2, intervals=2, stage_cost=(x - target) ** 2 + 1e-9 * u**2,
        bounds=ss.Bounds(controls=(-0.5, 0.5)), signals=target,
        constraints=[ss.PathConstraint(expression=x - target - gain, upper=0)],
    )
    return problem, [0], ss.Known([2.0], [[0.0, 1.0, 4.0]])
"""


DECIDED = """\
import casadi as ca
import swarmstart as ss

def build():
    x, v, u, push, wind, before = (
        ca.SX.sym(n) for n in ("x", "v", "u", "push", "wind", "before")
    )
    problem = ss.OptimalControlProblem(
        ss.Model(
            states=ca.vertcat(x, v), controls=u, ode=ca.vertcat(v + wind, push * u),
            parameters=push, signals=wind,
        ),
        horizon=ss.Free(0.1, 5, guess=2), intervals=10, stage_cost=ca.SX(1),
        step_cost=1e-9 * (u - before) ** 2, previous=before,
        bounds=ss.Bounds(controls=(-1, 1)), terminal=[x, v],
        decided={"push": ss.Free(0.5, 4)}, START
    )
    signals = [[0.0] * 11]
    return problem, [1, X0], ss.Known(signals=signals, previous=[0.5])
"""


def posed(project: Project, *assignments: str) -> Posed:
    return allowed(project.resolved(*assignments)).posed()


def test_it_is_not_run_without_permission(project: Project) -> None:
    resolved = project.resolved()
    with pytest.raises(CodeNotAllowedError, match=r"my_model\.py: .*--allow-code"):
        resolved.posed()
    with pytest.raises(CodeNotAllowedError):
        resolved.kind.pose(resolved.scenario)
    with pytest.raises(CodeNotAllowedError):
        run(resolved, seed=0)
    assert project.runs == 0


def test_a_pendulum_from_python_is_that_of_yaml(project: Project) -> None:
    measures = run(allowed(project.resolved()), seed=1).measures
    in_yaml = stated(
        PENDULUM
        + "measures: {final_angle: angle.end, effort: integral(torque**2)}\n"
        + "budget: {evaluations: 600}\n"
    )
    expected = run(in_yaml, seed=1).measures
    assert measures.keys() == expected.keys()
    same = {name for name in measures if "seconds" not in name}
    missing = {name for name in same if measures[name] is None}
    assert missing == {name for name in same if expected[name] is None}
    for name in same - missing:
        assert measures[name] == pytest.approx(expected[name], rel=1e-6, abs=1e-6)
    assert measures["verified_cost"] == pytest.approx(36.713, abs=1e-3)


def test_what_is_known_reaches_plans_and_plant(project: Project) -> None:
    project.model.write_text(KNOWN)
    changes = ("arguments={}", "steps=2", "measures={}", "feedback=receding_horizon")
    flown = posed(project, *changes)
    (agent,) = flown.agents
    known = known_at(agent.problem, 1.0, agent.reference, agent.parameters)
    np.testing.assert_array_equal(known.parameters, [2.0])
    np.testing.assert_array_equal(known.signals, [[1.0, 4.0, 4.0]])
    assert flown.plant.parameters is not None
    np.testing.assert_array_equal(flown.plant.parameters(np.arange(3.0)), [[2.0] * 3])
    measures = run(allowed(project.resolved(*changes)), seed=0).measures
    # At full rate x = t; the target is t until 1 s, then 1 + 3 (t - 1).
    assert measures["flown_cost"] == pytest.approx(4 / 3, rel=1e-6)
    assert measures["constraint_excess"] == 0.0


HELD = """\
import casadi as ca
import swarmstart as ss


def build():
    x, u, price = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("price")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u + 0 * price, signals=price), horizon=2.0,
        intervals=2, checks=2, stage_cost=price * u + u**2, terminal=[(x, 1)],
        bounds=ss.Bounds(controls=(-2, 2)), features=[ss.HeldSignals(["price"])],
    )
    return problem, [0], ss.Known(signals=[[0, 5, 1, 5, 7]])
"""


def test_signals_that_plans_hold_are_held_in_the_simulated_system(
    project: Project,
) -> None:
    project.model.write_text(HELD)
    made = run(
        allowed(project.resolved("arguments={}", "measures={}", "steps=2")), seed=0
    )
    # min sum(p_k u_k + u_k^2) with u_0 + u_1 = 1 is 0.875; see test_held.py.
    assert made.measures["flown_cost"] == pytest.approx(0.875, rel=1e-6)
    assert "another" not in made.status


@pytest.mark.parametrize(
    ("returns", "said"),
    [
        ("None", r"\(problem, x0, known\); found \(NoneType\)"),
        ("problem", r"found \(OptimalControlProblem\)"),
        ("problem, [0, 0], 3", r"found \(OptimalControlProblem, list, int\)"),
        ("problem, [0, 0], ss.Known(), 3", r"Known, int\)"),
        ("problem, [0]", r"x0 of shape \(2,\); found \(1,\)"),
        ("problem, [0, float('nan')]", r"finite numbers as x0; found \[0.0, nan\]"),
        ("problem, 'ab'", "numbers as x0; found ValueError"),
        ("problem, model.states", "numbers as x0; found TypeError"),
        ("problem, [0, 0], ss.Known([1])", r"known.parameters of shape \(0,\)"),
    ],
)
def test_another_answer_is_refused(returns: str, said: str, project: Project) -> None:
    text = MODEL.replace("return problem, [0, 0]", f"return {returns}")
    project.model.write_text(text)
    with pytest.raises(UserCodeError, match=said):
        posed(project)


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        ("steps=51", "steps: expected at most the problem's 50 intervals .* found 51"),
        ("measures={m: anlge.end}", "measures.m: .*unknown name 'anlge'"),
        ("arguments={mass: 3}", "found TypeError: .*mass"),
        ("arguments={gravity: a}", "found TypeError|found NotImplementedError"),
    ],
)
def test_what_does_not_go_with_the_problem_is_refused(
    assignment: str, said: str, project: Project
) -> None:
    with pytest.raises(UserCodeError, match=said):
        posed(project, assignment)


def test_more_intervals_than_yaml_may_have_are_refused(project: Project) -> None:
    project.model.write_text(MODEL.replace("intervals=50", "intervals=10**9"))
    with pytest.raises(UserCodeError, match="at most 10000 intervals"):
        posed(project)


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        ("sha256=abc", "expected my_model.py with the hash abc, found one with"),
        ("problem=none.py:build", "No such file"),
        ("measures={m: angle}", "expected one number, .* found a path: angle"),
        ("measures={cost: angle.end}", "expected a new name, found 'cost'"),
        ("measures={m: angle +}", "expression"),
        ("prediction={intervals: 3}", "expected a known key, found 'prediction'"),
        ("search={name: none}\npolish=none", "expected a search, a polish or both"),
    ],
)
def test_what_can_be_said_without_running_the_file_is_said(
    assignment: str, said: str, project: Project
) -> None:
    with pytest.raises(InvalidScenarioError, match=said):
        project.resolved(*assignment.split("\n"))
    assert project.runs == 0


def test_the_file_is_in_the_key_and_its_folder_is_not(project: Project) -> None:
    key = key_of(project.resolved(), 0)
    moved = Project(project.folder.rename(project.folder.with_name("moved")))
    assert key_of(moved.resolved(), 0) == key
    moved.model.write_text(MODEL + "\n")
    assert key_of(moved.resolved(), 0) != key


def test_settings_alone_give_no_permission(
    project: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    resolved = allowed(project.resolved())
    folder = str(project.folder)
    assert resolved_again(resolved.settings, "", code_in=folder).posed().documents
    assert project.runs == 1
    with pytest.raises(InvalidScenarioError, match="No such file"):
        resolved_again(resolved.settings, "")
    monkeypatch.chdir(project.folder)  # The file is there, and still not allowed.
    with pytest.raises(CodeNotAllowedError):
        resolved_again(resolved.settings, "").posed()
    project.model.write_text(MODEL + "\n")
    with pytest.raises(InvalidScenarioError, match="the file has changed"):
        resolved_again(resolved.settings, "", code_in=folder)
    assert project.runs == 1


def test_the_bytes_that_are_run_are_those_that_were_hashed(project: Project) -> None:
    resolved = allowed(project.resolved())
    project.model.write_text("raise SystemExit")
    assert resolved.posed().documents == {"my_model.py": MODEL}


def test_decided_end_time_parameter_and_start_are_solved_and_flown(
    project: Project,
) -> None:
    start = "start={'v': ss.Free(-1, 0)}"
    text = DECIDED.replace("START", start).replace("X0", "float('nan')")
    project.model.write_text(text)
    changes = ("arguments={}", "steps=10", "measures={}", "search={name: none}")
    done = run(allowed(project.resolved(*changes)), seed=0)
    assert done.measures["confirmed"] == 1
    assert done.measures["decided_push"] == pytest.approx(4.0, abs=1e-6)
    assert done.measures["decided_v"] == pytest.approx(-1.0, abs=1e-6)
    assert done.trajectory.times[-1] == pytest.approx(done.measures["end_time"])
    assert done.measures["flown_cost"] == pytest.approx(done.measures["end_time"])
    np.testing.assert_allclose(done.trajectory.states[:, -1], 0.0, atol=1e-6)


def test_decided_end_time_is_followed_in_periods(project: Project) -> None:
    project.model.write_text(DECIDED.replace("START", "").replace("X0", "0"))
    changes = ("arguments={}", "steps=10", "measures={}", "search={name: none}")
    period = "feedback={law: receding_horizon, period_s: 0.25}"
    fine = "plant={substeps: 200}"
    done = run(allowed(project.resolved(*changes, period, fine)), seed=0)
    # Half of the way with 4, half with -4.
    assert done.measures["end_time"] == pytest.approx(1.0, abs=1e-2)
    assert done.trajectory.times[-1] == pytest.approx(1.0, abs=2e-2)
    np.testing.assert_allclose(done.trajectory.states[:, -1], 0.0, atol=2e-2)
    with pytest.raises(UserCodeError, match="at least the problem's 10 intervals"):
        posed(project, *changes, period, "plant={substeps: 9}")
    with pytest.raises(InvalidProblemError, match="needs a period"):
        run(allowed(project.resolved(*changes, "feedback=receding_horizon")), seed=0)
