"""The library's default, and the evidence for it."""

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    LSHADE,
    Box,
    Budget,
    ChaoticPSO,
    default_algorithm,
    default_order,
    epsilon_level,
    minimize,
)

BOX = Box(lower=np.full(3, -1.0), upper=np.full(3, 2.0))


def sphere(points: Array) -> tuple[Array, Array]:
    return (points**2).sum(axis=0), np.zeros(points.shape[1])


@pytest.mark.parametrize(
    ("evaluations", "kind"),
    [(100, ChaoticPSO), (399, ChaoticPSO), (400, LSHADE), (10**6, LSHADE)],
)
def test_the_swarm_is_for_small_budgets(evaluations: int, kind: type) -> None:
    assert isinstance(default_algorithm(evaluations), kind)


def test_wall_time_alone_is_for_l_shade() -> None:
    assert default_algorithm(None) == LSHADE()


@pytest.mark.parametrize("tolerance", [0.0, 1e-6])
def test_the_default_order_is_the_adaptive_level(tolerance: float) -> None:
    assert default_order(tolerance) == epsilon_level(tolerance)
    assert default_order(tolerance).adaptive


def test_minimize_takes_the_default_order() -> None:
    def constrained(points: Array) -> tuple[Array, Array]:
        return points.sum(axis=0), np.maximum(1.0 - points[0], 0.0)

    results = [
        minimize(constrained, BOX, budget=2000, order=order, seed=0)
        for order in (None, default_order())
    ]
    np.testing.assert_array_equal(results[0].x, results[1].x)
    assert results[0].violation == 0.0


@pytest.mark.parametrize("evaluations", [100, 2000])
def test_minimize_takes_the_default_for_its_budget(evaluations: int) -> None:
    budget = Budget(evaluations=evaluations)
    results = [
        minimize(
            sphere, BOX, algorithm=chosen, budget=budget, rng=np.random.default_rng(0)
        )
        for chosen in (None, default_algorithm(evaluations))
    ]
    np.testing.assert_array_equal(results[0].x, results[1].x)
