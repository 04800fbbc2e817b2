"""Searches of other libraries behind our objective."""

import importlib.util
import sys
from collections.abc import Callable
from typing import cast, get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.benchmarks.adapters import (
    MissingPeerError,
    PeerResult,
    PygmoAlgorithm,
    UnsupportedOrderError,
    pygmo_search,
    scipy_de,
)
from swarmstart.heuristics import (
    Box,
    Budget,
    Initial,
    InvalidBudgetError,
    InvalidSettingsError,
    feasibility_first,
    static_penalty,
)

Array = NDArray[np.float64]
Peer = Callable[..., PeerResult]
DIM = 4
BOX = Box(lower=np.full(DIM, -3.0), upper=np.full(DIM, 2.0))
BUDGET = Budget(evaluations=4010)
PYGMO = importlib.util.find_spec("pygmo") is not None


def peer(name: str) -> Peer:
    if name == "scipy":
        return scipy_de

    def search(*arguments: object, **keywords: object) -> PeerResult:
        return cast(Peer, pygmo_search)(*arguments, algorithm=name, **keywords)

    return search


NAMES = ("scipy", *get_args(PygmoAlgorithm))
each_peer = pytest.mark.parametrize(
    "search",
    [
        pytest.param(
            peer(name),
            id=name,
            marks=pytest.mark.skipif(
                name != "scipy" and not PYGMO,
                reason="pygmo is not installed: pip install swarmstart[peers]",
            ),
        )
        for name in NAMES
    ],
)


def sphere(x: Array) -> tuple[Array, Array]:
    """At least 1 at x_0 = 1; NaN at a side of the box."""
    cost = np.where(x[1] > 1.5, np.nan, (x**2).sum(axis=0))
    return cost, np.maximum(1.0 - x[0], 0.0)


@each_peer
def test_peer_finds_the_constrained_optimum_within_its_budget(search: Peer) -> None:
    seen: list[Array] = []

    def objective(x: Array) -> tuple[Array, Array]:
        assert not x.flags.writeable
        seen.append(x)
        return sphere(x)

    result = search(
        objective,
        BOX,
        order=static_penalty(10.0),
        budget=BUDGET,
        rng=np.random.default_rng(1),
        size=40,
    )
    points = np.concatenate(seen, axis=1)
    assert result.evaluations == points.shape[1] == 4000
    assert BOX.contains(points).all()
    assert 1.0 - 1e-6 <= result.cost + 10.0 * result.violation < 1.05
    cost, violation = sphere(result.x[:, None])
    assert (cost[0], violation[0]) == (result.cost, result.violation)
    cost, violation = sphere(points)
    assert result.cost + 10.0 * result.violation == np.nanmin(cost + 10.0 * violation)


@each_peer
def test_same_seed_same_bits_and_initial_points_are_used(search: Peer) -> None:
    given = np.zeros((DIM, 1))
    given[0] = 1.0
    results = [
        search(
            sphere,
            BOX,
            order=static_penalty(10.0),
            budget=Budget(evaluations=200),
            rng=np.random.default_rng(2),
            size=20,
            initial=Initial(points=points),
        )
        for points in (None, None, given)
    ]
    np.testing.assert_array_equal(results[0].x, results[1].x)
    assert results[2].cost < 1.0 + 1e-12 < results[0].cost


@each_peer
def test_refuses_what_a_peer_cannot_do(search: Peer) -> None:
    rng = np.random.default_rng(3)
    with pytest.raises(UnsupportedOrderError, match="order must be a static_penalty"):
        search(sphere, BOX, order=feasibility_first(), budget=BUDGET, rng=rng)
    for budget in (Budget(seconds=1.0), Budget(evaluations=100, target=0.0)):
        with pytest.raises(InvalidBudgetError, match="evaluations only"):
            search(sphere, BOX, order=static_penalty(1.0), budget=budget, rng=rng)
    with pytest.raises(InvalidBudgetError, match="evaluations must be at least 50"):
        search(
            sphere,
            BOX,
            order=static_penalty(1.0),
            budget=Budget(evaluations=49),
            rng=rng,
        )
    with pytest.raises(InvalidSettingsError, match="size must be an integer"):
        search(sphere, BOX, order=static_penalty(1.0), budget=BUDGET, rng=rng, size=3)


def test_without_pygmo_one_sentence_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "pygmo", None)
    with pytest.raises(MissingPeerError, match=r"pip install swarmstart\[peers\]"):
        pygmo_search(
            sphere,
            BOX,
            algorithm="de",
            order=static_penalty(1.0),
            budget=BUDGET,
            rng=np.random.default_rng(4),
        )


def test_an_unknown_algorithm_of_pygmo_is_refused() -> None:
    with pytest.raises(InvalidSettingsError, match="algorithm must be one of"):
        pygmo_search(
            sphere,
            BOX,
            algorithm="bees",  # type: ignore[arg-type]
            order=static_penalty(1.0),
            budget=BUDGET,
            rng=np.random.default_rng(4),
        )
