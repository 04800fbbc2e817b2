"""Algorithms of pygmo by name.

Its DE evaluates one individual after the other, its `pso_gen` and `cmaes` a generation.

Source: Biscani and Izzo (2020), A parallel global multiobjective framework for
optimization: pagmo, Journal of Open Source Software 5(53).
"""

from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np

from swarmstart.benchmarks.adapters.peer import (
    Evaluator,
    MissingPeerError,
    PeerResult,
    generations_of,
)
from swarmstart.heuristics.algorithm import require, require_size
from swarmstart.heuristics.box import Box
from swarmstart.heuristics.budget import Budget
from swarmstart.heuristics.initial import Initial, initial_population
from swarmstart.heuristics.minimize import Objective
from swarmstart.heuristics.order import Order
from swarmstart.kernel import Array

PygmoAlgorithm = Literal["de", "sade", "pso_gen", "cmaes"]
NO_STOP = {"ftol": 0.0, "xtol": 0.0}
DEFAULTS: dict[str, dict[str, float]] = {
    "de": NO_STOP,
    "sade": NO_STOP,
    "pso_gen": {},
    "cmaes": {**NO_STOP, "force_bounds": True},
}
"""What differs from pygmo's own: nothing stops before the budget, all in the box."""


class _Problem:
    """A problem as pygmo asks for one."""

    def __init__(self, evaluator: Evaluator, box: Box) -> None:
        self._evaluator = evaluator
        self._box = box

    def get_bounds(self) -> tuple[Array, Array]:
        return self._box.lower, self._box.upper

    def fitness(self, x: Array) -> Array:
        return self._evaluator.merits(x[:, None])

    def batch_fitness(self, points: Array) -> Array:
        return self._evaluator.merits(points.reshape(-1, self._box.dim).T)


def pygmo_search(  # noqa: PLR0913
    objective: Objective,
    box: Box,
    *,
    algorithm: PygmoAlgorithm,
    order: Order,
    budget: Budget,
    rng: np.random.Generator,
    size: int = 50,
    settings: Mapping[str, float] | None = None,
    initial: Initial | None = None,
) -> PeerResult:
    """Search a box with an algorithm of pygmo.

    Args:
        objective: As in `minimize`.
        box: The box to search.
        algorithm: The name of its class in pygmo.
        order: A static penalty.
        budget: Evaluations, no other limit.
        rng: Source of randomness.
        size: Number of individuals, at least 7 (which its DE needs).
        settings: Arguments of the class by name; None means its own, but for DEFAULTS.
        initial: How the initial population is made (known costs are not used); None
            means `Initial()`.

    Returns:
        The best point found. pygmo may stop before the budget is used up, where all
        individuals have become equal.

    Raises:
        InvalidBudgetError: If the budget has other limits, or fits no generation.
        InvalidSettingsError: If the algorithm is unknown, or the size is below 7.
        MissingPeerError: If pygmo is not installed.
        UnsupportedOrderError: If the order is no static penalty.
    """
    names = get_args(PygmoAlgorithm)
    require("algorithm", algorithm, ok=algorithm in names, allowed=f"one of {names}")
    require_size(size, at_least=7)
    evaluator = Evaluator(objective, box, order)
    generations = generations_of(budget, size)
    try:
        import pygmo  # noqa: PLC0415 - lazy
    except ImportError as error:
        raise MissingPeerError("pygmo") from error
    first, _ = initial_population(box, size, initial or Initial(), rng=rng)
    seeds = [int(seed) for seed in rng.integers(2**31, size=2)]
    population = pygmo.population(
        pygmo.problem(_Problem(evaluator, box)), size=0, seed=seeds[0]
    )
    for point, merit in zip(first.T, evaluator.merits(first), strict=True):
        population.push_back(point, [merit])
    chosen = {**DEFAULTS[algorithm], **(settings or {})}
    if generations > 1:
        peer = getattr(pygmo, algorithm)(gen=generations - 1, seed=seeds[1], **chosen)
        if hasattr(peer, "set_bfe"):
            peer.set_bfe(pygmo.bfe(pygmo.member_bfe()))
        pygmo.algorithm(peer).evolve(population)
    return evaluator.result()
