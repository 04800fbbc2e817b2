"""The argument `search` has the same meaning in `solve` and in a planner."""

from dataclasses import replace

import numpy as np
import pytest

from swarmstart.heuristics import (
    LSHADE,
    Budget,
    InvalidSettingsError,
    Order,
    feasibility_first,
)
from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    OptimalControlProblem,
    Planner,
    SearchSettings,
    solve,
)
from swarmstart.ocp.search.settings import (
    EVALUATIONS,
    SearchGiven,
    search_settings,
)

FORMS: list[SearchGiven] = ["lshade", LSHADE, LSHADE()]


@pytest.mark.parametrize("given", FORMS)
def test_a_name_a_class_and_an_algorithm_are_the_same_search(
    given: SearchGiven,
) -> None:
    found = search_settings(given)
    assert found is not None and found.algorithm == LSHADE()
    assert found.budget == Budget(evaluations=EVALUATIONS) and found.order is None


def test_settings_stay_as_they_are() -> None:
    settings = SearchSettings(algorithm=LSHADE(), budget=Budget(seconds=1.0))
    assert search_settings(settings) is settings


@pytest.mark.parametrize("given", [None, "none"])
def test_none_is_no_search(given: SearchGiven, lq: OptimalControlProblem) -> None:
    assert search_settings(given) is None
    assert Planner(lq, search=given).search is None


def test_a_planner_and_solve_take_every_form_and_find_the_same(
    lq: OptimalControlProblem,
) -> None:
    lq = replace(lq, bounds=Bounds(controls=(-2, 2)))
    budget = Budget(evaluations=300)
    settings = SearchSettings(algorithm=LSHADE(), budget=budget)
    planner = Planner(lq, search=settings)
    plan = planner.plan([1, 0], rng=np.random.default_rng(0))
    solved = [
        solve(lq, [1, 0], search=settings, polish=None, seed=0),
        *(
            solve(lq, [1, 0], search=form, budget=300, polish=None, seed=0)
            for form in FORMS
        ),
    ]
    for solution in solved:
        np.testing.assert_array_equal(solution.controls, plan.controls)
    named = Planner(lq, search="lshade").search
    assert named is not None and named.algorithm == LSHADE()


@pytest.mark.parametrize(
    ("budget", "order"),
    [(100, None), (None, feasibility_first())],
)
def test_settings_with_a_budget_or_an_order_beside_them_are_refused(
    budget: int | None, order: Order | None
) -> None:
    settings = SearchSettings(algorithm=LSHADE(), budget=Budget(evaluations=100))
    with pytest.raises(InvalidProblemError, match="must stand in the SearchSettings"):
        search_settings(settings, budget, order)


def test_an_unknown_name_is_refused_by_a_planner(lq: OptimalControlProblem) -> None:
    with pytest.raises(InvalidSettingsError, match="'annealing'"):
        Planner(lq, search="annealing")
