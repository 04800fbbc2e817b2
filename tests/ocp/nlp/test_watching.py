"""A watch counts the work of an NLP solver, stops it, and changes nothing else."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest

from swarmstart.ocp import (
    Bounds,
    IpoptOptions,
    Model,
    NlpOptions,
    OptimalControlProblem,
    Planner,
)
from swarmstart.ocp.nlp.watching import (
    Answer,
    Ratios,
    Unwatched,
    Work,
    ratios_of,
    work_of,
)


class Counting(Unwatched):
    """A watch that counts, and asks to stop after a given amount of work."""

    def __init__(self, most: float = np.inf) -> None:
        self.most, self.spent, self.iterates = most, 0.0, 0
        self.work, self.ratios = Work(), Ratios(0.0, 0.0)
        self.costs: list[float] = []

    @property
    def is_over(self) -> bool:  # type: ignore[override]
        return self.spent >= self.most

    def iterated(self, evaluations: float, answer: Callable[[], Answer] | None) -> bool:
        self.iterates += 1
        assert answer is not None and np.isfinite(answer()[0]).all()
        return self.spent + evaluations < self.most

    def solved(self, work: Work, ratios: Ratios) -> None:
        self.work, self.ratios = self.work + work, ratios
        self.spent += work.evaluations(ratios)

    def answered(self, answer: Answer, cost: float, violation: float) -> None:
        self.costs.append(cost)


def swing(intervals: int = 20) -> OptimalControlProblem:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    model = Model(states=x, controls=u, ode=ca.vertcat(x[1], u - 9.81 * ca.sin(x[0])))
    return OptimalControlProblem(
        model,
        horizon=1.0,
        intervals=intervals,
        stage_cost=u**2,
        bounds=Bounds(controls=(-20.0, 20.0)),
        terminal=[x - ca.vertcat(1.0, 0.0)],
    )


def planned(watch: Unwatched | None, plugin: str = "ipopt") -> Planner:
    polish = IpoptOptions() if plugin == "ipopt" else NlpOptions(plugin=plugin)
    told = {} if watch is None else {"watch": watch}
    return Planner(swing(), search=None, polish=polish, **told)  # type: ignore[arg-type]


@pytest.mark.parametrize("plugin", ["ipopt", "sqpmethod"])
def test_watching_changes_no_bit(plugin: str) -> None:
    rng, watch = np.random.default_rng(0), Counting()
    alone = planned(None, plugin).plan([0.0, 0.0], rng=rng)
    watched = planned(watch, plugin).plan([0.0, 0.0], rng=rng)
    assert np.array_equal(alone.controls, watched.controls)
    assert watch.costs[-1] == watched.cost
    # IPOPT reports its start as well, and each iteration after it.
    assert watch.iterates == watch.work.hessians + 1


def test_counts_are_those_of_the_solver() -> None:
    """The work for a problem that CasADi's own solver solves side by side."""
    watch = Counting()
    planner = planned(watch)
    planner.plan([0.0, 0.0], rng=np.random.default_rng(0))
    assert planner.polisher is not None and planner.polisher.program is not None
    x = ca.MX.sym("x", 2)
    nlp = {"x": x, "f": (1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2, "g": x[0]}
    solver = ca.nlpsol(
        "rosenbrock", "ipopt", nlp, {"ipopt.print_level": 0, "print_time": False}
    )
    solver(x0=[-1.2, 1.0])
    stats = solver.stats()
    work = work_of(stats)
    assert work.hessians == stats["iter_count"] == stats["n_call_nlp_hess_l"]
    assert work.gradients == stats["n_call_nlp_grad_f"]
    assert work.rollouts == max(stats["n_call_nlp_f"], stats["n_call_nlp_g"])
    assert watch.work.gradients >= watch.work.hessians > 0


def test_derivatives_cost_the_ratio_of_their_instructions() -> None:
    """It does not depend on the number of intervals, except for the two ends."""
    found = []
    for intervals in (20, 40):
        planner = Planner(swing(intervals), search=None, polish=IpoptOptions())
        assert planner.polisher is not None and planner.polisher.program is not None
        program = planner.polisher.program
        ratios = ratios_of(program, planner.fitness.shooting)
        assert ratios == planner.polisher.ratios
        part = program.parts.interval
        rollout = planner.fitness.shooting.stage_without_path.n_instructions()
        by_hand = part.curvature.n_instructions() / rollout
        assert ratios.hessian == pytest.approx(by_hand, rel=0.1)
        found.append(ratios)
    assert found[0].gradient == pytest.approx(found[1].gradient, rel=0.05)
    work = Work(rollouts=3, gradients=2, hessians=1)
    assert work.evaluations(Ratios(4.0, 10.0)) == 3 + 2 * 4 + 10


def test_a_budget_stops_ipopt_after_the_iteration_that_spends_it() -> None:
    whole = Counting()
    planned(whole).plan([0.0, 0.0], rng=np.random.default_rng(0))
    most = whole.spent / 2
    watch = Counting(most)
    planned(watch).plan([0.0, 0.0], rng=np.random.default_rng(0))
    iteration = Work(2, 1, 1).evaluations(watch.ratios)
    assert most <= watch.spent <= most + iteration
    assert watch.work.hessians < whole.work.hessians
