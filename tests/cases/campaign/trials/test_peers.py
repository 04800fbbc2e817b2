"""Peers are run as their packages run them, on the same objective."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import differential_evolution

from swarmstart.arrays import Array
from swarmstart.cases.campaign.trials.history import BudgetSpent
from swarmstart.cases.campaign.trials.peers import (
    LARGEST,
    PeerError,
    PeerTask,
    cmaes_ipop,
    peers_best,
    penalised,
    pygmo_cmaes,
    pygmo_de,
    pygmo_de1220,
    pygmo_pso,
    scipy_de,
)
from swarmstart.heuristics import Box

BOX = Box(lower=np.full(4, -3.0), upper=np.full(4, 2.0))
EVERY = (scipy_de, pygmo_de, pygmo_de1220, pygmo_pso, pygmo_cmaes, cmaes_ipop)


def rastrigin(x: Array) -> Array:
    return np.asarray(10 + (x**2 - 10 * np.cos(2 * np.pi * x)).sum(axis=0))


class Recorded:
    """Counts, keeps the best, and ends at a number of evaluations."""

    def __init__(self, function: Callable[[Array], Array], most: int) -> None:
        self.function, self.most, self.count = function, most, 0
        self.best, self.x = np.inf, np.empty(0)

    def __call__(self, population: Array) -> Array:
        values = self.function(population)
        self.count += values.size
        place = int(np.argmin(values))
        if values[place] < self.best:
            self.best, self.x = float(values[place]), population[:, place].copy()
        if self.count >= self.most:
            raise BudgetSpent
        return values


def run(peer: Callable[[PeerTask], None], seed: int, most: int = 10**9) -> Recorded:
    asked = Recorded(rastrigin, most)
    options = {} if peer is cmaes_ipop else {"popsize": 8, "size": 24, "tol": 0.01}
    task = PeerTask(objective=asked, box=BOX, seed=seed, options=options)
    peers_best(peer, task, peer.__name__)
    return asked


def test_scipy_gives_what_scipy_gives_when_called_directly() -> None:
    bounds = list(zip(BOX.lower, BOX.upper, strict=True))
    for seed in (0, 1):
        direct = differential_evolution(
            rastrigin, bounds, popsize=8, polish=False, vectorized=True,
            updating="deferred", rng=np.random.default_rng(seed),
        )  # fmt: skip
        ours = run(scipy_de, seed)
        assert np.array_equal(ours.x, direct.x) and ours.best == direct.fun
        assert ours.count == 32 * direct.nfev  # SciPy counts calls, of 32 points each.


@pytest.mark.parametrize("peer", EVERY)
def test_a_seed_and_a_budget_give_the_same_bits(
    peer: Callable[[PeerTask], None],
) -> None:
    first, again, other = (run(peer, seed, 700) for seed in (3, 3, 4))
    assert np.array_equal(first.x, again.x) and first.count == again.count
    assert not np.array_equal(first.x, other.x)
    assert 700 <= first.count <= 700 + 32
    assert (first.x >= BOX.lower).all() and (first.x <= BOX.upper).all()
    assert first.best < 10.0


def test_values_that_are_not_finite_are_large_ones() -> None:
    cost = np.array([1.0, np.nan, -np.inf, np.inf, 2.0])
    values = penalised(cost, np.array([0.0, 0.0, 0.0, 0.0, 0.5]), 10.0)
    np.testing.assert_array_equal(values, [1.0, LARGEST, LARGEST, LARGEST, 7.0])


def test_what_a_peer_refuses_is_an_error_of_this_package() -> None:
    task = PeerTask(objective=rastrigin, box=BOX, seed=0, options={"variant": 99})
    with pytest.raises(PeerError, match="pygmo-de cannot be run"):
        peers_best(pygmo_de, task, "pygmo-de")
    line = Box(lower=np.zeros(1), upper=np.ones(1))
    with pytest.raises(PeerError, match="at least 2 variables"):
        cmaes_ipop(PeerTask(objective=rastrigin, box=line, seed=0, options={}))
