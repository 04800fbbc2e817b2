"""Searches by local solves in lanes: results, cost and end."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.heuristics import Box, Budget
from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    IpoptOptions,
    Memetic,
    Model,
    Multistart,
    OptimalControlProblem,
    Planner,
    SearchSettings,
    Solution,
    SolveInterrupted,
    TrajectoryFamily,
    solve,
)
from swarmstart.ocp.lanes.answers import unseen_share
from swarmstart.ocp.lanes.solver import LaneSolver
from swarmstart.ocp.search.settings import search_settings
from swarmstart.tests.ocp.lanes.problems import cart, four_discs, pendulum

pytestmark = pytest.mark.usefixtures("compiler")
START = [0.0, 0.0, 0.0]


def searched(
    problem: OptimalControlProblem,
    x0: list[float],
    search: Multistart | Memetic | str,
    budget: Budget | int | None = None,
    **more: object,
) -> Solution:
    more = {"repair": False, "seed": 0, **more}
    return solve(problem, x0, search=search, budget=budget, **more)  # type: ignore[arg-type]


def test_multistart_finds_the_best_of_many_optima_without_a_population() -> None:
    """10.8186 and 10.8435 of the four discs, as IPOPT from random starts finds them."""
    answer = searched(four_discs(), START, "multistart", 150_000)
    assert answer.cost == pytest.approx(10.8186, abs=1e-4)
    lanes = answer.plan.search.lanes
    assert lanes is not None
    assert [one.cost for one in lanes.optima[:2]] == pytest.approx(
        [10.8186, 10.8435], abs=1e-4
    )
    assert answer.plan.search.cost == pytest.approx(answer.cost, rel=1e-5)


def test_multistart_ends_when_hardly_an_optimum_is_unseen() -> None:
    """A convex problem has one: 3 / n is below 5 % from 61 starts on."""
    answer = searched(cart(), [0.0, 1.0], Multistart(size=32))
    lanes = answer.plan.search.lanes
    assert lanes is not None
    assert len(lanes.optima) == 1
    assert lanes.starts == 64
    assert lanes.unseen == unseen_share([64])
    assert answer.plan.evaluations < 200_000
    on = searched(cart(), [0.0, 1.0], Multistart(size=32, unseen=0.0), 60_000)
    assert on.plan.search.lanes is not None
    assert on.plan.search.lanes.starts > 64


@pytest.mark.parametrize("search", ["multistart", "memetic"])
def test_budget_of_evaluations_pays_for_the_lanes(search: str) -> None:
    answer = searched(four_discs(), START, search, 30_000, polish=None)
    assert 24_000 <= answer.plan.evaluations <= 40_000
    assert answer.plan.search.evaluations[-1] == answer.plan.evaluations
    lanes = answer.plan.search.lanes
    assert lanes is not None
    assert 4 <= lanes.starts <= 40


def test_lanes_of_a_memetic_search_make_its_members_local_optima() -> None:
    """36.7126 of the pendulum: a population alone is at twice that, and infeasible."""
    alone = searched(pendulum(), [0.0, 0.0], "lshade", 10_000, polish=None)
    assert alone.plan.violation > 1e-6
    assert alone.cost > 60
    answer = searched(pendulum(), [0.0, 0.0], "memetic", 10_000, polish=None)
    assert answer.plan.violation <= 1e-6
    assert answer.cost == pytest.approx(36.7126, abs=1e-3)


@pytest.mark.parametrize("search", ["multistart", "memetic"])
def test_same_seed_gives_the_same_bits(search: str) -> None:
    one, two = (searched(four_discs(), START, search, 15_000) for _ in range(2))
    np.testing.assert_array_equal(one.controls, two.controls)
    assert one.plan.search.lanes == two.plan.search.lanes
    assert one.plan.evaluations == two.plan.evaluations


def test_cost_of_an_iteration_is_fixed_and_no_less_than_there_and_back() -> None:
    one, two = (LaneSolver(pendulum()).rollouts_per_iteration for _ in range(2))
    assert one == two
    assert 3 < one < 100


@pytest.mark.parametrize("search", ["multistart", "memetic"])
def test_without_a_lane_method_another_way_is_taken_and_said(search: str) -> None:
    answer = searched(cart(blocks=[25, 25]), [0.0, 1.0], search, 200)
    assert answer.cost == pytest.approx(2.0)
    assert answer.plan.search.lanes is None
    assert "searched    without lanes: it has blocks of intervals" in str(answer)
    assert answer.plan.evaluations >= 200


def test_budget_too_small_for_a_local_solve_is_said() -> None:
    answer = searched(four_discs(), START, "memetic", 500)
    assert "without lanes: a local solve would cost more" in str(answer)


def test_multistart_that_nothing_can_solve_is_refused() -> None:
    with pytest.raises(InvalidProblemError, match=r"blocks.*there is no polish"):
        searched(cart(blocks=[25, 25]), [0.0, 1.0], "multistart", polish=None)
    u, x = ca.SX.sym("u"), ca.SX.sym("x")
    whole = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4, stage_cost=x**2,
        bounds=Bounds(controls=(-1, 1), integer=[0]),
    )  # fmt: skip
    with pytest.raises(InvalidProblemError, match="whole numbers"):
        searched(whole, [0.5], "multistart")


def test_members_of_a_family_are_polished_where_lanes_cannot_begin() -> None:
    u, x = ca.SX.sym("u"), ca.SX.sym("x")
    c, x0, p = ca.SX.sym("c"), ca.SX.sym("x0", 1), ca.SX.sym("p", 0)
    held = ca.Function("held", [c, x0, p], [ca.repmat(x0, 1, 5), ca.repmat(c, 1, 5)])
    one = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4, stage_cost=x**2,
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    alone = solve(one, [0.5], search=None, seed=0)
    line = Box(lower=np.array([-1.0]), upper=np.array([1.0]))
    family = TrajectoryFamily(box=line, trajectory=held)
    for search in ("multistart", "memetic"):
        planner = Planner(
            one,
            search=search_settings(search, 40),
            polish=IpoptOptions(),
            family=family,
        )
        plan = planner.plan([0.5], rng=np.random.default_rng(0))
        assert plan.cost == pytest.approx(alone.cost)
        assert plan.search.without_lanes == "its search looks at members of a family"


@pytest.mark.parametrize("search", ["multistart", "memetic"])
def test_ctrl_c_keeps_the_best_so_far(search: str) -> None:
    def stop() -> Callable[[int, int, str], None]:
        told = []

        def tell(done: int, of: int, what: str) -> None:
            if what == "searching":
                told.append(done)
                if len(told) == 3:
                    raise KeyboardInterrupt

        return tell

    algorithm = Multistart(size=8) if search == "multistart" else search
    with pytest.raises(SolveInterrupted) as stopped:
        searched(four_discs(), START, algorithm, 200_000, progress=stop())
    assert np.isfinite(stopped.value.partial.cost)
    assert stopped.value.partial.plan.evaluations > 0


def test_seconds_and_a_target_end_it() -> None:
    quick = searched(four_discs(), START, Multistart(size=8), Budget(seconds=1e-3))
    lanes = quick.plan.search.lanes
    assert lanes is not None
    assert lanes.starts == 8
    there = Budget(evaluations=10**6, target=12.0)
    aimed = searched(four_discs(), START, Multistart(size=8), there)
    assert aimed.plan.evaluations < 10**6 / 4
    assert aimed.plan.search.cost <= 12.0
    still = Budget(evaluations=10**6, stagnation=1)
    ended = searched(cart(), [0.0, 1.0], Multistart(size=8, unseen=0.0), still)
    assert ended.plan.evaluations < 10**5


def test_guess_is_one_of_the_starts() -> None:
    """A valley that random starts miss, but the user knows."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=4,
        stage_cost=1e-3 * u**2,
        terminal_cost=1 - 0.1 * x**2 - 5 * ca.exp(-2000 * (x - 0.95) ** 2),
        bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    one = Multistart(size=1, unseen=1.0)
    settings = SearchSettings(algorithm=one, budget=Budget(evaluations=1))
    answer = solve(
        problem, [0.0], search=settings, guess=np.full((1, 4), 0.945), seed=0
    )
    assert answer.cost < -4


def test_gains_are_told_as_gains() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=1.0, intervals=5,
        stage_cost=2.5 - u**2, maximize=True, bounds=Bounds(controls=(-1, 1)),
    )  # fmt: skip
    assert "searched    16 starts: 2.5 (16)" in str(
        searched(problem, [0.0], Multistart(size=16, unseen=0.5))
    )


def test_start_that_breaks_down_leaves_the_others() -> None:
    """From most starts the state explodes."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=x**3 + 4 * u), horizon=2.0, intervals=20,
        stage_cost=x**2 + u**2, bounds=Bounds(controls=(-2, 2)),
    )  # fmt: skip
    for search in ("multistart", "memetic"):
        assert searched(problem, [0.1], search, 20_000).status.is_confirmed


def test_sampling_of_a_multistart_is_refused() -> None:
    budget = Budget(evaluations=100)
    with pytest.raises(InvalidProblemError, match="sampling must be left out"):
        SearchSettings(algorithm=Multistart(), budget=budget, sampling="uniform")


def test_names_classes_and_settings_are_one() -> None:
    for given in ("multistart", Multistart, Multistart()):
        settings = search_settings(given)
        assert settings is not None
        assert settings.algorithm == Multistart()
        assert settings.budget.evaluations == 500_000
    settings = search_settings(Memetic)
    assert settings is not None
    assert settings.algorithm == Memetic()
    assert settings.budget.evaluations == 20_000
