"""Perturbed starts lead down from a saddle, and nowhere from a flat minimum."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import repeat
from types import SimpleNamespace
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Plan,
    Planner,
    SolutionStatus,
    Source,
    solve,
)
from swarmstart.ocp.answer import improving
from swarmstart.ocp.answer.improving import STARTS, Settled, settled
from swarmstart.ocp.nlp.optimality import Curvature, curvature
from swarmstart.ocp.nlp.polish import SAME_COST, Polished
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.rollout.fitness import NOTHING
from swarmstart.ocp.search.account import Restarts

X, U = ca.SX.sym("x"), ca.SX.sym("u")


def scalar(cost: ca.SX, end: ca.SX) -> OptimalControlProblem:
    """x' = u over 1 s, |u| <= 2."""
    return OptimalControlProblem(
        Model(states=X, controls=U, ode=U),
        horizon=1.0,
        intervals=3,
        stage_cost=cost,
        terminal_cost=end,
        bounds=Bounds(controls=(-2, 2)),
    )


def planned(problem: OptimalControlProblem) -> tuple[Planner, Plan]:
    """Return the plan at which the polish from zero controls ends, from 0."""
    planner = Planner(problem, search=None, polish=IpoptOptions(), backend="casadi")
    return planner, planner.plan([0.0], rng=np.random.default_rng(0))


def looked_at(problem: OptimalControlProblem, seed: int = 0) -> tuple[Plan, Plan, bool]:
    planner, plan = planned(problem)
    rng = np.random.default_rng(seed)
    after, is_settled, _ = settled(planner, plan, [0.0], NOTHING, rng=rng)
    return plan, after, is_settled


@pytest.mark.parametrize("seed", range(3))
def test_saddle_is_left_downhill(seed: int) -> None:
    """u = 0 is stationary for u^2 / 9 + 4 cos x(1); the minimum lies at a bound."""
    plan, after, is_settled = looked_at(scalar(U**2 / 9, 4 * ca.cos(X)), seed)
    assert plan.point is not None
    assert curvature(plan.point) is Curvature.NEGATIVE
    np.testing.assert_allclose(plan.controls, 0, atol=1e-6)
    assert is_settled
    # With equal parts u: the least of u^2 / 9 + 4 cos u within |u| <= 2.
    np.testing.assert_allclose(np.abs(after.controls), 2, atol=1e-6)
    assert after.cost == pytest.approx(4 / 9 + 4 * np.cos(2))
    assert after.source is Source.POLISH
    assert after.evaluations > plan.evaluations
    assert after.states[0, -1] == pytest.approx(after.controls.mean())


def test_saddle_without_a_way_down_worth_it_is_not_settled() -> None:
    """Relative to a cost of 1e9 a fall of 4 is nothing; but a saddle is no minimum."""
    plan, after, is_settled = looked_at(scalar(1e9 + U**2 / 9, 4 * ca.cos(X)))
    assert plan.point is not None
    assert curvature(plan.point) is Curvature.NEGATIVE
    np.testing.assert_array_equal(after.controls, plan.controls)
    assert not is_settled


def test_strict_minimum_costs_no_evaluation() -> None:
    plan, after, is_settled = looked_at(scalar((U - 1) ** 2, X**2))
    assert is_settled
    assert after is plan


def test_flat_minimum_is_settled_by_all_starts() -> None:
    """Only the sum of the controls counts: singular, but nothing is better."""
    plan, after, is_settled = looked_at(scalar(ca.SX(0), (X - 0.5) ** 2))
    assert plan.point is not None
    assert curvature(plan.point) is Curvature.FLAT
    assert is_settled
    np.testing.assert_array_equal(after.controls, plan.controls)
    assert after.evaluations >= plan.evaluations + STARTS


def test_restarts_are_in_the_account_and_take_a_part_of_the_iterations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """With less than five of them nothing is decided."""
    problem = scalar(ca.SX(0), (X - 0.5) ** 2)
    found = solve(problem, [0], search=None, backend="casadi", seed=0)
    told = found.restarts
    assert told is not None
    assert (told.starts, told.better) == (STARTS, 0)
    assert f"  restarts    {told.line}" in str(found)
    assert told.iterations >= STARTS
    monkeypatch.setattr(improving, "_LEAST_ITERATIONS", told.iterations // 2)
    fewer = solve(problem, [0], search=None, backend="casadi", seed=0).restarts
    assert fewer is not None
    assert 0 < fewer.starts < STARTS
    monkeypatch.setattr(improving, "_LEAST_ITERATIONS", 1)
    monkeypatch.setattr(improving, "_SHARE", 0.0)
    left = solve(problem, [0], search=None, backend="casadi", seed=0)
    assert left.restarts is not None and left.restarts.starts == 1
    assert left.status is SolutionStatus.FEASIBLE


def test_flat_minimum_of_a_large_problem_is_left_undecided(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Not all starts are tried if they take long; then it is not called a minimum."""
    monkeypatch.setattr(improving, "_MOST_WORK", 1)
    plan, after, is_settled = looked_at(scalar(ca.SX(0), X**4))
    assert not is_settled
    assert after.cost == plan.cost
    planner, plan = planned(scalar(ca.SX(0), X**4))
    told = settled(planner, plan, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert told.restarts is not None and told.restarts.starts > 0


def test_flat_point_that_is_no_minimum_is_left() -> None:
    """x^3 is flat at 0 to second order: it falls on one side."""
    plan, after, _ = looked_at(scalar(U**4 / 100, X**3))
    np.testing.assert_allclose(plan.controls, 0, atol=1e-2)
    assert after.cost < -1


def test_plan_that_is_not_stationary_is_not_settled() -> None:
    planner, plan = planned(scalar((U - 1) ** 2, X**2))
    other = replace(plan, point=None)
    same = settled(planner, other, [0.0], NOTHING, rng=np.random.default_rng(0))
    assert same == (other, False, None)
    searching = Planner(planner.problem, search=None, backend="casadi")
    rng = np.random.default_rng(0)
    assert settled(searching, plan, [0.0], NOTHING, rng=rng)[:2] == (plan, False)


def test_solve_says_local_optimum_of_what_is_settled_only() -> None:
    def status(problem: OptimalControlProblem) -> tuple[SolutionStatus, str]:
        found = solve(problem, [0], search=None, backend="casadi", seed=0)
        return found.status, found.reason

    flat = status(scalar(ca.SX(0), (X - 0.5) ** 2))
    assert flat[0] is SolutionStatus.CONVERGED
    assert "no perturbed start" in flat[1]
    strict = status(scalar((U - 1) ** 2, X**2))
    assert strict == (
        SolutionStatus.CONVERGED, "stationary, with positive second derivatives"
    )  # fmt: skip
    saddle = solve(
        scalar(U**2 / 9, 4 * ca.cos(X)), [0], search=None, backend="casadi", seed=0
    )
    assert saddle.status is SolutionStatus.CONVERGED
    np.testing.assert_allclose(np.abs(saddle.controls), 2, atol=1e-6)


FLAT = scalar(ca.SX(0), (X - 0.5) ** 2)


class Descents:
    """A planner whose polish gives prescribed answers, each with 3 evaluations.

    Attributes:
        planner: The planner.
        plan: A plan at a flat point, of cost 1 and with 10 evaluations.
        starts: Controls that the polish started from.
    """

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        *,
        iterations: int = 1,
        answers: Iterator[dict[str, Any]] | None = None,
        cost: float = 1.0,
        bent: Callable[[object], Curvature] = lambda _: Curvature.FLAT,
    ) -> None:
        real, plan = planned(FLAT)
        answers = repeat({}) if answers is None else answers
        self.plan = replace(plan, cost=cost, evaluations=10, starts=None)
        self.starts: list[np.ndarray] = []

        def polisher(
            controls: np.ndarray, x0: Any, _: object, *, near: bool
        ) -> Polished:
            assert near
            self.starts.append(controls)
            answer = {"cost": cost, "violation": 0.0, **next(answers)}
            found = {
                "controls": controls, "x0": np.array(x0), "improved": True,
                "status": PolishStatus.CONVERGED, "iterations": iterations,
                "evaluations": 3, "point": plan.point, **answer,
            }  # fmt: skip
            return Polished(**found)

        monkeypatch.setattr(improving, "curvature", bent)
        self.planner = cast(
            Planner,
            SimpleNamespace(
                polisher=polisher,
                fitness=real.fitness,
                evaluated=real.evaluated,
                threads=1,
            ),
        )

    def settled(self, **changes: Any) -> Settled:
        plan = replace(self.plan, **changes)
        rng = np.random.default_rng(7)
        return settled(self.planner, plan, [0.0], NOTHING, rng=rng)


def account(starts: int, iterations: int, better: int = 0) -> Restarts:
    return Restarts(starts=starts, iterations=iterations, better=better, seconds=0.0)


@pytest.mark.parametrize(
    ("iterations", "before", "starts", "is_settled"),
    [
        (1, [], 20, True),
        (5, [], 20, True),  # 100 iterations in any case.
        (7, [], 15, True),
        (20, [], 5, True),  # The least that decides.
        (21, [], 5, True),
        (25, [], 4, False),
        (100, [], 1, False),
        (10, [200, 300], 10, True),  # A fifth of 500 is 100,
        (10, [300, 400], 14, True),  # of 700 it is 140.
        (10, [100, 300], 10, True),
        (10, [5000], 20, True),
    ],
)
def test_starts_take_a_fifth_of_the_iterations_before_them_or_a_hundred(
    monkeypatch: pytest.MonkeyPatch,
    iterations: int,
    before: list[int],
    starts: int,
    is_settled: bool,
) -> None:
    descents = Descents(monkeypatch, iterations=iterations)
    tried = [SimpleNamespace(iterations=count) for count in before]
    found = descents.settled(starts=SimpleNamespace(tried=tried) if before else None)
    assert found.restarts == account(starts, starts * iterations)
    assert found.is_settled == is_settled
    assert found.plan.evaluations == 10 + 3 * starts
    np.testing.assert_array_equal(found.plan.controls, descents.plan.controls)


def test_starts_of_a_large_problem_end_after_two_million_rows(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Iterations times rows: 2,000,000 go on, and a row more does not."""
    for rows, starts in (
        (10_000, 20),
        (20_000, 11),
        (50_000, 5),
        (50_001, 4),
        (100_001, 2),
    ):
        descents = Descents(monkeypatch, iterations=10)
        point = SimpleNamespace(lam_g=np.zeros(rows))
        found = descents.settled(
            point=point, starts=SimpleNamespace(tried=[SimpleNamespace(iterations=9e3)])
        )
        assert found.restarts == account(starts, 10 * starts)
        assert found.is_settled == (starts == 20)


def test_starts_are_as_far_away_as_a_thousandth_to_a_tenth_of_the_controls(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The controls' size is the width of their bounds, 4."""
    descents = Descents(monkeypatch)
    descents.settled()
    rng, controls = np.random.default_rng(7), descents.plan.controls
    for start in descents.starts:
        part = np.exp(rng.uniform(np.log(1e-3), np.log(1e-1)))
        move = 4 * part * rng.standard_normal((1, 3))
        np.testing.assert_allclose(start - controls, move, rtol=1e-6)


@pytest.mark.parametrize(
    ("cost", "answer", "is_better"),
    [
        (5.0, {"cost": 5 * (1 - 1.01e-6)}, True),
        (5.0, {"cost": 5 * (1 - 0.99e-6)}, False),
        (-5.0, {"cost": -5 * (1 + 1.01e-6)}, True),
        (-5.0, {"cost": -5 * (1 + 0.99e-6)}, False),
        (5.0, {"cost": 4.0, "violation": FLAT.tolerance}, True),
        (5.0, {"cost": 4.0, "violation": 1.01 * FLAT.tolerance}, False),
        (5.0, {"cost": 4.0, "status": PolishStatus.ITERATION_LIMIT}, False),
        (5.0, {"cost": 6.0}, False),
    ],
)
def test_start_is_better_if_it_converged_to_a_lower_cost_within_the_tolerance(
    monkeypatch: pytest.MonkeyPatch,
    cost: float,
    answer: dict[str, Any],
    is_better: bool,
) -> None:
    assert SAME_COST == 1e-6
    bent = iter([Curvature.FLAT, Curvature.POSITIVE])
    descents = Descents(
        monkeypatch, cost=cost, answers=iter([{}, answer, *[{}] * 18]),
        bent=lambda _: next(bent),
    )  # fmt: skip
    found = descents.settled()
    assert found.is_settled
    expected = account(2, 2, better=1) if is_better else account(20, 20)
    assert found.restarts == expected
    assert found.plan.cost == (answer["cost"] if is_better else cost)


def test_near_a_cost_of_zero_the_natural_size_says_what_is_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    planner, plan = planned(FLAT)
    sizes = planner.fitness.arguments.sizes_along(
        plan.controls, plan.states, [0.0], NOTHING
    )
    for part, better in ((1.01, 1), (0.99, 0)):
        fall = {"cost": -part * 1e-6 * sizes.cost}
        descents = Descents(
            monkeypatch, cost=0.0, answers=iter([fall, *[{"cost": 0.0}] * 60])
        )
        found = descents.settled()
        assert found.restarts is not None and found.restarts.better == better


def test_way_down_is_followed_from_each_better_point_and_counted_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of 100 iterations the third start leaves 70 to those from its better point."""
    answers = iter([{}, {}, {"cost": 0.5}, *[{"cost": 0.5}] * 7])
    descents = Descents(monkeypatch, iterations=10, answers=answers)
    found = descents.settled()
    assert found.restarts == account(10, 100, better=1)
    assert found.is_settled
    assert found.plan.cost == 0.5
    assert found.plan.evaluations == 10 + 10 * 3
    assert found.plan.source is Source.POLISH
    np.testing.assert_allclose(found.plan.controls, descents.starts[2])
    # A point that is better each time is left undecided after three of them.
    answers = iter([{"cost": -float(k)} for k in range(5)])
    found = Descents(monkeypatch, answers=answers).settled()
    assert (found.restarts, found.is_settled) == (account(3, 3, better=3), False)
    assert found.plan.cost == -2.0


def test_saddle_is_no_minimum_even_if_no_start_leads_down(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for bent, is_settled, starts in (
        (Curvature.NEGATIVE, False, 20),
        (Curvature.FLAT, True, 20),
        (Curvature.POSITIVE, True, 0),
    ):
        found = Descents(monkeypatch, bent=lambda _, bent=bent: bent).settled()  # type: ignore[misc]
        assert found.is_settled == is_settled
        assert found.restarts == (account(starts, starts) if starts else None)
