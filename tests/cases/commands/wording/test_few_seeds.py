"""The number of seeds that a comparison needs, told before it begins."""

from __future__ import annotations

from swarmstart.cases.campaign.judging.judgement import fewest_seeds
from swarmstart.cases.campaign.studies.comparing import Contest, contest_of
from swarmstart.cases.campaign.studies.comparison_plan import Chosen, ComparisonPlan
from swarmstart.cases.campaign.trials.solver_names import solvers_of
from swarmstart.cases.commands.actions.compare import too_few_seeds
from swarmstart.cases.format.scenario import read_document


def contest(solvers: str, seeds: int) -> Contest:
    plan = ComparisonPlan(scenarios=(), solvers=(), seeds=seeds)
    chosen = Chosen(source="passing_side", of="auto", assignments=())
    document, named = read_document("passing_side"), solvers_of(solvers)
    budget = {"evaluations": 600}
    return contest_of(chosen, document, named, plan, budget, lambda given: given)


def test_too_few_seeds_are_told_with_the_number_that_is_needed() -> None:
    named = "lshade,cpso,repeated-ipopt"  # Three pairs are compared.
    needed = fewest_seeds(3)
    assert too_few_seeds([contest(named, 5)], 5) == (
        f"5 seeds: with fewer than {needed} seeds no difference between solvers can be "
        "told from chance, so their costs are shown, but not compared; --seeds "
        f"{needed} compares them"
    )
    assert too_few_seeds([contest(named, needed)], needed) == ""
    assert too_few_seeds([contest("lshade", 1)], 1) == ""
    assert too_few_seeds([], 1) == ""
