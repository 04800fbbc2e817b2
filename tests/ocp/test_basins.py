import casadi as ca
import numpy as np
import pytest

from swarmstart.heuristics import Budget, DifferentialEvolution
from swarmstart.ocp import (
    Bounds,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Planner,
    SearchSettings,
)
from swarmstart.ocp.answer.plan import Source
from swarmstart.ocp.common.errors import InvalidProblemError

X0 = np.zeros(1)


@pytest.fixture(scope="module")
def two_valleys() -> OptimalControlProblem:
    """One control: a wide valley at -1, and a deeper, narrow one at 1.6."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    wide = (u + 1) ** 2
    narrow = -2 * ca.exp(-(((u - 1.6) / 0.15) ** 2))
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=0 * x),
        horizon=1.0,
        intervals=1,
        stage_cost=wide / 4 + narrow,
        bounds=Bounds(controls=(-3.0, 3.0)),
    )


def settings(basins: int) -> SearchSettings:
    return SearchSettings(
        algorithm=DifferentialEvolution(size=8),
        budget=Budget(evaluations=16),
        basins=basins,
        radius=0.15,
    )


def test_polish_from_several_basins_finds_what_the_best_point_alone_misses(
    two_valleys: OptimalControlProblem,
) -> None:
    costs = {}
    for basins in (0, 6):
        planner = Planner(two_valleys, search=settings(basins), polish=IpoptOptions())
        plans = [
            planner.plan(X0, rng=np.random.default_rng(seed)) for seed in range(10)
        ]
        costs[basins] = np.array([plan.cost for plan in plans])
    assert np.all(costs[6] <= costs[0] + 1e-9)
    assert np.sum(costs[6] < costs[0] - 1e-3) >= 3


def test_search_without_polish_keeps_no_basins(
    two_valleys: OptimalControlProblem,
) -> None:
    plans = [
        Planner(two_valleys, search=settings(basins)).plan(
            X0, rng=np.random.default_rng(0)
        )
        for basins in (0, 6)
    ]
    np.testing.assert_array_equal(plans[0].controls, plans[1].controls)
    assert plans[1].source is Source.SEARCH


def test_basins_that_are_none_are_refused() -> None:
    with pytest.raises(InvalidProblemError, match="basins must be an integer of"):
        settings(-1)
