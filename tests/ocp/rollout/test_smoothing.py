"""Kinks rounded less and less: values, sizes, least fuel against a linear program."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from swarmstart.ocp import (
    Bounds,
    Model,
    OptimalControlProblem,
    Planner,
    SolutionStatus,
    Source,
    solve,
    verified,
)
from swarmstart.ocp.rollout.fitness import NOTHING
from swarmstart.ocp.rollout.kinks import kink_sizes, kinks_of, smoothed


def kinked(unit: float = 1.0) -> OptimalControlProblem:
    """fabs in the cost, fmax in the model, fmin in a constraint; no kink in the end."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    force = ca.fmax(u, -unit) - x[1]
    return OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], force)),
        horizon=2.0,
        intervals=4,
        stage_cost=ca.fabs(u) + ca.sin(x[0] / unit) ** 2,
        bounds=Bounds(controls=(-3 * unit, 2 * unit)),
        constraints=[ca.fmin(x[0], 4 * unit) <= 3 * unit],
        terminal=[x[1]],
    )


def test_kinks_have_the_sizes_of_what_they_compare() -> None:
    sizes = kink_sizes(kinked(), [1.0, 0.0], NOTHING)
    # |u| up to 3; u + 1 up to 3 and -2; x - 4 from about x = 1.
    assert sorted(sizes)[1:] == pytest.approx([3.0, 3.4], abs=0.5)
    scaled = kink_sizes(kinked(2.0**9), [2.0**9, 0.0], NOTHING)
    np.testing.assert_array_equal(np.array(scaled), 2.0**9 * np.array(sizes))


@pytest.mark.parametrize(
    ("side", "size"),
    [
        (lambda x, u: 0 * u, None),  # No kink: it is constant.
        (lambda x, u: x[1] ** 2 * u, 1.0),  # 0 at all points,
        (lambda x, u: ca.log(x[1] - 9), 1.0),  # no number at any of them,
        (lambda x, u: 1 / x[1], 1.0),  # or infinite.
        (lambda x, u: u, 3.0),
        (lambda x, u: u + 1, 3.0),  # From -2 to 3.
        (lambda x, u: x[0] - 5, 4.0 + 0.382 * 8),  # x_0 is 1, and 8 its size.
        (lambda x, u: x[0] + 5, 6.0 + 0.618 * 8),
    ],
)
def test_size_of_a_kink_is_the_largest_of_its_side_about_the_start(
    side: Callable[[ca.SX, ca.SX], ca.SX], size: float | None
) -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(u, 0)),
        horizon=2.0,
        intervals=4,
        stage_cost=ca.fabs(side(x, u)),
        bounds=Bounds(controls=(-3, 2)),
        scales={"x_0": 8.0, "x_1": 1e-300},
    )
    sizes = kink_sizes(problem, [1.0, 0.0], NOTHING)
    assert sizes == pytest.approx([] if size is None else [size])


def test_no_kink_is_left_in_the_model_the_costs_or_the_constraints() -> None:
    problem = kinked()
    assert len(kinks_of(problem).names) == 3
    sizes = kink_sizes(problem, [1.0, 0.0], NOTHING)
    assert not kinks_of(smoothed(problem, sizes, 1e-3)).names


@given(
    place=st.floats(-5, 5), speed=st.floats(-5, 5), push=st.floats(-3, 2),
    part=st.sampled_from([1e-1, 1e-3, 1e-5]),
)  # fmt: skip
@settings(deadline=None, max_examples=40)
def test_rounding_changes_values_by_the_width_at_most(
    place: float, speed: float, push: float, part: float
) -> None:
    problem = kinked()
    sizes = kink_sizes(problem, [1.0, 0.0], NOTHING)
    rounded = smoothed(problem, sizes, part)
    for one, other in (
        (problem.stage_cost, rounded.stage_cost),
        (problem.model.ode, rounded.model.ode),
        (problem.stated[0].expression, rounded.stated[0].expression),
    ):
        symbols = [problem.model.states, problem.model.controls]
        both = ca.Function("both", symbols, [one - other])
        off = np.abs(np.array(both([place, speed], push)))
        assert off.max() <= part * max(sizes) * (1 + 1e-9)


def test_a_problem_without_kinks_stays_as_it_is() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u - ca.sin(x)),
        horizon=1.0,
        intervals=2,
        stage_cost=u**2,
        bounds=Bounds(controls=(-1, 1)),
    )
    assert kink_sizes(problem, [0.0], NOTHING) == []
    same = smoothed(problem, [], 0.1)
    assert str(same.model.ode) == str(problem.model.ode)


def least_fuel(distance: float, intervals: int, horizon: float) -> float:
    """Return the least integral of |u| from rest to rest, |u| <= 1, by an LP."""
    h = horizon / intervals
    to_end = horizon - h * (np.arange(intervals) + 0.5)
    ends = np.vstack([h * to_end, np.full(intervals, h)])
    found = linprog(
        np.full(2 * intervals, h),
        A_eq=np.hstack([ends, -ends]),
        b_eq=[distance, 0.0],
        bounds=(0, 1),
    )
    return float(found.fun)


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_least_fuel_is_that_of_a_linear_program(unit: float) -> None:
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=ca.vertcat(x[1], u)),
        horizon=4.0,
        intervals=24,
        stage_cost=ca.fabs(u),
        bounds=Bounds(controls=(-unit, unit)),
        terminal=[x - ca.vertcat(1.5 * unit, 0)],
    )
    solution = solve(problem, [0, 0], seed=0)
    assert solution.status is SolutionStatus.FEASIBLE  # Never a smooth optimum.
    assert solution.cost == pytest.approx(unit * least_fuel(1.5, 24, 4.0), rel=1e-3)


def test_an_answer_on_the_edge_of_a_jump_is_a_mismatch() -> None:
    """Short of x = 1 the charge is 1, up to rounding; four steps of 0.25 end there."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=4.0,
        intervals=4,
        stage_cost=0.1 * u**2,
        terminal_cost=ca.if_else(x < 1 - 1e-10, 1, 0),
        bounds=Bounds(controls=(-1, 1)),
    )
    planner = Planner(problem, search=None)

    def status(push: float) -> SolutionStatus:
        plan = planner.evaluated(np.full((1, 4), push), [0.0], source=Source.GUESS)
        solution = verified(problem, plan, [0.0])
        if push == 0.25:
            assert "on the edge of" in solution.reason
        return solution.status

    assert status(0.25) is SolutionStatus.MISMATCH
    assert status(0.2501) is SolutionStatus.FEASIBLE
    assert status(0.2499) is SolutionStatus.FEASIBLE
