"""Solvers side by side on planning problems: cells, and what they show.

A success is a feasible answer, confirmed on the finer grid, whose cost is within NEAR
of the least that any solver of the comparison has found. Each solver is compared with
the first, seed by seed, by a signed-rank test; p values are adjusted for their number
(Holm). An answer that is not feasible counts as dearer than any that is.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from swarmstart.cases.campaign.engine.cells import Outcome
from swarmstart.cases.campaign.judging.entry import Entry, entry_of
from swarmstart.cases.campaign.judging.runs import NEAR, About, Asked, runs_of
from swarmstart.cases.campaign.judging.scenario_content import (
    judged_scenario,
    scenario_content,
)

__all__ = ["NEAR", "Entry", "Row", "entry_of", "rows_of"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Row:
    """Results of a solver on a scenario.

    Attributes:
        entry: The solver and the scenario.
        outcomes: Of its cells.
        feasible: How many answers are feasible.
        successes: How many come near the best known cost.
        success_interval: 95 percent interval of the rate; None where deterministic.
        costs: Verified costs of the feasible answers, sorted.
        evaluations: Median of the evaluations; None where no cell has ended well.
        against_first: In words, how it compares with the first solver.
        false_successes: How many answers the solver calls feasible that are not, or
            that cost other than it says.
        expected_evaluations: To come near the best known cost, what failed runs have
            spent counted; None if no run does, or it is not known.
    """

    entry: Entry
    outcomes: tuple[Outcome, ...]
    feasible: int
    successes: int
    success_interval: tuple[float, float] | None
    costs: tuple[float, ...]
    evaluations: float | None
    against_first: str
    false_successes: int = 0
    expected_evaluations: float | None = None

    def __repr__(self) -> str:
        """Return problem, solver and what it has shown in one line."""
        cost = f"{statistics.median(self.costs):.6g}" if self.costs else "-"
        said = f"; {self.against_first}" if self.against_first else ""
        return (
            f"{self.entry.scenario}, {self.entry.solver.name}: {self.feasible} of "
            f"{len(self.outcomes)} feasible, {self.successes} near the best, "
            f"median cost {cost}{said}"
        )


def rows_of(
    entries: Sequence[Entry], outcomes: Mapping[str, Outcome], *, seeds: int
) -> list[Row]:
    """Return what the solvers of one scenario have shown, in their order.

    Args:
        entries: Of one scenario; the first is what the others are compared with.
        outcomes: By the cells' keys.
        seeds: Number of seeds: a deterministic answer counts for each.
    """
    asked = Asked(seeds=tuple(range(seeds)), resamples=0)
    found = judged_scenario([runs_of(e, outcomes, asked) for e in entries], asked)
    rng = np.random.default_rng(asked.bootstrap_seed)
    content = scenario_content("", found, asked, About(), rng=rng)
    rows = []
    for entry, runs, row in zip(entries, found.runs, content["rows"], strict=True):
        interval = row["near_intervals"]
        rows.append(
            Row(
                entry=entry,
                outcomes=runs.outcomes,
                feasible=row["feasible"],
                successes=row["near"][0],
                success_interval=None if interval is None else tuple(interval[0]),
                costs=tuple(sorted(cost for cost in row["costs"] if cost is not None)),
                evaluations=row["evaluations_median"],
                against_first=row["against_first"]["words"],
                false_successes=row["false_successes"],
                expected_evaluations=row["ert_evaluations"][0],
            )
        )
    return rows
