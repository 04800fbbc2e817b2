"""How individuals are ordered."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmstart.heuristics import (
    InvalidOrderError,
    Order,
    feasibility_first,
    static_penalty,
)
from swarmstart.heuristics.order import better, merits

ORDERS = [feasibility_first(), feasibility_first(0.5), static_penalty(10.0)]

# Multiples of 1/8 keep every sum exact, so that merits tie only where costs do.
costs = st.integers(-80, 80).map(lambda n: n / 8) | st.sampled_from(
    [np.nan, np.inf, -np.inf]
)
violations = st.integers(0, 16).map(lambda n: n / 8) | st.sampled_from([np.nan, np.inf])
individuals = st.tuples(costs, violations)


@given(st.sampled_from(ORDERS), st.lists(individuals, min_size=1, max_size=6))
def test_merits_agree_with_better(
    order: Order, population: list[tuple[float, float]]
) -> None:
    cost, violation = np.array(population).T.copy()
    merit = np.empty(cost.size)
    merits(order, cost, violation, merit)
    for a, b in itertools.product(range(cost.size), repeat=2):
        expected = better(order, cost[a], violation[a], cost[b], violation[b])
        assert (merit[a] < merit[b]) == expected


@given(costs, costs, st.floats(1e-300, 1e300))
def test_feasibility_first_never_prefers_infeasible(
    cost_a: float, cost_b: float, violation: float
) -> None:
    if np.isfinite(cost_b):
        assert not better(feasibility_first(), cost_a, violation, cost_b, 0.0)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("bad", [(np.nan, 0.0), (-np.inf, 0.0), (0.0, np.nan)])
def test_nonfinite_ranks_last(order: Order, bad: tuple[float, float]) -> None:
    assert better(order, 1e300, 1e3, *bad)
    assert not better(order, *bad, 1e300, 1e3)
    assert not better(order, *bad, *bad)


def test_static_penalty_trades_cost_for_violation() -> None:
    order = static_penalty(2.0)
    assert better(order, 0.0, 1.0, 3.0, 0.0)
    assert not better(order, 0.0, 1.0, 2.0, 0.0)


def test_tolerance_counts_as_feasible() -> None:
    assert better(feasibility_first(1e-4), 1.0, 1e-4, 2.0, 0.0)
    assert not better(feasibility_first(1e-4), 1.0, 2e-4, 2.0, 0.0)


def test_infeasible_population_has_its_violations_as_merits() -> None:
    merit = np.empty(2)
    merits(feasibility_first(), np.array([7.0, -7.0]), np.array([1.0, 2.0]), merit)
    assert merit.tolist() == [1.0, 2.0]


@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_refuses_negative_or_infinite_parameters(value: float) -> None:
    with pytest.raises(InvalidOrderError, match="weight must be finite and at least 0"):
        static_penalty(value)
    with pytest.raises(InvalidOrderError, match="tolerance must be finite"):
        feasibility_first(value)
