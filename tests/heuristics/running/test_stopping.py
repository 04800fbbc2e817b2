"""Conditions at which a search ends."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Algorithm,
    Box,
    Budget,
    GenerationEvent,
    InvalidBudgetError,
    Order,
    ParticleSwarm,
    RandomSearch,
    Search,
    SearchResult,
    StopReason,
    epsilon_level,
    feasibility_first,
    minimize,
)
from swarmstart.heuristics.running.budget import (
    AT_TARGET,
    GOES_ON,
    STAGNANT,
    UNLIMITED,
    Limits,
    finished,
    progress_of,
)

BOX = Box(lower=np.full(2, -1.0), upper=np.full(2, 1.0))


def told(costs: list[float], violations: list[float] | None = None) -> Search:
    """A search of generations of one, told these costs."""
    search = Search(RandomSearch(size=1), BOX, rng=np.random.default_rng(0))
    for k, cost in enumerate(costs):
        search.ask()
        search.tell([cost], [violations[k] if violations else 0.0])
    return search


def limits(target: float = -np.inf, stagnation: int = 0) -> Limits:
    return Limits(evaluations=UNLIMITED, target=target, stagnation=stagnation)


def test_target_is_reached_where_the_best_is_at_most_that_and_feasible() -> None:
    assert told([3.0, 2.0]).finished(limits(target=2.0)) == AT_TARGET
    assert told([3.0, 2.0]).finished(limits(target=1.9)) == GOES_ON
    assert told([3.0, 2.0], [0.0, 1.0]).finished(limits(target=2.0)) == GOES_ON
    assert told([-np.inf, np.nan]).finished(limits(target=np.inf)) == GOES_ON
    assert told([5.0]).finished(limits(target=np.inf)) == AT_TARGET


def test_the_tolerance_of_the_order_says_what_is_feasible() -> None:
    state = told([1.0], [0.25]).state
    for tolerance, code in ((0.25, AT_TARGET), (0.24, GOES_ON)):
        order = feasibility_first(tolerance).running()
        assert finished(order, state, limits(target=1.0)) == code


@pytest.mark.parametrize(
    ("costs", "idle"),
    [
        ([1.0], 0),
        ([1.0, 1.0, 1.0], 2),  # Not worse is not better.
        ([1.0, 2.0, 0.5, 3.0], 1),
        ([np.nan, np.nan], 2),
        ([np.nan, 4.0], 0),
    ],
)
def test_stagnation_counts_generations_without_a_better_point(
    costs: list[float], idle: int
) -> None:
    search = told(costs)
    assert search.finished(limits(stagnation=idle + 1)) == GOES_ON
    if idle:
        assert search.finished(limits(stagnation=idle)) == STAGNANT
    assert search.finished(limits()) == GOES_ON


def test_less_violation_is_better_and_no_stagnation() -> None:
    assert told([1.0, 9.0], [2.0, 1.0]).finished(limits(stagnation=1)) == GOES_ON


def test_nothing_ends_before_the_first_generation() -> None:
    assert told([]).finished(limits(target=np.inf, stagnation=1)) == GOES_ON


@settings(deadline=None)
@given(st.integers(1, 50), st.integers(1, 40), st.integers(0, 49))
def test_progress_is_that_of_5_19_with_generations_of_one_size(
    size: int, generations: int, rest: int
) -> None:
    budget = size * generations + rest % size
    steps = [progress_of(k * size, size, budget) for k in range(generations)]
    last = max(generations - 1, 1)
    np.testing.assert_allclose(steps, np.arange(generations) / last, rtol=1e-15)


@settings(deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 10**4), st.integers(1, 10**6))
def test_progress_is_a_fraction_of_any_budget(
    evaluations: int, size: int, budget: int
) -> None:
    assert 0.0 <= progress_of(evaluations, size, budget) <= 1.0
    assert progress_of(0, size, budget) == 0.0


def searched(
    algorithm: Algorithm,
    budget: Budget,
    *,
    order: Order | None = None,
    stop_at: int = -1,
) -> SearchResult:
    def sphere(points: Array) -> tuple[Array, Array]:
        return (points**2).sum(axis=0), np.maximum(0.25 - points[0], 0.0)

    def on_generation(event: GenerationEvent) -> None:
        if event.generation == stop_at:
            raise StopIteration

    return minimize(
        sphere,
        BOX,
        algorithm=algorithm,
        budget=budget,
        order=order,
        rng=np.random.default_rng(2),
        on_generation=on_generation,
    )


def test_a_search_ends_with_the_first_generation_at_its_target(
    algorithm: Algorithm,
) -> None:
    result = searched(algorithm, Budget(evaluations=5000, target=0.2))
    assert result.stopped is StopReason.TARGET
    reached = (result.history_cost <= 0.2) & (result.history_violation == 0.0)
    assert np.flatnonzero(reached).tolist() == [result.generations - 1]


def test_a_search_ends_after_so_many_generations_without_a_better_point(
    algorithm: Algorithm, order: Order
) -> None:
    result = searched(algorithm, Budget(evaluations=20_000, stagnation=6), order=order)
    assert result.stopped is StopReason.STAGNATION
    best = np.stack([result.history_cost, result.history_violation])
    changed = np.append(True, (np.diff(best) != 0.0).any(axis=0))
    idle = result.generations - 1 - np.flatnonzero(changed)[-1]
    # Generations with the level above the tolerance do not count.
    assert idle >= 6 if order.rule == epsilon_level().rule else idle == 6


def test_generations_above_the_tolerance_do_not_count() -> None:
    order = epsilon_level(quantile=1.0, adaptive=False)
    search = Search(RandomSearch(), BOX, order=order, rng=np.random.default_rng(0))
    limits = Budget(evaluations=1000, stagnation=3).limits()

    def advance(generations: int, progress: float) -> int:
        for _ in range(generations):
            size = search.ask(progress=progress).shape[1]
            search.tell(np.ones(size), np.ones(size))
        return search.finished(limits)

    assert advance(9, progress=0.5) == GOES_ON
    assert advance(2, progress=1.0) == GOES_ON
    assert advance(1, progress=1.0) == STAGNANT


def test_every_other_reason_has_its_name(algorithm: Algorithm) -> None:
    never = Budget(evaluations=100, target=-1.0, stagnation=1000)
    assert searched(algorithm, never).stopped is StopReason.EVALUATIONS
    assert searched(algorithm, never, stop_at=2).stopped is StopReason.CALLBACK
    quick = Budget(seconds=1e-9, target=-1.0)
    assert searched(algorithm, quick).stopped is StopReason.SECONDS


def test_the_callback_has_the_first_word() -> None:
    both = Budget(evaluations=100, target=np.inf)
    result = searched(ParticleSwarm(), both, stop_at=0)
    assert (result.stopped, result.generations) == (StopReason.CALLBACK, 1)


@pytest.mark.parametrize(
    ("target", "stagnation", "message"),
    [
        (np.nan, None, "target must be a number, got nan"),
        (None, 0, "stagnation must be an integer of at least 1 and below 2.62, got 0"),
        (
            None,
            2.0,
            "integer of at least 1 and below 2.62, got 2.0",
        ),
    ],
)
def test_refuses_what_ends_no_search(
    target: float | None, stagnation: int | None, message: str
) -> None:
    with pytest.raises(InvalidBudgetError, match=message):
        Budget(evaluations=10, target=target, stagnation=stagnation)


def test_target_and_stagnation_alone_are_no_budget() -> None:
    with pytest.raises(InvalidBudgetError, match="needs evaluations or seconds"):
        Budget(target=0.0, stagnation=3)


@pytest.mark.parametrize("evaluations", [81, 85, 90])
def test_progress_is_1_in_the_last_generation_after_others_of_another_size(
    evaluations: int,
) -> None:
    assert progress_of(evaluations, 10, 100) == 1.0
    assert progress_of(evaluations - 11, 10, 100) < 1.0
