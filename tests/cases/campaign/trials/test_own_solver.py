"""Solvers of a user's own are counted, judged and refused like all others."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.cases.campaign.trials.own_solver import OwnSolverError, required_solver
from swarmstart.cases.format.kind import SeveralPlansError
from swarmstart.ocp.statement import END_TIME
from swarmstart.tests.processes import announced, ended, installed_beside

FIXED = ss.OptimalControlProblem(
    ss.Model(
        states=(x := ca.SX.sym("x")),
        controls=(u := ca.SX.sym("u", 2)),
        ode=u[0] - u[1],
        control_names=("push", "pull"),
    ),
    horizon=1.0,
    intervals=3,
    terminal_cost=(x - 1) ** 2,
    stage_cost=ca.sumsqr(u) / 10,
    bounds=ss.Bounds(controls=([0, 0], [2, 1])),
)
FIXED_COST = 1 / 11
"""The least of (1 - push)^2 + push^2 / 10, at a push of 10 / 11 and no pull."""
DECIDED = ss.OptimalControlProblem(
    ss.Model(states=(y := ca.SX.sym("y")), controls=(v := ca.SX.sym("v")), ode=v),
    horizon=ss.Free(0.5, 3.0),
    intervals=2,
    stage_cost=ca.SX(1),
    terminal=[(y, 1.0)],
    bounds=ss.Bounds(controls=(-1, 1)),
)


def row_of(solver: Any, problem: Any = (FIXED, [0.0]), **given: Any) -> ss.Row:
    settings = {"seeds": 1, "budget": 100, **given}
    (row,) = ss.compare(problem, {"mine": solver}, **settings)
    return row


def test_an_answer_is_judged_as_it_is_and_charged_the_budget_if_it_does_not_count() -> (
    None
):
    best = np.array([[10 / 11] * 3, [0.0] * 3])
    row = row_of(lambda problem, x0, budget, rng: best)
    assert row.costs == pytest.approx([FIXED_COST], rel=1e-9)
    assert row.feasible == 1 and row.evaluations == 100


def test_evaluations_are_those_of_the_evaluator_and_the_best_of_them_is_an_answer() -> (
    None
):
    seen: list[Any] = []

    def mine(problem: Any, x0: Any, budget: Any, rng: Any, evaluate: Any) -> None:
        points = rng.uniform(0, 1, (2, 3, 7))
        cost, violation = evaluate(points)
        one, _ = evaluate(points[:, :, 4])
        assert one[0] == cost[4] and cost.shape == violation.shape == (7,)
        seen.append((points, cost, budget.evaluations))

    row = row_of(mine)
    ((points, cost, most),) = seen
    assert most == 100 and row.evaluations == 8
    # Three intervals of constant speed: the closed form of the cost.
    moved = (points[0] - points[1]).sum(axis=0) / 3
    expected = (moved - 1) ** 2 + (points**2).sum(axis=(0, 1)) / 30
    assert cost == pytest.approx(expected, rel=1e-9)
    assert row.costs == pytest.approx([expected.min()], rel=1e-9)


@pytest.mark.parametrize(("budget", "most"), [(100, 100), ("1s", None)])
def test_a_solver_without_an_end_is_ended_with_its_budget(
    budget: Any, most: int | None
) -> None:
    def endless(problem: Any, x0: Any, budget: Any, rng: Any, evaluate: Any) -> None:
        while True:
            evaluate(rng.uniform(0, 1, (2, 3, 30)))

    row = row_of(endless, budget=budget)
    result = row.outcomes[0].result
    assert row.feasible == 1 and result is not None
    assert row.evaluations == most or most is None
    assert result["stopped_by"] == ("evaluations" if most else "seconds")


def test_the_same_seed_gives_the_same_answer_and_another_seed_another() -> None:
    def drawn(problem: Any, x0: Any, budget: Any, rng: Any) -> Any:
        return rng.uniform(0, 1, (2, 3))

    first, second = (row_of(drawn, seeds=3).costs for _ in range(2))
    assert first == second and len({*first}) == 3


def test_a_decided_end_time_is_answered_with_a_start() -> None:
    def mine(problem: Any, x0: Any, budget: Any, rng: Any) -> ss.Start:
        return ss.Start(np.full((1, 2), 0.5), decided={END_TIME: 2.0})

    row = row_of(mine, (DECIDED, [0.0]))
    assert row.feasible == 1 and row.costs == pytest.approx([2.0])
    # Without it the guess of the end time counts, which does not lead to the goal.
    lost = row_of(lambda problem, x0, budget, rng: [0.1, 0.1], (DECIDED, [0.0]))
    assert lost.feasible == 0


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (None, "returned no controls, and evaluated none"),
        (np.zeros((2, 4)), r"controls of shape \(2, 3\), found \(2, 4\)"),
        (np.full((2, 3), np.nan), "expected finite controls"),
        (np.full((2, 3), np.inf), "expected finite controls"),
        (np.zeros((2, 3)) + 1j, r"real controls of shape \(2, 3\)"),
        (np.array([["a"] * 3] * 2), r"real controls of shape \(2, 3\)"),
        (np.array([[0.0] * 3, [0.0, 0.0, 1.1]]), "within their bounds, found pull"),
        (np.array([[-1e-6] * 3, [0.0] * 3]), "found push from -1e-06 to -1e-06"),
        ("text", r"real controls of shape \(2, 3\)"),
    ],
)
def test_what_is_no_answer_is_a_failure_with_its_reason(answer: Any, said: str) -> None:
    row = row_of(lambda problem, x0, budget, rng: answer)
    assert row.feasible == 0 and row.outcomes[0].result is None
    with pytest.raises(OwnSolverError, match=said):
        raise OwnSolverError(row.outcomes[0].failure)


def test_a_fault_of_one_solver_fails_its_runs_and_no_other() -> None:
    def odd(problem: Any, x0: Any, budget: Any, rng: Any) -> Any:
        raise KeyError("half\nof it")

    bad, good = ss.compare((FIXED, [0.0]), [odd, "ipopt"], seeds=2, budget=100)
    assert [one.failure for one in bad.outcomes] == [
        r"odd failed: KeyError: 'half\nof it'"
    ] * 2
    assert good.feasible == 1 and bad.feasible == 0


def test_a_solver_that_goes_on_after_its_budget_is_told_again() -> None:
    def stubborn(problem: Any, x0: Any, budget: Any, rng: Any, evaluate: Any) -> None:
        while len(ends) < 3:
            try:
                evaluate(rng.uniform(0, 1, (2, 3, 30)))
            except Exception as error:  # noqa: BLE001 - as a library may
                ends.append(type(error).__name__)

    ends: list[str] = []
    row = row_of(stubborn)
    assert ends == ["BudgetSpent"] * 3
    assert row.evaluations == 100 and row.feasible == 1


def test_the_end_of_the_budget_may_come_as_an_error_of_a_library() -> None:
    def wrapped(problem: Any, x0: Any, budget: Any, rng: Any, evaluate: Any) -> None:
        try:
            while True:
                evaluate(rng.uniform(0, 1, (2, 3, 30)))
        except Exception as error:
            raise RuntimeError("the objective failed") from error

    assert row_of(wrapped).feasible == 1


@pytest.mark.parametrize(
    "wrong",
    [np.zeros((2, 3)) + 1j, [["a"] * 3] * 2, np.zeros((2, 4)), np.zeros((2, 3, 0)), 1],
)
def test_only_real_controls_of_the_right_shape_are_evaluated(wrong: Any) -> None:
    def mine(problem: Any, x0: Any, budget: Any, rng: Any, evaluate: Any) -> None:
        with pytest.raises(OwnSolverError, match=r"expected real controls of shape"):
            evaluate(wrong)
        evaluate(np.zeros((2, 3)))

    assert row_of(mine).feasible == 1


def test_controls_that_are_no_numbers_are_evaluated_as_the_worst() -> None:
    def mine(problem: Any, x0: Any, budget: Any, rng: Any, evaluate: Any) -> None:
        points = np.zeros((2, 3, 2))
        points[0, 0, 0] = np.nan
        cost, _ = evaluate(points)
        assert not np.isfinite(cost[0]) and np.isfinite(cost[1])

    assert row_of(mine).costs == pytest.approx([1.0])


def test_controls_outside_of_their_bounds_are_no_cheap_answer_of_evaluate() -> None:
    def mine(problem: Any, x0: Any, budget: Any, rng: Any, evaluate: Any) -> None:
        _, violation = evaluate(np.array([[10 / 11] * 3, [-0.5] * 3]))
        assert violation[0] == pytest.approx(0.5)
        evaluate(np.full((2, 3), 0.1))

    assert row_of(mine).feasible == 1


@pytest.mark.parametrize(
    "wrong", [3, lambda: 0, lambda problem, x0: 0, lambda *, problem: 0, object()]
)
def test_what_takes_no_arguments_of_a_solver_is_refused_at_the_door(wrong: Any) -> None:
    with pytest.raises(OwnSolverError, match=r"mine: expected a function of \(problem"):
        required_solver(wrong, "mine")
    with pytest.raises(ss.SwarmstartError):
        row_of(wrong)


def test_settings_and_classes_of_searches_are_solvers() -> None:
    rows = ss.compare(
        (FIXED, [0.0]),
        {"small": ss.LSHADE(size=8), "own": ss.RandomSearch, "named": "lshade"},
        seeds=2,
        budget=200,
    )
    assert [row.solver for row in rows] == ["small", "own", "lshade"]
    assert rows[0].costs != rows[2].costs
    with pytest.raises(ss.UnknownSolverError, match="two of 'LSHADE'"):
        ss.compare((FIXED, [0.0]), [ss.LSHADE(size=8), ss.LSHADE()], seeds=1)


@pytest.mark.parametrize("is_first", [True, False])
def test_a_function_is_not_taken_for_a_solver_of_the_library(is_first: bool) -> None:
    def ipopt(problem: Any, x0: Any, budget: Any, rng: Any) -> Any:
        return np.zeros((2, 3))

    both: list[Any] = [ipopt, "ipopt"] if is_first else ["ipopt", ipopt]
    with pytest.raises(ss.UnknownSolverError, match="two of 'ipopt'"):
        ss.compare((FIXED, [0.0]), both, seeds=1)
    (row,) = ss.compare((FIXED, [0.0]), ipopt, seeds=1, budget=50)
    assert row.costs == pytest.approx([1.0])


def test_a_scenario_is_solved_by_it_if_it_plans_once() -> None:
    def zero(problem: Any, x0: Any, budget: Any, rng: Any) -> Any:
        return np.zeros((1, problem.intervals))

    first, mine = ss.compare("van_der_pol", ["ipopt", zero], seeds=1, budget=50)
    assert (first.solver, mine.solver) == ("ipopt", "zero") and mine.feasible == 1
    with pytest.raises(SeveralPlansError):
        ss.compare("formation_v", zero, seeds=1, settings={"steps": 2})


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A package `lottery` with solvers, as installed."""
    (tmp_path / "lottery").mkdir()
    (tmp_path / "lottery" / "__init__.py").write_text(
        "import numpy as np\n"
        "def draw(problem, x0, budget, rng):\n"
        "    return rng.uniform(-0.1, 0.1, (1, problem.intervals))\n"
    )
    announced(
        tmp_path,
        "lottery",
        "[swarmstart.solvers]\n"
        "draw = lottery:draw\nlost = lottery.absent:draw\nodd = lottery:np\n"
        "solve = lottery:draw\nipopt = lottery:draw\nrepeated-ipopt = lottery:draw\n",
    )
    return tmp_path


def test_a_solver_of_another_package_is_compared_by_its_name(folder: Path) -> None:
    run = ended(
        *("-m", "swarmstart", "compare", "van_der_pol", "--solvers", "draw,ipopt,lost"),
        *("--seeds", "2", "--budget", "100", "--json", "-q"),
        root=folder,
        variables=installed_beside(folder),
    )
    (one,) = json.loads(run.stdout)["scenarios"]
    rows = {row["solver"]: row for row in one["rows"]}
    assert rows["draw"]["feasible"] == 2 and rows["ipopt"]["feasible"] == 1
    assert "expected a solver at lottery.absent:draw" in rows["lost"]["failed"][0]
    known = ended(
        *("-m", "swarmstart", "compare", "van_der_pol", "--solvers", "draw[a=1]"),
        root=folder,
        variables=installed_beside(folder),
    )
    assert "expected draw without options: it is a function" in known.stderr
