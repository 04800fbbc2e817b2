"""Differential evolution, against its equations and against published counts.

Some figures were measured on other implementations; the long form of the counts
is benchmarks/published_results.py.
"""

import itertools
from typing import Any

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Box,
    Budget,
    DifferentialEvolution,
    GenerationEvent,
    InvalidSettingsError,
    Objective,
    Search,
    StopReason,
    minimize,
)
from swarmstart.heuristics.searches.de import DifferentialEvolutionState, Strategy
from swarmstart.heuristics.searches.trials import (
    cross_binomially,
    cross_exponentially,
    draw_three_others,
    draw_two_others,
)


def evaluations_until(target: float, events: list[GenerationEvent]) -> int:
    costs = np.concatenate([event.cost for event in events])
    return int(np.argmax(costs <= target)) + 1


def test_trials_are_those_of_the_paper() -> None:
    F, CR, dim, size = 0.7, 0.4, 5, 8
    box = Box(lower=np.full(dim, -1.0), upper=np.full(dim, 1.0))
    algorithm = DifferentialEvolution(size=size, F=F, CR=CR)
    search = Search(algorithm, box, rng=np.random.default_rng(0))
    x = search.ask()
    search.tell(x.sum(axis=0), np.zeros(size))
    rng = np.random.default_rng()
    rng.bit_generator.state = search.rng.bit_generator.state
    trials = search.ask()
    repaired = 0
    for i in range(size):
        r = draw_three_others(rng, size, i)
        k = int(rng.random() * dim)
        from_mutant = rng.random(dim) < CR
        from_mutant[k] = True
        mutant = x[:, r[0]] + F * (x[:, r[1]] - x[:, r[2]])
        low, high = (x[:, i] + bound for bound in (box.lower, box.upper))
        repaired += int((np.abs(mutant) > 1.0).sum())
        mutant = np.where(mutant < -1.0, low / 2, mutant)
        mutant = np.where(mutant > 1.0, high / 2, mutant)
        expected = np.where(from_mutant, mutant, x[:, i])
        np.testing.assert_allclose(trials[:, i], expected, rtol=0, atol=1e-15)
    assert repaired > 0


def test_all_triples_of_others_are_equally_likely() -> None:
    rng = np.random.default_rng(1)
    draws = [draw_three_others(rng, 5, 2) for _ in range(24_000)]
    triples = list(itertools.permutations([0, 1, 3, 4], 3))
    counts = np.array([draws.count(triple) for triple in triples])
    assert counts.sum() == len(draws)
    # 1000 expected of each, sd 31: five sd
    np.testing.assert_allclose(counts, 1000, atol=155)


def test_all_pairs_of_others_are_equally_likely() -> None:
    rng = np.random.default_rng(2)
    draws = [draw_two_others(rng, 4, 1, 6) for _ in range(12_000)]
    pairs = [(a, b) for a in (0, 2, 3) for b in range(6) if b not in (a, 1)]
    counts = np.array([draws.count(pair) for pair in pairs])
    assert counts.sum() == len(draws)
    # 1000 expected of each, sd 30: five sd
    np.testing.assert_allclose(counts, 1000, atol=155)


def test_exponential_crossover_takes_a_circular_run_of_geometric_length() -> None:
    dim, CR, number = 6, 0.7, 20_000
    rng = np.random.default_rng(3)
    mutated = np.zeros((dim, number), dtype=np.bool_)
    for i in range(number):
        cross_exponentially(rng, CR, np.arange(dim), mutated, i)
    lengths = mutated.sum(axis=0)
    begins = (mutated & ~np.roll(mutated, 1, axis=0)).sum(axis=0)
    np.testing.assert_array_equal(begins, lengths < dim)
    # P(length = n) = CR^(n-1) (1 - CR), the rest at n = dim; sd of a share < 0.0036
    shares = np.array([(lengths == n).mean() for n in range(1, dim + 1)])
    expected = CR ** np.arange(dim) * np.append(np.full(dim - 1, 1.0 - CR), 1.0)
    np.testing.assert_allclose(shares, expected, atol=5 * 0.0036)
    # Each coordinate is as likely as another: sd of a share < 0.0036
    shares = mutated.mean(axis=1)
    np.testing.assert_allclose(shares, lengths.mean() / dim, atol=5 * 0.0036)


def test_exponential_crossover_changes_one_circular_run() -> None:
    dim, size = 7, 40
    box = Box(lower=np.full(dim, -1.0), upper=np.full(dim, 1.0))
    algorithm = DifferentialEvolution(size=size, CR=0.6, crossover="exp")
    search = Search(algorithm, box, rng=np.random.default_rng(5))
    x = search.ask()
    search.tell(np.zeros(size), np.zeros(size))
    mutated = search.ask() != x
    lengths = mutated.sum(axis=0)
    begins = (mutated & ~np.roll(mutated, 1, axis=0)).sum(axis=0)
    np.testing.assert_array_equal(begins, lengths < dim)
    assert lengths.min() == 1 and (mutated[0] & mutated[-1] & (lengths < dim)).any()


@pytest.mark.parametrize("strategy", ["best/1", "current-to-best/1"])
def test_strategies_that_follow_the_best(strategy: Strategy) -> None:
    dim, size, F = 4, 6, 0.3
    box = Box(lower=np.full(dim, -1.0), upper=np.full(dim, 1.0))
    algorithm = DifferentialEvolution(
        size=size, F=F, CR=1.0, strategy=strategy, bound_handling="none"
    )
    search = Search(algorithm, box, rng=np.random.default_rng(4))
    x = search.ask()
    # Feasibility first: the fourth is the best, though the others cost less.
    search.tell([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], [1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    trials = search.ask()
    for i in range(size):
        base = x[:, 3] if strategy == "best/1" else x[:, i] + F * (x[:, 3] - x[:, i])
        others = itertools.permutations([j for j in range(size) if j != i], 2)
        mutants = [base + F * (x[:, a] - x[:, b]) for a, b in others]
        distances = [np.abs(trials[:, i] - mutant).max() for mutant in mutants]
        assert min(distances) < 1e-15


def test_child_replaces_a_parent_of_equal_cost_but_no_better_one() -> None:
    box = Box(lower=np.zeros(2), upper=np.ones(2))
    algorithm = DifferentialEvolution(size=4)
    search = Search(algorithm, box, rng=np.random.default_rng(2))
    parents = search.ask()
    search.tell(np.ones(4), np.zeros(4))
    children = search.ask()
    search.tell([1.0, 1.0 + 1e-12, np.nan, 0.5], [0.0, 0.0, 0.0, 1e-9])
    state = search.state
    assert isinstance(state, DifferentialEvolutionState)
    np.testing.assert_array_equal(state.population[:, 0], children[:, 0])
    np.testing.assert_array_equal(state.population[:, 1:], parents[:, 1:])


def test_clip_puts_coordinates_onto_the_bound() -> None:
    box = Box(lower=np.zeros(3), upper=np.ones(3))
    algorithm = DifferentialEvolution(size=8, F=2.0, CR=1.0, bound_handling="clip")
    search = Search(algorithm, box, rng=np.random.default_rng(3))
    search.tell(search.ask().sum(axis=0), np.zeros(8))
    asked = search.ask()
    assert (asked == 0.0).any() and (asked == 1.0).any()


def mean_evaluations(
    function: Objective, box: Box, seeds: int, **settings: Any
) -> float:
    """Mean evaluations to a feasible 1e-6; every seed must get there.

    As in Storn and Price (1997): no bounds after the first population.
    """
    counts = []
    for seed in range(seeds):
        events: list[GenerationEvent] = []
        result = minimize(
            function,
            box,
            algorithm=DifferentialEvolution(bound_handling="none", **settings),
            budget=Budget(evaluations=60_000, target=1e-6),
            rng=np.random.default_rng(seed),
            on_generation=events.append,
        )
        assert result.stopped is StopReason.TARGET
        cost = [np.where(e.violation == 0.0, e.cost, np.inf) for e in events]
        counts.append(int(np.argmax(np.concatenate(cost) <= 1e-6)) + 1)
    return float(np.mean(counts))


def cube(dim: int, half_width: float) -> Box:
    return Box(lower=np.full(dim, -half_width), upper=np.full(dim, half_width))


def step(x: Array) -> tuple[Array, Array]:
    """De Jong's third; infeasible outside, if it would fall on."""
    excess = np.maximum(np.abs(x) - 5.12, 0.0).sum(axis=0)
    return 30.0 + np.floor(x).sum(axis=0), excess


def rosenbrock(x: Array) -> tuple[Array, Array]:
    cost = 100.0 * (x[0] ** 2 - x[1]) ** 2 + (1.0 - x[0]) ** 2
    return cost, np.zeros(x.shape[1])


def griewank(x: Array) -> tuple[Array, Array]:
    root = np.sqrt(np.arange(1.0, x.shape[0] + 1.0))[:, None]
    cost = (x**2).sum(axis=0) / 4000.0 - np.cos(x / root).prod(axis=0) + 1.0
    return cost, np.zeros(x.shape[1])


def test_needs_as_many_evaluations_as_scipy_for_the_step_function() -> None:
    """The test of Storn and Price (1997) in 5-D: SciPy needs 844, with sd 155."""
    mean = mean_evaluations(step, cube(5, 5.12), 20, size=10, F=0.9, CR=0.0)
    assert mean == pytest.approx(844, abs=4 * 155 / np.sqrt(20))


def test_needs_as_many_evaluations_as_scipy_for_rosenbrock() -> None:
    """The test of Storn and Price (1997) in 2-D: SciPy needs 683; to 20 %."""
    mean = mean_evaluations(rosenbrock, cube(2, 2.048), 60, size=10, F=0.9, CR=0.9)
    assert mean == pytest.approx(683, rel=0.2)


def test_crossovers_need_as_many_evaluations_as_scipy_for_griewank() -> None:
    """The test of Storn and Price (1997), 10-D; SciPy: bin 12821, exp 17145.

    The numbers are measured by benchmarks/storn_price.py. One run has sd 1818 (bin) or
    2285 (exp); the limits are 3 sd of the mean of 8 runs.
    """
    settings = {"size": 25, "F": 0.5, "CR": 0.2}
    bin_mean = mean_evaluations(griewank, cube(10, 400.0), 8, **settings)
    exp_mean = mean_evaluations(
        griewank, cube(10, 400.0), 8, crossover="exp", **settings
    )
    assert bin_mean == pytest.approx(12821, abs=3 * 1818 / np.sqrt(8))
    assert exp_mean == pytest.approx(17145, abs=3 * 2285 / np.sqrt(8))
    assert exp_mean > bin_mean


def test_needs_as_many_evaluations_as_its_peers_for_the_sphere() -> None:
    """DE/rand/1/bin, NP 50, F 0.5, CR 0.9, 10-D sphere in [-5, 5] to 1e-8.

    pygmo needs 10935 evaluations on the mean, scipy 10944 (30 and 10 runs),
    with other bound repairs, which is worth some 2 %. The optimum is drawn in [-4, 4],
    as in BBOB.
    """
    counts = []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        optimum = rng.uniform(-4.0, 4.0, (10, 1))
        events: list[GenerationEvent] = []

        def sphere(x: Array, optimum: Array = optimum) -> tuple[Array, Array]:
            return ((x - optimum) ** 2).sum(axis=0), np.zeros(x.shape[1])

        result = minimize(
            sphere,
            Box(lower=np.full(10, -5.0), upper=np.full(10, 5.0)),
            algorithm=DifferentialEvolution(size=50, F=0.5, CR=0.9),
            budget=Budget(evaluations=15_000),
            rng=rng,
            on_generation=events.append,
        )
        assert result.cost < 1e-8
        counts.append(evaluations_until(1e-8, events))
    assert np.mean(counts) == pytest.approx(10_940, rel=0.06)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"size": 3}, "size must be an integer of at least 4, got 3"),
        ({"F": 0.0}, r"F must be a number in \(0, 2\], got 0.0"),
        ({"CR": 1.5}, r"CR must be a number in \[0, 1\], got 1.5"),
        (
            {"bound_handling": "stick"},
            "bound_handling must be one of clip, .*none, got 'stick'",
        ),
        ({"strategy": "rand/2"}, "strategy must be one of rand/1, .*, got 'rand/2'"),
        ({"crossover": "uniform"}, "crossover must be one of bin, exp, got 'uniform'"),
    ],
)
def test_refuses_settings_out_of_range(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        DifferentialEvolution(**setting)  # type: ignore[arg-type]


def test_what_is_surely_taken_from_the_mutant_is_free() -> None:
    rng = np.random.default_rng(5)
    free = np.array([1, 3])
    for cross in (cross_binomially, cross_exponentially):
        mutated = np.zeros((5, 200), dtype=np.bool_)
        for i in range(200):
            cross(rng, 0.0, free, mutated, i)
        assert mutated.sum(axis=0).tolist() == [1] * 200
        assert np.flatnonzero(mutated.any(axis=1)).tolist() == [1, 3]
