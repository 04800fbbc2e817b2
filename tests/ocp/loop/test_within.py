"""A time for a plan: the best until then is applied, and the step says so.

The clock is one of the tests: it advances whenever it is read, or stands still.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.heuristics import Budget, ParticleSwarm
from swarmstart.ocp import (
    Bounds,
    Decision,
    InvalidProblemError,
    IpoptOptions,
    LocalAgent,
    LocalTeam,
    Model,
    Multistart,
    NlpOptions,
    OpenLoop,
    OptimalControlProblem,
    Plan,
    Planner,
    Plant,
    PolishStatus,
    RecedingHorizon,
    SearchSettings,
    Source,
    phased_horizon,
    simulate,
)
from swarmstart.ocp.loop import controller as controllers
from swarmstart.ocp.nlp.polish import is_better
from swarmstart.ocp.nlp.watching import Deadline

TICKS = 1.0
"""Seconds by which the clock advances when it is read."""
LONG = 1e6
"""A time that no test reaches."""
START = np.array([0.3, 0.0])
SWARM = ParticleSwarm(size=20)


class Clock:
    """A stopwatch that advances by a step whenever it is read."""

    def __init__(self, begin: float, step: float) -> None:
        self._now, self._step = begin, step

    @property
    def seconds(self) -> float:
        self._now += self._step
        return self._now


SetClock = Callable[[float, float], None]


@pytest.fixture
def set_clock(monkeypatch: pytest.MonkeyPatch) -> SetClock:
    def set_to(begin: float, step: float) -> None:
        @contextmanager
        def stopwatch() -> Iterator[Clock]:
            yield Clock(begin, step)

        monkeypatch.setattr(controllers, "stopwatch", stopwatch)

    return set_to


@pytest.fixture
def over(set_clock: SetClock) -> None:
    """The time of every step is over at once."""
    set_clock(math.inf, 0.0)


def swing_up() -> OptimalControlProblem:
    """A pendulum that swings up within bounds, whose polish takes ten iterations."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0])))
    return OptimalControlProblem(
        model, horizon=2.0, intervals=20, stage_cost=u**2 + 10 * (1 + ca.cos(x[0])),
        terminal_cost=20 * (1 + ca.cos(x[0])), constraints=[x[1] <= 4],
        bounds=Bounds(controls=(-8, 8)),
    )  # fmt: skip


def by_polish(**options: object) -> RecedingHorizon:
    planner = Planner(swing_up(), search=None, polish=IpoptOptions())
    return RecedingHorizon(planner=planner, **options)  # type: ignore[arg-type]


def by_search(*, polish: bool, evaluations: int = 4000) -> Planner:
    search = SearchSettings(
        algorithm=SWARM, budget=Budget(evaluations=evaluations), when="always"
    )
    return Planner(swing_up(), search=search, polish=IpoptOptions() if polish else None)


def first(controller: RecedingHorizon) -> Plan:
    rng = np.random.default_rng(0)
    return controller.decide(0.0, START, None, rng=rng).plans[0]


def follows(controller: RecedingHorizon, plan: Plan, state: Array) -> Plan:
    decision = Decision(control=plan.controls[:, 0], plans=(plan,))
    time, rng = controller.dt, np.random.default_rng(0)
    return controller.decide(time, state, decision, rng=rng).plans[0]


def beats(one: Plan, other: Plan) -> bool:
    values = [(plan.cost, plan.violation) for plan in (one, other)]
    return is_better(*values, tolerance=1e-6)


def test_a_time_that_is_long_enough_changes_no_bit() -> None:
    free, limited = by_polish(), by_polish(within=LONG)
    plan, timed = first(free), first(limited)
    state = np.array([0.05, 0.1])
    later, later_timed = follows(free, plan, state), follows(limited, timed, state)
    for one, other in ((plan, timed), (later, later_timed)):
        assert one.polish_status is PolishStatus.CONVERGED and not other.stopped
        np.testing.assert_array_equal(one.controls, other.controls)
        assert (one.cost, one.evaluations) == (other.cost, other.evaluations)


def test_more_time_never_gives_a_worse_plan(set_clock: SetClock) -> None:
    """Iterates are the same from run to run, so the best so far only gets better."""
    set_clock(0.0, TICKS)
    controller = by_polish()
    plans = [first(replace(controller, within=k)) for k in range(1, 40, 3)]
    assert plans[0].stopped and not plans[-1].stopped
    assert not any(beats(a, b) for a, b in pairwise(plans))
    # The solver's first iterates are worse than its start, and yet some help.
    stopped = [plan for plan in plans if plan.stopped]
    assert len({plan.cost for plan in stopped}) > 2
    done = plans[-1]
    assert done.polish_status is PolishStatus.CONVERGED
    assert any(beats(done, plan) for plan in stopped)


def test_the_best_iterate_is_taken_and_not_the_last(
    set_clock: SetClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    set_clock(0.0, TICKS)
    seen: list[tuple[float, float]] = []
    keep = Deadline._keep

    def spying(self: object, answer: object, value: tuple[float, float]) -> None:
        seen.append(value)
        keep(self, answer, value)  # type: ignore[arg-type]

    monkeypatch.setattr(Deadline, "_keep", spying)
    was_better_before = False
    controller = by_polish()
    for within in range(2, 40):
        seen.clear()
        plan = first(replace(controller, within=within))
        value = plan.cost, plan.violation
        if not plan.stopped:
            break
        assert len(seen) >= 2
        assert not any(is_better(one, value, tolerance=1e-6) for one in seen)
        iterates = seen[:-1]  # The last one is the polish's own answer.
        was_better_before |= value in iterates[:-1]
        assert plan.feasible == (plan.violation <= 1e-6)
    assert was_better_before


@pytest.mark.usefixtures("over")
def test_a_first_step_without_time_applies_the_start_and_says_so() -> None:
    given = np.full((1, 20), 0.5)
    for controller, controls, source in (
        (by_polish(within=1.0), np.zeros((1, 20)), Source.COLD),
        (by_polish(within=1.0, first=given), given, Source.GUESS),
    ):
        plan = first(controller)
        np.testing.assert_array_equal(plan.controls, controls)
        assert plan.source is source and plan.stopped
        assert plan.polish_status is PolishStatus.ITERATION_LIMIT
        assert "stopped when its time was over" in repr(plan)


@pytest.mark.parametrize("shift", [True, False])
def test_a_later_step_without_time_applies_the_shifted_last_plan(
    over: None, *, shift: bool
) -> None:
    del over
    last = first(by_polish(first=None))
    controller = by_polish(within=1.0, shift=shift)
    state = last.states[:, 1]
    plan = follows(controller, last, state)
    np.testing.assert_array_equal(plan.controls[:, :-1], last.controls[:, 1:])
    assert plan.stopped and plan.feasible and plan.source is Source.GUESS


def test_an_infeasible_step_without_time_falls_back_as_ever(over: None) -> None:
    del over
    last = first(by_polish())
    plan = follows(by_polish(within=1.0), last, np.array([0.0, 5.0]))
    assert plan.stopped and not plan.feasible


def test_a_search_ends_in_time_and_leaves_half_of_it_to_the_polish(
    set_clock: SetClock,
) -> None:
    # A clock that stands still: the time is not over, but hardly any is left.
    set_clock(1.0 - 1e-9, 0.0)
    planner = by_search(polish=True)
    plan = first(RecedingHorizon(planner=planner, within=1.0))
    assert plan.search.evaluations.tolist() == [20]
    assert plan.stopped and plan.polish_status is PolishStatus.CONVERGED
    alone = by_search(polish=False)
    plan = first(RecedingHorizon(planner=alone, within=1.0))
    assert plan.search.evaluations.tolist() == [20] and plan.stopped
    whole = first(RecedingHorizon(planner=alone, within=LONG))
    assert whole.search.evaluations[-1] == 4000 and not whole.stopped


@pytest.mark.usefixtures("over")
def test_nothing_is_searched_when_the_time_is_over() -> None:
    for polish in (True, False):
        planner = by_search(polish=polish)
        plan = first(RecedingHorizon(planner=planner, within=1.0))
        assert not plan.is_searched and plan.stopped
        assert plan.evaluations == 0 and plan.source is Source.COLD


def test_a_searched_plan_is_not_worse_than_the_shifted_one(
    set_clock: SetClock,
) -> None:
    """A generation at random is worse than the last plan, if it is not in it."""
    last = first(by_polish())
    planner = by_search(polish=False)
    assert planner.search is not None
    planner.search = replace(planner.search, warm_start="none")
    set_clock(1.0 - 1e-9, 0.0)
    plan = follows(
        RecedingHorizon(planner=planner, within=1.0), last, last.states[:, 1]
    )
    np.testing.assert_array_equal(plan.controls[:, :-1], last.controls[:, 1:])
    assert plan.stopped and plan.is_searched


def test_lanes_are_left_out_of_a_plan_with_a_time() -> None:
    planner = Planner(swing_up(), search=None, polish=IpoptOptions(), lanes=4)
    plan = first(RecedingHorizon(planner=planner, within=LONG))
    assert plan.starts is None and plan.feasible and not plan.stopped
    free = first(RecedingHorizon(planner=planner))
    assert free.starts is not None and free.starts.lanes is not None


def test_a_run_counts_its_stopped_steps(set_clock: SetClock) -> None:
    problem = swing_up()
    plant = Plant(problem.model, dt=problem.dt, substeps=2)
    free = simulate(plant, by_polish(), [0.0, 0.0], steps=3, seed=0)
    assert free.stopped_steps == 0 and "stopped" not in repr(free)
    set_clock(math.inf, 0.0)
    run = simulate(plant, by_polish(within=0.1), [0.0, 0.0], steps=3, seed=0)
    assert run.stopped_steps == 3
    assert repr(run).endswith("; 3 stopped when their time was over")


def test_phases_are_planned_in_time(over: None) -> None:
    del over
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    leg = OptimalControlProblem(
        Model(states=x, controls=u, ode=u), horizon=0.5, intervals=4,
        stage_cost=u**2, bounds=Bounds(controls=(-4, 4)), terminal=[(x, 1)],
    )  # fmt: skip
    loop = phased_horizon([leg, leg], period=0.25, polish=IpoptOptions(), within=1.0)
    rng = np.random.default_rng(0)
    plan = loop.decide(0.0, loop.start([0.0]), None, rng=rng).plans[0]
    assert plan.stopped
    np.testing.assert_array_equal(plan.controls, np.zeros((1, 8)))
    with pytest.raises(InvalidProblemError, match=r"within must be .*got 0"):
        phased_horizon([leg, leg], period=0.25, polish=IpoptOptions(), within=0.0)


def test_agents_of_a_local_team_plan_in_time(over: None) -> None:
    del over
    x, u, gap = (ca.SX.sym(name) for name in ("x", "u", "gap"))
    followed, seen = ca.SX.sym("followed"), ca.SX.sym("seen")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u, parameters=gap), horizon=1.0, intervals=2,
        terminal_cost=(x - followed + gap) ** 2, bounds=Bounds(controls=(-5, 5)),
        signals=ca.vertcat(followed, seen),
    )  # fmt: skip
    planner = Planner(problem, search=None, polish=IpoptOptions())
    agents = [
        LocalAgent(parameters=[0], reference=lambda t: np.ones((1, t.size))),
        LocalAgent(parameters=[0.5]),
    ]
    team = LocalTeam(
        agents, planners={1: planner}, order=(0, 1), range=10.0, position=(0,),
        within=0.5,
    )  # fmt: skip
    decision = team.decide(0.0, np.zeros(2), None, rng=np.random.default_rng(0))
    assert [plan.stopped for plan in decision.plans] == [True, True]


@pytest.mark.parametrize("within", [0, -1.0, math.nan, math.inf, "soon", True])
def test_a_time_is_a_positive_number(within: object) -> None:
    with pytest.raises(
        InvalidProblemError, match="within must be None or a finite number above 0"
    ):
        by_polish(within=within)


def test_a_time_is_refused_where_nothing_could_be_stopped() -> None:
    with pytest.raises(InvalidProblemError, match=r"plans once.*got 2 s"):
        OpenLoop(loop=by_polish(within=2.0))
    lanes = Planner(swing_up(), search=Multistart(size=4), polish=IpoptOptions())
    with pytest.raises(InvalidProblemError, match="got one in lanes"):
        RecedingHorizon(planner=lanes, within=1.0)
    deaf = Planner(swing_up(), search=None, polish=NlpOptions(plugin="fatrop"))
    with pytest.raises(InvalidProblemError, match="ipopt, got fatrop"):
        RecedingHorizon(planner=deaf, within=1.0)


def test_other_solvers_are_stopped_as_well(set_clock: SetClock) -> None:
    set_clock(0.0, TICKS)
    options = NlpOptions(plugin="sqpmethod")
    planner = Planner(swing_up(), search=None, polish=options)
    plan = first(RecedingHorizon(planner=planner, within=4.0))
    start = first(RecedingHorizon(planner=planner, within=1.0))
    assert plan.stopped and start.stopped and not beats(start, plan)
