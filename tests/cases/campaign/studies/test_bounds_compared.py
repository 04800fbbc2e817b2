"""Bounds of a comparison: cells of their own, after the solvers', for plans only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from swarmstart.cases.campaign.engine.cells import Cell, Outcome
from swarmstart.cases.campaign.studies.comparing import Contest, bounds_of, contest_of
from swarmstart.cases.campaign.studies.comparison_plan import Chosen, ComparisonPlan, Of
from swarmstart.cases.campaign.trials.bounds import bound_cell
from swarmstart.cases.campaign.trials.solver_names import solvers_of
from swarmstart.cases.format.scenario import read_document
from swarmstart.ocp.lower_bound.stated.answer import LowerBound
from swarmstart.tests.ocp.bounds import NONE, PROVEN, SAMPLED, Found

NAN = float("nan")


def contest(name: str = "double_integrator", of: Of = "auto") -> Contest:
    plan = ComparisonPlan(scenarios=(), solvers=(), seeds=2)
    return contest_of(
        Chosen(source=name, of=of),
        read_document(name),
        solvers_of("lshade,ipopt"),
        plan,
        {"evaluations": 600},
        lambda given: given,
    )


def outcome(result: dict[str, Any] | None, failure: str = "") -> Outcome:
    return Outcome(result=result, failure=failure, seconds=1.0, folder=Path("cells/k"))


def solved(given: Contest, costs: Sequence[float | None], sense: int = 1) -> Any:
    """Return outcomes of the solvers' cells; None means infeasible."""
    cells = [cell for entry in given.entries for cell in entry.cells]
    assert len(cells) == len(costs)
    return {
        cell.key: outcome(
            {
                "feasible": cost is not None,
                "verified_cost": cost or -9.0,
                "sense": sense,
            }
        )
        for cell, cost in zip(cells, costs, strict=True)
    }


def sought(
    given: Sequence[Contest], outcomes: Any, *results: Outcome
) -> tuple[list[Cell], dict[str, Any]]:
    """Return the cells to be done, with their knowledge of the best cost."""
    asked: list[Cell] = []

    def done(cells: Sequence[Cell]) -> Sequence[Outcome]:
        asked.extend(cells)
        return results

    return asked, bounds_of(given, outcomes, 60.0, done)


def test_the_best_confirmed_cost_is_what_a_bound_begins_with() -> None:
    """An infeasible answer does not count, at any cost."""
    one = contest()
    outcomes = solved(one, [13.0, None, 12.5])
    ((cell,), _) = sought([one], outcomes, outcome(None, "it died"))
    assert cell.job["known"] == 12.5 and cell.job["seconds"] == 60.0
    maximised = solved(one, [-13.0, None, -12.5], sense=-1)
    ((cell,), _) = sought([one], maximised, outcome(None, "it died"))
    assert cell.job["known"] == 13.0
    nothing = solved(one, [None] * 3)
    ((cell,), _) = sought([one], nothing, outcome(None, "it died"))
    assert cell.job["known"] is None


def test_its_cell_is_no_solver_s_and_what_changes_it_is_the_best_cost() -> None:
    one = contest()
    solvers = {cell.key for entry in one.entries for cell in entry.cells}
    keys = []
    for best in (12.5, 12.5, 12.4):
        ((cell,), _) = sought(
            [one], solved(one, [13.0, None, best]), outcome(None, "-")
        )
        keys.append(cell.key)
    assert keys[0] == keys[1] != keys[2] and not solvers & {*keys}


@pytest.mark.parametrize("sense", [1, -1])
def test_values_are_minimised_like_all_costs(sense: int) -> None:
    one = contest()
    result = {
        "value": 11.5,
        "kind": "proven",
        "reason": "",
        "sense": sense,
        "degree": 5,
    }
    _, found = sought([one], solved(one, [13.0, 12.0, 12.5]), outcome(result))
    about = found["double_integrator"]
    assert (about["value"], about["kind"]) == (sense * 11.5, "proven")
    assert about["degree"] == 5 and about["cell"] == "k"


@pytest.mark.parametrize(
    ("found", "reason"),
    [
        (outcome(None, "it took more than 240 s"), "it took more than 240 s"),
        (
            outcome({"value": None, "kind": "none", "reason": "5 states", "sense": 1}),
            "5 states",
        ),
        (
            outcome({"value": NAN, "kind": "none", "reason": "5 states", "sense": 1}),
            "5 states",
        ),
    ],
)
def test_where_there_is_none_the_reason_is_kept(found: Outcome, reason: str) -> None:
    one = contest()
    _, bounds = sought([one], solved(one, [13.0, 12.0, 12.5]), found)
    about = bounds["double_integrator"]
    assert (about["value"], about["kind"], about["reason"]) == (None, "none", reason)


def test_whole_flights_have_none() -> None:
    flight, plan = contest("formation_v", of="flight"), contest()
    outcomes = solved(plan, [13.0, 12.0, 12.5])
    cells, bounds = sought([flight, plan], outcomes, outcome(None, "-"))
    assert [cell.label for cell in cells] == ["double_integrator, lower bound"]
    assert [*bounds] == ["double_integrator"]


def test_nothing_is_sought_unless_it_is_asked_for() -> None:
    assert bounds_of([contest()], {}, None, lambda _: 1 / 0) == {}  # type: ignore[arg-type,return-value]


@pytest.mark.parametrize("bound", [PROVEN, SAMPLED, NONE])
def test_a_cell_asks_with_the_scenario_s_own_problem(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, bound: LowerBound
) -> None:
    found = Found(replace(bound, sense=-1.0)).instead(monkeypatch)
    one = contest()
    ((cell,), _) = sought([one], solved(one, [13.0, 12.0, 12.5]), outcome(None, "-"))
    told = bound_cell(cell.job, tmp_path)
    (call,) = found.calls
    assert (call["answer"], call["work"]) == (12.0, 60.0)
    assert call["problem"].model.state_names == ("position", "speed")
    assert (told["kind"], told["sense"]) == (bound.kind.value, -1)
    assert told["set"] == bound.set_name and told["certificate"] is None
