"""The loop in compiled code: the same bits as the loop in Python."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Algorithm,
    AskTellError,
    Box,
    Budget,
    Initial,
    Order,
    ParticleSwarm,
    Search,
    SearchResult,
    StopReason,
    minimize,
    run,
)
from swarmstart.heuristics.running.compiled_loop import CHUNK, next_chunk

if TYPE_CHECKING:
    from swarmstart.tests.heuristics.conftest import Compiled, Refusing

DIM, SIZE = 6, 12
BOX = Box(lower=np.full(DIM, -3.0), upper=np.full(DIM, 2.0))
EVALUATIONS = (CHUNK + 7) * SIZE + 5  # No whole number of chunks nor generations.


def values(population: Array) -> tuple[Array, Array]:
    cost = (population**2).sum(axis=0)
    cost[population[1] > 1.5] = np.nan
    return cost, np.maximum(1.0 - population[0], 0.0)


def assert_same(one: SearchResult, other: SearchResult) -> None:
    for name in ("x", "history_cost", "history_violation", "history_evaluations"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name in ("cost", "violation", "evaluations", "generations", "nonfinite"):
        assert getattr(one, name) == getattr(other, name)
    assert one.stopped is other.stopped
    assert len(one.basins) == len(other.basins)
    assert one.snapshot.keys() == other.snapshot.keys()
    for name in one.snapshot:
        expected = other.snapshot[name]
        np.testing.assert_array_equal(one.snapshot[name], expected, err_msg=name)


def both(
    compiled: type[Compiled],
    algorithm: Algorithm,
    budget: Budget,
    *,
    order: Order | None = None,
    initial: Initial | None = None,
    box: Box = BOX,
) -> SearchResult:
    """The result of the compiled loop, after that of Python was seen to be the same."""
    objective, told = compiled(values, DIM), list[int]()
    python, loop = (
        minimize(
            function,
            box,
            algorithm=algorithm,
            budget=budget,
            order=order,
            rng=np.random.default_rng(3),
            initial=initial,
            basins=4,
            radius=0.2,
            on_advance=told.append,
        )
        for function in (values, objective)
    )
    assert told[-1] == loop.evaluations  # Telling it calls no generation from Python.
    assert objective.calls_from_python == (initial is not None)
    assert_same(python, loop)
    return loop


def test_both_loops_give_the_same_bits(
    compiled: type[Compiled], algorithm: Algorithm, order: Order
) -> None:
    result = both(compiled, algorithm, Budget(evaluations=EVALUATIONS), order=order)
    assert result.stopped is StopReason.EVALUATIONS
    assert result.generations > CHUNK
    assert 1 <= len(result.basins) <= 4 and result.nonfinite > 0


def test_both_loops_give_the_same_bits_with_fixed_variables(
    compiled: type[Compiled], algorithm: Algorithm
) -> None:
    upper = BOX.upper.copy()
    upper[[2, 5]] = BOX.lower[[2, 5]]
    box = Box(lower=BOX.lower, upper=upper)
    result = both(compiled, algorithm, Budget(evaluations=EVALUATIONS), box=box)
    np.testing.assert_array_equal(result.x[[2, 5]], upper[[2, 5]])


def test_both_loops_stop_at_the_same_target(
    compiled: type[Compiled], algorithm: Algorithm, order: Order
) -> None:
    whole = both(compiled, algorithm, Budget(evaluations=EVALUATIONS), order=order)
    feasible = whole.history_violation <= order.tolerance
    costs = whole.history_cost[feasible]
    target = float(costs[costs.size // 2]) if costs.size else 1.0
    budget = Budget(evaluations=EVALUATIONS, target=target)
    result = both(compiled, algorithm, budget, order=order)
    if costs.size:  # With a penalty the best may be infeasible all the time.
        assert result.stopped is StopReason.TARGET
        assert result.cost <= target
    else:
        assert_same(result, whole)


def test_both_loops_stop_at_the_same_stagnation(
    compiled: type[Compiled], algorithm: Algorithm, order: Order
) -> None:
    for stagnation in (1, 4):
        budget = Budget(evaluations=10**5, stagnation=stagnation)
        result = both(compiled, algorithm, budget, order=order)
        assert result.stopped is StopReason.STAGNATION


def test_both_loops_give_the_same_bits_from_costs_known_before(
    compiled: type[Compiled], algorithm: Algorithm
) -> None:
    points = np.linspace(-1.0, 1.5, 3 * DIM).reshape(DIM, 3)
    cost, violation = values(points)
    initial = Initial(points=points, cost=cost, violation=violation)
    both(compiled, algorithm, Budget(evaluations=EVALUATIONS), initial=initial)


def test_a_search_continues_from_its_chunk_bit_for_bit(
    compiled: type[Compiled], algorithm: Algorithm, order: Order
) -> None:
    budget = Budget(evaluations=EVALUATIONS)
    whole = both(compiled, algorithm, budget, order=order)

    def new_search(seed: int, part: SearchResult | None = None) -> Search:
        return Search(
            algorithm,
            BOX,
            order=order,
            rng=np.random.default_rng(seed),
            evaluations=EVALUATIONS,
            basins=4,
            radius=0.2,
            snapshot=None if part is None else part.snapshot,
        )

    objective = compiled(values, DIM)
    part = run(new_search(3), objective, budget=replace(budget, seconds=1e-9))
    assert part.stopped is StopReason.SECONDS
    assert 1 <= part.generations <= CHUNK
    for continued in (objective, values):
        rest = run(new_search(8, part), continued, budget=budget)
        joined = np.append(part.history_cost, rest.history_cost)
        np.testing.assert_array_equal(joined, whole.history_cost)
        for name, array in whole.snapshot.items():
            np.testing.assert_array_equal(rest.snapshot[name], array, err_msg=name)


def test_an_objective_that_cannot_attach_is_called_from_python(
    refusing: type[Refusing],
) -> None:
    objective = refusing(values, DIM)
    budget = Budget(evaluations=5 * SIZE)
    result = minimize(
        objective,
        BOX,
        algorithm=ParticleSwarm(size=SIZE),
        budget=budget,
        rng=np.random.default_rng(4),
    )
    assert objective.calls_from_python == result.generations == 5


def test_a_callback_is_called_after_every_generation_of_a_compiled_objective(
    compiled: type[Compiled],
) -> None:
    seen: list[int] = []
    minimize(
        compiled(values, DIM),
        BOX,
        algorithm=ParticleSwarm(size=SIZE),
        budget=Budget(evaluations=4 * SIZE),
        on_generation=lambda event: seen.append(event.generation),
        rng=np.random.default_rng(5),
    )
    assert seen == [0, 1, 2, 3]


def test_seconds_end_a_compiled_search_after_its_chunk(
    compiled: type[Compiled],
) -> None:
    result = minimize(
        compiled(values, DIM),
        BOX,
        algorithm=ParticleSwarm(size=SIZE),
        budget=Budget(evaluations=10**7, seconds=1e-9),
        rng=np.random.default_rng(6),
    )
    assert result.stopped is StopReason.SECONDS
    assert result.generations == CHUNK


def test_a_budget_in_seconds_alone_runs_the_compiled_loop(
    compiled: type[Compiled],
) -> None:
    objective = compiled(values, DIM)
    result = minimize(
        objective,
        BOX,
        algorithm=ParticleSwarm(size=SIZE),
        budget=Budget(seconds=0.05),
        rng=np.random.default_rng(6),
    )
    assert result.stopped is StopReason.SECONDS
    assert result.generations > 1
    assert objective.calls_from_python == 0


def test_without_a_limit_of_evaluations_the_clock_tells_the_progress(
    compiled: type[Compiled],
) -> None:
    search = Search(ParticleSwarm(size=SIZE), BOX, rng=np.random.default_rng(7))
    limits = Budget(seconds=1.0).limits()
    objective = compiled(values, DIM)
    for progress in (0.0, 0.25):
        search.loop(objective, generations=3, limits=limits, progress=progress)
        assert search.state.progress[0] == progress


def test_loop_before_tell_is_refused(compiled: type[Compiled]) -> None:
    search = Search(ParticleSwarm(size=SIZE), BOX, rng=np.random.default_rng(7))
    search.ask()
    limits = Budget(evaluations=SIZE).limits()
    with pytest.raises(AskTellError, match="before tell"):
        search.loop(compiled(values, DIM), generations=1, limits=limits, progress=0.0)


@pytest.mark.parametrize(
    ("generations", "seconds", "following"),
    [(16, 0.02, 16), (16, 0.04, 8), (16, 2.0, 1), (16, 1e-9, 4096), (4096, 0.01, 4096)],
)
def test_chunks_take_about_a_fiftieth_of_a_second(
    generations: int, seconds: float, following: int
) -> None:
    """From 1 generation, if one is slow, to 4096: Ctrl-C waits for no longer."""
    assert next_chunk(generations, seconds) == following


def test_a_chunk_takes_no_longer_than_is_left() -> None:
    assert next_chunk(100, 0.01, left=0.005) == 50
    assert next_chunk(100, 0.01, left=1e-9) == 1
    assert next_chunk(100, 0.01, left=-1.0) == 1
