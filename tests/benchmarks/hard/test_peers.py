"""Peers on hard problems: paths avoid obstacles, searches approach the optimum."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.benchmarks.hard.peers import (
    Flags,
    archipelago,
    cross_entropy,
    shortest_path,
)
from swarmstart.cases.campaign.trials.history import BudgetSpent
from swarmstart.cases.campaign.trials.peers import PeerTask, peers_best
from swarmstart.heuristics import Box

START, END = (0.0, 0.0), (4.0, 0.0)
BOX = Box(lower=np.full(3, -4.0), upper=np.full(3, 5.0))
OPTIMUM = np.array([1.0, -2.0, 3.0])


def drawn(n: int = 300) -> Array:
    rng = np.random.default_rng(0)
    points = rng.uniform((-1.0, -3.0), (5.0, 3.0), size=(n, 2))
    return np.vstack([[START, END], points])


def length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def test_path_goes_around_a_disc_and_is_little_longer_than_the_taut_string() -> None:
    def free(points: Array) -> Flags:
        return np.asarray(np.hypot(points[:, 0] - 2.0, points[:, 1]) >= 1.0)

    path = shortest_path(drawn(), free)
    assert path is not None
    assert np.array_equal(path[0], START)
    assert np.array_equal(path[-1], END)
    shares = np.linspace(0, 1, 200)[:, None, None]
    inside = path[:-1] + shares * np.diff(path, axis=0)
    # Lines are checked at 40 points, so a corner may be cut by half a step.
    assert np.hypot(inside[..., 0] - 2.0, inside[..., 1]).min() > 0.99
    # Two tangents of length sqrt(3) and an arc of 60 degrees.
    taut = 2 * np.sqrt(3) + np.pi / 3
    assert taut * 0.995 < length(path) < 1.15 * taut


def test_there_is_no_path_through_a_closed_wall() -> None:
    assert shortest_path(drawn(), lambda p: np.abs(p[:, 0] - 2.0) > 0.3) is None


@pytest.mark.parametrize("peer", [cross_entropy, archipelago])
def test_search_approaches_the_least_point_of_a_quadratic(
    peer: Callable[[PeerTask], None],
) -> None:
    if peer is archipelago:
        pytest.importorskip("pygmo")
    least, count = np.inf, 0

    def objective(population: Array) -> Array:
        nonlocal least, count
        assert (population >= BOX.lower[:, None]).all()
        assert (population <= BOX.upper[:, None]).all()
        values = ((population - OPTIMUM[:, None]) ** 2).sum(axis=0)
        least, count = min(least, float(values.min())), count + values.size
        if count >= 4000:
            raise BudgetSpent
        return np.asarray(values)

    task = PeerTask(objective=objective, box=BOX, seed=1, options={})
    assert not peers_best(peer, task, "it")
    assert least < 1e-3


def test_archipelago_is_the_same_with_the_same_seed() -> None:
    pytest.importorskip("pygmo")

    def points(seed: int) -> list[Array]:
        asked = list[Array]()

        def objective(population: Array) -> Array:
            asked.append(population.copy())
            if len(asked) >= 2000:
                raise BudgetSpent
            return np.asarray((population**2).sum(axis=0))

        task = PeerTask(objective=objective, box=BOX, seed=seed, options={})
        peers_best(archipelago, task, "it")
        return asked

    assert np.array_equal(points(3), points(3))
    assert not np.array_equal(points(3), points(4))
