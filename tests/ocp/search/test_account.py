"""The account of many starts says what became of each of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import swarmstart as ss
from swarmstart.ocp.lanes.answers import Optimum, unseen_share
from swarmstart.ocp.search.account import Lanes, StartsAccount, Tried

NONE = np.empty((0, 0))


def lanes(
    *counts: int, infeasible: int = 0, unfinished: int = 0, lost: int = 0
) -> Lanes:
    return Lanes(
        starts=sum(counts) + infeasible + unfinished + lost,
        optima=tuple(
            Optimum(lane=k, cost=1.5 + k, count=c, controls=NONE, states=NONE,
                    decided=NONE)
            for k, c in enumerate(counts)
        ),
        unseen=unseen_share(counts),
        iterations=7, seconds=0.1, infeasible=infeasible, unfinished=unfinished,
        lost=lost,
    )  # fmt: skip


def test_starts_that_reach_nothing_are_counted_and_claim_nothing() -> None:
    assert lanes(infeasible=8, lost=2).line() == (
        "10 starts: no optimum, 8 infeasible, 2 not finite"
    )
    assert lanes(unfinished=3, lost=2).line() == (
        "5 starts: no optimum, 3 unfinished, 2 not finite"
    )
    found = lanes(90, infeasible=10).line()
    assert found.startswith("100 starts: 1.5 (90), 10 infeasible; at most 3% of such")
    assert lanes(3).line(-1.0).startswith("3 starts: -1.5 (3); at most")


def test_more_starts_are_advised_if_one_alone_found_the_cheapest() -> None:
    advice = "; the best was found once: try more, such as lanes="
    assert lanes(1, 20, 9).advice == f"{advice}120"
    varied = replace(lanes(1, 99), varied=36)
    assert varied.advice == f"{advice}256"
    for enough in (lanes(2, 20), lanes(20, 1), lanes(1), lanes(infeasible=4)):
        assert not enough.advice
    tried = Tried(
        origin="the lanes", cost=1.5, violation=0.0, feasible=True, iterations=1,
        evaluations=1, seconds=0.1,
    )  # fmt: skip
    account = StartsAccount(won="the lanes", tried=(tried,), lanes=varied)
    assert account.lines()[-1].endswith(f"(95% interval){advice}256")
    # In a search the budget gives the number of lanes, and `lanes=` would do nothing.
    assert "try more" not in varied.line()


@pytest.mark.parametrize("search", ["default", ss.Multistart(), ss.Memetic()])
def test_every_start_of_the_lanes_is_counted_once(search: Any) -> None:
    """A wall with a gap: many starts end at it."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 2)
    wall = 4 - 60 * ca.exp(-20 * (x[0] - 1) ** 2) * (1 - ca.exp(-100 * x[1] ** 2))
    problem = ss.OptimalControlProblem(
        ss.Model(states=x, controls=u, ode=u), horizon=2.0, intervals=10,
        stage_cost=ca.sumsqr(u), bounds=ss.Bounds(controls=(-4, 4)),
        constraints=[ss.PathConstraint(expression=wall, lower=0)],
        terminal=[(x, [2.0, 1.0])],
    )  # fmt: skip
    plan = ss.solve(problem, [0.0, 1.0], seed=0, search=search, budget=20_000).plan
    own = None if plan.starts is None else plan.starts.lanes
    accounts = [one for one in (own, plan.search.lanes) if one is not None]
    assert accounts and (search == "default" or plan.search.lanes)
    for account in accounts:
        counted = sum(one.count for one in account.optima)
        others = account.unfinished + account.infeasible + account.lost
        assert counted + others == account.starts
    assert any(account.infeasible + account.lost for account in accounts)


def test_a_single_start_is_no_plural() -> None:
    assert lanes(1).line().startswith("1 start: ")
    assert lanes(2).line().startswith("2 starts: ")
