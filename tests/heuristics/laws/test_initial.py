"""Initial populations: how they are drawn, and what is known of them."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Algorithm,
    AskTellError,
    Box,
    Budget,
    Initial,
    InvalidPointsError,
    InvalidSettingsError,
    RandomSearch,
    Sampling,
    Search,
    SearchResult,
    minimize,
)
from swarmstart.heuristics.laws.initial import initial_population, sample

BOX = Box(lower=np.array([-1.0, 2.0, 0.0]), upper=np.array([1.0, 2.5, 8.0]))
SEQUENCE = Box(lower=np.full(8, -2.0), upper=np.full(8, 2.0), per_step=2)
GIVEN = np.array([[0.5, -0.5], [2.0, 2.5], [1.0, 7.0]])


def drawn(box: Box, size: int, sampling: Sampling | None = None) -> Array:
    rng = np.random.default_rng(0)
    return initial_population(box, size, Initial(sampling=sampling), rng=rng)[0]


@settings(deadline=None)
@given(st.integers(1, 40), st.integers(0, 2**32))
def test_latin_hypercube_has_a_point_in_each_stratum_of_each_variable(
    size: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    points = sample(BOX, size, sampling="latin_hypercube", rng=rng)
    assert BOX.contains(points).all()
    strata = (points - BOX.lower[:, None]) / BOX.width[:, None] * size
    for row in strata:
        np.testing.assert_array_equal(np.sort(row).astype(int), np.arange(size))


def test_variables_of_a_latin_hypercube_are_independent() -> None:
    points = drawn(BOX, 10_000, "latin_hypercube")
    correlation = np.corrcoef(points) - np.eye(3)
    assert np.abs(correlation).max() < 4 / math.sqrt(10_000)


def test_first_half_is_correlated_in_time_and_the_rest_is_not() -> None:
    points = drawn(SEQUENCE, 20_000, "half_smooth")
    assert SEQUENCE.contains(points).all()
    smooth, rest = points[:, :10_000], points[:, 10_000:]
    # Uniform scores of a Gaussian pair with correlation r correlate by 6/pi asin(r/2).
    expected = 6 / math.pi * math.asin(math.exp(-1 / 4) / 2)
    assert np.corrcoef(smooth[0], smooth[2])[0, 1] == pytest.approx(expected, abs=0.04)
    assert abs(np.corrcoef(smooth[0], smooth[1])[0, 1]) < 0.04
    assert np.abs(np.corrcoef(rest) - np.eye(8)).max() < 0.05


@pytest.mark.parametrize(("size", "smooth"), [(1, 0), (5, 2), (6, 3)])
def test_half_of_an_odd_number_is_rounded_down(size: int, smooth: int) -> None:
    half, whole = (drawn(SEQUENCE, size, s) for s in ("half_smooth", "smooth"))
    np.testing.assert_array_equal(half[:, :smooth], whole[:, :smooth])
    assert half.shape == whole.shape == (8, size)
    assert not np.isin(half[:, smooth:], whole).any()


def test_by_default_half_is_smooth_in_a_sequence_and_all_is_uniform_else() -> None:
    np.testing.assert_array_equal(drawn(BOX, 9), drawn(BOX, 9, "uniform"))
    expected = drawn(SEQUENCE, 9, "half_smooth")
    np.testing.assert_array_equal(drawn(SEQUENCE, 9), expected)


@pytest.mark.parametrize("sampling", ["uniform", "latin_hypercube"])
def test_given_points_come_first_and_the_others_as_drawn(sampling: Sampling) -> None:
    initial = Initial(sampling=sampling, points=GIVEN)
    rng = np.random.default_rng(0)
    population, known = initial_population(BOX, 7, initial, rng=rng)
    assert known is None
    np.testing.assert_array_equal(population[:, :2], GIVEN)
    np.testing.assert_array_equal(population[:, 2:], drawn(BOX, 7, sampling)[:, 2:])


def bowl(points: Array) -> tuple[Array, Array]:
    return ((points - 0.4) ** 2).sum(axis=0), np.maximum(2.2 - points[1], 0.0)


def searched(
    algorithm: Algorithm, evaluations: int, initial: Initial
) -> tuple[SearchResult, int]:
    """The result, and how many points were evaluated."""
    calls: list[int] = []

    def objective(points: Array) -> tuple[Array, Array]:
        calls.append(points.shape[1])
        return bowl(points)

    result = minimize(
        objective,
        BOX,
        algorithm=algorithm,
        budget=Budget(evaluations=evaluations),
        rng=np.random.default_rng(4),
        initial=initial,
        basins=2,
    )
    return result, sum(calls)


def test_known_costs_are_not_evaluated_again(algorithm: Algorithm) -> None:
    size = algorithm.first_size(BOX, 200)
    cost, violation = bowl(GIVEN)
    rng = np.random.default_rng(4)
    asked = Search(algorithm, BOX, rng=rng, initial=GIVEN, evaluations=200).ask()
    search = Search(
        algorithm,
        BOX,
        rng=np.random.default_rng(4),
        initial=Initial(points=GIVEN, cost=cost, violation=violation),
        evaluations=200,
    )
    rest = search.ask()
    np.testing.assert_array_equal(rest, asked[:, 2:])
    search.tell(*bowl(rest))
    assert (search.generations, search.evaluations) == (1, size - 2)

    initial = Initial(points=GIVEN, cost=cost, violation=violation)
    result, evaluated = searched(algorithm, 200, initial)
    assert result.evaluations == evaluated <= 200


def test_known_costs_count_as_if_they_had_been_evaluated(algorithm: Algorithm) -> None:
    plain = Search(algorithm, BOX, rng=np.random.default_rng(5), initial=GIVEN)
    cost, violation = bowl(GIVEN)
    known = Search(
        algorithm,
        BOX,
        rng=np.random.default_rng(5),
        initial=Initial(points=GIVEN, cost=cost, violation=violation),
    )
    for _ in range(6):
        for search in (plain, known):
            search.tell(*bowl(search.ask()))
    np.testing.assert_array_equal(plain.ask(), known.ask())
    assert plain.evaluations == known.evaluations + 2
    np.testing.assert_array_equal(plain.best.x, known.best.x)


def test_a_population_that_is_known_whole_is_told_at_once() -> None:
    points = np.concatenate([GIVEN, GIVEN[:, ::-1] + [[0.1], [0.0], [0.5]]], axis=1)
    cost, _ = bowl(points)
    initial = Initial(points=points, cost=cost)
    search = Search(
        RandomSearch(size=4), BOX, rng=np.random.default_rng(6), initial=initial
    )
    assert (search.generations, search.evaluations) == (1, 0)
    assert search.best.cost == cost.min()
    assert search.best.violation == 0.0  # None means that all are.
    assert search.ask().shape == (3, 4)
    result, evaluated = searched(RandomSearch(size=4), 8, initial)
    assert (result.evaluations, evaluated, result.generations) == (8, 8, 3)


def test_known_points_may_be_nonfinite_and_fill_basins() -> None:
    initial = Initial(points=GIVEN, cost=[np.nan, -1.0])
    result, _ = searched(RandomSearch(size=4), 100, initial)
    assert result.nonfinite == 1
    assert result.cost == -1.0
    assert result.basins[0].cost == -1.0


def test_no_snapshot_before_what_is_known_was_told() -> None:
    initial = Initial(points=GIVEN, cost=[1.0, 2.0])
    search = Search(
        RandomSearch(size=4), BOX, rng=np.random.default_rng(7), initial=initial
    )
    with pytest.raises(AskTellError, match=r"snapshot\(\) before tell"):
        search.snapshot()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"sampling": "sobol"}, "sampling must be None or one of .*'sobol'"),
        ({"cost": [1.0]}, "cost must be None without points"),
        ({"points": GIVEN, "violation": [1, 2]}, "violation must be None without cost"),
    ],
)
def test_refuses_what_does_not_go_together(
    arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        Initial(**arguments)


@pytest.mark.parametrize("sampling", ["smooth", "half_smooth"])
def test_smooth_points_need_a_box_that_is_a_sequence(sampling: Sampling) -> None:
    with pytest.raises(InvalidSettingsError, match="in a box without per_step"):
        drawn(BOX, 4, sampling)


@pytest.mark.parametrize(
    ("cost", "violation", "message"),
    [
        ([1.0], None, r"cost must have shape \(2,\), got \(1,\)"),
        ([1.0, 2.0], [0.0], r"violation must have shape \(2,\), got \(1,\)"),
        ([[1.0, 2.0]], None, r"cost must have shape \(2,\), got \(1, 2\)"),
    ],
)
def test_there_is_one_cost_and_violation_for_each_point(
    cost: Any, violation: Any, message: str
) -> None:
    initial = Initial(points=GIVEN, cost=cost, violation=violation)
    with pytest.raises(InvalidPointsError, match=message):
        initial_population(BOX, 4, initial, rng=np.random.default_rng(8))


def test_known_violations_must_not_be_negative() -> None:
    initial = Initial(points=GIVEN, cost=[1.0, 2.0], violation=[0.0, -1.0])
    with pytest.raises(InvalidPointsError, match="must be at least 0, got -1"):
        Search(RandomSearch(size=2), BOX, rng=np.random.default_rng(9), initial=initial)
