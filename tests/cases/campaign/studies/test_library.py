"""`run` and `compare` as functions of the library."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.campaign.studies.library import Compared
from swarmstart.cases.format.scenario import read_document, resolve

SMALL = {"steps": 2, "budget": {"evaluations": 40}}


def landing() -> tuple[ss.OptimalControlProblem, list[float]]:
    """A double integrator with a quadratic cost: convex, so every start leads there."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        horizon=2.0,
        intervals=5,
        stage_cost=ca.sumsqr(x) + u**2,
        bounds=ss.Bounds(controls=(-2, 2)),
    )
    return problem, [1.0, 0.0]


def test_a_run_of_the_library_is_that_of_the_command() -> None:
    resolved = resolve(
        read_document("formation_v"),
        assignments=["steps=2", "budget.evaluations=40"],
    )
    expected = run(resolved, seed=3)
    told: list[tuple[int, int, str]] = []
    found = ss.run(
        "formation_v",
        seed=3,
        settings={"steps": np.int64(2), "budget.evaluations": 40},
        progress=lambda *news: told.append(news),
    )
    assert found.measures == {
        **expected.measures,
        **{k: v for k, v in found.measures.items() if "seconds" in k},
    }
    assert found.resolved.settings == expected.resolved.settings
    assert told[-1] == (2, 2, "simulating")
    assert repr(found).startswith("Run of formation_v, seed 3: simulated to the end")


def test_a_run_is_recorded_where_it_is_asked_to_be_and_loaded_again(
    tmp_path: Path,
) -> None:
    finished = ss.run(
        "formation_v", seed=0, out=tmp_path / "a", figures=False, settings=SMALL
    )
    assert finished.folder == tmp_path / "a"
    again = ss.load(tmp_path / "a")
    assert again.summary["measures"] == finished.summary()["measures"]


def test_a_file_is_run_by_its_path(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    settings = resolve(read_document("formation_v"), assignments=["steps=1"]).settings
    file.write_text(json.dumps(dict(settings)))
    assert ss.run(file, seed=0, settings=SMALL).resolved.settings["steps"] == 2


def test_a_wrong_setting_is_refused_with_its_place() -> None:
    with pytest.raises(ss.InvalidScenarioError, match="expected steps to be"):
        ss.run("formation_v", seed=0, settings={"steps": 0.5})
    with pytest.raises(ss.UnknownScenarioError, match="did you mean formation_v"):
        ss.run("formation_w", seed=0)


def test_solvers_of_a_users_problem_are_compared_under_one_budget() -> None:
    told: list[str] = []
    solvers = ["ipopt", "lshade", "lshade+ipopt"]
    rows = ss.compare(
        landing(),
        solvers,
        seeds=2,
        budget=600,
        progress=lambda done, of, what: told.append(f"{done} of {of}: {what}"),
    )
    assert [row.entry.solver.name for row in rows] == solvers
    assert [len(row.outcomes) for row in rows] == [1, 2, 2]
    assert all(row.feasible == len(row.outcomes) for row in rows)
    least = rows[0].costs[0]
    np.testing.assert_allclose(rows[2].costs, least, rtol=1e-6)
    assert rows[1].costs[0] >= least - 1e-9
    assert rows[1].evaluations is not None and rows[1].evaluations <= 600
    assert told[0] == "0 of 5: problem 1, ipopt, seed 0"
    assert repr(rows[0]).startswith(
        "problem 1, ipopt: 1 of 1 feasible, 1 near the best"
    )


def test_problems_with_names_stand_beside_scenarios() -> None:
    problems: dict[str, Compared] = {"landing": landing(), "side": "passing_side"}
    rows = ss.compare(problems, "ipopt", seeds=1, budget="2000evals")
    assert [row.entry.scenario for row in rows] == ["landing", "side"]
    # From zero controls IPOPT passes the disc on the costlier side, with a margin.
    assert rows[1].costs == pytest.approx([1802.0], abs=0.1)


def test_what_no_solver_can_do_is_a_failure_of_its_row() -> None:
    problem, x0 = landing()
    free = ss.OptimalControlProblem(
        problem.model, horizon=1.0, intervals=2, stage_cost=problem.stage_cost
    )
    (row,) = ss.compare((free, x0), "lshade", seeds=1, budget=100)
    assert row.feasible == 0 and "bounds" in row.outcomes[0].failure


def test_wrong_names_and_budgets_are_refused_before_anything_is_solved() -> None:
    with pytest.raises(ss.UnknownSolverError, match="found 'snopt'"):
        ss.compare(landing(), ["lshade", "snopt"])
    with pytest.raises(ss.InvalidBudgetTextError, match="found '0evals'"):
        ss.compare(landing(), "lshade", budget=0)


def decided() -> tuple[ss.OptimalControlProblem, list[float]]:
    """From 1 to rest at 0 in the least time, with a push to be chosen: 1 s at 4."""
    x, u, push = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("push")
    problem = ss.OptimalControlProblem(
        ss.Model(
            states=x, controls=u, ode=ca.vertcat(x[1], push * u), parameters=push
        ),
        horizon=ss.Free(0.2, 5.0, guess=3.0),
        intervals=10,
        stage_cost=ca.SX(1),
        bounds=ss.Bounds(controls=(-1, 1)),
        terminal=[x],
        decided={"push": ss.Free(0.5, 4.0)},
        start={"x_1": ss.Free(-1.0, 0.0)},
    )  # fmt: skip
    return problem, [1.0, np.nan]


def test_solvers_are_compared_where_more_than_controls_is_decided() -> None:
    problem, x0 = decided()
    answer = ss.solve(problem, x0, search=None, seed=0)
    solvers = ["lshade+ipopt", "repeated-ipopt", "ipopt", "de"]
    *polished, searched = ss.compare((problem, x0), solvers, seeds=2, budget=1500)
    for row in polished:
        assert row.successes == len(row.outcomes)
        assert row.costs == pytest.approx([answer.cost] * len(row.costs), rel=1e-6)
    assert searched.outcomes[0].result is not None
    assert searched.outcomes[0].result["evaluations"] <= 1500


BEAD = """\
kind: problem
states:
  x: {start: 0, rate: v*sin(slope)}
  y: {start: 0, rate: v*cos(slope)}
  v: {start: 0, rate: 9.8*cos(slope), bounds: [0, null]}
controls: {slope: {bounds: [0, pi], previous: 1}}
stage_cost: 1
step_cost: 1e-9*(slope - previous(slope))**2*time
terminal: [{expression: x, equals: 2}, {expression: y, equals: 2}]
prediction: {horizon_s: {free: [0.1, 5], guess: 1}, intervals: 20}
"""


def test_scenario_that_decides_its_end_time_is_compared(tmp_path: Path) -> None:
    file = tmp_path / "bead.yaml"
    file.write_text(BEAD)
    rows = ss.compare(file, ["lshade+ipopt", "repeated-ipopt", "ipopt"], seeds=2)
    for row in rows:
        assert row.feasible == len(row.outcomes)
        assert row.costs == pytest.approx([0.824884] * len(row.costs), rel=1e-5)


def test_whole_flights_are_compared_where_several_plan() -> None:
    small = {"steps": 2}
    rows = ss.compare(
        "formation_v", "de,ipopt,scipy-de", seeds=2, budget=60, settings=small
    )
    # The search of another package cannot plan in closed loop, and is left out.
    assert [row.entry.solver.name for row in rows] == ["de", "ipopt"]
    flown = ss.run(
        "formation_v", seed=1, search="de", polish="none",
        settings={**small, "budget.evaluations": 60, "lanes": 0},
    )  # fmt: skip
    assert flown.measures["closed_loop_cost"] in rows[0].costs
    assert len(rows[0].costs) == 2 and len(rows[1].costs) == 1
