"""Orders of individuals."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Algorithm,
    Box,
    Budget,
    DifferentialEvolution,
    InvalidOrderError,
    Order,
    ParticleSwarm,
    Search,
    epsilon_level,
    feasibility_first,
    minimize,
    static_penalty,
)
from swarmstart.heuristics.laws.order import (
    RunningOrder,
    begin_level,
    better,
    better_at,
    merits,
    set_level,
)

ORDERS = [
    feasibility_first(),
    feasibility_first(0.5),
    static_penalty(10.0),
    epsilon_level(0.25),
]

# Multiples of 1/8 keep every sum exact, so that merits tie only where costs do.
costs = st.integers(-80, 80).map(lambda n: n / 8) | st.sampled_from(
    [np.nan, np.inf, -np.inf]
)
violations = st.integers(0, 16).map(lambda n: n / 8) | st.sampled_from([np.nan, np.inf])
individuals = st.tuples(costs, violations)


@settings(deadline=None)
@given(st.sampled_from(ORDERS), st.lists(individuals, min_size=1, max_size=6))
def test_merits_agree_with_better(
    order: Order, population: list[tuple[float, float]]
) -> None:
    running = order.running()
    cost, violation = np.array(population).T.copy()
    merit = np.empty(cost.size)
    merits(running, cost, violation, merit)
    for a, b in itertools.product(range(cost.size), repeat=2):
        expected = better(running, cost[a], violation[a], cost[b], violation[b])
        assert (merit[a] < merit[b]) == expected


@settings(deadline=None)
@given(costs, costs, st.floats(1e-300, 1e300))
def test_feasibility_first_never_prefers_infeasible(
    cost_a: float, cost_b: float, violation: float
) -> None:
    if np.isfinite(cost_b):
        assert not better(feasibility_first().running(), cost_a, violation, cost_b, 0.0)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("bad", [(np.nan, 0.0), (-np.inf, 0.0), (0.0, np.nan)])
def test_nonfinite_ranks_last(order: Order, bad: tuple[float, float]) -> None:
    running = order.running()
    assert better(running, 1e300, 1e3, *bad)
    assert not better(running, *bad, 1e300, 1e3)
    assert not better(running, *bad, *bad)


def test_static_penalty_trades_cost_for_violation() -> None:
    order = static_penalty(2.0).running()
    assert better(order, 0.0, 1.0, 3.0, 0.0)
    assert not better(order, 0.0, 1.0, 2.0, 0.0)


def test_tolerance_counts_as_feasible() -> None:
    order = feasibility_first(1e-4).running()
    assert better(order, 1.0, 1e-4, 2.0, 0.0)
    assert not better(order, 1.0, 2e-4, 2.0, 0.0)


def test_merits_are_places_among_feasible_costs_and_among_violations() -> None:
    merit = np.empty(5)
    order = feasibility_first().running()
    cost = np.array([7.0, -7.0, 3.0, 1.0, -1.0])
    merits(order, cost, np.array([1.0, 4.0, 0.0, 0.0, 0.0]), merit)
    assert merit.tolist() == [1.25, 2.0, 1.0, 0.5, 0.0]


@pytest.mark.parametrize("order", [feasibility_first(), epsilon_level(0.25)])
def test_merits_depend_on_the_units_neither_of_cost_nor_of_violation(
    order: Order,
) -> None:
    rng = np.random.default_rng(0)
    cost, violation = rng.normal(size=20), np.maximum(rng.normal(size=20), 0.0)
    expected, scaled = np.empty(20), np.empty(20)
    merits(order.running(), cost, violation, expected)
    order = order._replace(tolerance=2.0**20 * order.tolerance)
    merits(order.running(), 2.0**-30 * cost, 2.0**20 * violation, scaled)
    np.testing.assert_array_equal(scaled, expected)


@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf])
def test_refuses_negative_or_infinite_parameters(value: float) -> None:
    with pytest.raises(InvalidOrderError, match="weight must be a finite"):
        static_penalty(value)
    with pytest.raises(InvalidOrderError, match="tolerance must be a finite"):
        feasibility_first(value)


def begun(order: Order, violation: list[float]) -> RunningOrder:
    """The order after an initial population of these violations."""
    running = order.running()
    begin_level(running, np.array(violation))
    set_level(running, 0.0, np.array(violation))
    return running


@settings(deadline=None)
@given(st.lists(violations, min_size=1, max_size=30), st.floats(0.0, 1.0))
def test_first_level_is_the_quantile_of_the_initial_population(
    violation: list[float], quantile: float
) -> None:
    running = begun(epsilon_level(0.25, quantile=quantile), violation)
    finite = np.array(violation)[np.isfinite(violation)]
    first = np.quantile(finite, quantile, method="lower") if finite.size else 0.0
    assert running.level.tolist() == [max(first, 0.25), first]


@settings(deadline=None)
@given(
    st.floats(0.0, 1.0),
    st.floats(0.0, 10.0),
    st.floats(0.01, 1.0),
    st.floats(0.0, 9.0),
    st.sampled_from([0.0, 1e-4, 0.5]),
)
def test_level_falls_as_its_closed_form(
    progress: float, first: float, control: float, power: float, tolerance: float
) -> None:
    order = epsilon_level(
        tolerance, quantile=1.0, control=control, power=power, adaptive=False
    )
    running = begun(order, [0.0, first])
    set_level(running, progress, np.zeros(1))
    expected = tolerance
    if progress < control:
        expected = max(tolerance, first * (1.0 - progress / control) ** power)
    assert running.level[0] == pytest.approx(expected, rel=1e-13)
    if progress >= control:
        assert running.level[0] == tolerance
    before = running.level[0]
    set_level(running, 1.0 - 0.5 * (1.0 - progress), np.zeros(1))
    assert tolerance <= running.level[0] <= before


def test_level_of_the_other_orders_is_their_tolerance_for_ever() -> None:
    for order in (feasibility_first(0.5), static_penalty(10.0)):
        assert begun(order, [3.0, 4.0]).level[0] == order.tolerance


@settings(deadline=None)
@given(individuals, individuals, st.sampled_from([0.0, 0.25, 1.0]))
def test_at_the_tolerance_the_order_is_feasibility_first(
    a: tuple[float, float], b: tuple[float, float], tolerance: float
) -> None:
    running = begun(epsilon_level(tolerance, quantile=1.0), [2.0])
    expected = better(feasibility_first(tolerance).running(), *a, *b)
    assert better_at(running, tolerance, *a, *b) == expected
    set_level(running, 1.0, np.zeros(1))
    assert better(running, *a, *b) == expected


def test_below_the_level_the_cost_decides() -> None:
    running = begun(epsilon_level(quantile=1.0, adaptive=False), [2.0])
    assert better(running, 1.0, 2.0, 1.5, 0.0)
    assert not better(running, 1.0, 2.5, 9.0, 2.0)
    set_level(running, 0.4, np.zeros(1))  # 2 (1 - 0.4 / 0.8)^5 = 1 / 16
    assert better(running, 1.0, 0.0625, 1.5, 0.0)
    assert not better(running, 1.0, 0.07, 1.5, 0.0)


@pytest.mark.parametrize("adaptive", [False, True])
def test_level_of_a_search_follows_its_progress_and_its_violations(
    algorithm: Algorithm, adaptive: bool
) -> None:
    box = Box(lower=np.zeros(2), upper=np.ones(2))
    order = epsilon_level(0.01, quantile=0.5, control=0.5, power=2.0, adaptive=adaptive)
    search = Search(algorithm, box, order=order, rng=np.random.default_rng(0))
    points = search.ask(progress=0.0)
    search.tell(points[1], points[0])
    first = np.quantile(points[0], 0.5, method="lower")
    for progress in (0.0, 0.1, 0.3, 0.45, 0.5, 1.0):
        points = search.ask(progress=progress)
        search.tell(points[1], points[0])
        level = first * max(1.0 - progress / 0.5, 0.0) ** 2
        if adaptive:
            level = min(level, np.quantile(points[0], 0.5, method="lower"))
        expected = max(0.01, level)
        reached = search.snapshot()["order.level"]
        assert reached.tolist() == pytest.approx([expected, first], rel=1e-14)


@settings(deadline=None)
@given(
    st.lists(violations, min_size=1, max_size=30),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.sampled_from([0.0, 0.25]),
)
def test_adaptive_level_is_at_most_the_quantile_of_the_last_generation(
    violation: list[float], quantile: float, progress: float, tolerance: float
) -> None:
    fixed, adaptive = (
        begun(epsilon_level(tolerance, quantile=quantile, adaptive=adaptive), [2.0])
        for adaptive in (False, True)
    )
    for running in (fixed, adaptive):
        set_level(running, progress, np.array(violation))
    finite = np.array(violation)[np.isfinite(violation)]
    part = np.quantile(finite, quantile, method="lower") if finite.size else np.inf
    assert adaptive.level[0] == max(tolerance, min(fixed.level[0], part))


def test_with_enough_feasible_points_the_level_is_feasibility_first(
    algorithm: Algorithm,
) -> None:
    """Bit for bit: half of the box is feasible."""

    def half(points: Array) -> tuple[Array, Array]:
        return points.sum(axis=0), np.maximum(0.5 - points[0], 0.0)

    results = [
        minimize(
            half,
            Box(lower=np.zeros(3), upper=np.ones(3)),
            algorithm=algorithm,
            budget=300,
            order=order,
            seed=3,
        )
        for order in (feasibility_first(), epsilon_level())
    ]
    np.testing.assert_array_equal(results[0].history_cost, results[1].history_cost)
    np.testing.assert_array_equal(results[0].x, results[1].x)


def test_best_reported_is_best_by_the_final_tolerance() -> None:
    box = Box(lower=np.zeros(1), upper=np.ones(1))
    search = Search(
        ParticleSwarm(size=3),
        box,
        order=epsilon_level(0.125, quantile=1.0),
        rng=np.random.default_rng(1),
    )
    points = search.ask(progress=0.0)
    search.tell([5.0, 1.0, 4.0], [0.125, 1.0, 0.0])  # at the first level the second is
    assert search.best[1:] == (4.0, 0.0)
    np.testing.assert_array_equal(search.best.x, points[:, 2])


def test_equality_constraint_is_met_at_the_least_cost() -> None:
    """min |x|^2 with sum x = 1 in 4-D: x = 1/4 in each, cost 1/4."""
    tolerance = 1e-4

    def on_a_plane(points: Array) -> tuple[Array, Array]:
        return (points**2).sum(axis=0), np.abs(points.sum(axis=0) - 1.0)

    result = minimize(
        on_a_plane,
        Box(lower=np.full(4, -2.0), upper=np.full(4, 2.0)),
        algorithm=DifferentialEvolution(size=30),
        budget=Budget(evaluations=12_000),
        order=epsilon_level(tolerance),
        rng=np.random.default_rng(2),
    )
    assert result.violation <= tolerance
    # The tolerance is worth 2 * 1/4 of cost each.
    assert result.cost == pytest.approx(0.25, abs=2 * tolerance)
    np.testing.assert_allclose(result.x, 0.25, atol=0.01)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"tolerance": -1.0},
            "tolerance must be a finite number of at least 0",
        ),
        ({"power": np.inf}, "power must be a finite number of at least 0, got inf"),
        ({"quantile": 1.5}, r"quantile must be a number in \[0, 1\], got 1.5"),
        ({"control": 0.0}, r"control must be a number in \(0, 1\], got 0.0"),
        ({"control": np.nan}, r"control must be a number in \(0, 1\], got nan"),
    ],
)
def test_refuses_parameters_of_a_level_out_of_range(
    arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidOrderError, match=message) as caught:
        epsilon_level(**arguments)
    assert caught.value.name in arguments
