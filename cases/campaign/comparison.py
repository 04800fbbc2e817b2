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
from typing import Any

import numpy as np

from swarmstart.cases.campaign.cells import Cell, Outcome
from swarmstart.cases.campaign.solvers import Solver
from swarmstart.cases.campaign.statistics import (
    LEVEL,
    fewest_pairs,
    holm,
    signed_rank_p,
    too_few,
    wilson_interval,
)
from swarmstart.cases.format.scenario import Resolved

NEAR = 0.01
SAME = 1e-6
"""Costs within this relative difference count as equal."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Entry:
    """A solver on a scenario.

    Attributes:
        scenario: The scenario's name.
        solver: The solver.
        cells: One a seed; one where the solver is deterministic.
    """

    scenario: str
    solver: Solver
    cells: tuple[Cell, ...]


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
    """

    entry: Entry
    outcomes: tuple[Outcome, ...]
    feasible: int
    successes: int
    success_interval: tuple[float, float] | None
    costs: tuple[float, ...]
    evaluations: float | None
    against_first: str

    def __repr__(self) -> str:
        """Return problem, solver and what it has shown in one line."""
        cost = f"{statistics.median(self.costs):.6g}" if self.costs else "-"
        said = f"; {self.against_first}" if self.against_first else ""
        return (
            f"{self.entry.scenario}, {self.entry.solver.name}: {self.feasible} of "
            f"{len(self.outcomes)} feasible, {self.successes} near the best, "
            f"median cost {cost}{said}"
        )


def entry_of(
    resolved: Resolved,
    solver: Solver,
    *,
    seeds: int,
    budget: Mapping[str, Any],
    timeout_s: float,
    repair: bool,
) -> Entry:
    """Return the cells of a solver on a scenario.

    Args:
        resolved: The scenario with the solver's search.
        solver: The solver.
        seeds: Their number, from 0 on.
        budget: Of one planning problem.
        timeout_s: After which a cell is given up [s].
        repair: Whether answers that break constraints between the checks are solved
            again with a margin.
    """
    settings, code = resolved.anonymous_settings(), resolved.code
    permissions = {}
    if code is not None and resolved.allow_python:
        permissions["python_in"] = str(code.parent.resolve())
    cells = [
        Cell(
            work="swarmstart.cases.campaign.solvers:solve_cell",
            job={
                "settings": settings,
                "variant": resolved.variant,
                "solver": solver.name,
                "budget": dict(budget),
                "seed": seed,
                "repair": repair,
            },
            label=f"{resolved.scenario.name}, {solver.name}, seed {seed}",
            timeout_s=timeout_s,
            permissions=permissions,
        )
        for seed in range(1 if solver.is_deterministic else seeds)
    ]
    return Entry(scenario=resolved.scenario.name, solver=solver, cells=tuple(cells))


def rows_of(
    entries: Sequence[Entry], outcomes: Mapping[str, Outcome], *, seeds: int
) -> list[Row]:
    """Return what the solvers of one scenario have shown, in their order.

    Args:
        entries: Of one scenario; the first is what the others are compared with.
        outcomes: By the cells' keys.
        seeds: Number of seeds: a deterministic answer counts for each.
    """
    found = [[outcomes[cell.key] for cell in entry.cells] for entry in entries]
    costs = [[_cost(outcome) for outcome in each] for each in found]
    least = min((c for each in costs for c in each), default=np.inf)
    words = _against_first([_for_seeds(each, seeds) for each in costs])
    rows = []
    for entry, each, own, said in zip(entries, found, costs, words, strict=True):
        near = sum(cost <= least + NEAR * abs(least) for cost in own if cost < np.inf)
        counted = [o.result["evaluations"] for o in each if o.result]
        alone = entry.solver.is_deterministic
        rows.append(
            Row(
                entry=entry,
                outcomes=tuple(each),
                feasible=sum(cost < np.inf for cost in own),
                successes=near,
                success_interval=None if alone else wilson_interval(near, len(own)),
                costs=tuple(sorted(cost for cost in own if cost < np.inf)),
                evaluations=statistics.median(counted) if counted else None,
                against_first=said,
            )
        )
    return rows


def _cost(outcome: Outcome) -> float:
    """Return the verified cost; infinity where the answer is not feasible."""
    result = outcome.result
    if result is None or not result["feasible"]:
        return float("inf")
    return float(result["verified_cost"])


def _for_seeds(costs: Sequence[float], seeds: int) -> list[float]:
    return list(costs) * seeds if len(costs) == 1 else list(costs)


def _against_first(costs: Sequence[Sequence[float]]) -> list[str]:
    """Return in words how each compares with the first, seed by seed."""
    first, *others = costs
    finite = [c for each in costs for c in each if c < np.inf]
    worst = 2 * max(map(abs, finite), default=1.0) + 1.0
    fewest = fewest_pairs(len(others))
    if len(first) < fewest:
        few = f"not compared: {too_few(len(first), 'seed', fewest)}"
        return ["", *[few for _ in others]]
    pairs = [
        [
            0.0 if _is_same(a, b) else min(b, worst) - min(a, worst)
            for a, b in zip(first, each, strict=True)
        ]
        for each in others
    ]
    adjusted = holm([signed_rank_p(each) for each in pairs])
    return ["", *[_words(each, p) for each, p in zip(pairs, adjusted, strict=True)]]


def _is_same(a: float, b: float) -> bool:
    return a == b or (max(a, b) < np.inf and abs(a - b) <= SAME * max(abs(a), abs(b)))


def _words(differences: Sequence[float], p: float) -> str:
    cheaper, dearer = (sum(sign * d > 0 for d in differences) for sign in (-1, 1))
    counted = f"cheaper in {cheaper}, dearer in {dearer} of {len(differences)} seeds"
    if p > LEVEL:
        return f"no difference shown ({counted}, p = {p:.2g})"
    median = statistics.median([d for d in differences if d])
    word = "cheaper" if median < 0 else "dearer"
    return f"{word} ({counted}, p = {p:.2g})"
