"""The genetic algorithm."""

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.heuristics import (
    Box,
    GeneticAlgorithm,
    InvalidSettingsError,
    Search,
    feasibility_first,
)
from swarmstart.heuristics.searches.genetic import (
    GeneticAlgorithmState,
    roulette_weights,
    spin,
)

BOX = Box(lower=np.full(3, -1.0), upper=np.full(3, 2.0))


def population_costs(elitism: bool) -> NDArray[np.float64]:
    """Best cost within the population, generation after generation."""
    algorithm = GeneticAlgorithm(size=6, elitism=elitism, mutation=0.5)
    search = Search(algorithm, BOX, rng=np.random.default_rng(0))
    bests = []
    for _ in range(60):
        search.tell((search.ask() ** 2).sum(axis=0), np.zeros(6))
        state = search.state
        assert isinstance(state, GeneticAlgorithmState)
        bests.append(state.cost.min())
    return np.array(bests)


def test_elitism_keeps_the_best() -> None:
    assert (np.diff(population_costs(elitism=True)) <= 0.0).all()


@pytest.mark.parametrize(
    ("children_cost", "replaced"),
    [([0.5, 5.0, 2.0, 3.0], 1), ([0.5, 0.9, 0.2, 0.3], None)],
)
def test_best_parent_takes_the_place_of_the_worst_child_alone(
    children_cost: list[float], replaced: int | None
) -> None:
    search = Search(GeneticAlgorithm(size=4), BOX, rng=np.random.default_rng(0))
    parents = search.ask().copy()
    search.tell([3.0, 4.0, 1.0, 2.0], np.zeros(4))
    expected = search.ask().copy()
    search.tell(children_cost, np.zeros(4))
    costs = np.array(children_cost)
    if replaced is not None:
        expected[:, replaced], costs[replaced] = parents[:, 2], 1.0
    state = search.state
    assert isinstance(state, GeneticAlgorithmState)
    np.testing.assert_array_equal(state.population, expected)
    np.testing.assert_array_equal(state.cost, costs)


def test_without_elitism_the_population_can_worsen() -> None:
    assert (np.diff(population_costs(elitism=False)) > 0.0).any()


def weights(cost: list[float], violation: list[float]) -> NDArray[np.float64]:
    weight = np.empty(len(cost))
    order = feasibility_first().running()
    roulette_weights(order, np.array(cost), np.array(violation), weight)
    return weight


def test_roulette_draws_in_proportion_to_the_distance_from_the_worst() -> None:
    # J = 1/4, 1, 0, not finite, 1 + 1 (infeasible): J_max - J = 7/4, 1, 2, 0, 0
    weight = weights([1.0, 4.0, 0.0, np.nan, -9.0], [0.0, 0.0, 0.0, 0.0, 1.0])
    np.testing.assert_allclose(weight, [0.875, 0.5, 1.0, 0.0, 0.0], rtol=1e-15)
    rng = np.random.default_rng(1)
    draws = np.bincount([spin(rng, weight) for _ in range(20_000)], minlength=5)
    # 5 standard deviations of the most uncertain count
    np.testing.assert_allclose(draws, [7368, 4211, 8421, 0, 0], atol=353)
    assert draws[3:].tolist() == [0, 0]


@pytest.mark.parametrize(
    ("cost", "expected"),
    [
        ([2.0, 2.0, 2.0], [1.0, 1.0, 1.0]),
        ([2.0, np.nan, 2.0], [1.0, 0.0, 1.0]),
        ([np.nan, np.inf, -np.inf], [1.0, 1.0, 1.0]),
        ([-1.7e308, 1.7e308, 0.0], [1.0, 0.0, 0.5]),
    ],
)
def test_roulette_weights_are_usable_for_any_costs(
    cost: list[float], expected: list[float]
) -> None:
    np.testing.assert_allclose(weights(cost, [0.0] * 3), expected, rtol=1e-15)


def test_crossed_pair_lies_mirrored_on_the_segment_between_its_parents() -> None:
    algorithm = GeneticAlgorithm(size=2, crossover=1.0, mutation=0.0)
    crossed = 0
    for seed in range(20):
        search = Search(algorithm, BOX, rng=np.random.default_rng(seed))
        parents = search.ask()
        search.tell([1.0, 1.0], [0.0, 0.0])
        children = search.ask()
        alpha = (children[:, 0] - parents[:, 1]) / (parents[:, 0] - parents[:, 1])
        np.testing.assert_allclose(alpha, alpha[0], rtol=1e-9, atol=1e-14)
        if 0.0 < alpha[0] < 1.0:  # else one point was drawn twice, as the pair (a, a)
            crossed += 1
            sums = children.sum(axis=1), parents.sum(axis=1)
            np.testing.assert_allclose(*sums, rtol=0.0, atol=1e-14)
        else:
            np.testing.assert_array_equal(children[:, 0], children[:, 1])
    assert 4 <= crossed <= 16  # equal merits: probability 1/2 each


def test_mutation_redraws_one_coordinate_in_dim_over_the_whole_box() -> None:
    algorithm = GeneticAlgorithm(size=2000, crossover=0.0)
    search = Search(
        algorithm,
        BOX,
        rng=np.random.default_rng(3),
        initial=np.full((3, 2000), 1.0),
    )
    search.ask()
    search.tell(np.ones(2000), np.zeros(2000))
    children = search.ask()
    mutated = children[children != 1.0]
    # 2000 of 6000 expected, sd 37; uniform on [-1, 2]: mean 0.5, its sd 0.02
    assert mutated.size == pytest.approx(2000, abs=150)
    assert mutated.mean() == pytest.approx(0.5, abs=0.08)
    assert (mutated.min(), mutated.max()) == pytest.approx((-1.0, 2.0), abs=0.02)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"size": 1}, "size must be an integer of at least 2, got 1"),
        ({"crossover": -0.1}, r"crossover must be a number in \[0, 1\], got -0.1"),
        ({"mutation": 2.0}, r"mutation must be None or a number in \[0, 1\], got 2.0"),
        ({"elitism": 1}, "elitism must be True or False, got 1"),
    ],
)
def test_refuses_settings_out_of_range(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        GeneticAlgorithm(**setting)  # type: ignore[arg-type]
