"""Results of compared solvers, against values by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.judging.content import content_of
from swarmstart.cases.campaign.judging.runs import Asked, Entry
from swarmstart.cases.campaign.studies.library import Row, rows_of
from swarmstart.cases.campaign.trials.solvers import solver_of

FAR = None
"""An answer that is not feasible."""


def rows(**costs: Sequence[float | None]) -> dict[str, Row]:
    """Return the rows of solvers with these verified costs, one for each seed."""
    entries, outcomes = entries_of(costs)
    seeds = max(map(len, costs.values()))
    found = rows_of(entries, outcomes, seeds=seeds)
    return {row.entry.solver.name: row for row in found}


def entries_of(
    costs: Mapping[str, Sequence[float | None]], dates: Sequence[str] = ()
) -> tuple[list[Entry], dict[str, Outcome]]:
    """Return solvers and their runs; a run begins at the date of its seed."""
    entries, outcomes = [], {}
    for name, own in costs.items():
        cells = []
        for seed, cost in enumerate(own):
            cell = Cell(work="none", job={"solver": name, "seed": seed}, label=name)
            result: dict[str, Any] = {
                "feasible": cost is not FAR,
                "verified_cost": 1e9 if cost is FAR else cost,
                "evaluations": 100 + seed,
            }
            outcomes[cell.key] = Outcome(
                result=result, failure="", seconds=1.0, folder=Path(),
                date=dates[seed] if dates else "",
            )  # fmt: skip
            cells.append(cell)
        solver = solver_of(name)
        entries.append(Entry(scenario="s", solver=solver, cells=tuple(cells)))
    return entries, outcomes


@pytest.mark.parametrize(("dates", "begun"), [
    (["2026-01-03", "2026-01-02", ""], "2026-01-02"), ([], ""),
])  # fmt: skip
def test_a_comparison_has_begun_with_its_first_run(
    dates: list[str], begun: str
) -> None:
    entries, outcomes = entries_of({"de": [1.0, 2.0, 3.0]}, dates)
    asked = Asked(seeds=(0, 1, 2), resamples=0)
    assert content_of([entries], outcomes, asked)["date"] == begun


def test_success_is_near_the_least_cost_that_anybody_has_found() -> None:
    found = rows(de=[10.0, 10.1, 10.11, 20.0, FAR], ga=[10.05, 11.0, 12.0, FAR, FAR])
    assert (found["de"].feasible, found["de"].successes) == (4, 2)
    assert (found["ga"].feasible, found["ga"].successes) == (3, 1)
    assert found["de"].costs == (10.0, 10.1, 10.11, 20.0)
    assert found["de"].evaluations == 102


def test_each_is_compared_with_the_first_seed_by_seed() -> None:
    cheap = [10.0 + 0.01 * seed for seed in range(8)]
    dear = [20.0 + 0.3 * seed for seed in range(8)]
    found = rows(de=cheap, ga=dear, pso=cheap)
    assert found["de"].against_first == ""
    # 2^(1 - 8) = 0.0078, times two tests that can show anything (its costs and its
    # successes), with four fifths of the chance of a false claim.
    assert found["ga"].against_first == (
        "costlier (cheaper in 0, costlier in 8 of 8 seeds, p = 0.02)"
    )
    assert found["pso"].against_first.startswith("no difference shown (cheaper in 0, ")


def test_an_answer_that_is_not_feasible_is_costlier_than_any_that_is() -> None:
    found = rows(de=[10.0] * 8, ga=[FAR] * 8, pso=[FAR, *[10.0] * 7])
    assert found["ga"].against_first.startswith(
        "costlier (cheaper in 0, costlier in 8 of"
    )
    assert "costlier in 1 of 8" in found["pso"].against_first
    both = rows(de=[FAR] * 8, ga=[FAR] * 8)
    assert "cheaper in 0, costlier in 0" in both["ga"].against_first


def test_a_deterministic_answer_counts_for_every_seed() -> None:
    found = rows(de=[10.0 + 0.1 * seed for seed in range(7)], ipopt=[30.0])
    assert found["ipopt"].success_interval is None
    assert found["ipopt"].against_first.startswith(
        "costlier (cheaper in 0, costlier in 7"
    )


def test_the_word_is_that_of_those_that_differ() -> None:
    """Eight ties and six cheaper: the median difference is 0."""
    base = [10.0 + seed for seed in range(14)]
    other = [cost - (0.1 * seed if seed < 7 else 0) for seed, cost in enumerate(base)]
    said = rows(de=base, ga=other)["ga"].against_first
    assert said.startswith("cheaper (cheaper in 6, costlier in 0 of 14 seeds")


def test_few_seeds_are_not_compared() -> None:
    found = rows(de=[10.0, 11.0], ga=[12.0, 13.0])
    assert found["ga"].against_first == "not compared: 2 seeds, 7 are needed"


def test_the_interval_is_wilsons() -> None:
    found = rows(de=[10.0] * 9 + [20.0])
    interval = found["de"].success_interval
    assert interval == pytest.approx((0.596, 0.982), abs=1e-3)
