"""The searches against published results and against other implementations.

    python benchmarks/published_results.py [--short] [--write FILE] [--only WORD]

Prints one line for each number: measured, published, tolerance, verdict. `--short` runs
fewer seeds; its tolerances are the same, so that a miss there may be chance.

What is counted. Storn and Price: evaluations up to and including the individual that
hits. Everywhere else whole generations, as the anchors, which come from runs that
looked once a generation. ERT: evaluations of all runs divided by the number that
succeeded.
"""

import argparse
import importlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmstart.heuristics import (
    LSHADE,
    Algorithm,
    Box,
    Budget,
    DifferentialEvolution,
    GenerationEvent,
    Objective,
    SearchResult,
    SelfAdaptiveDE,
    StopReason,
    minimize,
)

Array = NDArray[np.float64]


class Row(NamedTuple):
    """A published number and what was measured.

    Attributes:
        table: Where it is from.
        name: Which number.
        measured: What was measured.
        published: What was published.
        tolerance: What difference is allowed, and where that comes from.
        holds: Whether it is within.
    """

    table: str
    name: str
    measured: str
    published: str
    tolerance: str
    holds: bool


def within(value: float, published: float, tolerance: float) -> bool:
    """Whether a number is within a relative tolerance."""
    return bool(abs(value - published) <= tolerance * published)


def cube(dim: int, half_width: float) -> Box:
    """The box [-half_width, half_width]^dim."""
    return Box(lower=np.full(dim, -half_width), upper=np.full(dim, half_width))


def no_violation(points: Array) -> Array:
    """Zeros, one for each point."""
    return np.zeros(points.shape[1])


def search_until(
    objective: Objective,
    box: Box,
    algorithm: Algorithm,
    *,
    target: float,
    evaluations: int,
    seed: int | Sequence[int],
) -> SearchResult:
    """Search until a feasible point has the target, or the budget is used up."""
    return minimize(
        objective,
        box,
        algorithm=algorithm,
        budget=Budget(evaluations=evaluations, target=target),
        rng=np.random.default_rng(seed),
    )


def expected_running_time(results: Sequence[SearchResult]) -> tuple[int, float]:
    """Number of runs that reached the target, and the ERT."""
    successes = sum(r.stopped is StopReason.TARGET for r in results)
    total = sum(r.evaluations for r in results)
    return successes, total / successes if successes else np.inf


# Storn and Price (1997): evaluations to 1e-6 without bounds after the first population.


class StornPrice(NamedTuple):
    """A row of the paper's table.

    Attributes:
        name: The function.
        objective: The function.
        box: Where the first population is drawn.
        settings: NP, F, CR.
        published: Evaluations on the mean.
        seeds: Runs.
        tolerance: Relative.
        successes: Least part of the runs that must succeed.
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
    """The third function of De Jong; infeasible outside, where it would fall on."""
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
    """Evaluations up to the first individual with 1e-6; None if there was none."""
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
            size=size, F=F, CR=CR, bounds="none", **settings
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
            "Storn & Price 1997",
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
        "Storn & Price 1997",
        "Griewank 10-D, exponential crossover",
        f"{mean:.0f} +- {error:.0f}, {successes}/{seeds}",
        f"{EXPONENTIAL_GRIEWANK:.0f} (another implementation)",
        "12%",
        within(mean, EXPONENTIAL_GRIEWANK, 0.12),
    )


# CEC 2006: feasibility first, DE/rand/1/bin NP 50 F 0.5 CR 0.9, 30,000 evaluations.


class Constrained(NamedTuple):
    """A problem of CEC 2006.

    Attributes:
        number: g01 is 1.
        optimum: The best known cost.
        median: Evaluations to a gap of 1e-4, median of 15 runs of another
            implementation; 20 % are allowed.
        successes: Least part of the runs that must succeed. g06: 17 of 30, the 0.1 %
            point of a binomial distribution with 0.8.
    """

    number: int
    optimum: float
    median: float
    successes: float = 1.0


CONSTRAINED = (
    Constrained(1, -15.0, 23100),
    Constrained(4, -30665.53867178333, 14950),
    Constrained(6, -6961.8138755802, 7425, 17 / 30),
    Constrained(8, -0.0958250414180359, 1200),
    Constrained(9, 680.6300573744021, 15600),
    Constrained(12, -1.0, 3150),
    Constrained(24, -5.508013271595, 2950),
)


def constrained_objective(problem: Any) -> Objective:
    """Cost and summed violation of a problem of pygmo; equalities up to 1e-4."""
    equalities = problem.get_nec()

    def evaluate(points: Array) -> tuple[Array, Array]:
        values = np.array([problem.fitness(point) for point in points.T])
        equal = np.maximum(np.abs(values[:, 1 : 1 + equalities]) - 1e-4, 0.0)
        unequal = np.maximum(values[:, 1 + equalities :], 0.0)
        return values[:, 0], equal.sum(axis=1) + unequal.sum(axis=1)

    return evaluate


def cec2006(*, short: bool) -> Iterator[Row]:
    """Success rates and median evaluations to a gap of 1e-4."""
    pygmo = peer("pygmo")
    runs = 6 if short else 30
    for row in CONSTRAINED:
        problem = pygmo.problem(pygmo.cec2006(prob_id=row.number))
        lower, upper = problem.get_bounds()
        results = [
            search_until(
                constrained_objective(problem),
                Box(lower=lower, upper=upper),
                DifferentialEvolution(size=50, F=0.5, CR=0.9),
                target=row.optimum + 1e-4,
                evaluations=30_000,
                seed=seed,
            )
            for seed in range(runs)
        ]
        hit = [r.evaluations for r in results if r.stopped is StopReason.TARGET]
        median = float(np.median(hit)) if hit else np.inf
        needed = int(np.ceil(row.successes * runs - 1e-9))
        yield Row(
            "CEC 2006",
            f"g{row.number:02d}",
            f"{len(hit)}/{runs}, median {median:.0f}",
            f"median {row.median:.0f} (another implementation)",
            f"at least {needed}/{runs}, 20%",
            len(hit) >= needed and within(median, row.median, 0.2),
        )


# BBOB, 10-D: instances 1-15, two seeds each, 40,000 evaluations.


class Bbob(NamedTuple):
    """An algorithm on a function of BBOB, and what pygmo needs there.

    Attributes:
        name: Which.
        algorithm: Its settings.
        function: Number of the function.
        gap: Cost above the optimum that is the target.
        ert: Published expected running time.
        tolerance: Relative.
        successes: Least part of the runs that must succeed.
    """

    name: str
    algorithm: Algorithm
    function: int
    gap: float
    ert: float
    tolerance: float
    successes: float = 1.0


BBOB = (
    Bbob(
        "DE/rand/1/bin f1 1e-8",
        DifferentialEvolution(size=50, F=0.5, CR=0.9),
        1,
        1e-8,
        10940,
        0.06,
    ),
    Bbob("jDE f1 1e-8", SelfAdaptiveDE(size=50), 1, 1e-8, 9976, 0.08),
    # Rows of particle swarms and of CMA-ES go here.
)


def bbob_problem(function: int, instance: int) -> tuple[Objective, float]:
    """A 10-D function of BBOB and its optimum."""
    ioh = peer("ioh")
    kind = ioh.ProblemClass.BBOB
    problem = ioh.get_problem(function, instance, 10, kind)

    def evaluate(points: Array) -> tuple[Array, Array]:
        return np.array(problem(points.T.tolist())), no_violation(points)

    return evaluate, float(problem.optimum.y)


def bbob_runs(row: Bbob, *, short: bool) -> list[SearchResult]:
    """The runs of a row."""
    results = []
    for instance in range(1, 6 if short else 16):
        objective, optimum = bbob_problem(row.function, instance)
        for seed in range(2):
            results.append(
                search_until(
                    objective,
                    cube(10, 5.0),
                    row.algorithm,
                    target=optimum + row.gap,
                    evaluations=40_000,
                    seed=(instance, seed),
                )
            )
    return results


def bbob(*, short: bool) -> Iterator[Row]:
    """Success rates and expected running times."""
    peer("ioh")
    for row in BBOB:
        results = bbob_runs(row, short=short)
        successes, ert = expected_running_time(results)
        yield Row(
            "BBOB 10-D",
            row.name,
            f"{successes}/{len(results)}, ERT {ert:.0f}",
            f"ERT {row.ert:.0f} (pygmo)",
            f"at least {row.successes:.0%} of the runs, {row.tolerance:.0%}",
            successes >= row.successes * len(results)
            and within(ert, row.ert, row.tolerance),
        )


# L-SHADE on CEC 2014, 10-D, 1e5 evaluations, the settings of its paper.

FALSE_OPTIMUM = 34.78
"""Error of the local optimum of F4 in 10-D that most runs of the paper end in."""


def cec2014(*, short: bool) -> Iterator[Row]:
    """Errors of L-SHADE; F1-F3 and F8 are solved in every run of the paper."""
    pygmo = peer("pygmo")
    runs = 2 if short else 10
    for number in (1, 2, 3, 8, 4):
        problem = pygmo.problem(pygmo.cec2014(prob_id=number, dim=10))

        def evaluate(points: Array, problem: Any = problem) -> tuple[Array, Array]:
            costs = [problem.fitness(point)[0] for point in points.T]
            return np.array(costs), no_violation(points)

        errors = np.array(
            [
                search_until(
                    evaluate,
                    cube(10, 100.0),
                    LSHADE.as_published(10),
                    target=-np.inf,
                    evaluations=100_000,
                    seed=seed,
                ).cost
                - 100.0 * number
                for seed in range(runs)
            ]
        )
        solved = errors < 1e-8
        known = solved | (np.abs(errors - FALSE_OPTIMUM) < 0.1)
        yield Row(
            "L-SHADE, CEC 2014 10-D",
            f"F{number}",
            f"{solved.sum()}/{runs} solved, worst error {errors.max():.3g}",
            "0 or 34.8" if number == 4 else "all solved",
            "error < 1e-8",
            bool(known.all() if number == 4 else solved.all()),
        )


# Equivalence with pygmo at run time: the same algorithm, the same repair.


def pygmo_evaluations(algorithm: Any, instance: int, seed: int) -> int:
    """Evaluations of whole generations of pygmo until f1 is at 1e-8."""
    pygmo = peer("pygmo")
    objective, optimum = bbob_problem(1, instance)

    class Problem:
        def fitness(self, x: Array) -> list[float]:
            return [float(np.asarray(objective(x[:, None])[0])[0])]

        def get_bounds(self) -> tuple[list[float], list[float]]:
            return [-5.0] * 10, [5.0] * 10

    population = pygmo.population(pygmo.problem(Problem()), size=50, seed=seed)
    while population.champion_f[0] > optimum + 1e-8:
        population = algorithm.evolve(population)
    return int(population.problem.get_fevals())


def median_ratio(ours: Array, theirs: Array) -> tuple[float, float, float]:
    """Ratio of the medians with its 90 % bootstrap interval."""
    rng = np.random.default_rng(0)
    shape = (10_000, ours.size)
    one, other = (np.median(rng.choice(v, shape), axis=1) for v in (ours, theirs))
    low, high = np.quantile(one / other, [0.05, 0.95])
    return float(np.median(ours) / np.median(theirs)), float(low), float(high)


def peers(*, short: bool) -> Iterator[Row]:
    """Ratios of the medians of evaluations to f1 1e-8, 30 runs of each."""
    pygmo = peer("pygmo")
    none = {"ftol": 0.0, "xtol": 0.0, "gen": 1}

    def de(seed: int) -> Any:
        return pygmo.de(F=0.5, CR=0.9, variant=7, seed=seed, **none)

    def sade(seed: int) -> Any:
        return pygmo.sade(variant=7, variant_adptv=1, memory=True, seed=seed, **none)

    rows: tuple[tuple[str, Algorithm, Callable[[int], Any]], ...] = (
        ("de", DifferentialEvolution(size=50, bounds="redraw"), de),
        ("sade (jDE, rand/1/bin)", SelfAdaptiveDE(size=50, bounds="redraw"), sade),
        # Rows of particle swarms and of CMA-ES go here.
    )
    for name, algorithm, theirs in rows:
        row = Bbob(name, algorithm, 1, 1e-8, np.nan, np.nan)
        ours = np.array([float(r.evaluations) for r in bbob_runs(row, short=short)])
        peers = [
            pygmo_evaluations(pygmo.algorithm(theirs(seed)), 1 + seed // 2, seed)
            for seed in range(ours.size)
        ]
        ratio, low, high = median_ratio(ours, np.array(peers, dtype=np.float64))
        yield Row(
            "pygmo at run time",
            name,
            f"{ratio:.3f} [{low:.3f}, {high:.3f}], medians {np.median(ours):.0f} "
            f"and {np.median(peers):.0f}",
            "1",
            "90% interval in [0.88, 1.12]",
            low >= 0.88 and high <= 1.12,
        )


class PeerMissingError(ImportError):
    """A package that is compared with is not installed."""


def peer(name: str) -> Any:
    """Import a package that is compared with.

    Raises:
        PeerMissingError: If it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise PeerMissingError(
            f"{name} is not installed, its rows are skipped: pip install {name}"
        ) from error


TABLES: dict[str, Callable[..., Iterator[Row]]] = {
    "storn_price": storn_price,
    "cec2006": cec2006,
    "bbob": bbob,
    "cec2014": cec2014,
    "peers": peers,
    # Tables of particle swarms and of CMA-ES go here.
}


def main() -> int:
    """Run the tables; return 1 where a number is missed."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--short", action="store_true", help="fewer runs")
    parser.add_argument("--write", type=Path, metavar="FILE", help="also into a file")
    parser.add_argument("--only", choices=TABLES, help="one table")
    arguments = parser.parse_args()
    lines = [
        "| table | row | measured | published | tolerance | verdict |",
        "|---|---|---|---|---|---|",
    ]
    print("\n".join(lines), flush=True)
    missed = 0
    for name, table in TABLES.items():
        if arguments.only not in (None, name):
            continue
        begin = time.perf_counter()
        try:
            for row in table(short=arguments.short):
                missed += not row.holds
                verdict = "holds" if row.holds else "MISSED"
                lines.append(f"| {' | '.join(row[:-1])} | {verdict} |")
                print(lines[-1], flush=True)
        except PeerMissingError as error:
            print(error, file=sys.stderr)
        print(f"{name}: {time.perf_counter() - begin:.0f} s", file=sys.stderr)
    if arguments.write:
        arguments.write.write_text("\n".join(lines) + "\n")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
