"""Common parts of all algorithms: the best point, counters, invalid settings."""

import numpy as np

from swarmstart.heuristics import (
    Order,
    epsilon_level,
    feasibility_first,
)
from swarmstart.heuristics.laws.algorithm import (
    common_fields,
    take_generation,
)
from swarmstart.heuristics.searches.random_search import RandomSearchState

POINTS = np.arange(8.0).reshape(2, 4)


def taken(
    order: Order, *generations: tuple[list[float], list[float]]
) -> RandomSearchState:
    """The state after generations of these costs and violations, all at POINTS."""
    state = RandomSearchState(*common_fields(POINTS), population=POINTS)
    running = order.running()
    for cost, violation in generations:
        points = POINTS[:, : len(cost)].copy()
        take_generation(running, state, points, np.array(cost), np.array(violation))
    return state


def test_before_anything_was_seen_the_first_point_stands_for_the_best() -> None:
    state = taken(feasibility_first())
    np.testing.assert_array_equal(state.best, POINTS[:, 0])
    assert state.best_cost[0] == state.best_violation[0] == np.inf
    assert (state.size[0], state.evaluations[0], state.improved[0]) == (4, 0, 0)


def test_individuals_are_counted_in_generations_of_any_size() -> None:
    state = taken(
        feasibility_first(),
        ([3.0, np.nan, 2.0, 4.0], [0.0, 0.0, 0.0, 0.0]),
        ([9.0, 1.0], [0.0, np.inf]),
        ([1.5, 1.0, 1.0], [0.0, 0.0, 0.0]),
    )
    assert (state.generation[0], state.evaluations[0]) == (3, 9)
    assert state.nonfinite[0] == 2
    assert (state.best_cost[0], state.improved[0]) == (1.0, 3)
    np.testing.assert_array_equal(state.best, POINTS[:, 1])  # the first of equals


def test_improved_is_the_generation_that_found_the_best() -> None:
    better, worse = ([1.0], [0.0]), ([2.0], [0.0])
    state = taken(feasibility_first(), worse, better, worse, better)
    assert state.improved[0] == 2


def test_best_is_that_of_the_tolerance_and_not_of_the_level() -> None:
    order = epsilon_level(0.5, quantile=1.0)
    state = taken(order, ([1.0, 3.0], [2.0, 0.5]), ([0.0, 2.0], [2.0, 0.5]))
    assert (state.best_cost[0], state.best_violation[0]) == (2.0, 0.5)
