"""The exact chain, against another enumeration, its laws, and the searches' own DE.

ROWS and TIMES come from an enumeration that shares no code with this one.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.cases.chapter.markov_chain import (
    GridBoundHandling,
    GridDE,
    MarkovChain,
    absorption,
    build_chain,
    dead_states,
    fixed_points,
    hitting_times,
    miss_bounds,
    miss_probabilities,
    spectral_radius,
)
from swarmstart.heuristics import Box, DifferentialEvolution, InvalidSettingsError
from swarmstart.heuristics.laws.order import feasibility_first
from swarmstart.heuristics.searches.de import (
    DifferentialEvolutionSettings,
    DifferentialEvolutionState,
    accept,
    propose,
)

Row = tuple[list[int], float, GridBoundHandling, int, int, float, float]

TRAP = [1, 2, 3, 4, 5, 0]
TWO_WAYS = [1, 3, 4, 3, 2, 0]
MONOTONE = [5, 4, 3, 2, 1, 0]
RUGGED = [3, 2, 0, 4, 1, 2]
ROWS: list[Row] = [
    (TRAP, 0.5, "clip", 239, 5, 0.681902, 0.340393),
    (TRAP, 1.0, "clip", 143, 5, 0.759808, 0.501938),
    (TRAP, 1.0, "reject", 231, 35, 0.705760, 0.389864),
    (TWO_WAYS, 0.5, "clip", 65, 5, 0.803367, 0.592261),
    (TWO_WAYS, 1.0, "clip", 65, 5, 0.831648, 0.650905),
    (MONOTONE, 0.5, "clip", 5, 5, 0.885287, 0.762131),
    (MONOTONE, 1.0, "clip", 5, 5, 0.967880, 0.933396),
    (RUGGED, 1.0, "clip", 129, 11, 0.753363, 0.488574),
]
# eps, mean and longest expected hitting time of TRAP with F 0.5, clip
TIMES = [
    (0.02, 24.164, 75.376),
    (0.05, 9.918, 30.378),
    (0.1, 5.171620, 15.380252),
    (0.3, 2.015, 5.391),
]
PAGE = Path(__file__).parents[3] / "docs" / "chapter" / "stability.md"


def chain_of(
    costs: list[int],
    F: float = 0.5,
    bound_handling: GridBoundHandling = "clip",
    immigrant: float = 0.0,
) -> MarkovChain:
    grid = GridDE(
        costs=np.array(costs), F=F, bound_handling=bound_handling, immigrant=immigrant
    )
    return build_chain(grid)


def index_of(chain: MarkovChain, population: list[int]) -> int:
    shape = (chain.grid.points,) * chain.grid.size
    return int(np.ravel_multi_index(population, shape))


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_plain_chain_has_the_enumerated_numbers(row: Row) -> None:
    costs, F, rule, dead, fixed, uniform, without_optimum = row
    chain = chain_of(costs, F, rule)
    assert chain.populations.shape == (1296, 4)
    assert np.count_nonzero(~chain.optimal) == 625
    assert np.count_nonzero(dead_states(chain)) == dead
    assert np.count_nonzero(fixed_points(chain)) == fixed
    found = absorption(chain)
    assert found.uniform == pytest.approx(uniform, abs=1e-6)
    assert found.without_optimum == pytest.approx(without_optimum, abs=1e-6)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_immigrant_reaches_the_optimum_from_everywhere(row: Row) -> None:
    """The bounds are attained where all are at the second best: only one is better."""
    chain = chain_of(*row[:3], immigrant=0.1)
    stays = (59 / 60) ** 4
    assert not dead_states(chain).any()
    assert not fixed_points(chain).any()
    np.testing.assert_allclose(absorption(chain).by_state, 1.0, rtol=0, atol=1e-12)
    assert spectral_radius(chain) == pytest.approx(stays, abs=1e-12)
    assert hitting_times(chain).longest == pytest.approx(1 / (1 - stays), abs=1e-9)
    missed, bounds = miss_probabilities(chain, 100), miss_bounds(chain.grid, 100)
    # The rounding of 100 products
    np.testing.assert_allclose(missed, bounds, rtol=1e-12)
    assert missed[[10, 100]] == pytest.approx([0.5105, 1.203e-3], rel=5e-4)


@pytest.mark.parametrize(("eps", "mean", "longest"), TIMES)
def test_hitting_times_fall_with_the_rate_of_immigrants(
    eps: float, mean: float, longest: float
) -> None:
    times = hitting_times(chain_of(TRAP, immigrant=eps))
    digits = 1e-6 if eps == 0.1 else 5e-4
    assert times.mean == pytest.approx(mean, abs=digits)
    assert times.longest == pytest.approx(longest, abs=digits)


def test_immigrants_alone_are_random_search_that_keeps_the_best() -> None:
    """Then every state without the optimum stays so with (1 - 1/m)^NP."""
    chain = chain_of(TRAP, immigrant=1.0)
    stays = (5 / 6) ** 4
    times = hitting_times(chain)
    expected = np.where(chain.optimal, 0.0, 1.0 / (1.0 - stays))
    np.testing.assert_allclose(times.by_state, expected, rtol=1e-12)
    assert times.mean == pytest.approx(stays / (1.0 - stays), rel=1e-12)
    np.testing.assert_allclose(miss_probabilities(chain, 9), stays ** np.arange(10))


def test_immigrant_is_taken_if_it_is_not_worse() -> None:
    """At point 1 of RUGGED, cost 2: points 2, 4 and 5, and 0 and 3 leave it there."""
    chain = chain_of(RUGGED, immigrant=1.0)
    row = chain.transition[index_of(chain, [1, 1, 1, 1])].reshape(6, 6, 6, 6)
    first = np.array([0, 3, 1, 0, 1, 1]) / 6
    np.testing.assert_allclose(row.sum(axis=(1, 2, 3)), first, rtol=0, atol=1e-12)
    together = np.multiply.outer(first, first)
    np.testing.assert_allclose(row.sum(axis=(0, 2)), together, rtol=0, atol=1e-12)


@pytest.mark.parametrize("costs", [TRAP, TWO_WAYS, MONOTONE, RUGGED], ids=str)
def test_equal_individuals_stay_forever(costs: list[int]) -> None:
    chain = chain_of(costs)
    for point in np.flatnonzero(costs):
        state = index_of(chain, [int(point)] * 4)
        assert chain.transition[state, state] == 1.0
        assert fixed_points(chain)[state] and dead_states(chain)[state]
        assert absorption(chain).by_state[state] == 0.0
    assert hitting_times(chain).longest == np.inf
    assert spectral_radius(chain) == pytest.approx(1.0, abs=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    costs=st.lists(st.integers(0, 3), min_size=2, max_size=4).filter(
        lambda costs: len(set(costs)) > 1
    ),
    size=st.integers(4, 5),
    F=st.sampled_from([0.25, 0.5, 0.8, 1.0, 2.0]),
    bound_handling=st.sampled_from(["clip", "reject"]),
    immigrant=st.sampled_from([0.0, 0.05, 1.0]),
)
def test_laws_of_the_chain(
    costs: list[int],
    size: int,
    F: float,
    bound_handling: GridBoundHandling,
    immigrant: float,
) -> None:
    grid = GridDE(
        costs=np.array(costs),
        size=size,
        F=F,
        bound_handling=bound_handling,
        immigrant=immigrant,
    )
    chain = build_chain(grid)
    P, optimal = chain.transition, chain.optimal
    np.testing.assert_allclose(P.sum(axis=1), 1.0, rtol=0, atol=1e-12)
    assert (P >= 0.0).all()
    # The best never worsens, so that the populations with an optimum are a closed set.
    best = grid.costs[chain.populations].min(axis=1)
    before, after = np.nonzero(P)
    assert (best[after] <= best[before]).all()
    np.testing.assert_array_equal(optimal, best == min(costs))
    # h = P h, which has h = 0 in the dead states and h = 1 in the optimal ones
    h, dead = absorption(chain).by_state, dead_states(chain)
    np.testing.assert_allclose(P @ h, h, rtol=0, atol=1e-12)
    assert (h[dead] == 0.0).all() and (h[optimal] == 1.0).all()
    assert (h[~dead] > 0.0).all() and (h <= 1.0 + 1e-12).all()
    # T = 1 + P T in states with finite T: no dead state can be reached from them
    T = hitting_times(chain).by_state
    finite = np.isfinite(T)
    np.testing.assert_array_equal(finite, h > 1.0 - 1e-9)
    step = P[:, finite] @ T[finite] + 1.0
    expected = np.where(optimal, 0.0, step)[finite]
    np.testing.assert_allclose(T[finite], expected, rtol=1e-9)
    missed = miss_probabilities(chain, 30)
    assert (missed <= miss_bounds(grid, 30) * (1.0 + 1e-12)).all()
    # Only comparisons of costs matter.
    curved = GridDE(
        costs=np.exp(grid.costs),
        size=size,
        F=F,
        bound_handling=bound_handling,
        immigrant=immigrant,
    )
    np.testing.assert_array_equal(build_chain(curved).transition, P)


class OwnDE:
    """The searches' own DE on a grid, its kernels driven by hand."""

    def __init__(self, grid: GridDE, seed: int) -> None:
        self.grid = grid
        self.rng = np.random.default_rng(seed)
        self.box = Box(lower=np.zeros(1), upper=np.full(1, grid.points - 1.0))
        # Rejected is what has an infinite cost; it must not be repaired then.
        self.algorithm = DifferentialEvolution(
            size=grid.size,
            F=grid.F,
            CR=1.0,
            bound_handling="clip" if grid.bound_handling == "clip" else "none",
        )
        order = feasibility_first().running()
        self.settings: DifferentialEvolutionSettings = self.algorithm.kernel_settings(
            self.box, order
        )
        self.feasible = np.zeros(grid.size)

    def start(self, population: Array) -> DifferentialEvolutionState:
        state = self.algorithm.start(self.box, population[None], rng=self.rng)
        self.go_on(state)
        return state

    def go_on(self, state: DifferentialEvolutionState) -> None:
        asked = np.empty_like(state.population)
        propose(self.rng, self.settings, state, asked)
        np.floor(asked + 0.5, out=asked)
        point = asked[0].astype(np.int64)
        inside = (point >= 0) & (point < self.grid.points)
        cost = np.where(inside, self.grid.costs[point * inside], np.inf)
        accept(self.settings, state, asked, cost, self.feasible)


@pytest.mark.parametrize(
    ("costs", "F", "rule", "population"),
    [
        (TRAP, 0.5, "clip", [0, 2, 3, 4]),
        (TRAP, 1.0, "reject", [3, 4, 2, 0]),
        (RUGGED, 1.0, "clip", [1, 5, 3, 0]),
    ],
)
def test_generation_of_the_searches_de_is_distributed_as_the_row(
    costs: list[int], F: float, rule: GridBoundHandling, population: list[int]
) -> None:
    """The last has two points of equal cost, which a trial may exchange."""
    chain, draws = chain_of(costs, F, rule), 6_000
    search = OwnDE(chain.grid, seed=1)
    counts = np.zeros(chain.grid.states)
    for _ in range(draws):
        state = search.start(np.array(population, dtype=np.float64))
        search.go_on(state)
        counts[index_of(chain, state.population[0].astype(int).tolist())] += 1.0
    expected = draws * chain.transition[index_of(chain, population)]
    possible = expected > 0.0
    assert counts[~possible].sum() == 0.0
    # Pearson's statistic has mean n and at most the variance 2 n + sum 1/expected
    degrees = np.count_nonzero(possible) - 1
    statistic = ((counts - expected)[possible] ** 2 / expected[possible]).sum()
    sd = np.sqrt(2.0 * degrees + (1.0 / expected[possible]).sum())
    assert degrees > 10
    assert abs(statistic - degrees) < 4.0 * sd


@pytest.mark.parametrize(
    ("F", "rule", "runs"), [(0.5, "clip", 10_000), (1.0, "reject", 3_000)]
)
def test_searches_de_reaches_the_optimum_as_often_as_computed(
    F: float, rule: GridBoundHandling, runs: int
) -> None:
    """After 20 generations all but 1e-7 of the runs are decided."""
    chain = chain_of(TRAP, F, rule)
    search = OwnDE(chain.grid, seed=0)
    reached = 0
    for _ in range(runs):
        population = search.rng.integers(chain.grid.points, size=4)
        state = search.start(population.astype(np.float64))
        for _ in range(20):
            if state.best_cost[0] == 0.0:
                break
            search.go_on(state)
        reached += int(state.best_cost[0] == 0.0)
    p = absorption(chain).uniform
    assert reached / runs == pytest.approx(p, abs=4 * np.sqrt(p * (1 - p) / runs))


def table_of(page: str, heading: str) -> list[list[str]]:
    """The cells below the row of a table that begins with a heading."""
    table, _, _ = page[page.index(heading) :].partition("\n\n")
    rows = table.splitlines()[2:]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def test_page_has_the_numbers_of_the_chain() -> None:
    page = PAGE.read_text(encoding="utf-8")
    rows = table_of(page, "| costs | F |")
    assert len(rows) == len(ROWS)
    for (costs, F, rule, *_), (name, *cells) in zip(ROWS, rows, strict=True):
        chain = chain_of(costs, F, rule)
        found = absorption(chain)
        assert re.findall(r"\d", name) == [str(cost) for cost in costs]
        assert cells == [
            f"{F:g}",
            rule,
            f"{np.count_nonzero(dead_states(chain))}",
            f"{np.count_nonzero(fixed_points(chain))}",
            f"{found.uniform:.6f}",
            f"{found.without_optimum:.6f}",
        ]
    rows = table_of(page, "| eps |")
    assert len(rows) == len(TIMES)
    for eps, *cells in rows:
        chain = chain_of(TRAP, immigrant=float(eps))
        times, missed = hitting_times(chain), miss_probabilities(chain, 100)
        assert cells == [
            f"{spectral_radius(chain):.6f}",
            f"{times.mean:.3f}",
            f"{times.longest:.3f}",
            f"{missed[10]:.4f}",
            f"{missed[100]:.3e}",
        ]


def test_example_of_the_page_prints_what_it_says(
    capsys: pytest.CaptureFixture[str],
) -> None:
    page = PAGE.read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    exec(code, {})
    expected = re.findall(r"# (.+)", code)
    assert capsys.readouterr().out.splitlines() == expected


def test_costs_are_copied_and_what_is_returned_is_read_only() -> None:
    costs = np.array([1.0, 2.0, 0.0])
    grid = GridDE(costs=costs)
    costs[0] = -1.0
    chain = build_chain(grid)
    assert grid.costs[0] == 1.0
    for array in (
        grid.costs,
        chain.populations,
        chain.transition,
        chain.optimal,
        absorption(chain).by_state,
        hitting_times(chain).by_state,
    ):
        assert not array.flags.writeable


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"costs": [1.0]}, r"costs must be a vector of .*, got \[1.0\]"),
        ({"costs": [1.0, np.nan]}, r"at least 2 finite numbers.*, got \[1.0, nan\]"),
        ({"costs": [[1.0, 2.0]]}, r"costs must be a vector.*, got \[\[1.0, 2.0\]\]"),
        ({"costs": [2.0, 2.0]}, r"not all equal, got \[2.0, 2.0\]"),
        ({"size": 3}, "size must be an integer of at least 4, got 3"),
        ({"size": 4.0}, "size must be an integer of at least 4, got 4.0"),
        ({"size": 6}, r"populations must be at most 10000, got '6\*\*6'"),
        ({"costs": [0, 1], "size": 14}, r"at most 10000, got '2\*\*14'"),
        ({"F": 0.0}, r"F must be in \(0, 2.0\], got 0.0"),
        ({"F": 2.5}, r"F must be in \(0, 2.0\], got 2.5"),
        (
            {"bound_handling": "midpoint"},
            "bound_handling must be one of clip, reject, got",
        ),
        ({"immigrant": -0.1}, r"immigrant must be a number in \[0, 1\], got -0.1"),
        ({"immigrant": 1.5}, r"immigrant must be a number in \[0, 1\], got 1.5"),
    ],
)
def test_refuses_settings_out_of_range(
    setting: dict[str, object], message: str
) -> None:
    with pytest.raises(InvalidSettingsError, match=message):
        GridDE(**{"costs": TRAP, **setting})  # type: ignore[arg-type]


@pytest.mark.parametrize("generations", [-1, 2.0])
def test_refuses_no_number_of_generations(generations: int) -> None:
    chain = chain_of([1, 0])
    message = f"generations must be an integer of at least 0, got {generations}"
    with pytest.raises(InvalidSettingsError, match=message):
        miss_probabilities(chain, generations)
    with pytest.raises(InvalidSettingsError, match=message):
        miss_bounds(chain.grid, generations)
