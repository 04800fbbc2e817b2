"""The loop: budgets, events, results."""

from typing import Any

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    CMAES,
    Box,
    Budget,
    ChaoticPSO,
    DifferentialEvolution,
    GenerationEvent,
    InvalidBoxError,
    InvalidBudgetError,
    InvalidEvaluationError,
    InvalidSettingsError,
    Objective,
    Search,
    SearchResult,
    StopReason,
    minimize,
    run,
)

BOX = Box(lower=np.full(3, -1.0), upper=np.full(3, 1.0))


def sphere(points: Array) -> tuple[Array, Array]:
    return (points**2).sum(axis=0), np.zeros(points.shape[1])


def new_search(seed: int = 0) -> Search:
    return Search(ChaoticPSO(size=10), BOX, rng=np.random.default_rng(seed))


def test_last_generation_is_the_last_that_fits() -> None:
    result = run(new_search(), sphere, budget=Budget(evaluations=59))
    assert result.stopped is StopReason.EVALUATIONS
    assert (result.evaluations, result.generations) == (50, 5)
    assert result.history_cost.shape == result.history_violation.shape == (5,)
    assert (np.diff(result.history_cost) <= 0.0).all()
    assert result.history_evaluations.tolist() == [10, 20, 30, 40, 50]
    assert result.cost == result.history_cost[-1] == sphere(result.x[:, None])[0][0]


def test_progress_runs_from_0_to_1_over_the_evaluations() -> None:
    events: list[GenerationEvent] = []
    budget = Budget(evaluations=59, seconds=1e9)
    run(new_search(), sphere, budget=budget, on_generation=events.append)
    assert [event.progress for event in events] == [0.0, 0.25, 0.5, 0.75, 1.0]
    assert [event.generation for event in events] == [0, 1, 2, 3, 4]
    assert [event.evaluations for event in events] == [10, 20, 30, 40, 50]
    for event in events:
        np.testing.assert_array_equal(event.cost, sphere(event.population)[0])


def test_seconds_stop_a_search_after_its_first_generation_at_the_earliest() -> None:
    budget = Budget(evaluations=10**9, seconds=1e-9)
    result = run(new_search(), sphere, budget=budget)
    assert result.stopped is StopReason.SECONDS
    assert result.generations == 1
    result = run(new_search(), sphere, budget=Budget(seconds=0.05))
    assert result.stopped is StopReason.SECONDS
    assert 0.0 < result.snapshot["state.progress"][0] <= 1.0


def test_callback_stops_a_search_which_then_continues_as_if_it_had_not() -> None:
    def stop_after_four(event: GenerationEvent) -> None:
        if event.generation == 3:
            raise StopIteration

    budget = Budget(evaluations=200)
    whole = run(new_search(), sphere, budget=budget)
    search = new_search()
    part = run(search, sphere, budget=budget, on_generation=stop_after_four)
    assert part.stopped is StopReason.CALLBACK
    assert part.generations == 4
    rest = run(search, sphere, budget=budget)
    np.testing.assert_array_equal(rest.x, whole.x)
    assert rest.evaluations == 200
    assert rest.history_evaluations[0] == part.evaluations + 10
    np.testing.assert_array_equal(
        np.append(part.history_cost, rest.history_cost), whole.history_cost
    )


def test_nan_is_counted_and_never_best() -> None:
    def sometimes_nan(points: Array) -> tuple[Array, Array]:
        cost, violation = sphere(points)
        cost[:3] = np.nan
        return cost - 1e6, violation

    result = run(new_search(), sometimes_nan, budget=Budget(evaluations=100))
    assert result.nonfinite == 30
    assert np.isfinite(result.cost)


def test_objective_may_reuse_its_arrays() -> None:
    buffer = np.empty(10), np.zeros(10)

    def reusing(points: Array) -> tuple[Array, Array]:
        buffer[0][:] = sphere(points)[0]
        return buffer

    events: list[GenerationEvent] = []
    budget = Budget(evaluations=100)
    result = run(new_search(), reusing, budget=budget, on_generation=events.append)
    assert result.cost == run(new_search(), sphere, budget=budget).cost
    assert any((event.cost != buffer[0]).any() for event in events)


def test_minimize_is_a_search_and_its_run() -> None:
    def minimized(seed: int) -> SearchResult:
        return minimize(
            sphere,
            BOX,
            algorithm=ChaoticPSO(size=10),
            budget=Budget(evaluations=100),
            rng=np.random.default_rng(seed),
        )

    expected = run(new_search(1), sphere, budget=Budget(evaluations=100))
    np.testing.assert_array_equal(minimized(1).x, expected.x)
    assert minimized(2).cost != expected.cost


def test_feasible_optimum_on_the_boundary_is_found() -> None:
    def constrained(points: Array) -> tuple[Array, Array]:
        return sphere(points)[0], np.maximum(0.5 - points[0], 0.0)

    result = minimize(
        constrained,
        BOX,
        algorithm=DifferentialEvolution(size=20),
        budget=Budget(evaluations=6000),
        rng=np.random.default_rng(3),
    )
    assert result.violation == 0.0
    assert result.cost == pytest.approx(0.25, abs=1e-8)
    assert (np.diff(result.history_violation) <= 0.0).all()


def rows(points: Array) -> Array:
    return np.stack(sphere(points))


@pytest.mark.parametrize(
    "objective",
    [
        lambda x: sphere(x)[0],
        lambda x: sphere(x)[0].tolist(),
        lambda x: list(sphere(x)),
        rows,
    ],
    ids=["cost", "list of costs", "list of two", "two rows"],
)
def test_a_cost_alone_and_two_rows_mean_what_the_pair_means(
    objective: Objective,
) -> None:
    budget = Budget(evaluations=200)
    found = run(new_search(), objective, budget=budget)
    expected = run(new_search(), sphere, budget=budget)
    np.testing.assert_array_equal(found.history_cost, expected.history_cost)
    assert found.violation == 0.0


@pytest.mark.parametrize(
    ("returned", "found"),
    [
        (1.0, r"got float of shape \(\)"),
        (np.zeros((3, 10)), r"got ndarray of shape \(3, 10\)"),
        ((np.zeros(10),) * 3, "got a tuple of 3"),
        (None, r"got NoneType"),
        ({"f": 1.0}, "got dict"),
        ([[1.0], 2.0], "got list"),
    ],
)
def test_refuses_what_is_neither_costs_nor_a_pair(returned: Any, found: str) -> None:
    message = rf"return \(cost, violation\), or the cost alone, .* \(10,\).*{found}"
    with pytest.raises(InvalidEvaluationError, match=message):
        run(new_search(), lambda _: returned, budget=Budget(evaluations=10))


def test_minimize_takes_names_pairs_of_bounds_a_number_and_a_seed() -> None:
    expected = minimize(
        sphere,
        BOX,
        algorithm=CMAES(),
        budget=Budget(evaluations=300),
        rng=np.random.default_rng(8),
    )
    pairs = [(-1.0, 1.0)] * 3
    for result in (
        minimize(sphere, bounds=pairs, algorithm="cma", budget=300, seed=8),
        minimize(sphere, pairs, algorithm=CMAES, budget=300, seed=8),
    ):
        np.testing.assert_array_equal(result.x, expected.x)


@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({"objective": {"x": 1, "f": 2, "g": 3}}, InvalidEvaluationError, "got dict"),
        ({"on_generation": 3}, InvalidSettingsError, "on_generation must be None or a"),
        ({"order": "deb"}, InvalidSettingsError, "order must be None or .*, got 'deb'"),
        ({"radius": "wide"}, InvalidSettingsError, "radius must be a number above 0"),
        ({"initial": "x"}, InvalidSettingsError, "initial must be None or"),
        ({"seed": None}, InvalidSettingsError, "seed must be an integer .*, got None"),
        ({"rng": np.random.default_rng(0)}, InvalidSettingsError, "None if rng"),
        ({"budget": "long"}, InvalidBudgetError, "budget must be .*, got 'long'"),
        ({"algorithm": "swarm"}, InvalidSettingsError, "'lshade', .*, got 'swarm'"),
        ({"bounds": 3.0}, InvalidBoxError, "bounds must be pairs .*, got 3.0"),
        ({"bounds": None}, InvalidSettingsError, "bounds must be .*, got None"),
    ],
)
def test_wrong_arguments_are_refused_by_name(
    changed: dict[str, Any], error: type[Exception], message: str
) -> None:
    arguments: dict[str, Any] = {
        "objective": sphere,
        "bounds": [(-1.0, 1.0)] * 3,
        "budget": 200,
        "seed": 0,
    }
    with pytest.raises(error, match=message):
        minimize(**arguments | changed)


def test_refuses_a_budget_smaller_than_one_generation() -> None:
    with pytest.raises(InvalidBudgetError, match=r"at least 10 .* got 9") as caught:
        run(new_search(), sphere, budget=Budget(evaluations=9))
    assert caught.value.evaluations == 9
    search = new_search()
    run(search, sphere, budget=Budget(evaluations=20))
    with pytest.raises(InvalidBudgetError, match=r"at least 30 .* got 20"):
        run(search, sphere, budget=Budget(evaluations=20))
