"""The shipped problems against the values that their own claims state.

    python benchmarks/shipped_problems.py [--seeds 10] [--write FILE]

Claims 1a and 1b of each are the value on its grid, within 1e-4 on both sides; 2b is the
value without a grid, or on a fine one, and 2a how far from it the grid may lie.
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

"""


class Stated(NamedTuple):
    """Statements of a problem's claims.

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
    """Return the median gap to the value without a grid, relative to that."""
    return statistics.median(abs(cost / on.free - 1) for cost in found.costs)


def table(own: Mapping[str, Solved], finer: Mapping[str, Solved]) -> list[str]:
    """Return the table in Markdown.

    Args:
        own: Name of a problem -> its runs on its own grid.
        finer: The same on the finer one.
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
        lines.append(
            row(
                f"`{name}`",
                str(on.intervals),
                f"{on.value:.7g}",
                f"{max(abs(cost / on.value - 1) for cost in found.costs):.1e}",
                f"{sum(found.reached)} of {len(found.reached)}",
                f"{on.free:.9g}",
                on.source,
                f"{gap(found, on):.1e}",
                f"{on.gap:.0e}",
                f"{gap(finer[name], on):.1e}",
            )
        )
    return lines


def main() -> None:
    """Solve all, and print or write the page."""
    parser = page_options(__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    own, finer = (
        {name: solved(name, options.seeds, finer=fine) for name in PROBLEMS}
        for fine in (False, True)
    )
    publish(table(own, finer), options, TEXT)


if __name__ == "__main__":
    main()
