"""Measurement of broken constraints: amounts, scales, times and names."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Bounds,
    Model,
    OptimalControlProblem,
    PathConstraint,
    SolutionStatus,
    TerminalConstraint,
    disc,
    solve,
)
from swarmstart.ocp.rollout.checking import Checker, Excess, Points
from swarmstart.ocp.rollout.scaling import Sizes, Sizing

NONE = np.empty(0)
X, U, S = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("s")


def posed(**stated: object) -> OptimalControlProblem:
    given = {"horizon": 2.0, "intervals": 4, "stage_cost": U**2, **stated}
    return OptimalControlProblem(
        Model(states=X, controls=U, ode=ca.vertcat(X[1], U)),
        **given,  # type: ignore[arg-type]
    )


def sizes_of(problem: OptimalControlProblem, x0: Array) -> Sizes:
    return Sizing(problem)(x0, NONE, np.zeros((problem.ns, problem.nodes)))


def at_start(problem: OptimalControlProblem, x0: list[float]) -> list[Excess]:
    start = np.array(x0, dtype=np.float64)
    sizes = sizes_of(problem, start)
    return Checker(problem).at_start(start, NONE, np.zeros(problem.ns), lambda: sizes)


def along(
    problem: OptimalControlProblem,
    states: list[list[float]],
    controls: list[float] | None = None,
    outside: list[Excess] | None = None,
) -> list[Excess]:
    """Return the excesses of a path at 0, 1, 2, ... s."""
    x = np.array(states, dtype=np.float64)
    count = x.shape[1]
    u = np.zeros((1, count)) if controls is None else np.array([controls])
    points = Points(np.arange(float(count)), x, u, np.zeros((problem.ns, count)))
    sizes = sizes_of(problem, x[:, 0])
    return Checker(problem).along(points, NONE, sizes, outside=outside or [])


def test_worst_place_of_each_row_is_told_with_its_side_and_scale() -> None:
    stated = PathConstraint(
        expression=X, lower=[-1, -2], upper=[1, 2], scale=[0.5, 4], name="box"
    )
    # The worst first, relative to the scales.
    below, above = along(posed(constraints=[stated]), [[0, 1.5, -3, 0], [0, 3, 6, -1]])
    assert (below.amount, below.scale, below.relative) == (2, 0.5, 4)
    assert (below.time, below.row, below.above) == (2, 0, False)
    assert (above.amount, above.scale, above.relative) == (4, 4, 1)
    assert (above.time, above.row, above.above) == (2, 1, True)
    assert (below.constraint, above.constraint) == (0, 0)
    assert below.name == "'box' (x_0)"
    assert str(above) == ("'box' (x_1) is broken by 4 (1 of its scale 4) at 2 s")


@given(
    values=st.lists(st.floats(-5, 5), min_size=2, max_size=6),
    lower=st.floats(-3, 0),
    width=st.floats(0, 4),
)
@settings(max_examples=20, deadline=None)
def test_excess_is_the_largest_distance_from_the_range(
    values: list[float], lower: float, width: float
) -> None:
    upper = lower + width
    stated = PathConstraint(expression=X[0], lower=lower, upper=upper, scale=2)
    found = along(posed(constraints=[stated]), [values, [0.0] * len(values)])
    # `outside` reports the excess at the start, not this function.
    beyond = [max(lower - v, v - upper) for v in values[1:]]
    if max(beyond) <= 0:
        assert found == []
        return
    assert found[0].amount == max(beyond)
    assert found[0].time == 1 + int(np.argmax(beyond))
    assert found[0].above == (values[int(found[0].time)] > upper)


def test_names_tell_the_constraint_and_the_row() -> None:
    problem = posed(
        bounds=Bounds(states=([-1, -np.inf], [1, 3])),
        constraints=[
            disc(X, centre=[9, 9], radius=99, name="house"),
            X[0] - X[1] <= -9,
            PathConstraint(expression=ca.vertcat(X[0] + 1, X[1]), upper=-9),
            PathConstraint(expression=X, upper=-9, name="low"),
        ],
    )
    found = {e.name for e in along(problem, [[0, 5], [0, 5]])}
    assert found == {
        "'house'",
        "'((x_0-x_1)<=-9)'",
        "row 0 of '[(x_0+1), x_1]'",
        "row 1 of '[(x_0+1), x_1]'",
        "'low' (x_0)",
        "'low' (x_1)",
        "the bound of state x_0",
        "the bound of state x_1",
    }


def test_bound_of_the_second_state_alone_is_named_after_it() -> None:
    problem = posed(bounds=Bounds(states=([-np.inf, 0], np.inf)))
    (found,) = along(problem, [[0, -9, 0], [0, 1, -2]])
    assert found.name == "the bound of state x_1"
    assert (found.amount, found.time, found.above, found.row) == (2, 2, False, 0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_value_that_is_no_number_is_broken_without_end(value: float) -> None:
    problem = posed(constraints=[X[0] <= 1, PathConstraint(expression=X[1])])
    (found,) = along(problem, [[0, value, 0], [0, value, 0]])
    assert found.amount == np.inf
    assert found.time == 1
    assert found.name == "'(x_0<=1)'"


def test_rows_without_limits_are_never_broken() -> None:
    problem = posed(constraints=[PathConstraint(expression=X)], terminal=[])
    assert along(problem, [[0, 1e9], [0, -1e9]]) == []
    assert along(posed(), [[0, 1e9], [0, -1e9]]) == []
    assert at_start(posed(), [1e9, 0]) == []
    assert not Checker(posed()).looks_at_start


def test_start_is_judged_by_what_no_control_enters() -> None:
    rows = ca.vertcat(X[0], X[0] + U, X[1])
    problem = posed(
        constraints=[PathConstraint(expression=rows, upper=1), U - 10 >= X[0]]
    )
    found = at_start(problem, [3, 2])
    assert [(e.row, e.amount, e.time) for e in found] == [(0, 2, 0), (2, 1, 0)]
    assert at_start(problem, [1, 1]) == []
    assert not Checker(posed(constraints=[X[0] + U <= 1])).looks_at_start


def test_row_with_controls_counts_at_the_start_of_a_path() -> None:
    problem = posed(constraints=[X[0] + U <= 1])
    (found,) = along(problem, [[0, 0], [0, 0]], controls=[5, 0])
    assert (found.amount, found.time) == (4, 0)


def test_start_outside_by_less_than_the_tolerance_is_inside() -> None:
    problem = posed(constraints=[PathConstraint(expression=X[0], upper=1, scale=2)])
    assert at_start(problem, [1 + 1e-6, 0]) == []
    assert at_start(replace(problem, tolerance=1e-9), [1 + 1e-6, 0]) != []


@pytest.mark.parametrize(
    ("path", "told"),
    [
        ([3, 2.5, 1.2, 0.9, 0.5], None),  # Back inside, and it stays.
        ([3, 2.5, 1.2, 0.9, 1.5], (0.5, 4)),  # Out again.
        ([3, 2.5, 3.5, 0.9, 0.5], (2.5, 2)),  # Farther out than at the start.
        ([3, 3, 2, 2, 2], (2, 1)),  # Never worse, but never inside.
        ([3, 4, 5, 6, 7], (6, 4)),
    ],
)
def test_start_outside_may_come_back_inside(
    path: list[float], told: tuple[float, float] | None
) -> None:
    problem = posed(constraints=[PathConstraint(expression=X[0], upper=1, scale=1)])
    outside = at_start(problem, [path[0], 0])
    assert outside[0].amount == path[0] - 1
    found = along(problem, [path, [0] * 5], outside=outside)
    assert [(e.amount, e.time) for e in found] == ([] if told is None else [told])


def test_start_outside_by_the_tolerance_itself_is_inside() -> None:
    edge = 2.0**-10
    row = PathConstraint(expression=X[0], upper=1, scale=2)
    problem = posed(constraints=[row], tolerance=edge)
    assert at_start(problem, [1 + 2 * edge, 0]) == []
    assert len(at_start(problem, [1 + 2 * edge + 1e-9, 0])) == 1


@pytest.mark.parametrize(("beyond", "count"), [(0.0, 0), (1e-9, 1)])
def test_excess_of_a_start_outside_may_grow_by_the_path_tolerance_itself(
    beyond: float, count: int
) -> None:
    row = PathConstraint(expression=X[0], upper=1, scale=1)
    problem = posed(constraints=[row], path_tolerance=2.0**-4)
    outside = at_start(problem, [3, 0])
    path = [3, 1 + 2 * (1 + 2.0**-4) + beyond, 0.9]
    assert len(along(problem, [path, [0] * 3], outside=outside)) == count


def test_state_after_the_last_jump_counts_but_for_rows_with_controls() -> None:
    """The parameter is 2; at the end x jumps from (0, 0) to (5, 7)."""
    p = ca.SX.sym("p")
    problem = OptimalControlProblem(
        Model(states=X, controls=U, parameters=p, ode=ca.vertcat(X[1], U)),
        horizon=2.0,
        intervals=4,
        constraints=[
            PathConstraint(expression=p * X[0], upper=1, scale=1),
            PathConstraint(expression=X[1] + U, upper=1, scale=1),
        ],
    )
    parameter, none = np.array([2.0]), np.empty((0, 3))
    sizes = Sizing(problem)(np.zeros(2), parameter, np.empty((0, problem.nodes)))
    points = Points(np.arange(3.0), np.zeros((2, 3)), np.zeros((1, 3)), none)
    left = Points(np.array([2.0]), np.array([[5.0], [7.0]]), np.zeros((1, 1)),
                  none[:, :1])  # fmt: skip
    checker = Checker(problem)
    assert checker.along(points, parameter, sizes, outside=[]) == []
    (found,) = checker.along(points, parameter, sizes, outside=[], left=left)
    assert (found.constraint, found.amount, found.time) == (0, 9.0, 2.0)
    (first,) = checker.at_start(np.ones(2), parameter, np.empty(0), lambda: sizes)
    assert (first.constraint, first.amount) == (0, 1.0)


def test_answer_from_a_start_outside_is_confirmed_once_it_is_inside() -> None:
    """Such an answer used to count as broken between the checks."""
    problem = posed(
        bounds=Bounds(controls=(-9, 9), states=([-1, -np.inf], [1, np.inf])),
        terminal_cost=X[0] ** 2,
    )
    found = solve(
        problem, [1.05, 0], start="may violate", search=None, backend="casadi", seed=0
    )
    assert found.status is SolutionStatus.CONVERGED
    assert found.reason.startswith("the start is outside: the bound of state x_0")
    assert found.plan.start_excess == pytest.approx(0.05 / 2)


def test_end_is_judged_by_the_terminal_rows() -> None:
    problem = posed(
        constraints=[X[0] <= 9],
        terminal=[
            TerminalConstraint(expression=X, lower=[0, -1], upper=[0, 1], name="goal")
        ],
    )
    sizes = sizes_of(problem, np.array([4.0, 0]))
    checker = Checker(problem)
    found = checker.at_end(np.array([-3.0, 2.0]), NONE, NONE, sizes, 2.0)
    assert {(e.name, e.amount, e.above) for e in found} == {
        ("'goal' (x_0)", 3, False),
        ("'goal' (x_1)", 1, True),
    }
    assert all((e.constraint, e.time) == (1, 2.0) for e in found)
    assert checker.at_end(np.array([0.0, -1.0]), NONE, NONE, sizes, 2.0) == []


def test_slack_is_how_far_inside_each_row_is_at_least() -> None:
    rows = PathConstraint(expression=X, lower=[-4, -np.inf], upper=[4, 9])
    problem = posed(constraints=[rows, X[0] + U <= 5])
    points = Points(
        np.arange(3.0), np.array([[0, 3, -3.5], [0, 1, 2]]), np.array([[0, 1, 0.0]]),
        np.empty((0, 3)),
    )  # fmt: skip
    found = Checker(problem).slack(points, NONE)
    assert found == {(0, 0): 0.5, (0, 1): 7.0, (1, 0): 1.0}
    beyond = replace(points, states=points.states + 3)
    assert Checker(problem).slack(beyond, NONE)[0, 0] == -2
    assert Checker(posed()).slack(points, NONE) == {}


def test_signals_move_limits() -> None:
    problem = posed(signals=S, constraints=[X[0] <= S])
    assert at_start(problem, [0, 0]) == []
    found = at_start(problem, [1, 0])
    assert found[0].amount == 1
