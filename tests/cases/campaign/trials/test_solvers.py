"""Solvers by name, budgets in words, and one planning problem under each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from swarmstart.cases.campaign.trials.solvers import (
    SEARCHED,
    InvalidBudgetTextError,
    UnknownSolverError,
    budget_of,
    solve_cell,
    solver_of,
)
from swarmstart.cases.format.scenario import read_document, resolve


@pytest.mark.parametrize(
    ("text", "budget"),
    [
        ("4000evals", {"evaluations": 4000}),
        ("5000", {"evaluations": 5000}),
        ("5000|5s", {"evaluations": 5000, "seconds": 5}),
        ("5s", {"seconds": 5.0}),
        ("2m", {"seconds": 120.0}),
        ("1h", {"seconds": 3600.0}),
        ("4e3evals | 0.5s", {"evaluations": 4000, "seconds": 0.5}),
    ],
)
def test_a_budget_is_read(text: str, budget: dict[str, float]) -> None:
    assert budget_of(text) == budget


@pytest.mark.parametrize(
    "text",
    [
        "",
        "evals",
        "-5s",
        "0s",
        "1.5evals",
        "5s|6s",
        "1..2s",
        "5 d",
        "1e400s",
        "1e30evals",
    ],
)
def test_what_is_no_budget_is_refused(text: str) -> None:
    with pytest.raises(InvalidBudgetTextError, match="such as 4000evals, 5s or"):
        budget_of(text)


@pytest.mark.parametrize("name", [*SEARCHED, "ipopt", "repeated-ipopt", "de+ipopt"])
def test_solvers_have_names(name: str) -> None:
    assert solver_of(name).name == name
    assert solver_of(name).is_deterministic == (name == "ipopt")


@pytest.mark.parametrize("name", ["", "none", "lshade+", "lshade+snopt", "ipopt+de"])
def test_an_unknown_solver_is_refused(name: str) -> None:
    with pytest.raises(UnknownSolverError, match=f"found '{name}'".replace("+", r"\+")):
        solver_of(name)


def solved(
    name: str, solver: str, seed: int = 0, *, repair: bool = False, **budget: float
) -> dict[str, Any]:
    how = solver_of(solver)
    resolved = resolve(
        read_document(name),
        search=how.search,
        polish="ipopt" if how.polished else "none",
    )
    job = {
        "settings": dict(resolved.settings),
        "variant": resolved.variant,
        "solver": solver,
        "budget": budget or {"evaluations": 4000},
        "seed": seed,
        "repair": repair,
    }
    return solve_cell(job, Path())


def test_ipopt_from_zero_controls_passes_on_the_dear_side() -> None:
    """Below the disc, J = 1810.2; above it 446.7."""
    found = solved("passing_side", "ipopt")
    assert found["verified_cost"] == pytest.approx(1810.2, abs=0.1)


@pytest.mark.parametrize("solver", ["lshade+ipopt", "repeated-ipopt"])
def test_searching_for_the_side_finds_the_cheap_one(solver: str) -> None:
    found = solved("passing_side", solver)
    assert found["verified_cost"] == pytest.approx(446.7, abs=0.1)
    assert found["claimed_cost"] == pytest.approx(found["verified_cost"], rel=1e-3)
    # The disc is cut between the checks; what keeps clear of it costs a little more.
    assert not found["feasible"]
    assert found["status"].startswith("not confirmed: a constraint is broken between")
    clear = solved("passing_side", solver, repair=True)
    assert clear["feasible"]
    assert 446.7 < clear["verified_cost"] < 1.05 * 446.7
    assert (
        clear["evaluations"] == found["evaluations"]
    )  # Those of the repair are apart.
    assert clear["evaluations_repair"] > 0 and clear["repaired"]


@pytest.mark.parametrize("solver", ["cpso", "de", "ga"])
def test_evaluations_are_within_the_budget(solver: str) -> None:
    assert (
        800 <= solved("passing_side", solver, evaluations=1000)["evaluations"] <= 1000
    )


def test_many_starts_stop_after_the_one_that_spends_the_budget() -> None:
    spent = solved("passing_side", "repeated-ipopt", evaluations=300)["evaluations"]
    assert 300 <= spent <= 320  # An iteration counts as 13.


def test_seconds_are_a_budget_too() -> None:
    found = solved("passing_side", "lshade+ipopt", repair=True, seconds=0.2)
    assert found["feasible"] and found["evaluations"] > 0


def test_the_same_seed_gives_the_same_bits() -> None:
    first, again = (solved("passing_side", "de", evaluations=400) for _ in range(2))
    other = solved("passing_side", "de", 1, evaluations=400)
    assert first["plan"] == again["plan"] and first["plan"] != other["plan"]


def test_paths_are_searched_where_a_problem_has_a_family() -> None:
    found = solved("swap_5", "lshade+ipopt", repair=True, evaluations=2400)
    assert found["feasible"]
    assert found["verified_cost"] <= 0.395
