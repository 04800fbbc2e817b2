"""Lanes from random starts and from variations of their optima."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmstart.ocp import (
    Bounds,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
    Planner,
    Start,
)
from swarmstart.ocp.lanes.answers import LaneAnswers, distinct_optima, reached, some_of
from swarmstart.ocp.lanes.solver import LaneSolver
from swarmstart.ocp.nlp.watching import UNWATCHED, Relay, Unwatched, Watch
from swarmstart.ocp.search import start_lanes
from swarmstart.ocp.search.start_lanes import StartLanes, variations
from swarmstart.tests.ocp.lanes.problems import cart, crossing

START = np.array([-1.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 1.0])


def answers(costs: list[float], *, nodes: int = 11) -> LaneAnswers:
    """Return feasible answers far from each other, with states of different size."""
    n = len(costs)
    time = np.linspace(0.0, 1.0, nodes)
    level = np.arange(1.0, n + 1.0)
    states = np.stack([np.outer(time, level), np.outer(time**2, 10.0 * level)])
    return LaneAnswers(
        controls=np.repeat(level[None, None, :], nodes - 1, axis=1),
        starts=level[None, :], states=states, cost=np.array(costs),
        violation=np.zeros(n), iterations=np.ones(n, np.int64),
    )  # fmt: skip


@given(st.integers(0, 2**32), st.integers(1, 40))
def test_variations_are_finite_and_keep_the_start(seed: int, n: int) -> None:
    found = answers([3.0, 1.0, 2.0])
    before = found.states.copy()
    controls, decided, states = variations(found, n, np.random.default_rng(seed))
    assert controls.shape == (1, 10, n) and states.shape == (2, 11, n)
    assert decided.shape == (1, n)
    assert np.isfinite(states).all()
    assert (states[:, 0] == 0.0).all()
    assert (np.abs(controls - 2.0) <= 1.0 + 1e-9).all()
    np.testing.assert_array_equal(found.states, before)


def test_crossings_begin_on_one_optimum_and_end_on_the_other() -> None:
    found = answers([1.0, 2.0], nodes=101)
    _, decided, states = variations(found, 400, np.random.default_rng(0))
    crossed = states[:, :, :200]
    ends = crossed[0, -1]
    pure = np.isin(np.round(ends, 9), (1.0, 2.0))
    assert pure.mean() > 0.9  # Others are cut within the last tenth.
    begins = crossed[0, 1] / 0.01
    changed = pure & (np.abs(ends - decided[0, :200]) > 0.5)
    assert 0.2 < changed.mean() < 0.8
    kept = np.abs(begins[changed] - decided[0, :200][changed]) < 1e-9
    assert kept.mean() > 0.9


def test_kicks_move_each_state_by_a_share_of_its_way() -> None:
    found = answers([1.0])
    _, _, states = variations(found, 2000, np.random.default_rng(0))
    away = np.abs(states - found.states).max(axis=1)
    small, large = np.median(away, axis=1)
    assert large == pytest.approx(10.0 * small, rel=0.2)
    assert 0.05 < small < 0.8


def test_cheaper_optima_are_varied_more_often() -> None:
    found = answers([5.0, 1.0, 9.0])
    _, decided, _ = variations(found, 3000, np.random.default_rng(0))
    counts = [(decided == one).sum() for one in (2.0, 1.0, 3.0)]
    np.testing.assert_allclose(counts, 3000 * np.array([6, 3, 2]) / 11, rtol=0.15)


def lanes_of(problem: OptimalControlProblem, watch: Watch = UNWATCHED) -> StartLanes:
    """Return lanes with an observer."""
    planner = Planner(problem, search=None, polish=IpoptOptions())
    solver = LaneSolver(planner.fitness.shooting)
    return StartLanes(planner.fitness, solver, Relay(watch))


def first(problem: OptimalControlProblem) -> list[Start]:
    """Return a start at zero controls."""
    return [Start(np.zeros((problem.model.nu, problem.intervals)))]


@pytest.mark.usefixtures("compiler")
def test_variations_find_cheaper_optima_and_are_no_sample() -> None:
    """Four points cross: nothing found is lost, and variations are counted apart."""
    problem = crossing()
    lanes = lanes_of(problem)
    rng = np.random.default_rng(1)
    solved = lanes.random(first(problem), START, Known(), 12, rng)
    account = lanes.account(solved)
    assert account.starts == 13 and account.varied == 0
    more = lanes.varied(solved, 12, rng)
    told = lanes.account(more)
    assert told.varied in range(12, 12 * start_lanes.ROUNDS + 1, 12)
    assert told.starts == 13 + told.varied
    assert told.unseen == account.unseen
    assert told.iterations > account.iterations
    assert more.least <= solved.least
    assert len(told.optima) > len(account.optima)
    best = lanes.best(more, 2)
    assert len(best) == 2
    kept = some_of(more.answers, np.flatnonzero(reached(more.answers)))
    assert distinct_optima(kept)[0].cost == more.least


@pytest.mark.usefixtures("compiler")
def test_answers_of_batches_are_in_the_order_of_their_starts() -> None:
    """Random controls, then states that lead to the end, as if solved at once."""

    class Counting(Unwatched):
        def counted(self, evaluations: float) -> None:
            batches.append(evaluations)

    batches: list[float] = []
    problem = crossing()
    one, other = (
        lanes_of(problem, watch).random(
            first(problem), START, Known(), 40, np.random.default_rng(0)
        )
        for watch in (UNWATCHED, Counting())
    )
    assert len(batches) == 4 and one.answers.cost.size == 41
    np.testing.assert_array_equal(one.answers.cost, other.answers.cost)
    np.testing.assert_array_equal(one.answers.states, other.answers.states)


@pytest.mark.usefixtures("compiler")
def test_rounds_end_with_the_first_that_finds_nothing_cheaper() -> None:
    """A convex problem has one optimum, so that one round follows."""
    lanes = lanes_of(cart())
    rng = np.random.default_rng(0)
    x0 = np.array([0.0, 1.0])
    solved = lanes.random(first(cart()), x0, Known(), 8, rng)
    assert lanes.account(lanes.varied(solved, 8, rng)).varied == 8


@pytest.mark.usefixtures("compiler")
def test_nothing_is_varied_where_no_lane_is_feasible() -> None:
    problem = crossing(apart=1.6)  # No two of four points fit into their circle so.
    lanes = lanes_of(problem)
    rng = np.random.default_rng(0)
    solved = lanes.random(first(problem), START, Known(), 4, rng)
    assert not np.isfinite(solved.least)
    assert lanes.varied(solved, 4, rng) is solved
    assert lanes.best(solved, 3) == []


@pytest.mark.usefixtures("compiler")
def test_states_lead_from_the_start_to_the_end_in_the_units_of_the_problem(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Metres in thousands and two checks an interval: sizes and nodes differ."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        horizon=1.0, intervals=8, checks=2, stage_cost=u**2,
        bounds=Bounds(controls=(-9e4, 9e4)), terminal=[x - ca.vertcat(5e3, 2e3)],
    )  # fmt: skip
    begun: list[Any] = []
    solve = LaneSolver.__call__

    def noted(self: LaneSolver, *given: Any, **more: Any) -> LaneAnswers:
        begun.append(given[3] if len(given) > 3 else None)
        return solve(self, *given, **more)

    monkeypatch.setattr(LaneSolver, "__call__", noted)
    lanes, rng = lanes_of(problem), np.random.default_rng(0)
    x0 = np.array([1e3, -3e3])
    solved = lanes.random(first(problem), x0, Known(), 8, rng)
    lanes.varied(solved, 8, rng)
    controls, bent, varied = begun[:3]
    assert controls is None and bent.shape == (2, 9, 4) and varied.shape == (2, 9, 8)
    for states in (bent, varied):
        np.testing.assert_allclose(
            states[:, 0], x0[:, None] + np.zeros(states.shape[2])
        )
    np.testing.assert_allclose(bent[:, -1], [[5e3] * 4, [2e3] * 4])
