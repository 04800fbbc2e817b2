"""The shipped problems against the values that their own claims state.

    python benchmarks/shipped_problems.py [--seeds 10] [--write FILE]

Claims 1a and 1b of each are the value on its grid, within 1e-4 on both sides; 2b is the
value without a grid, or on a fine one, and 2a how far from it the grid may lie. A
problem to which its grid belongs has neither 2a nor 2b.
"""

import statistics
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from swarmstart.benchmarks.tables import head, page_options, publish, row
from swarmstart.cases.campaign.library import run
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
    "brachistochrone",
    "race_car",
    "lotka_volterra_fishing",
    "goddard_rocket",
    "shuttle_reentry",
    "four_discs",
    "bifunctional_catalyst",
    "supersonic_climb",
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
- Brachistochrone, race car and Goddard rocket decide their end time; the values on
  their grids, and that of the fishing, are those of CasADi's Opti with the same grid.
  The race car's limit is asked for at the checks only, as on CasADi's page: with more
  of them the lap takes longer, by 2e-5 on 400 intervals. COPS 3 rounds the rocket's
  1.0128369 to 1.01284 (claim 3).
- Shuttle re-entry: the value on 60 intervals is that of CasADi's Opti, same grid.
- Four discs: the values on 40 intervals and on 400, with the discs kept at eight checks
  in each, are those of CasADi's Opti with the same grids. With one check in each
  interval a path cuts the discs by up to 3 mm, and costs 10.818588 (claim 3).
- Bifunctional catalyst: ten constant blends belong to the problem. The yield of the
  best known ones is that of matrix exponentials, and the published 10.0942 (claim 2).
- Supersonic climb: the tables and the air are those of PSOPT, whose result file gives
  318.8067 with splines of its own (claim 3). The values here are own measurements.

"""


class Stated(NamedTuple):
    """Statements of a problem's claims.

    Attributes:
        intervals: Of its grid.
        value: On that grid.
        free: Without a grid, or on a fine one; None if the grid belongs to the problem.
        source: Of `free`, or else of `value`.
        gap: How far the two may be apart, relative to `free`.
    """

    intervals: int
    value: float
    free: float | None
    source: str
    gap: float = 0.0


def stated(name: str) -> Stated:
    """Return what the claims of a shipped problem state."""
    scenario = resolve(read_document(name)).scenario
    if not isinstance(scenario, ProblemScenario):
        raise TypeError(f"expected a scenario of kind: problem, found {name}")
    claims = {claim.id: claim for claim in scenario.claims}
    bounds = {number: float(claim.bound or 0.0) for number, claim in claims.items()}
    intervals = scenario.prediction.intervals
    value = (bounds["1a"] + bounds["1b"]) / 2
    if "2b" not in claims:
        return Stated(intervals, value, None, claims["1a"].source)
    return Stated(
        intervals=intervals,
        value=value,
        free=bounds["2b"],
        source=claims["2b"].source,
        gap=abs(bounds["2a"] / bounds["2b"] - 1),
    )


class Solved(NamedTuple):
    """Results of the runs of a problem, one a seed.

    Attributes:
        costs: Their costs.
        reached: Whether each answer is confirmed, and claims 1a and 1b hold.
    """

    costs: Sequence[float]
    reached: Sequence[bool]


def solved(name: str, seeds: int, *, finer: bool = False) -> Solved:
    """Return what a shipped problem's runs find.

    Args:
        name: Of the problem.
        seeds: Their number.
        finer: Whether its grid has twice as many intervals.
    """
    settings = {"prediction.intervals": stated(name).intervals * (2 if finer else 1)}
    costs, reached = [], []
    for seed in range(seeds):
        one = run(name, seed=seed, settings=settings)
        gates = [claim["holds"] for claim in one.claims if claim["gate"]]
        costs.append(float(one.measures["cost"]))  # type: ignore[arg-type]
        reached.append(one.measures["confirmed"] == 1 and gates == [True, True])
    return Solved(costs, reached)


def gap(found: Solved, on: Stated) -> float:
    """Return the median gap to the value without a grid, relative to that.

    Raises:
        ValueError: If the problem has no such value.
    """
    if on.free is None:
        raise ValueError("expected a value without a grid")
    free = on.free
    return statistics.median(abs(cost / free - 1) for cost in found.costs)


def table(own: Mapping[str, Solved], finer: Mapping[str, Solved]) -> list[str]:
    """Return the table in Markdown.

    Args:
        own: Name of a problem -> its runs on its own grid.
        finer: The same on the finer one, of those with a value without a grid.
    """
    lines = head(
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
    for name, found in own.items():
        on = stated(name)
        gaps = ["-", on.source, "-", "-", "-"]
        if on.free is not None:
            gaps = [
                f"{on.free:.9g}",
                on.source,
                f"{gap(found, on):.1e}",
                f"{on.gap:.0e}",
                f"{gap(finer[name], on):.1e}",
            ]
        lines.append(
            row(
                f"`{name}`",
                str(on.intervals),
                f"{on.value:.7g}",
                f"{max(abs(cost / on.value - 1) for cost in found.costs):.1e}",
                f"{sum(found.reached)} of {len(found.reached)}",
                *gaps,
            )
        )
    return lines


def main() -> None:
    """Solve all, and print or write the page."""
    parser = page_options(__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    own = {name: solved(name, options.seeds) for name in PROBLEMS}
    finer = {
        name: solved(name, options.seeds, finer=True)
        for name in PROBLEMS
        if stated(name).free is not None
    }
    publish(table(own, finer), options, TEXT)


if __name__ == "__main__":
    main()
