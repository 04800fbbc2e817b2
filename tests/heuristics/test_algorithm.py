"""Laws that every algorithm obeys."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmstart.heuristics import (
    Algorithm,
    Box,
    ChaoticPSO,
    DifferentialEvolution,
    GeneticAlgorithm,
    InvalidSettingsError,
    Order,
    ParticleSwarm,
    RandomSearch,
    Search,
    feasibility_first,
    static_penalty,
)

SIZE = 9  # odd: the last child of the genetic algorithm has no twin
ALGORITHMS: list[Algorithm] = [
    ChaoticPSO(size=SIZE),
    ParticleSwarm(size=SIZE),
    DifferentialEvolution(size=SIZE),
    GeneticAlgorithm(size=SIZE),
    RandomSearch(size=SIZE),
]
BY_RANK = ALGORITHMS[:3]
each_algorithm = pytest.mark.parametrize(
    "algorithm", ALGORITHMS, ids=lambda algorithm: type(algorithm).__name__
)
Array = NDArray[np.float64]


def rippled(points: Array) -> tuple[Array, Array]:
    """Many local minima, the best ones infeasible; NaN in a corner."""
    cost = (points**2 + np.cos(7.0 * points)).sum(axis=0)
    cost[points[0] > 2.0] = np.nan
    return cost, np.maximum(0.5 - points[0], 0.0)


def asked_points(search: Search, generations: int, *, shift: float = 0.0) -> Array:
    """Every point asked, shape (generations, dim, size)."""
    points = []
    for k in range(generations):
        points.append(search.ask(progress=k / generations))
        cost, violation = rippled(points[-1])
        search.tell(np.round(8.0 * cost) + shift, violation)
    return np.array(points)


@settings(max_examples=60, deadline=None)
@given(
    algorithm=st.sampled_from(ALGORITHMS),
    order=st.sampled_from([feasibility_first(), static_penalty(3.0)]),
    dim=st.integers(1, 6),
    scale=st.sampled_from([1e-6, 0.3, 1.0, 1e5]),
    seed=st.integers(0, 2**32),
)
def test_every_point_lies_in_the_box_and_the_best_never_worsens(
    algorithm: Algorithm, order: Order, dim: int, scale: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    lower = rng.normal(size=dim) * scale
    box = Box(lower=lower, upper=lower + rng.uniform(0.1, 4.0, dim) * scale)
    search = Search(algorithm, box, order=order, rng=rng)
    before = (np.inf, np.inf)
    for k in range(12):
        points = search.ask(progress=k / 11)
        assert box.contains(points).all()
        search.tell(*rippled(points))
        best = search.best
        merit = (
            (max(best.violation, 0.0), best.cost)
            if order == feasibility_first()
            else (0.0, best.cost + 3.0 * best.violation)
        )
        assert merit <= before
        before = merit
        if np.isfinite(best.cost):
            cost, violation = rippled(best.x[:, None])
            assert (cost[0], violation[0]) == (best.cost, best.violation)


@each_algorithm
def test_same_seed_same_bits_and_other_seed_other_bits(algorithm: Algorithm) -> None:
    box = Box(lower=np.full(4, -3.0), upper=np.full(4, 3.0))
    runs = [
        asked_points(Search(algorithm, box, rng=np.random.default_rng(seed)), 30)
        for seed in (1, 1, 2)
    ]
    np.testing.assert_array_equal(runs[0], runs[1])
    inside = np.abs(runs[0]) < 3.0  # several points may share a bound
    assert not np.isin(runs[0][inside], runs[2]).any()


@pytest.mark.parametrize("order", [feasibility_first(), static_penalty(2.0)])
@pytest.mark.parametrize("algorithm", BY_RANK, ids=lambda a: type(a).__name__)
def test_points_do_not_depend_on_a_constant_added_to_all_costs(
    algorithm: Algorithm, order: Order
) -> None:
    # Costs and weighted violations are rounded so coarsely that the sum is exact.
    box = Box(lower=np.full(4, -3.0), upper=np.full(4, 3.0))
    runs = []
    for shift in (0.0, 2.0**20):
        search = Search(algorithm, box, order=order, rng=np.random.default_rng(3))
        points = []
        for k in range(30):
            points.append(search.ask(progress=k / 30))
            cost, violation = rippled(points[-1])
            search.tell(np.round(8.0 * cost) + shift, np.round(violation * 8.0))
        runs.append(points)
    np.testing.assert_array_equal(runs[0], runs[1])


@each_algorithm
def test_search_continues_bit_for_bit_from_a_saved_state(
    algorithm: Algorithm, tmp_path: Path
) -> None:
    box = Box(lower=np.full(4, -3.0), upper=np.full(4, 3.0))
    whole = Search(algorithm, box, rng=np.random.default_rng(4))
    asked_points(whole, 12)
    state = whole.state
    assert isinstance(state, tuple)
    names = type(state)._fields  # type: ignore[attr-defined]
    np.savez(tmp_path / "state.npz", **dict(zip(names, state, strict=True)))
    bits = whole.rng.bit_generator.state
    expected = asked_points(whole, 8)

    with np.load(tmp_path / "state.npz") as saved:
        restored = type(state)(**saved)
    rng = np.random.default_rng(99)
    rng.bit_generator.state = bits
    continued = Search(algorithm, box, rng=rng, state=restored)
    np.testing.assert_array_equal(asked_points(continued, 8), expected)
    assert continued.evaluations == whole.evaluations == 20 * SIZE
    assert continued.nonfinite == whole.nonfinite


@each_algorithm
def test_nothing_finite_is_no_failure(algorithm: Algorithm) -> None:
    box = Box(lower=np.zeros(2), upper=np.ones(2))
    search = Search(algorithm, box, rng=np.random.default_rng(5))
    for _ in range(5):
        points = search.ask()
        assert box.contains(points).all()
        search.tell(np.full(SIZE, np.nan), np.zeros(SIZE))
    assert search.best.cost == np.inf
    assert search.nonfinite == 5 * SIZE
    points = search.ask()
    search.tell(np.where(np.arange(SIZE) == 3, 1e300, np.inf), np.zeros(SIZE))
    assert search.best.cost == 1e300
    np.testing.assert_array_equal(search.best.x, points[:, 3])


PRINT_RUNS = """
import numpy as np
from swarmstart import heuristics as h
box = h.Box(lower=np.full(3, -3.0), upper=np.full(3, 3.0))
for algorithm in (
    h.ChaoticPSO(size=6), h.DifferentialEvolution(size=6), h.ParticleSwarm(size=6),
    h.GeneticAlgorithm(size=6), h.RandomSearch(size=6),
):
    initial = np.full((3, 6), 0.1) if isinstance(algorithm, h.ChaoticPSO) else None
    for order in (h.feasibility_first(), h.static_penalty(3.0)):
        rng = np.random.default_rng(7)
        search = h.Search(algorithm, box, order=order, rng=rng, initial=initial)
        for k in range(8):
            points = search.ask(progress=k / 7)
            print(points.tobytes().hex())
            search.tell((points**2).sum(axis=0), np.maximum(0.5 - points[0], 0.0))
"""


def test_plain_python_gives_the_same_bits_as_compiled_code() -> None:
    outputs = [
        subprocess.run(
            [sys.executable, "-c", PRINT_RUNS],
            env=os.environ
            | {"NUMBA_DISABLE_JIT": disable, "PYTHONPATH": os.pathsep.join(sys.path)},
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for disable in ("0", "1")
    ]
    assert outputs[0] == outputs[1]
    assert len(outputs[0].split()) == 5 * 2 * 8


def test_random_search_refuses_an_empty_generation() -> None:
    with pytest.raises(InvalidSettingsError, match="size must be an integer"):
        RandomSearch(size=0)
