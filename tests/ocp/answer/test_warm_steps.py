"""Closed loop with search and polish: the steps that are searched."""

from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

from swarmstart.heuristics import LSHADE, Budget
from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Plan,
    Planner,
    Plant,
    PolishStatus,
    RecedingHorizon,
    SearchSettings,
    Source,
    simulate,
)
from swarmstart.ocp.answer.plan import JUMP, better_plan, is_enough
from swarmstart.ocp.rollout.fitness import NOTHING

SEARCH = SearchSettings(algorithm=LSHADE(size=20), budget=Budget(evaluations=400))
X0 = np.array([1.0, 0.0])


@pytest.fixture(scope="module")
def problem() -> OptimalControlProblem:
    """A pendulum that follows a target, its parameter."""
    x, u, target = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("target")
    return OptimalControlProblem(
        Model(states=x, controls=u, parameters=target,
              ode=ca.vertcat(x[1], u - ca.sin(x[0]))),
        horizon=3.0,
        intervals=10,
        stage_cost=(x[0] - target) ** 2 + x[1] ** 2 + 0.1 * u**2,
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip


def loop(
    problem: OptimalControlProblem, search: SearchSettings | None
) -> RecedingHorizon:
    return RecedingHorizon(
        planner=Planner(problem, search=search, polish=IpoptOptions()),
        parameters=lambda time: np.array([0.0 if time < 1.4 else 1.5]),
    )


def flown(problem: OptimalControlProblem, search: SearchSettings | None) -> list[Plan]:
    flight = simulate(
        Plant(problem.model, dt=0.3, substeps=10,
              parameters=lambda times: np.zeros((1, times.size))),
        loop(problem, search), X0, steps=8, seed=0,
    )  # fmt: skip
    return [decision.plans[0] for decision in flight.decisions]


def test_only_the_first_plan_and_that_after_a_jump_of_the_target_are_searched(
    problem: OptimalControlProblem,
) -> None:
    plans = flown(problem, SEARCH)
    assert [k for k, plan in enumerate(plans) if plan.is_searched] == [0, 5]
    alone = flown(problem, None)
    for plan, other in zip(plans, alone, strict=True):
        assert plan.polish_status is PolishStatus.CONVERGED
        assert plan.cost <= other.cost * (1 + 1e-6)
    warm = plans[1]
    assert (warm.source, warm.search.evaluations.size) == (Source.POLISH, 0)
    assert warm.evaluations < 20 < plans[0].evaluations


def test_always_searches_every_plan_and_so_does_a_search_without_a_polish(
    problem: OptimalControlProblem,
) -> None:
    assert all(
        plan.is_searched for plan in flown(problem, replace(SEARCH, when="always"))
    )
    alone = RecedingHorizon(
        planner=Planner(problem, search=SEARCH), parameters=lambda time: np.zeros(1)
    )
    decision, rng = None, np.random.default_rng(0)
    for _ in range(3):
        decision = alone.decide(0.0, X0, decision, rng=rng)
        assert decision.plans[0].is_searched


def test_horizon_of_one_interval_leaves_nothing_so_that_each_plan_is_searched(
    problem: OptimalControlProblem,
) -> None:
    plans = flown(replace(problem, horizon=0.3, intervals=1), SEARCH)
    assert all(plan.is_searched for plan in plans)


def test_what_a_jump_is_depends_on_no_unit_of_the_cost(
    problem: OptimalControlProblem,
) -> None:
    """The rule J > 2 J_last of costs that are not negative."""
    for unit in (1e-9, 1.0, 1e9):
        scaled = replace(problem, stage_cost=unit * problem.stage_cost)
        planner = Planner(scaled, search=SEARCH, polish=IpoptOptions())
        x0, known, _ = planner.posed(X0, NOTHING._replace(parameters=[0.0]))
        plan = planner.plan(x0, known=known, rng=np.random.default_rng(0))
        size = plan.cost * JUMP
        for share, enough in ((0.9, True), (1.6, False)):
            last = plan.cost - share * size
            assert is_enough(planner.fitness, plan, x0, known, last) is enough
        assert is_enough(planner.fitness, plan, x0, known, None)
        for bad in (
            replace(plan, feasible=False),
            replace(plan, polish_status=PolishStatus.ITERATION_LIMIT),
        ):
            assert not is_enough(planner.fitness, bad, x0, known, plan.cost)


def test_a_plan_that_no_polish_converged_to_must_save_a_hundredth(
    problem: OptimalControlProblem,
) -> None:
    planner = Planner(problem, search=SEARCH, polish=IpoptOptions())
    x0, known, _ = planner.posed(X0, NOTHING._replace(parameters=[0.0]))
    solved = planner.plan(x0, known=known, rng=np.random.default_rng(0))
    for part, wins in ((0.995, False), (0.98, True)):
        loose = replace(solved, cost=part * solved.cost,
                        polish_status=PolishStatus.WORSE)  # fmt: skip
        best = better_plan(planner.fitness, loose, solved, x0, known)
        assert (best.polish_status is PolishStatus.WORSE) is wins
        assert best.evaluations == 2 * solved.evaluations


def test_multipliers_save_iterations_and_change_no_flight(
    problem: OptimalControlProblem,
) -> None:
    planner = loop(problem, None)
    rng = np.random.default_rng(0)
    last = planner.plan(0.0, X0, None, rng=rng)
    state = last.states[:, 1]
    with_them = planner.plan(0.3, state, last, rng=rng)
    without = planner.plan(0.3, state, replace(last, point=None), rng=rng)
    assert with_them.evaluations < without.evaluations
    np.testing.assert_allclose(with_them.controls, without.controls, atol=1e-5)
    assert last.point is not None


def test_a_loop_remembers_the_iterations_of_its_warm_polishes(
    problem: OptimalControlProblem,
) -> None:
    plans = flown(problem, None)
    assert plans[0].spent == ()
    for before, plan in pairwise(plans):
        assert plan.spent[:-1] == before.spent and 0 < plan.spent[-1] <= 20


def test_when_must_be_one_of_three() -> None:
    with pytest.raises(InvalidProblemError, match="needed or undecided or always"):
        replace(SEARCH, when="sometimes")  # type: ignore[arg-type]
