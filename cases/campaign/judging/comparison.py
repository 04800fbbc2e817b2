"""Comparison of solvers on planning problems: cells and results.

A success is a feasible answer, confirmed on the finer grid, whose cost is within NEAR
of the least that any solver of the comparison has found. Each solver is compared with
the first, seed by seed, by a signed-rank test; p values are adjusted for their number
(Holm). An infeasible answer counts as costlier than any feasible one.
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
        outcomes: Outcomes of its cells.
        feasible: Number of feasible answers.
        successes: Number of answers near the best known cost.
        success_interval: 95 percent interval of the rate; None for a deterministic
            solver.
        costs: Verified costs of the feasible answers, sorted.
        evaluations: Median of the evaluations; None if no cell ended without failure.
        against_first: Comparison with the first solver, in words.
        false_successes: Number of answers that the solver calls feasible although they
            are not, or whose cost differs from the solver's.
        expected_evaluations: Expected evaluations to come near the best known cost,
            with those of failed runs; None if no run does, or it is not known.
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

    @property
    def scenario(self) -> str:
        """Name of the scenario."""
        return self.entry.scenario

    @property
    def solver(self) -> str:
        """Name of the solver."""
        return self.entry.solver.name

    def __repr__(self) -> str:
        """Return problem, solver and results in one line."""
        cost = f"{statistics.median(self.costs):.6g}" if self.costs else "-"
        said = f"; {self.against_first}" if self.against_first else ""
        return (
            f"{self.scenario}, {self.solver}: {self.feasible} of "
            f"{len(self.outcomes)} feasible, {self.successes} near the best, "
            f"median cost {cost}{said}"
        )


def rows_of(
    entries: Sequence[Entry], outcomes: Mapping[str, Outcome], *, seeds: int
) -> list[Row]:
    """Return the results of the solvers of one scenario, in their order.

    Args:
        entries: Solvers on one scenario; the others are compared with the first.
        outcomes: Outcomes by the cells' keys.
        seeds: Number of seeds; a deterministic answer counts for each.
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
