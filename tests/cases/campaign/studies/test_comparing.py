"""Cells of comparisons: plans or runs, their solvers and their order."""

from collections.abc import Sequence

import pytest

from swarmstart.cases.campaign.studies.comparing import (
    Contest,
    contest_of,
    interleaved,
    with_distinct_names,
)
from swarmstart.cases.campaign.studies.comparison_plan import Chosen, ComparisonPlan, Of
from swarmstart.cases.campaign.trials.solver_names import solvers_of
from swarmstart.cases.format.kind import SeveralPlansError
from swarmstart.cases.format.scenario import read_document

SOLVERS = "de,multistart-ipopt,ipopt,scipy-de"
GUSTY = "plant={gusts: {sigma_ft_s: 3, length_ft: 600, seed: 7}}"


def contest(name: str, *assignments: str, of: Of = "auto", seeds: int = 3) -> Contest:
    plan = ComparisonPlan(scenarios=(), solvers=(), seeds=seeds)
    chosen = Chosen(source=name, of=of, assignments=assignments)
    budget = {"evaluations": 600}
    document, solvers = read_document(name), solvers_of(SOLVERS)
    return contest_of(chosen, document, solvers, plan, budget, lambda given: given)


def names(found: Contest) -> Sequence[str]:
    return [entry.solver.name for entry in found.entries]


def test_what_plans_once_is_compared_by_its_plan_and_what_flies_by_flights() -> None:
    pendulum, flight = contest("pendulum"), contest("formation_v", "steps=2")
    assert (pendulum.of, flight.of) == ("plan", "flight")
    assert names(pendulum) == SOLVERS.split(",")
    # The search of another package cannot plan in closed loop.
    assert names(flight) == ["de", "multistart-ipopt", "ipopt"]
    assert flight.left_out == ("scipy-de",)
    assert contest("stirred_tank").of == "flight"
    assert contest("stirred_tank", of="plan").of == "plan"
    with pytest.raises(SeveralPlansError):
        contest("formation_v", of="plan")


def test_random_starts_fly_without_lanes_and_ipopt_without_a_search() -> None:
    found = contest("stirred_tank")
    de, many, cold = (entry.cells[0].job["settings"] for entry in found.entries)
    assert many["search"]["name"] == "multistart" and not many["search"]["lanes"]
    assert (cold["search"]["name"], cold["polish"]) == ("none", "ipopt")
    assert (de["search"]["name"], de["polish"]) == ("de", "none")
    assert {one["lanes"] for one in (de, many, cold)} == {0}


def test_a_solver_without_chance_runs_once_unless_gusts_are_drawn() -> None:
    calm = contest("stirred_tank")
    gusty = contest("close_formation", "steps=2", GUSTY)
    assert [len(entry.cells) for entry in calm.entries] == [3, 3, 1]
    assert [len(entry.cells) for entry in gusty.entries] == [3, 3, 3]
    assert gusty.is_seeded and not calm.is_seeded
    assert not contest("close_formation", GUSTY, of="plan").is_seeded


def test_solvers_of_a_scenario_take_turns_seed_by_seed() -> None:
    one, two = contest("pendulum"), contest("van_der_pol", seeds=2)
    labels = [cell.label for cell in interleaved([one, two])]
    assert labels[:5] == [
        *("pendulum, de, seed 0", "pendulum, multistart-ipopt, seed 0"),
        *("pendulum, ipopt, seed 0", "pendulum, scipy-de, seed 0"),
        "pendulum, de, seed 1",
    ]
    assert len(labels) == len(set(labels)) == 3 * 3 + 1 + 3 * 2 + 1
    assert all(label.startswith("van_der_pol") for label in labels[10:])


def test_two_scenarios_of_one_name_are_told_apart() -> None:
    first, second = with_distinct_names([contest("pendulum"), contest("pendulum")])
    assert (first.name, second.name) == ("pendulum", "pendulum (2)")
    assert {entry.scenario for entry in second.entries} == {"pendulum (2)"}
