"""Families of trajectories: a member's value is the problem's at the nodes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from swarmstart.heuristics import LSHADE, Box, Budget
from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    IpoptOptions,
    Known,
    Model,
    OptimalControlProblem,
    Planner,
    PolishStatus,
    SearchSettings,
    Separation,
    Source,
    TrajectoryFamily,
)
from swarmstart.ocp.rollout.fitness import Fitness
from swarmstart.ocp.search.search_space import FamilySpace

HORIZON, INTERVALS, CHECKS = 4.0, 8, 2
X0 = np.array([0.0, 0.0, 0.0, 0.0])
GOAL = np.array([4.0, 0.0])


@pytest.fixture(scope="module")
def problem() -> OptimalControlProblem:
    """A point mass in the plane from rest to rest, past a disc in the middle."""
    p, v, u = ca.SX.sym("p", 2), ca.SX.sym("v", 2), ca.SX.sym("u", 2)
    return OptimalControlProblem(
        Model(states=ca.vertcat(p, v), controls=u, ode=ca.vertcat(v, u)),
        horizon=HORIZON,
        intervals=INTERVALS,
        stage_cost=ca.sumsqr(u),
        bounds=Bounds(controls=(-4.0, 4.0)),
        constraints=[Separation(relative=p - ca.DM([2.0, 0.3]), distance=1.0)],
        terminal=[ca.vertcat(p - ca.DM(GOAL), v)],
        checks=CHECKS,
    )


def curve(c: Any, t: float) -> tuple[Any, Any]:
    """Rest to rest along x by a quintic, and a bump of y with the height c."""
    s = t / HORIZON
    x = GOAL[0] * (10 * s**3 - 15 * s**4 + 6 * s**5)
    vx = GOAL[0] * (30 * s**2 - 60 * s**3 + 30 * s**4) / HORIZON
    ax = GOAL[0] * (60 * s - 180 * s**2 + 120 * s**3) / HORIZON**2
    y = c * 64 * s**3 * (1 - s) ** 3
    vy = c * 64 * 3 * s**2 * (1 - s) ** 2 * (1 - 2 * s) / HORIZON
    ay = c * 64 * 6 * s * (1 - s) * (1 - 5 * s + 5 * s**2) / HORIZON**2
    return ca.vertcat(x, y, vx, vy), ca.vertcat(ax, ay)


@pytest.fixture(scope="module")
def family(problem: OptimalControlProblem) -> TrajectoryFamily:
    c, x0 = ca.SX.sym("c"), ca.SX.sym("x0", 4)
    states, controls = zip(*[curve(c, float(t)) for t in problem.times], strict=True)
    return TrajectoryFamily(
        box=Box(lower=np.array([-3.0]), upper=np.array([3.0])),
        trajectory=ca.Function(
            "curve",
            [c, x0, ca.SX.sym("p", 0)],
            [ca.horzcat(*states), ca.horzcat(*controls)],
        ),
    )


def members(problem: OptimalControlProblem, family: TrajectoryFamily) -> FamilySpace:
    """Return the search space of a family's members."""
    return FamilySpace(Fitness(problem, backend="casadi"), family)


def value(space: FamilySpace, c: float) -> tuple[float, float]:
    cost, violation = space.objective(X0, Known())(np.array([[c]]))
    return float(cost[0]), float(violation[0])


@pytest.mark.parametrize("c", [0.0, 1.0, -2.0])
def test_cost_and_violation_are_the_problems_on_the_curve(
    problem: OptimalControlProblem, family: TrajectoryFamily, c: float
) -> None:
    points = [
        tuple(np.array(part).ravel() for part in curve(ca.DM(c), float(t)))
        for t in problem.times
    ]
    squares = [float(u @ u) for _, u in points]
    cost, violation = value(members(problem, family), c)
    assert cost == pytest.approx(np.trapezoid(squares, problem.times), rel=1e-12)
    centre = np.array([2.0, 0.3])
    near = [max(1.0 - float(np.hypot(*(x[:2] - centre))), 0.0) for x, _ in points[1:]]
    assert violation == pytest.approx(sum(near), abs=1e-12)
    assert (violation == 0) == (c == -2.0)


def test_first_and_last_node_weigh_half(
    problem: OptimalControlProblem, family: TrajectoryFamily
) -> None:
    """The curve rests at both ends, so its own cost does not show their weights."""
    steady = replace(problem, stage_cost=ca.SX(3))
    cost, _ = value(members(steady, family), 1.0)
    assert cost == pytest.approx(3 * HORIZON, rel=1e-14)


def test_controls_out_of_their_bounds_count_in_parts_of_the_range(
    problem: OptimalControlProblem, family: TrajectoryFamily
) -> None:
    tight = replace(problem, bounds=Bounds(controls=(-0.5, 0.5)), constraints=[])
    over = [
        np.maximum(np.abs(np.array(curve(ca.DM(1.0), float(t))[1])) - 0.5, 0).sum()
        for t in problem.times
    ]
    _, violation = value(members(tight, family), 1.0)
    assert violation == pytest.approx(sum(over) / 1.0, rel=1e-12)


def test_a_member_is_decoded_to_states_and_mean_controls(
    problem: OptimalControlProblem, family: TrajectoryFamily
) -> None:
    start = members(problem, family).decoded(np.array([1.0]), X0, Known())
    states, controls = family.trajectory(1.0, X0, [])
    assert start.states is not None
    np.testing.assert_array_equal(start.states, np.array(states))
    first = np.array(controls)[:, : CHECKS + 1].mean(axis=1)
    np.testing.assert_allclose(start.controls[:, 0], first, rtol=1e-14)
    assert start.controls.shape == (2, INTERVALS)


def settings(evaluations: int = 200) -> SearchSettings:
    return SearchSettings(
        algorithm=LSHADE(size=20), budget=Budget(evaluations=evaluations), basins=3
    )


def test_search_in_the_family_and_polish_pass_the_disc_on_the_shorter_side(
    problem: OptimalControlProblem, family: TrajectoryFamily
) -> None:
    """The disc's centre lies above the straight line: below is cheaper."""
    planner = Planner(problem, search=settings(), polish=IpoptOptions(), family=family)
    plan = planner.plan(X0, rng=np.random.default_rng(0))
    assert (plan.feasible, plan.source) == (True, Source.POLISH)
    assert plan.polish_status is PolishStatus.CONVERGED
    middle = plan.states[:, plan.states.shape[1] // 2]
    assert middle[1] == pytest.approx(-0.7, abs=1e-3)
    # Held controls and free curves are better than the one curve of the family.
    assert plan.cost < plan.search.cost


def test_a_search_alone_says_what_its_controls_reach(
    problem: OptimalControlProblem, family: TrajectoryFamily
) -> None:
    plan = Planner(problem, search=settings(), family=family).plan(
        X0, rng=np.random.default_rng(0)
    )
    assert plan.source is Source.SEARCH
    assert plan.search.violation == pytest.approx(0.0, abs=1e-9)
    assert plan.violation > problem.tolerance and not plan.feasible


def test_refuses_what_does_not_fit(
    problem: OptimalControlProblem, family: TrajectoryFamily
) -> None:
    wrong = TrajectoryFamily(
        box=Box(lower=np.zeros(2), upper=np.ones(2)), trajectory=family.trajectory
    )
    with pytest.raises(InvalidProblemError, match="a family must map coefficients"):
        members(problem, wrong)
    planner = Planner(problem, search=settings(), family=family)
    guess = np.zeros((2, INTERVALS))
    with pytest.raises(InvalidProblemError, match="takes no guess of controls"):
        planner.plan(X0, guess=guess, rng=np.random.default_rng(0))
