"""Storn and Price (1997): evaluations to 1e-6, no bounds after the first population."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from swarmstart.benchmarks.anchors import Array, Row, cube, no_violation, within
from swarmstart.heuristics import (
    Box,
    Budget,
    DifferentialEvolution,
    GenerationEvent,
    Objective,
    minimize,
)


class StornPrice(NamedTuple):
    """A row of the paper's table.

    Attributes:
        name: The function.
        objective: The function.
        box: Box in which the first population is drawn.
        settings: NP, F, CR.
        published: Mean number of evaluations.
        seeds: Number of runs.
        tolerance: Relative tolerance.
        successes: Least fraction of the runs that must succeed.
    """

    name: str
    objective: Objective
    box: Box
    settings: tuple[int, float, float]
    published: float
    seeds: int
    tolerance: float
    successes: float


def sphere(x: Array) -> tuple[Array, Array]:
    """The first function of De Jong."""
    return (x**2).sum(axis=0), no_violation(x)


def rosenbrock(x: Array) -> tuple[Array, Array]:
    """The second function of De Jong."""
    cost = 100.0 * (x[0] ** 2 - x[1]) ** 2 + (1.0 - x[0]) ** 2
    return cost, no_violation(x)


def step(x: Array) -> tuple[Array, Array]:
    """The third function of De Jong; infeasible outside, since it decreases there."""
    excess = np.maximum(np.abs(x) - 5.12, 0.0).sum(axis=0)
    return 30.0 + np.floor(x).sum(axis=0), excess


def corana(x: Array) -> tuple[Array, Array]:
    """The parabola of Corana, full of holes."""
    weight = np.array([[1.0], [1000.0], [10.0], [100.0]])
    z = np.floor(np.abs(x / 0.2) + 0.49999) * np.sign(x) * 0.2
    hole = 0.15 * weight * (z - 0.05 * np.sign(z)) ** 2
    cost = np.where(np.abs(x - z) < 0.05, hole, weight * x**2)
    return cost.sum(axis=0), no_violation(x)


def griewank(x: Array) -> tuple[Array, Array]:
    """The function of Griewank."""
    root = np.sqrt(np.arange(1.0, x.shape[0] + 1.0))[:, None]
    cost = (x**2).sum(axis=0) / 4000.0 - np.cos(x / root).prod(axis=0) + 1.0
    return cost, no_violation(x)


STORN_PRICE = (
    StornPrice(
        "sphere 3-D", sphere, cube(3, 5.12), (5, 0.9, 0.1), 406, 60, 0.36, 50 / 60
    ),
    StornPrice(
        "Rosenbrock 2-D", rosenbrock, cube(2, 2.048), (10, 0.9, 0.9), 654, 60, 0.2, 0.9
    ),
    StornPrice("step 5-D", step, cube(5, 5.12), (10, 0.9, 0.0), 849, 60, 0.08, 0.9),
    StornPrice(
        "Corana 4-D", corana, cube(4, 1000.0), (10, 0.4, 0.2), 841, 60, 0.08, 0.8
    ),
    StornPrice(
        "Griewank 10-D", griewank, cube(10, 400.0), (25, 0.5, 0.2), 12752, 20, 0.12, 0.9
    ),
)
EXPONENTIAL_GRIEWANK = 16469.0
"""The same with exponential crossover, measured on another implementation: +- 511."""


def first_hit(row: StornPrice, seed: int, **settings: Any) -> int | None:
    """Return the evaluations up to the first individual with 1e-6; None without one."""
    hits: list[int] = []

    def note_hit(event: GenerationEvent) -> None:
        hit = (event.cost <= 1e-6) & (event.violation == 0.0)
        if hit.any():
            begin = event.evaluations - event.cost.size
            hits.append(begin + int(np.argmax(hit)) + 1)
            raise StopIteration

    size, F, CR = row.settings
    minimize(
        row.objective,
        row.box,
        algorithm=DifferentialEvolution(
            size=size, F=F, CR=CR, bound_handling="none", **settings
        ),
        budget=Budget(evaluations=100_000 if size > 10 else 10_000),
        rng=np.random.default_rng(seed),
        on_generation=note_hit,
    )
    return hits[0] if hits else None


def mean_hits(row: StornPrice, seeds: int, **settings: Any) -> tuple[float, float, int]:
    """Mean evaluations of the runs that succeeded, their standard error, how many."""
    every = [first_hit(row, seed, **settings) for seed in range(seeds)]
    hits = [hit for hit in every if hit is not None]
    return float(np.mean(hits)), float(np.std(hits) / np.sqrt(len(hits))), len(hits)


def storn_price(*, short: bool) -> Iterator[Row]:
    """Evaluations to 1e-6, and that bin and exp differ as they should."""
    for row in STORN_PRICE:
        seeds = max(row.seeds // 4, 5) if short else row.seeds
        mean, error, successes = mean_hits(row, seeds)
        yield Row(
            row.name,
            f"{mean:.0f} +- {error:.0f}, {successes}/{seeds}",
            f"{row.published:.0f}",
            f"{row.tolerance:.0%}, at least {row.successes:.0%} of the runs",
            within(mean, row.published, row.tolerance)
            and successes >= row.successes * seeds,
        )
    seeds = 5 if short else 20
    mean, error, successes = mean_hits(STORN_PRICE[-1], seeds, crossover="exp")
    yield Row(
        "Griewank 10-D, exponential crossover",
        f"{mean:.0f} +- {error:.0f}, {successes}/{seeds}",
        f"{EXPONENTIAL_GRIEWANK:.0f} (another implementation)",
        "12%",
        within(mean, EXPONENTIAL_GRIEWANK, 0.12),
    )
