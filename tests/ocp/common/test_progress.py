"""Progress of solve and multistart: reported, in order, without a changed result."""

import math
import re
from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np
import pytest

from swarmstart.heuristics import Budget
from swarmstart.ocp import (
    Bounds,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Planner,
    multistart,
    solve,
)
from swarmstart.ocp.common.presentation import of_budget, tell_nothing
from swarmstart.ocp.nlp import watching

News = list[tuple[int, int, str]]


@pytest.fixture(scope="module")
def bounded(lq: OptimalControlProblem) -> OptimalControlProblem:
    return replace(lq, bounds=Bounds(controls=(-2, 2)))


def test_solve_tells_its_evaluations_and_then_what_follows(
    bounded: OptimalControlProblem,
) -> None:
    told: News = []
    searched = partial(solve, bounded, [1, 0], search="lshade", budget=2000, seed=0)
    solution = searched(progress=lambda *news: told.append(news))
    searching = [news for news in told if news[2] == "searching"]
    done = [news[0] for news in searching]
    assert done == sorted(done) and 1500 < done[-1] <= 2000
    assert {news[1] for news in searching} == {2000}
    after = [news for news in told if news not in searching]
    words = [what for _, _, what in after]
    assert words == ["polishing", "polishing", "verifying", "improving"]
    # First from the cold starts, then from the points of search and lanes.
    assert told == [after[0], *searching, *after[1:]]
    silent = searched()
    np.testing.assert_array_equal(solution.controls, silent.controls)


def test_multistart_tells_after_each_start(bounded: OptimalControlProblem) -> None:
    told: News = []
    plan = multistart(
        Planner(bounded, search=None, polish=IpoptOptions()),
        [1, 0],
        budget=Budget(evaluations=30),
        rng=np.random.default_rng(0),
        progress=lambda *news: told.append(news),
    )
    assert len(told) > 1 and told[-1][0] == plan.evaluations
    assert {news[1:] for news in told} == {(30, "polishing from random starts")}


def test_a_budget_of_seconds_is_told_in_seconds() -> None:
    told: News = []
    tell = of_budget(lambda *news: told.append(news), Budget(seconds=5.0), "searching")
    assert tell is not None
    tell(400)
    assert told == [(0, 5, "searching")]


def test_nothing_is_counted_where_nothing_is_told() -> None:
    assert of_budget(tell_nothing, Budget(evaluations=5), "searching") is None


def test_ctrl_c_in_a_callback_ends_the_search(bounded: OptimalControlProblem) -> None:
    def stop(done: int, of: int, what: str) -> None:
        if what == "searching":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        solve(bounded, [1, 0], search="lshade", budget=2000, seed=0, progress=stop)
    assert stopped.value.partial.cost > 0  # type: ignore[attr-defined]


def test_a_long_polish_tells_its_start_and_iteration(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A swing-up that takes more than ten iterations from each start."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0])))
    problem = OptimalControlProblem(
        model, horizon=3.0, intervals=50, stage_cost=u**2,
        bounds=Bounds(controls=(-8, 6)), terminal=[x - ca.vertcat(np.pi, 0)],
    )  # fmt: skip
    told: News = []
    quick = partial(
        solve, problem, [0, 0], search="lshade", budget=100, lanes=4, seed=0,
        progress=lambda *news: told.append(news),
    )  # fmt: skip
    monkeypatch.setattr(watching, "_SOON_S", math.inf)
    quick()
    assert not any("iteration" in what for _, _, what in told)
    monkeypatch.setattr(watching, "_SOON_S", 0.0)
    seen = quick()
    words = [what for _, _, what in told if what.startswith("polishing start")]
    # States straight to the end take fewer iterations; then zero controls and the
    # middle of the bounds. Later starts are counted on.
    assert words[0] == "polishing start 2 of 3, iteration 10"
    numbers = [tuple(map(int, re.findall(r"\d+", one))) for one in words]
    assert all(1 <= start <= of for start, of, _ in numbers)
    assert [one[0] for one in numbers] == sorted(one[0] for one in numbers)
    assert max(of for _, of, _ in numbers) > 3
    silent = solve(problem, [0, 0], search="lshade", budget=100, lanes=4, seed=0)
    np.testing.assert_array_equal(seen.controls, silent.controls)
