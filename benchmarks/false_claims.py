"""Frequencies of false and of true claims of differences by comparisons.

    python benchmarks/false_claims.py [--repetitions 1000]

Solvers are simulated: two (or six) that draw their costs from one distribution, and one
whose costs are 0.8 times the other's. Each comparison passes through all steps: cells,
tests, words and headline. A claim is what the words say. The gate against an older
comparison is tested likewise.
"""

from __future__ import annotations

import argparse
import re
import time as clock
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.judging.content import content_of
from swarmstart.cases.campaign.judging.regression import regression
from swarmstart.cases.campaign.judging.runs import About, Asked, Entry
from swarmstart.cases.campaign.trials.solvers import solver_of

SPREAD = 0.2
EVALUATIONS = {"evaluations": 4000}
CLAIMS = (r"^(cheaper|costlier|faster|slower)\b", r": in (more|fewer) seeds")
GAINED = r"^on .* (comes .* in more seeds than|finds (cheaper|better) answers than)"
LOST = r"which does so in more than"
Costs = Mapping[str, Mapping[str, Sequence[float] | Array]]
"""Scenario -> solver -> cost of each seed; infinite if infeasible."""


def made_up(
    costs: Costs,
    *,
    seconds: Mapping[str, Array] | None = None,
    more: Callable[[float], Mapping[str, Any]] = lambda _: {},
    about: Mapping[str, About] | None = None,
    **asked: Any,
) -> dict[str, Any]:
    """Return the content of a comparison with these costs.

    Args:
        costs: Of each scenario and solver; names are those of solvers there are. NaN:
            the run failed.
        seconds: Of each solver, the same on every scenario.
        more: Cost -> further parts of a result.
        about: Of the scenarios.
        asked: Fields of `Asked`.
    """
    lengths = (len(own) for one in costs.values() for own in one.values())
    count = max(lengths, default=0)
    fields = {"seeds": tuple(range(count)), "budget": EVALUATIONS, **asked}
    question = Asked(**fields)
    entries, outcomes = [], {}
    for scenario, solvers in costs.items():
        each = []
        for name, own in solvers.items():
            cells = []
            for k, cost in enumerate(own):
                job = {"scenario": scenario, "solver": name, "seed": question.seeds[k]}
                cell = Cell(work="none", job=job, label=name)
                clock = 1.0 if seconds is None else float(seconds[name][k])
                outcomes[cell.key] = _outcome(float(cost), clock, more)
                cells.append(cell)
            each.append(
                Entry(scenario=scenario, solver=solver_of(name), cells=tuple(cells))
            )
        entries.append(each)
    return content_of(entries, outcomes, question, about or {})


def _outcome(
    cost: float, seconds: float, more: Callable[[float], Mapping[str, Any]]
) -> Outcome:
    if np.isnan(cost):
        return Outcome(result=None, failure="it died", seconds=0.0, folder=Path())
    good = bool(np.isfinite(cost))
    result = {
        "of": "plan",
        "feasible": good,
        "verified_cost": cost if good else 1e9,
        "claimed_cost": cost if good else 1e9,
        "claimed_feasible": good,
        "evaluations": 4000,
        "seconds": seconds,
        **more(cost),
    }
    return Outcome(result=result, failure="", seconds=seconds, folder=Path())


def claims_of(content: Mapping[str, Any]) -> list[str]:
    """Return everything that a comparison of stochastic solvers claims in words."""
    said = []
    for scenario in content["scenarios"]:
        for pair in scenario["pairs"]:
            findings = (pair, pair["success"], pair["seconds"])
            said += [one["words"] for one in findings if one is not None]
        said += [row["against_first"]["words"] for row in scenario["rows"]]
    found = [words for words in said if any(re.search(c, words) for c in CLAIMS)]
    return found + [
        one for one in clauses(content) if re.search(f"{GAINED}|{LOST}", one)
    ]


def clauses(content: Mapping[str, Any]) -> list[str]:
    """Return the parts of a headline, in small letters."""
    return str(content["headline"]).lower().split("; ")


def lognormal(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return costs with a spread of 20 percent."""
    costs: Array = 10 * np.exp(SPREAD * rng.standard_normal(shape))
    return costs


def with_basins(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return costs of three optima, nothing between."""
    costs: Array = rng.choice([10.0, 12.0, 20.0], size=shape, p=[0.4, 0.4, 0.2])
    return costs


def often_infeasible(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return costs of which three in ten are infinite."""
    costs: Array = np.where(rng.random(shape) < 0.3, np.inf, lognormal(rng, shape))
    return costs


def heavy_tailed(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return costs without a variance, some a thousand times the others."""
    costs: Array = 10 + np.abs(rng.standard_cauchy(shape))
    return costs


def at_the_optimum(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return costs of the optimum to round-off, one in five stuck or not feasible."""
    costs = 10 * (1 + 1e-9 * rng.random(shape))
    stuck = rng.choice([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, np.inf], shape)
    answers: Array = costs * stuck
    return answers


DRAWS = (lognormal, with_basins, often_infeasible, heavy_tailed, at_the_optimum)
Draw = Callable[[np.random.Generator, tuple[int, ...]], Array]
TWO, SIX = ("de", "ga"), ("de", "ga", "pso", "cpso", "lshade", "repeated-ipopt")


def false_claims(  # noqa: PLR0913 - each is varied
    draw: Draw,
    *,
    seeds: int,
    repetitions: int,
    rng: np.random.Generator,
    solvers: Sequence[str] = TWO,
    scenarios: int = 1,
    timed: bool = False,
) -> float:
    """Return the share of comparisons of equal solvers that claim any difference."""
    count = 0
    for _ in range(repetitions):
        costs = {
            f"s{k}": dict(zip(solvers, draw(rng, (len(solvers), seeds)), strict=True))
            for k in range(scenarios)
        }
        clocks = lognormal(rng, (len(solvers), seeds))
        content = made_up(
            costs,
            seconds=dict(zip(solvers, clocks, strict=True)) if timed else None,
            budget={"seconds": 60.0} if timed else EVALUATIONS,
            resamples=0,
        )
        count += bool(claims_of(content))
    return count / repetitions


def found_differences(
    ratio: float, *, seeds: int, repetitions: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Return how often a solver with `ratio` times the costs is called cheaper.

    Returns:
        Shares of the comparisons whose rows, and whose headline, say so.
    """
    rows = headlines = 0
    for _ in range(repetitions):
        one, other = lognormal(rng, (2, seeds))
        content = made_up({"s": {"de": one, "ga": ratio * other}}, resamples=0)
        words = content["scenarios"][0]["rows"][1]["against_first"]["words"]
        rows += words.startswith("cheaper")
        headlines += any(re.search(GAINED, one) for one in clauses(content))
    return rows / repetitions, headlines / repetitions


def gate(
    draw: Draw, ratio: float, *, seeds: int, repetitions: int, rng: np.random.Generator
) -> dict[str, float]:
    """Return how often a gate says "worse" of a solver with `ratio` times the costs.

    Returns:
        Quantity -> share of its rows; and "any": share of gates with any such row.
    """
    counts: dict[str, int] = {"any": 0}
    for _ in range(repetitions):
        old, new = draw(rng, (2, seeds))
        clocks = lognormal(rng, (2, seeds))
        before, now = (
            made_up(
                {"s": {"de": costs}},
                seconds={"de": clock},
                budget={"seconds": 60.0},
                resamples=0,
            )
            for costs, clock in ((old, clocks[0]), (ratio * new, clocks[1]))
        )
        for content in (before, now):
            content["machines"] = [{"processor": "one", "cores": 2, "system": "s"}]
        said = regression(before, now)
        counts["any"] += said["is_regression"]
        for row in said["rows"]:
            quantity = row["quantity"]
            counts[quantity] = counts.get(quantity, 0) + (row["verdict"] == "worse")
    return {name: count / repetitions for name, count in counts.items()}


def large_comparison_seconds(rng: np.random.Generator) -> float:
    """Return the CPU time of content: 12 solvers, 30 scenarios and 30 seeds [s]."""
    names = [*SIX, *(f"{name}+ipopt" for name in SIX[:5]), "ipopt"]
    marks = np.unique(np.rint(np.geomspace(1, 4000, 37))).tolist()

    def more(cost: float) -> Mapping[str, Any]:
        history = {
            "evaluations": marks,
            "seconds": [mark / 4000 for mark in marks],
            "cost": [cost + 1000 / mark for mark in marks],
            "violation": [0.0] * len(marks),
        }
        return {"history": history}

    costs = {
        f"s{k}": {name: lognormal(rng, (30,)) for name in names[:-1]}
        | {"ipopt": [10.0]}
        for k in range(30)
    }
    bare, full = -clock.process_time(), 0.0
    made_up(costs, resamples=0)  # Without curves: mostly the cells themselves.
    bare += clock.process_time()
    full = -clock.process_time()
    made_up(costs, more=more)
    full += clock.process_time()
    print(f"CPU of 12 x 30 x 30: {full:.2f} s, without curves {bare:.2f} s")
    return full


def main(arguments: Sequence[str] | None = None) -> None:
    """Print all shares."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repetitions", type=int, default=1000)
    repetitions = parser.parse_args(arguments).repetitions
    rng = np.random.default_rng(20)
    large_comparison_seconds(rng)
    print("comparisons of equal solvers that claim any difference")
    for draw in DRAWS:
        for seeds in (6, 10, 30):
            share = false_claims(draw, seeds=seeds, repetitions=repetitions, rng=rng)
            print(f"  two, {seeds:2} seeds, {draw.__name__:17} {share:.3f}")
    few = max(1, repetitions // 4)
    for draw in DRAWS:
        share = false_claims(
            draw, seeds=30, repetitions=few, rng=rng, solvers=SIX, scenarios=3
        )
        # Each scenario may claim in 5 percent.
        print(f"  six on three scenarios, {draw.__name__:17} {share:.3f}")
        share = false_claims(draw, seeds=30, repetitions=few, rng=rng, timed=True)
        print(f"  two with seconds,       {draw.__name__:17} {share:.3f}")
    shares = found_differences(0.8, seeds=30, repetitions=repetitions, rng=rng)
    print(
        "0.8 times the costs, found in rows and headlines: {:.3f} {:.3f}".format(
            *shares
        )
    )
    for seeds in (10, 30):
        for draw in DRAWS:
            found = gate(draw, 1.0, seeds=seeds, repetitions=few, rng=rng)
            print(f"gate, the same solver, {seeds} seeds, {draw.__name__:17} {found}")
    found = gate(lognormal, 1.3, seeds=30, repetitions=repetitions, rng=rng)
    print(f"gate, 1.3 times the costs, 30 seeds {found}")


if __name__ == "__main__":
    main()
