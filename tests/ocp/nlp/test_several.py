"""Polishes in other processes: answers and accounts as without them, bit for bit."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.arrays import Array
from swarmstart.ocp.answer.improving import settled
from swarmstart.ocp.common.processes import Ahead
from swarmstart.ocp.nlp import several
from swarmstart.ocp.nlp.polish import Polisher
from swarmstart.ocp.nlp.several import in_turn
from swarmstart.ocp.nlp.watching import Reporting, Unwatched, WorkAlone
from swarmstart.ocp.rollout.fitness import NOTHING, Fitness

Swing = Callable[..., ss.OptimalControlProblem]


class Copies(NamedTuple):
    """Copies that were made of the process."""

    made: list[int]


@pytest.fixture
def copies(monkeypatch: pytest.MonkeyPatch) -> Copies:
    """Count copies, which even small problems use."""
    found, copied = Copies([]), Ahead._copied

    def counted(ahead: Ahead[Any], call: Callable[[], Any]) -> Any:
        found.made.append(1)
        return copied(ahead, call)

    monkeypatch.setattr(Ahead, "_copied", counted)
    monkeypatch.setattr(several, "_WORTH", 0.0)
    return found


def told(solution: ss.Solution) -> tuple[Any, ...]:
    """Return all of an answer but times and rounded text."""
    plan = solution.plan
    assert plan.starts is not None
    tried = [
        (repr(one.cost), repr(one.violation), one.origin, one.iterations)
        for one in plan.starts.tried
    ]
    optima = () if plan.starts.lanes is None else plan.starts.lanes.optima
    return (
        solution.status, solution.cost, solution.controls.tobytes(),
        solution.states.tobytes(), plan.evaluations, plan.search.history.tobytes(),
        tried, optima,
        plan.starts.won, None if plan.point is None else plan.point.lam_g.tobytes(),
    )  # fmt: skip


def swing(swing_up: Swing) -> tuple[ss.OptimalControlProblem, Any]:
    return swing_up(20, 1), [0.0, 0.0]


def unstable(_: Swing) -> tuple[ss.OptimalControlProblem, Any]:
    """A problem whose roll-outs say nothing: its search is not used."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=40 * x + u), horizon=1.0, intervals=20,
        stage_cost=x**2 + 0.01 * u**2, bounds=ss.Bounds(controls=(-100, 100)),
        terminal=[x],
    )  # fmt: skip
    return problem, [1.0]


def stiff(_: Swing) -> tuple[ss.OptimalControlProblem, Any]:
    """A problem whose NLP has steps that are chosen for each start."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=ca.vertcat(-1e3 * (x[0] - u), x[0])),
        horizon=1.0, intervals=3, stage_cost=x[0] ** 2 + u**2, terminal=[(x[1], 0.5)],
        integrator="stiff", bounds=ss.Bounds(controls=(-3, 3)),
    )  # fmt: skip
    return problem, [0.0, 0.0]


@pytest.mark.parametrize("posed", [swing, unstable, stiff])
def test_solve_finds_the_same_bits_with_any_number_of_processes(
    posed: Callable[[Swing], tuple[ss.OptimalControlProblem, Any]],
    swing_up: Swing,
    copies: Copies,
) -> None:
    problem, x0 = posed(swing_up)
    found, drawn = [], []
    for threads in (1, 2, 3):
        rng = np.random.default_rng(3)
        solution = ss.solve(
            problem, x0, budget=400, lanes=8, rng=rng, threads=threads, progress=False
        )
        found.append(told(solution))
        drawn.append(rng.bit_generator.state)
        assert bool(copies.made) == (threads > 1)
    assert found[1:] == found[:1] * 2
    # What is drawn afterwards is the same, too.
    assert drawn[1:] == drawn[:1] * 2


def test_restarts_find_the_same_with_copies(copies: Copies) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u), horizon=1.0, intervals=2,
        stage_cost=u**2 / 9, terminal_cost=4 * ca.cos(x),
        bounds=ss.Bounds(controls=(-2, 2)),
    )  # fmt: skip
    found = []
    for threads in (1, 3):
        planner = ss.Planner(
            problem, search=None, polish=ss.IpoptOptions(), threads=threads
        )
        rng = np.random.default_rng(0)
        plan = planner.plan([0.0], guess=np.zeros((1, 2)), rng=rng)
        after = settled(planner, plan, np.zeros(1), NOTHING, rng=rng)
        assert after.restarts is not None
        account = replace(after.restarts, seconds=0.0)
        controls = after.plan.controls.tobytes()
        found.append((controls, account, rng.bit_generator.state))
    assert copies.made
    assert found[0] == found[1]
    # Starts that were begun ahead, and then not needed, draw nothing.
    expected = np.random.default_rng(0)
    for _ in range(found[0][1].starts):
        expected.uniform()
        expected.standard_normal((1, 2))
    assert found[0][2] == expected.bit_generator.state


def test_a_watch_that_counts_work_sees_every_polish(
    swing_up: Swing, copies: Copies
) -> None:
    class Counting(Unwatched):
        solves = 0

        def solved(self, work: Any, ratios: Any) -> None:
            del work, ratios
            self.solves += 1

    watch = Counting()
    fitness = Fitness(swing_up(5, 1))
    for watched, expected in ((watch, 3), (WorkAlone(watch), 6)):
        polisher = Polisher(fitness, watch=watched)

        def polished(controls: Array, polisher: Polisher = polisher) -> Any:
            return polisher(controls, [0.0, 0.0])

        calls = [lambda k=k: polished(np.full((1, 5), float(k))) for k in range(3)]
        with in_turn(polisher, calls, 3) as results:
            assert len([*results]) == 3
        assert watch.solves == expected
    assert not copies.made


def test_short_polishes_are_not_worth_a_copy(
    swing_up: Swing, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: Any) -> None:
        raise AssertionError("a copy was made")

    monkeypatch.setattr(Ahead, "_copied", refused)
    ss.solve(swing_up(5, 1), [0.0, 0.0], budget=200, lanes=4, seed=0, threads=2)


def test_progress_counts_every_start_once(swing_up: Swing, copies: Copies) -> None:
    said: list[str] = []
    watch = Reporting(lambda done, of, what: said.append(what))
    polisher = Polisher(Fitness(swing_up(20, 1)), watch=watch)
    calls = [
        partial(polisher, np.full((1, 20), float(k)), [0.0, 0.0]) for k in range(4)
    ]
    watch.expect(len(calls))
    with in_turn(polisher, calls, 2) as results:
        assert len([*results]) == len(calls)
    assert copies.made
    watch.expect(0)
    assert watch.starts == len(calls)


@pytest.mark.parametrize("threads", [0, -1, 1.5, True, "two"])
def test_a_number_of_threads_that_is_none_is_refused(
    threads: Any, swing_up: Swing
) -> None:
    with pytest.raises(ss.InvalidProblemError, match="threads"):
        ss.solve(swing_up(5, 1), [0.0, 0.0], seed=0, threads=threads)
