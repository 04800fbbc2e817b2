"""The shipped problems against the values that their own claims state.

    python benchmarks/shipped_problems.py [--seeds 10] [--write FILE]

Claims 1a and 1b of each are the value on its grid, within 1e-4 on both sides; 2b is the
value without a grid, or on a fine one, and 2a how far from it the grid may lie. A
problem to which its grid belongs has neither 2a nor 2b.

Each has two values on its grid: with its constraints kept at its checks, which `repair:
false` finds, and along the whole path, which the defaults find. kept_values.py makes
both, with more checks and margins of its own.
"""

import statistics
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from swarmstart.benchmarks.kept_values import PROBLEMS, Kept, read
from swarmstart.benchmarks.tables import (
    Bar,
    bar_table,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.cases.campaign.studies.library import run
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.problem.stated.scenario import ProblemScenario

WHOLE = "lotka_volterra_whole"
"""Problem with an integer control: no optimum is known, and its bar was written down
before it was measured."""
MOST, MEDIAN, RELAXED = 1.3508, 1.3501, 1.34466
"""Its bar: worst and best cost of a genetic algorithm; optimum of the relaxation."""
WITHIN = 1e-4
"""Relative tolerance of a value."""
TEXT = """# The shipped problems

Made by `python benchmarks/shipped_problems.py --write
docs/measured/shipped_problems.md`; each run is `swarmstart run PROBLEM --seed N`. A
seed counts if the answer is confirmed and claims 1a and 1b hold: the value on the grid,
within 1e-4 on both sides. The gap is relative to the value without a grid; claim 2a
states its limit.

- Pendulum: no value is published. It is compared with our own value on 400 intervals.
- Pendulum on a cart: the value on 20 intervals is that of CasADi's Opti with the same
  grid. acados, whose first example it is, publishes no value of a finer grid; it is
  compared with our own value on 400 intervals.
- Catalyst mixing: in the closed form the share of the first catalyst is 1, then 0.2271,
  then 0; the times of both switches and the middle share are the best ones, computed by
  matrix exponentials. The 0.0480559 of COPS 3 is 4.5e-6 above this value (claim 3).
- Hypersensitive problem: along an optimum `x'^2 = x^2 + x^6 + c`; c is the one for
  which the ways of x from 1.5 down to its least value and up to 1 take 10 s together;
  the cost is then an integral over x. On a horizon without end, c is 0 and the cost is
  1.3308069, 7e-5 more.
- Brachistochrone, race car and Goddard rocket have a free end time; the values on their
  grids, and that of `lotka_volterra_fishing`, are those of CasADi's Opti with the same
  grid. COPS 3 rounds the rocket's 1.0128369 to 1.01284 (claim 3).
- Shuttle re-entry: the value on 60 intervals is that of CasADi's Opti, same grid.
- Race car and four discs: the values are along the whole path. At one check in each
  interval CasADi's Opti finds 1.904634 and 10.818588 with the same grids (claim 3).
  Between the checks the Opti's car is too fast by 2.6e-4, and its vehicle cuts discs by
  up to 3 mm. The values on 400 intervals are along the path, too; those of the four
  discs keep the constraints at eight checks in each interval.
- Bifunctional catalyst: ten constant blends belong to the problem. The yield of the
  best known blends is computed by matrix exponentials, and equals the published 10.0942
  (claim 2).
- Batch reactor: the first plan of do-mpc's example, without the penalty of changes of
  the control; the cost is a sum over the steps of time, so the grid belongs to the
  problem.
- Lynx and hares: an estimate, with a free initial state, four free parameters and their
  priors, and the weather of each year. SciPy's least squares with DOP853 leave
  14.1312985 (claim 2); the rates are within a standard deviation of those that
  Carpenter (2018) found without weather (claims 3 and 4).
- Two-stage launch: the tangent of the best pitch is linear in time, through both
  stages. Its two coefficients and the duration of the second stage are found as roots
  of the end conditions, integrated by DOP853.
- Supersonic climb: the tables and the air are those of PSOPT, whose result file gives
  318.8067 with splines of its own (claim 3). The values here are own measurements.

"""
TWO_VALUES = """
## At the checks, and along the path

Constraints are imposed at [checks](../glossary.md#check), and a path may break them in
between; the table has the excess as a fraction of the constraint's scale. By default an
answer that breaks a constraint is solved again with a margin, and, if the margin costs
something, with more checks instead ([repair](../glossary.md#repair)). The values at the
checks and along the path are computed by `python benchmarks/kept_values.py --write
docs/measured/kept_values.json`, on the same grid of controls. That program has margins
and checks of its own, independent of `repair`. A seed counts if its cost is within
1e-4. If the excess is below `path_tolerance`, nothing is repaired, and the runs are the
same. The gap with doubled intervals is that of one seed.

The supersonic climb misses its value along the path. A constraint counts as kept up to
1e-4 of its scale. For the height of the climb this allows 6.9 ft below the ground, and
the fastest answer uses 4.2 ft of it at its start.

"""
WHOLE_TEXT = """
## Whole numbers

`lotka_volterra_whole` is `lotka_volterra_fishing` on 60 intervals, with the whole fleet
either out or in harbour. The best plan is unknown. The [bars](../glossary.md#bar) were
written before they were measured: the worst and the best answer of a genetic algorithm
(1.3508 and 1.3501), and the cost 1.34466 of fishing with any part of the fleet.

"""


class Stated(NamedTuple):
    """Statements of a problem's claims.

    Attributes:
        intervals: Number of intervals of its grid.
        value: Value on that grid.
        free: Value without a grid, or on a fine one; None if the grid belongs to the
            problem.
        source: Source of `free`, or else of `value`.
        gap: Largest difference of the two, relative to `free`.
    """

    intervals: int
    value: float
    free: float | None
    source: str
    gap: float = 0.0


def scenario_of(name: str) -> ProblemScenario:
    """Return a shipped scenario.

    Raises:
        TypeError: If it is of another kind.
    """
    scenario = resolve(read_document(name)).scenario
    if not isinstance(scenario, ProblemScenario):
        raise TypeError(f"expected a scenario of kind: problem, found {name}")
    return scenario


def stated(name: str) -> Stated:
    """Return what the claims of a shipped problem state."""
    scenario = scenario_of(name)
    claims = {claim.id: claim for claim in scenario.claims}
    bounds = {number: float(claim.bound or 0.0) for number, claim in claims.items()}
    intervals = sum(intervals_of(scenario))
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


def intervals_of(scenario: ProblemScenario) -> list[int]:
    """Return the number of intervals of each phase; of one, if there are none."""
    if scenario.phases:
        return [phase.intervals for phase in scenario.phases]
    return [scenario.prediction.intervals]


def doubled(name: str) -> Mapping[str, Any]:
    """Return settings with which a shipped problem has twice as many intervals."""
    scenario = scenario_of(name)
    if not scenario.phases:
        return {"prediction.intervals": 2 * scenario.prediction.intervals}
    phases = [
        {**phase.model_dump(mode="json", exclude_unset=True), "intervals": 2 * many}
        for phase, many in zip(scenario.phases, intervals_of(scenario), strict=True)
    ]
    return {"phases": phases}


class Solved(NamedTuple):
    """Results of the runs of a problem, one a seed.

    Attributes:
        costs: Their costs.
        reached: Whether each answer is confirmed, and claims 1a and 1b hold.
    """

    costs: Sequence[float]
    reached: Sequence[bool]


def solved(
    name: str, seeds: int, *, finer: bool = False, repair: bool = True
) -> Solved:
    """Return what a shipped problem's runs find.

    Args:
        name: Of the problem.
        seeds: Their number.
        finer: Whether its grid has twice as many intervals.
        repair: As `feedback.repair`.
    """
    settings = dict(doubled(name)) if finer else {}
    if not repair:
        settings["feedback.repair"] = False
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


def far(found: Solved, value: float) -> list[float]:
    """Return how far costs are from a value, relative to it."""
    return [abs(cost / value - 1) for cost in found.costs]


def two_values(
    kept: Mapping[str, Kept],
    own: Mapping[str, Solved],
    unrepaired: Mapping[str, Solved],
) -> list[str]:
    """Return the table of both values of each problem.

    Args:
        kept: The values, by the name of a problem.
        own: Its runs with the defaults.
        unrepaired: Its runs with `repair: false`.
    """
    lines = head(
        "problem",
        "at the checks",
        "`repair: false`: largest difference",
        "seeds",
        "broken between them",
        "along the path",
        "defaults: largest difference",
        "seeds",
    )
    for name, value in kept.items():
        at_checks = far(unrepaired[name], value.at_checks)
        along = far(own[name], value.along_path)
        lines.append(
            row(
                f"`{name}`",
                f"{value.at_checks:.7g}",
                f"{max(at_checks):.1e}",
                within(at_checks),
                f"{value.broken:.1e}" if value.broken else "-",
                f"{value.along_path:.7g}",
                f"{max(along):.1e}",
                within(along),
            )
        )
    return lines


def path_tolerance(name: str) -> float:
    """Return up to which excess a shipped problem's answers are not repaired."""
    return float(scenario_of(name).prediction.path_tolerance)


def within(differences: Sequence[float]) -> str:
    """Return how many differences are small enough, in words."""
    return f"{sum(d <= WITHIN for d in differences)} of {len(differences)}"


def whole_bars(found: Solved) -> list[Bar]:
    """Return the bar of fishing with the whole fleet, and what was measured."""
    return [
        Bar("largest cost", "<=", MOST, max(found.costs)),
        Bar("median cost", "<=", MEDIAN, statistics.median(found.costs)),
        Bar(
            "least cost, of that with any part of the fleet",
            ">=",
            1 - WITHIN,
            min(found.costs) / RELAXED,
        ),
    ]


def main() -> None:
    """Solve all, and print or write the page."""
    parser = page_options(__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    kept = read()
    own, unrepaired, finer = {}, {}, {}
    for name in PROBLEMS:
        own[name] = unrepaired[name] = solved(name, options.seeds)
        if kept[name].broken > path_tolerance(name):
            unrepaired[name] = solved(name, options.seeds, repair=False)
        if stated(name).free is not None:
            finer[name] = solved(name, 1, finer=True)
        print(name, own[name], unrepaired[name], file=sys.stderr, flush=True)
    bars = whole_bars(solved(WHOLE, options.seeds))
    lines = [
        *table(own, finer),
        *TWO_VALUES.splitlines(),
        *two_values(kept, own, unrepaired),
        *WHOLE_TEXT.splitlines(),
        *bar_table(bars),
    ]
    publish(lines[:-1], options, TEXT)


if __name__ == "__main__":
    main()
