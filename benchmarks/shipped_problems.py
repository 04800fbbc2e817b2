"""The shipped problems against the values that their own claims state.

    python benchmarks/shipped_problems.py [--seeds 10] [--jobs 2] [--write FILE]

Claims 1a and 1b of each are the value on its grid, within 1e-4 on both sides; 2b is the
value without a grid, or on a fine one, and 2a how far from it the grid may lie.
"""

import argparse
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from swarmstart.benchmarks.flights import Job, flown, fly_all
from swarmstart.benchmarks.tables import row
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.problem.scenario import ProblemScenario

PROBLEMS = (
    "pendulum",
    "double_integrator",
    "two_reaction_reactor",
    "van_der_pol",
    "catalyst_mixing",
    "bryson_denham",
    "hypersensitive",
    "pendulum_on_cart",
)
HEAD = (
    "problem",
    "intervals",
    "value",
    "largest difference",
    "seeds",
    "value without a grid",
    "source",
    "gap",
    "may be",
    "gap, intervals doubled",
)
TEXT = """# The shipped problems

Made by `python benchmarks/shipped_problems.py --write docs/shipped_problems.md`; each
run is `swarmstart run PROBLEM --seed N`. A seed counts if the answer is confirmed and
claims 1a and 1b hold: the value on the grid, within 1e-4 on both sides. The gap is that
to the value without a grid, relative to it; claim 2a states how large it may be.

- Pendulum: no value is published. It is compared with its own on 400 intervals.
- Pendulum on a cart: the value on 20 intervals is that of CasADi's Opti with the same
  grid. acados, whose first example it is, publishes no value of a finer one; it is
  compared with its own on 400 intervals.
- Catalyst mixing: the share of the closed form is 1, then 0.2271, then 0, with the best
  of both switches and of the share, by matrix exponentials. The 0.0480559 of COPS 3 is
  4.5e-6 above it (claim 3).
- Hypersensitive problem: along an optimum `x'^2 = x^2 + x^6 + c`; with the c for which
  both branches take 10 s, the cost is an integral over x. On a horizon without end c is
  0 and the cost 1.3308069, 7e-5 more.
"""


class Stated(NamedTuple):
    """What a problem's claims state.

    Attributes:
        intervals: Of its grid.
        value: On that grid.
        free: Without a grid, or on a fine one.
        source: Of the latter.
        gap: How far the two may be apart, relative to `free`.
    """

    intervals: int
    value: float
    free: float
    source: str
    gap: float


def stated(name: str) -> Stated:
    """Return what the claims of a shipped problem state."""
    scenario = resolve(read_document(name)).scenario
    if not isinstance(scenario, ProblemScenario):
        raise TypeError(f"expected a scenario of kind: problem, found {name}")
    claims = {claim.id: claim for claim in scenario.claims}
    bounds = {number: float(claim.bound or 0.0) for number, claim in claims.items()}
    return Stated(
        intervals=scenario.prediction.intervals,
        value=(bounds["1a"] + bounds["1b"]) / 2,
        free=bounds["2b"],
        source=claims["2b"].source,
        gap=abs(bounds["2a"] / bounds["2b"] - 1),
    )


def job(name: str, *, finer: bool = False, seed: int = 0) -> Job:
    """Return the run of a shipped problem, on a grid twice as fine or its own."""
    sets = (f"prediction.intervals={2 * stated(name).intervals}",) if finer else ()
    return Job(name, sets, seed=seed)


class Solved(NamedTuple):
    """What one run has found.

    Attributes:
        cost: Its cost.
        reached: Whether the answer is confirmed, and claims 1a and 1b hold.
    """

    cost: float
    reached: bool


def solved(one: Job) -> Solved:
    """Return what one run finds."""
    run = flown(one)
    gates = [claim["holds"] for claim in run.claims if claim["gate"]]
    cost = run.measures["cost"]
    if not isinstance(cost, float):
        raise TypeError(f"expected a cost, found {cost!r} in {one}")
    return Solved(cost, run.measures["confirmed"] == 1 and gates == [True, True])


def table(found: Mapping[Job, Solved], seeds: int) -> list[str]:
    """Return the table in Markdown.

    Args:
        found: Of every problem, on both grids, all seeds.
        seeds: Their number.
    """
    lines = [row(*HEAD), row(*["---"] * len(HEAD))]
    for name in PROBLEMS:
        on = stated(name)
        own, finer = (
            [found[job(name, finer=fine, seed=seed)] for seed in range(seeds)]
            for fine in (False, True)
        )
        lines.append(
            row(
                f"`{name}`",
                str(on.intervals),
                f"{on.value:.7g}",
                f"{max(abs(one.cost / on.value - 1) for one in own):.1e}",
                f"{sum(one.reached for one in own)} of {seeds}",
                f"{on.free:.9g}",
                on.source,
                f"{gap(own, on):.1e}",
                f"{on.gap:.0e}",
                f"{gap(finer, on):.1e}",
            )
        )
    return lines


def gap(found: Sequence[Solved], on: Stated) -> float:
    """Return the median gap to the value without a grid, relative to that."""
    return statistics.median(abs(one.cost / on.free - 1) for one in found)


def main() -> None:
    """Solve all, and print or write the page."""
    options = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    options.add_argument("--seeds", type=int, default=10)
    options.add_argument("--jobs", type=int, default=2)
    options.add_argument("--write", type=Path)
    given = options.parse_args()
    jobs = [
        job(name, finer=finer, seed=seed)
        for name in PROBLEMS
        for finer in (False, True)
        for seed in range(given.seeds)
    ]
    lines = table(fly_all(solved, jobs, given.jobs), given.seeds)
    page = "\n".join((TEXT, *lines)) + "\n"
    if given.write is None:
        print(page)
    else:
        given.write.write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
