"""Storn and Price (1997): evaluations to 1e-6, no bounds after the first population.

    python benchmarks/storn_price.py

The test functions and settings are those of the paper. The numbers to compare with are
not: they are means of SciPy's `differential_evolution`, an independent implementation
(1.17.1, deferred updating, its bounds a thousand times as wide as the first
population). The command above measures them again.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import differential_evolution

from swarmstart.arrays import Array
from swarmstart.benchmarks.anchors import Row, cube, no_violation, within
from swarmstart.heuristics import (
    Box,
    Budget,
    DifferentialEvolution,
    GenerationEvent,
    Objective,
    minimize,
)
from swarmstart.heuristics.running.minimize import values_of


class StornPrice(NamedTuple):
    """A row of the paper's table.

    Attributes:
        name: The function.
        objective: The function.
        box: Box in which the first population is drawn.
        settings: NP, F, CR.
        published: Mean number of evaluations of SciPy's runs that succeed.
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


# Of SciPy: 552 +- 59 (270 of 300 runs), 683 +- 14 (300 of 300), 844 +- 11 (200 of 200),
# 870 +- 7 (182 of 200), 12821 +- 181 (60 of 60).
STORN_PRICE = (
    StornPrice(
        "sphere 3-D", sphere, cube(3, 5.12), (5, 0.9, 0.1), 552, 60, 0.36, 50 / 60
    ),
    StornPrice(
        "Rosenbrock 2-D", rosenbrock, cube(2, 2.048), (10, 0.9, 0.9), 683, 60, 0.2, 0.9
    ),
    StornPrice("step 5-D", step, cube(5, 5.12), (10, 0.9, 0.0), 844, 60, 0.08, 0.9),
    StornPrice(
        "Corana 4-D", corana, cube(4, 1000.0), (10, 0.4, 0.2), 870, 60, 0.08, 0.8
    ),
    StornPrice(
        "Griewank 10-D", griewank, cube(10, 400.0), (25, 0.5, 0.2), 12821, 20, 0.12, 0.9
    ),
)
EXPONENTIAL_GRIEWANK = 17145.0
"""The same with exponential crossover, also of SciPy: +- 715, 38 of 40 runs."""


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
            f"{row.published:.0f} (SciPy)",
            f"{row.tolerance:.0%}, at least {row.successes:.0%} of the runs",
            within(mean, row.published, row.tolerance)
            and successes >= row.successes * seeds,
        )
    seeds = 5 if short else 20
    mean, error, successes = mean_hits(STORN_PRICE[-1], seeds, crossover="exp")
    yield Row(
        "Griewank 10-D, exponential crossover",
        f"{mean:.0f} +- {error:.0f}, {successes}/{seeds}",
        f"{EXPONENTIAL_GRIEWANK:.0f} (SciPy)",
        "12%",
        within(mean, EXPONENTIAL_GRIEWANK, 0.12),
    )


SCIPY_SEEDS = (300, 300, 200, 200, 60)
"""Runs of SciPy for each row."""


class _HitError(Exception):
    """The target is reached; ends a search of SciPy."""


def scipy_hit(row: StornPrice, seed: int, strategy: str = "rand1bin") -> int | None:
    """Return the evaluations of SciPy's search up to 1e-6; None without a hit."""
    size, F, CR = row.settings
    rng = np.random.default_rng([seed, 77])
    lower, upper = row.box.lower, row.box.upper
    first = lower + (upper - lower) * rng.random((size, lower.size))
    count = 0

    def cost(x: Array) -> float:
        nonlocal count
        count += 1
        values = values_of(row.objective(x[:, None]), 1)
        value, violation = (float(np.asarray(one)[0]) for one in values)
        if violation > 0.0:
            return 1e30 + violation
        if value <= 1e-6:
            raise _HitError
        return value

    try:
        differential_evolution(
            cost,
            list(zip(1e3 * lower, 1e3 * upper, strict=True)),
            strategy=strategy,
            maxiter=(100_000 if size > 10 else 10_000) // size - 1,
            tol=0.0,
            atol=-1.0,
            mutation=F,
            recombination=CR,
            rng=rng,
            polish=False,
            init=first,
            updating="deferred",
        )
    except _HitError:
        return count
    return None


def main() -> None:
    """Print the means of SciPy's runs, with standard errors and successes."""
    runs = [*zip(STORN_PRICE, SCIPY_SEEDS, strict=True)]
    cases = [(row, "rand1bin", seeds) for row, seeds in runs]
    for row, strategy, seeds in [*cases, (STORN_PRICE[-1], "rand1exp", 40)]:
        every = [scipy_hit(row, seed, strategy) for seed in range(seeds)]
        hits = [hit for hit in every if hit is not None]
        error = np.std(hits) / np.sqrt(len(hits))
        print(f"{row.name} {strategy}: {np.mean(hits):.0f} +- {error:.0f}, "
              f"{len(hits)}/{seeds}")  # fmt: skip


if __name__ == "__main__":
    main()
