"""Local solves of a population's best members: what they bring, and what they cost."""

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    LSHADE,
    Box,
    Budget,
    InvalidBudgetError,
    InvalidPointsError,
    SearchInterrupted,
    StopReason,
    minimize,
)
from swarmstart.heuristics.running.memetic import Improved, LocalSolves, run_memetic
from swarmstart.heuristics.running.result import SearchResult
from swarmstart.heuristics.running.search import Search

BOX = Box(lower=np.full(6, -5.12), upper=np.full(6, 5.12))
COST = 20


def rastrigin(x: Array) -> tuple[Array, Array]:
    """Minima near all whole numbers, the best of them, 0, at the origin."""
    cost = (x**2 - 10 * np.cos(2 * np.pi * x) + 10).sum(axis=0)
    return cost, np.zeros(x.shape[1])


class Rounding:
    """A local solver of it: the nearest whole numbers; keeps what it was given."""

    def __init__(self) -> None:
        self.seen: list[Array] = []

    def __call__(self, members: Array) -> Improved:
        self.seen += [*members.T]
        return Improved(np.round(members), COST * members.shape[1])


def found(
    improve: Rounding, *, budget: int = 3000, seed: int = 0, share: float = 0.3
) -> SearchResult:
    search = Search(
        LSHADE(size=30), BOX, rng=np.random.default_rng(seed), basins=8,
        evaluations=budget,
    )  # fmt: skip
    local = LocalSolves(improve=improve, each=COST, members=4, share=share)
    return run_memetic(search, rastrigin, local, budget=budget)


def test_local_optima_take_part_in_the_search() -> None:
    """Whole numbers combine to the best of them; no other search is there exactly."""
    for seed in range(3):
        alone = minimize(
            rastrigin, BOX, algorithm=LSHADE(size=30), budget=3000, seed=seed
        )
        assert alone.cost > 1e-9
        result = found(Rounding(), seed=seed)
        assert result.cost == 0.0
        np.testing.assert_array_equal(result.x, np.zeros(6))


def test_local_solves_are_paid_from_the_budget_and_keep_to_their_share() -> None:
    for share in (0.1, 0.5):
        improve = Rounding()
        result = found(improve, share=share)
        spent = COST * len(improve.seen)
        assert 0 < spent <= share * 3000
        assert 3000 - 30 <= result.evaluations <= 3000
        assert result.history_evaluations[-1] == result.evaluations
        assert result.stopped is StopReason.EVALUATIONS


def test_no_member_is_improved_twice() -> None:
    improve = Rounding()
    found(improve)
    seen = {x.tobytes() for x in improve.seen}
    assert len(seen) == len(improve.seen) > 4
    assert not any(np.array_equal(x, np.round(x)) for x in improve.seen)


def test_same_seed_gives_the_same_bits() -> None:
    one, two = (found(Rounding(), seed=5) for _ in range(2))
    np.testing.assert_array_equal(one.x, two.x)
    np.testing.assert_array_equal(one.history_cost, two.history_cost)


def test_ctrl_c_in_a_local_solve_keeps_the_best_so_far() -> None:
    class Stopping(Rounding):
        def __call__(self, members: Array) -> Improved:
            if self.seen:
                raise KeyboardInterrupt
            return super().__call__(members)

    with pytest.raises(SearchInterrupted) as stopped:
        found(Stopping())
    partial = stopped.value.partial
    assert partial.stopped is StopReason.INTERRUPTED
    assert partial.cost == rastrigin(partial.x[:, None])[0][0] < 60


def test_solves_dearer_than_their_share_are_not_begun() -> None:
    improve = Rounding()
    found(improve, budget=100, share=0.1)
    assert not improve.seen


def test_points_outside_of_the_box_are_refused() -> None:
    class Leaving(Rounding):
        def __call__(self, members: Array) -> Improved:
            return Improved(members + 100.0, 1)

    with pytest.raises(InvalidPointsError, match="suggested must lie in the box"):
        found(Leaving())


def test_budget_below_one_generation_is_refused() -> None:
    with pytest.raises(InvalidBudgetError, match="evaluations must be at least 30"):
        found(Rounding(), budget=29)


def test_seconds_end_it_too() -> None:
    search = Search(LSHADE(size=30), BOX, rng=np.random.default_rng(0), basins=8)
    local = LocalSolves(improve=Rounding(), each=COST, members=4, share=0.3)
    result = run_memetic(search, rastrigin, local, budget=Budget(seconds=0.05))
    assert result.stopped is StopReason.SECONDS
