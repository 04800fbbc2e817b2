"""The shipped double pendulum against the bar of its claims, over seeds.

python benchmarks/double_pendulum.py [--seeds 10] [--write FILE]
"""

import statistics
from collections.abc import Sequence
from typing import NamedTuple

from swarmstart.benchmarks.tables import (
    Bar,
    bar_table,
    head,
    page_options,
    publish,
    row,
)
from swarmstart.cases.campaign.studies.library import run

START, PEER = 105.126, 101.379
"""Costs of claims 1 and 2: Opti's from do-mpc's start, and do-mpc's."""
ROUNDED = 1 + 1e-4
TEXT = """# The double pendulum

Made by `python benchmarks/double_pendulum.py --write docs/measured/double_pendulum.md`;
each run is `swarmstart run double_pendulum --seed N`. The [bars](../glossary.md#bar)
were written into the problem's file, as claims, before they were measured. The problem
is hard: near the upright position the rods amplify an error a billion times, there are
many local optima, and the least one is unknown.

"""


class Solved(NamedTuple):
    """A run: its cost, and whether the finer grid confirms it."""

    cost: float
    confirmed: bool


def solved(seed: int) -> Solved:
    """Return the result of a run."""
    found = run("double_pendulum", seed=seed)
    return Solved(float(found.measures["cost"]), found.measures["confirmed"] == 1)  # type: ignore[arg-type]


def page(runs: Sequence[Solved]) -> list[str]:
    """Return the bars and the runs in Markdown."""
    costs = [one.cost for one in runs]
    confirmed = sum(one.confirmed for one in runs)
    bars = [
        Bar("confirmed on the finer grid", ">=", len(runs), confirmed),
        Bar("worst cost", "<=", START * ROUNDED, max(costs)),
        Bar("median cost", "<=", PEER * ROUNDED, statistics.median(costs)),
    ]
    rows = [
        row(str(seed), f"{one.cost:.6f}", "yes" if one.confirmed else "**no**")
        for seed, one in enumerate(runs)
    ]
    return [*bar_table(bars), *head("seed", "cost", "confirmed"), *rows]


def main() -> None:
    """Solve with each seed, and print or write the page."""
    parser = page_options(__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    publish(page([solved(seed) for seed in range(options.seeds)]), options, TEXT)


if __name__ == "__main__":
    main()
