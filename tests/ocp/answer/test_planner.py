"""Planning of one problem: guess, search, polish, and the plan's report."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, get_args

import numpy as np
import pytest
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.heuristics import (
    Box,
    Budget,
    ChaoticPSO,
    Initial,
    RandomSearch,
    Sampling,
    SearchResult,
    minimize,
)
from swarmstart.heuristics.laws.initial import sample
from swarmstart.ocp import (
    Fitness,
    InvalidProblemError,
    IpoptOptions,
    Known,
    OptimalControlProblem,
    Planner,
    PolishStatus,
    SearchSettings,
    Source,
)
from swarmstart.ocp.nlp.polish import is_better
from swarmstart.ocp.search.settings import WarmStart
from swarmstart.tests.ocp.two_valleys import two_valleys

Posed = tuple[OptimalControlProblem, Array, Known]


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def one_generation(warm_start: WarmStart, size: int = 5) -> SearchSettings:
    return SearchSettings(
        algorithm=RandomSearch(size=size),
        budget=Budget(evaluations=size),
        warm_start=warm_start,
    )


def test_without_search_and_polish_the_guess_is_the_plan(crossing: Posed) -> None:
    problem, x0, known = crossing
    planner = Planner(problem, search=None)
    plan = planner.plan(x0, known=known, rng=rng())
    np.testing.assert_array_equal(plan.controls, np.zeros((2, 3)))
    assert plan.source is Source.COLD
    assert (plan.evaluations, plan.polish_status) == (0, None)
    assert np.isnan(plan.search.cost)
    guess = rng(1).uniform(-1, 1, (2, 3))
    plan = planner.plan(x0, known=known, guess=guess, rng=rng())
    np.testing.assert_array_equal(plan.controls, guess)
    assert plan.source is Source.GUESS


@pytest.mark.parametrize("seed", range(5))
def test_plan_is_worth_what_the_evaluator_says(crossing: Posed, seed: int) -> None:
    problem, x0, known = crossing
    planner = Planner(problem, search=one_generation("one", size=8))
    plan = planner.plan(x0, known=known, rng=rng(seed))
    fitness = Fitness(problem)
    assert (plan.cost, plan.violation) == fitness.value(plan.controls, x0, known)
    np.testing.assert_array_equal(plan.states, fitness.states(plan.controls, x0, known))
    assert plan.feasible == (plan.violation <= problem.tolerance)
    assert (plan.source, plan.evaluations) == (Source.SEARCH, 8)
    assert (plan.search.cost, plan.search.violation) == (plan.cost, plan.violation)


def test_warm_start_says_how_much_of_the_first_population_is_the_guess(
    crossing: Posed,
) -> None:
    problem, x0, known = crossing
    guess = np.array([[5.0, -5, 5], [1, -1, 1]])
    best = Planner(problem, search=one_generation("one", size=200)).plan(
        x0, known=known, rng=rng(7)
    )

    def planned(warm_start: WarmStart, guess: Array | None) -> Array:
        planner = Planner(problem, search=one_generation(warm_start))
        return planner.plan(x0, known=known, guess=guess, rng=rng()).controls

    np.testing.assert_array_equal(planned("all", guess), guess)
    cold = planned("none", None)
    np.testing.assert_array_equal(planned("none", best.controls), cold)
    np.testing.assert_array_equal(planned("one", best.controls), best.controls)
    assert not np.array_equal(cold, best.controls)


@pytest.mark.parametrize(
    ("warm_start", "copies"), [("all", 5), ("half", 2), ("one", 1), ("none", 0)]
)
def test_the_guess_is_that_often_in_the_first_population(
    warm_start: WarmStart,
    copies: int,
    crossing: Posed,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """5.4.3, Step 3: half of the individuals are the last control actions."""
    problem, x0, known = crossing
    guess = np.zeros((2, 3))
    handed: list[ArrayLike | None] = []

    def noted(*arguments: Any, initial: Initial, **options: Any) -> SearchResult:
        handed.append(initial.points)
        return minimize(*arguments, initial=initial, **options)

    monkeypatch.setattr("swarmstart.ocp.search.lane_search.minimize", noted)
    planner = Planner(problem, search=one_generation(warm_start))
    planner.plan(x0, known=known, guess=guess, rng=rng())
    (points,) = handed
    assert (0 if points is None else np.asarray(points).shape[1]) == copies


def test_sampling_says_how_the_rest_of_the_first_population_is_drawn(
    crossing: Posed,
) -> None:
    problem, x0, known = crossing
    lower, upper = problem.control_limits
    box = Box(lower=np.tile(lower, 3), upper=np.tile(upper, 3), per_step=2)

    def planned(sampling: Sampling | None) -> Array:
        search = replace(one_generation("one", size=1), sampling=sampling)
        plan = Planner(problem, search=search).plan(x0, known=known, rng=rng())
        return plan.controls.ravel(order="F")

    for sampling in get_args(Sampling):
        (expected,) = sample(box, 1, sampling=sampling, rng=rng()).T
        np.testing.assert_array_equal(planned(sampling), expected)
    np.testing.assert_array_equal(planned(None), planned("half_smooth"))
    assert not np.array_equal(planned("uniform"), planned("smooth"))


def test_guess_outside_the_bounds_is_searched_from_the_nearest_inside(
    crossing: Posed,
) -> None:
    problem, x0, known = crossing
    planner = Planner(problem, search=one_generation("all"))
    guess = np.array([[9.0, -9, 0], [0, 0, 0]])
    plan = planner.plan(x0, known=known, guess=guess, rng=rng())
    np.testing.assert_array_equal(plan.controls, [[5, -5, 0], [0, 0, 0]])


def test_candidates_are_looked_at_besides_the_guess(crossing: Posed) -> None:
    """The best of candidates and guess is kept if they fill the whole population."""
    problem, x0, known = crossing
    given = rng(3).uniform(-1, 1, (2, 3, 4))
    planner = Planner(problem, search=one_generation("one"))
    fitness = Fitness(problem)
    values = [fitness.value(given[:, :, k], x0, known) for k in range(4)]
    best = min(range(4), key=lambda k: values[k][0] + 1e4 * values[k][1])
    for guessed in range(4):
        others = np.delete(given, guessed, axis=2)
        plan = planner.plan(
            x0,
            known=known,
            guess=given[:, :, guessed],
            candidates=np.concatenate([others, others[:, :, :1]], axis=2),
            rng=rng(),
        )
        np.testing.assert_array_equal(plan.controls, given[:, :, best])


def test_polish_is_never_worse_than_the_search(passing_side: Posed) -> None:
    problem, x0, known = passing_side
    search = SearchSettings(
        algorithm=ChaoticPSO(size=6), budget=Budget(evaluations=120)
    )
    alone = Planner(problem, search=search)
    both = Planner(problem, search=search, polish=IpoptOptions())
    for seed in range(6):
        searched = alone.plan(x0, known=known, rng=rng(seed))
        plan = both.plan(x0, known=known, rng=rng(seed))
        value = (plan.cost, plan.violation)
        before = (searched.cost, searched.violation)
        assert (plan.search.cost, plan.search.violation) == before
        assert not is_better(before, value, tolerance=problem.tolerance)
        assert plan.evaluations > searched.evaluations == 120
        improved = plan.polish_status is PolishStatus.CONVERGED
        assert plan.source is (Source.POLISH if improved else Source.SEARCH)


def test_same_seed_gives_the_same_bits(crossing: Posed) -> None:
    problem, x0, known = crossing
    search = SearchSettings(algorithm=ChaoticPSO(size=6), budget=Budget(evaluations=60))
    planner = Planner(problem, search=search, polish=IpoptOptions())
    first, _, again = (
        planner.plan(x0, known=known, rng=rng(seed)) for seed in (3, 4, 3)
    )
    np.testing.assert_array_equal(first.controls, again.controls)
    assert first.cost == again.cost


def test_refuses_a_search_without_finite_bounds(lq: OptimalControlProblem) -> None:
    with pytest.raises(InvalidProblemError, match="finite bounds on every control"):
        Planner(lq, search=one_generation("one"))


def test_refuses_an_unknown_warm_start() -> None:
    with pytest.raises(InvalidProblemError, match="all, half, one, none, got 'some'"):
        one_generation("some")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda guess: guess.T, r"a guess must have shape \(2, 3\), got \(3, 2\)"),
        (lambda guess: guess * np.inf, "a guess must be finite"),
    ],
)
def test_refuses_a_guess_that_is_none(
    crossing: Posed, spoil: Callable[[Array], Array], message: str
) -> None:
    problem, x0, known = crossing
    planner = Planner(problem, search=one_generation("one"))
    with pytest.raises(InvalidProblemError, match=message):
        planner.plan(x0, known=known, guess=spoil(np.ones((2, 3))), rng=rng())


def test_a_polish_alone_starts_at_the_middle_of_the_bounds_too() -> None:
    """From zero the valley at -1, from 2.5 that at 2."""
    planner = Planner(
        two_valleys(), search=None, polish=IpoptOptions(), backend="casadi"
    )
    plan = planner.plan([0.0], rng=rng())
    alone = planner.plan([0.0], guess=np.zeros((1, 2)), rng=rng())
    np.testing.assert_allclose(alone.controls, -1, atol=0.05)
    np.testing.assert_allclose(plan.controls, 2, atol=0.05)
    assert plan.evaluations > alone.evaluations
