"""L-SHADE: each mechanism against its equation."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    LSHADE,
    Box,
    Budget,
    GenerationEvent,
    InvalidSettingsError,
    Order,
    Search,
    epsilon_level,
    feasibility_first,
    minimize,
    static_penalty,
)
from swarmstart.heuristics.searches.lshade import (
    LSHADEState,
    find_leaders,
    fraction_after,
)
from swarmstart.heuristics.searches.trials import (
    TERMINAL,
    draw_parameters,
    measure_improvements,
    remember,
)
from swarmstart.tests.heuristics.adaptive_laws import (
    BOX,
    assert_both_loops_give_the_same_bits,
    assert_resumes_bit_for_bit,
    values,
)


def state_of(search: Search) -> LSHADEState:
    state = search.state
    assert isinstance(state, LSHADEState)
    return state


def started(
    size: int, cost: ArrayLike, violation: ArrayLike, order: Order | None = None
) -> Search:
    """A search whose initial population is evaluated."""
    rng = np.random.default_rng(0)
    search = Search(LSHADE(size=size), BOX, rng=rng, order=order)
    search.ask()
    search.tell(cost, violation)
    return search


@pytest.mark.parametrize("evaluations", [4000, 20_000])
def test_population_falls_linearly_to_four(evaluations: int) -> None:
    sizes: list[tuple[int, int]] = []

    def note_size(event: GenerationEvent) -> None:
        sizes.append((event.evaluations, event.cost.size))

    minimize(
        values,
        BOX,
        algorithm=LSHADE(size=100),
        budget=Budget(evaluations=evaluations),
        rng=np.random.default_rng(1),
        on_generation=note_size,
    )
    assert sizes[-1][1] == 4
    # The paper's size after `used` evaluations, from the second generation on. E_max
    # is cut by less than a generation of 100, which moves the size by less than
    # 96 * 100 / evaluations, and rounding by 1.
    tolerance = 1.0 + 96 * 100 / evaluations
    for (used, _), (_, size) in list(itertools.pairwise(sizes))[1:]:
        assert size == pytest.approx(100 - 96 * used / evaluations, abs=tolerance)


def test_fraction_after_a_generation_is_that_of_whole_generations() -> None:
    # 1000 evaluations in generations of 50: before the fifth, 200 of 950 are used.
    assert fraction_after(200 / 950, 200, 50) == pytest.approx(250 / 1000, rel=1e-15)
    assert fraction_after(1.0, 950, 50) == 1.0
    assert fraction_after(0.0, 200, 50) == 0.0


def test_removed_are_the_worst() -> None:
    # Feasible by cost, then infeasible by violation, then what is not finite.
    cost = [3.0, np.nan, 1.0, 0.0, 2.0, 0.0, 4.0, 5.0]
    violation = [0.0, 0.0, 0.0, 9.0, 0.0, 1.0, 0.0, 0.0]
    search = started(8, cost, violation)
    search.ask(progress=1.0)
    search.tell(np.full(8, np.inf), np.zeros(8))
    assert search.size == 4
    assert sorted(state_of(search).cost[:4]) == [1.0, 2.0, 3.0, 4.0]


def test_leaders_are_the_best_in_order() -> None:
    rng = np.random.default_rng(3)
    for size, number in ((4, 4), (9, 2), (40, 5)):
        cost = rng.permutation(size).astype(np.float64)
        violation = np.where(cost % 3 == 0, 0.5, 0.0)
        search = started(size, cost, violation)
        leaders = np.empty(number, dtype=np.int64)
        find_leaders(feasibility_first().running(), state_of(search), leaders)
        # All violations are the same, so the infeasible tie: the first of them first.
        rank = np.lexsort((np.where(violation > 0.0, 0.0, cost), violation))
        np.testing.assert_array_equal(leaders, rank[:number])


def test_trials_follow_one_of_the_best() -> None:
    size, dim = 20, BOX.dim
    search = started(size, np.arange(size), np.zeros(size))
    points = state_of(search).pool[:, :size]
    asked = search.ask()
    state = state_of(search)
    for i in range(size):  # round(0.11 * 20) = 2 leaders; the archive is empty
        F, x = state.F_trial[i], points[:, i]
        candidates = [
            x + F * (points[:, lead] - x) + F * (points[:, a] - points[:, b])
            for lead in (0, 1)
            for a in range(size)
            for b in range(size)
            if len({i, a, b}) == 3
        ]
        v = np.array(candidates).T
        v = np.where(v < BOX.lower[:, None], (x + BOX.lower)[:, None] / 2, v)
        v = np.where(v > BOX.upper[:, None], (x + BOX.upper)[:, None] / 2, v)
        mutated = asked[:, i] != x
        assert 1 <= mutated.sum() <= dim
        assert np.abs(v - asked[:, i, None])[mutated].max(axis=0).min() < 1e-14


def test_parameters_are_drawn_around_the_memory() -> None:
    search = started(4, np.zeros(4), np.zeros(4))
    state = state_of(search)
    state.F_memory[:], state.CR_memory[:] = 0.3, 0.6
    rng = np.random.default_rng(4)
    drawn = np.empty((2, 20_000))
    for k in range(drawn.shape[1]):
        draw_parameters(rng, state, 0)
        drawn[:, k] = state.F_trial[0], state.CR_trial[0]
    F, CR = drawn
    # Quantiles of a Cauchy distribution cut off at 0 from below
    cut = math.atan(-0.3 / 0.1) / math.pi + 0.5
    for q in (0.25, 0.5, 0.75):
        expected = 0.3 + 0.1 * math.tan(math.pi * (cut + q * (1.0 - cut) - 0.5))
        # sd of a quantile: 0.0035 / density <= 0.004
        assert np.quantile(F, q) == pytest.approx(expected, abs=5 * 0.004)
    assert F.min() > 0.0 and F.max() == 1.0
    assert CR.mean() == pytest.approx(0.6, abs=5 * 0.1 / np.sqrt(CR.size))
    assert CR.std() == pytest.approx(0.1, abs=0.005)
    state.CR_memory[:] = TERMINAL
    draw_parameters(rng, state, 0)
    assert state.CR_trial[0] == 0.0


def test_memory_takes_weighted_lehmer_means_in_turn() -> None:
    search = started(4, np.zeros(4), np.zeros(4))
    state = state_of(search)
    state.F_trial[:] = 0.4, 0.8, 0.9, 0.1
    state.CR_trial[:] = 0.2, 0.6, 1.0, 0.0
    remember(state, np.array([1.0, 3.0, 0.0, 0.0]))
    # (0.4^2 + 3 * 0.8^2) / (0.4 + 3 * 0.8), (0.2^2 + 3 * 0.6^2) / (0.2 + 3 * 0.6)
    assert state.F_memory[0] == pytest.approx(2.08 / 2.8, rel=1e-15)
    assert state.CR_memory[0] == pytest.approx(1.12 / 2.0, rel=1e-15)
    np.testing.assert_array_equal(state.F_memory[1:], 0.5)
    assert state.slot[0] == 1
    remember(state, np.zeros(4))  # nothing won: nothing changes
    assert state.slot[0] == 1
    remember(state, np.array([0.0, 0.0, 0.0, 1.0]))  # max S_CR = 0
    assert state.CR_memory[1] == TERMINAL
    state.slot[0] = 1
    remember(state, np.array([1.0, 0.0, 0.0, 0.0]))  # for ever
    assert state.CR_memory[1] == TERMINAL
    assert state.F_memory[1] == pytest.approx(0.4, rel=1e-15)
    state.slot[0] = 5
    remember(state, np.array([1.0, 0.0, 0.0, 0.0]))
    assert state.slot[0] == 0


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        # 1: both feasible, by cost. 2: by violation, though the cost rises. 3: from
        # infeasible to feasible, by violation. 4: not better. 5: parent not finite.
        # Each is divided by the largest of its kind: costs by 2, violations by 4.
        (feasibility_first(), [1.0, 1.0, 0.75, 0.0, 0.0]),
        # Violations up to 3 count as feasible: 3 by cost (worse by 7).
        (feasibility_first(3.0), [1.0, 1.0, 0.0, 0.0, 0.0]),
        (static_penalty(2.0), [1.0, 0.5, 0.0, 0.0, 0.0]),
    ],
)
def test_improvements_are_measured_as_the_order_orders(
    order: Order, expected: list[float]
) -> None:
    cost = np.array([5.0, 0.0, 0.0, 1.0, np.inf])
    violation = np.array([0.0, 6.0, 3.0, 0.0, 0.0])
    trial_cost = np.array([3.0, 7.0, 7.0, 1.0, 1.0])
    trial_violation = np.array([0.0, 2.0, 0.0, 0.0, 0.0])
    for shift in (0.0, 1024.0):
        search = started(5, cost + shift, violation, order)
        improvement = np.empty(5)
        measure_improvements(
            order.running(),
            state_of(search),
            trial_cost + shift,
            trial_violation,
            improvement,
        )
        np.testing.assert_array_equal(improvement, expected)


@pytest.mark.parametrize(
    "order", [feasibility_first(), epsilon_level(), static_penalty(8.0)]
)
def test_points_do_not_depend_on_a_constant_added_to_all_costs(order: Order) -> None:
    def asked(shift: float) -> Array:
        search = Search(LSHADE(size=20), BOX, rng=np.random.default_rng(5), order=order)
        points = []
        for k in range(40):
            points.append(search.ask(progress=k / 40))
            # Multiples of 1/64: exact with and without the constant
            cost = np.floor(64 * (points[-1] ** 2).sum(axis=0)) / 64
            violation = np.maximum(1.0 - np.floor(64 * points[-1][0]) / 64, 0.0)
            search.tell(cost + shift, violation)
        return np.concatenate(points, axis=1)

    np.testing.assert_array_equal(asked(0.0), asked(2.0**20))


def test_archive_holds_losers_and_never_too_many() -> None:
    rng = np.random.default_rng(6)
    search = Search(LSHADE(size=20, archive=1.5), BOX, rng=rng)
    seen: set[bytes] = set()
    fullest = 0
    for k in range(60):
        points = search.ask(progress=k / 60)
        state = state_of(search)  # as the trials saw it
        archived = int(state.archived[0])
        assert archived <= math.floor(1.5 * search.size + 0.5)
        fullest = max(fullest, archived)
        first = state.cost.size
        current = {point.tobytes() for point in state.pool[:, : search.size].T}
        for loser in state.pool[:, first : first + archived].T:
            assert loser.tobytes() in seen - current
        seen |= {point.tobytes() for point in points.T}
        search.tell((points**2).sum(axis=0), np.zeros(points.shape[1]))
    assert fullest > 20


def test_ties_replace_parents_without_archive_or_memory() -> None:
    search = started(6, np.ones(6), np.zeros(6))
    trials = search.ask()
    search.tell(np.ones(6), np.zeros(6))
    state = state_of(search)
    np.testing.assert_array_equal(state.pool[:, :6], trials)
    assert state.archived[0] == 0 and state.slot[0] == 0


def test_nothing_finite_is_no_failure() -> None:
    result = minimize(
        lambda x: (np.full(x.shape[1], np.nan), np.zeros(x.shape[1])),
        BOX,
        algorithm=LSHADE(size=20),
        budget=Budget(evaluations=400),
        rng=np.random.default_rng(7),
    )
    assert result.cost == np.inf
    assert result.nonfinite == result.evaluations


def test_huge_improvements_leave_the_memory_finite() -> None:
    search = started(6, np.full(6, 1.7e308), np.zeros(6))
    search.ask()
    search.tell(np.full(6, -1.7e308), np.zeros(6))
    assert np.isfinite(state_of(search).F_memory).all()


def test_solves_the_rotated_ellipsoid_of_its_paper() -> None:
    """CEC 2014 F1 is an ellipsoid of condition 1e6, rotated; error < 1e-8 in all runs.

    10-D, 1e5 evaluations, 18 individuals a dimension, as published.
    """
    rng = np.random.default_rng(8)
    rotation = np.linalg.qr(rng.normal(size=(10, 10)))[0]
    weight = 1e6 ** (np.arange(10) / 9)[:, None]
    optimum = rng.uniform(-80.0, 80.0, (10, 1))

    def ellipsoid(x: Array) -> tuple[Array, Array]:
        cost = (weight * (rotation @ (x - optimum)) ** 2).sum(axis=0)
        return cost, np.zeros(x.shape[1])

    result = minimize(
        ellipsoid,
        Box(lower=np.full(10, -100.0), upper=np.full(10, 100.0)),
        algorithm=LSHADE.as_published(10),
        budget=Budget(evaluations=100_000),
        rng=rng,
    )
    assert result.cost < 1e-8


@pytest.mark.parametrize(
    ("evaluations", "size"),
    [(None, 100), (1000, 40), (8000, 100), (100_000, 200)],
)
def test_default_size_follows_the_budget(evaluations: int | None, size: int) -> None:
    assert LSHADE().first_size(BOX, evaluations) == size
    assert LSHADE(size=33).first_size(BOX, evaluations) == 33


@pytest.mark.parametrize(
    "order", [feasibility_first(), epsilon_level(), static_penalty(10.0)]
)
def test_both_loops_give_the_same_bits(order: Order) -> None:
    assert_both_loops_give_the_same_bits(LSHADE(size=30), order)


def test_resumes_bit_for_bit(tmp_path: Path) -> None:
    assert_resumes_bit_for_bit(LSHADE(size=30), tmp_path)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"size": 3}, "size must be None or an integer of at least 4, got 3"),
        (
            {"size": 5, "smallest": 6},
            "size .* at least 6, got 5",
        ),
        ({"smallest": 3}, "smallest must be an integer of at least 4, got 3"),
        ({"memory": 0}, "memory must be an integer of at least 1, got 0"),
        ({"archive": -1.0}, "archive must be a finite number of at least 0, got -1.0"),
        ({"greediness": 0.0}, r"greediness must be a number in \(0, 1\], got 0.0"),
        ({"bound_handling": "fold"}, "bound_handling must be one of clip"),
    ],
)
def test_refuses_settings_out_of_range(setting: dict[str, int], message: str) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        LSHADE(**setting)  # type: ignore[arg-type]
