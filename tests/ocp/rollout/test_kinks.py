"""Kinks and jumps: found in every expression, touched if a path is on one."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.ocp import (
    Bounds,
    Model,
    OptimalControlProblem,
    PathConstraint,
    SolutionStatus,
    TerminalConstraint,
    solve,
)
from swarmstart.ocp.rollout.kinks import kinks_of, without_kink

X, U = ca.SX.sym("x", 2), ca.SX.sym("u")
OPERATIONS: dict[str, Callable[[ca.SX], ca.SX]] = {
    "fabs": ca.fabs,
    "sign": ca.sign,
    "fmin": lambda v: ca.fmin(v, 0),
    "fmax": lambda v: ca.fmax(0, v),
    "if": lambda v: ca.if_else(v > 0, v**2, v),
    "floor": ca.floor,
    "ceil": ca.ceil,
    "copysign": lambda v: ca.copysign(3, v),
    "fmod": lambda v: ca.fmod(v, 1),
    "remainder": lambda v: ca.remainder(v, 1),
}
NEXT_JUMP = {"floor": 1.0, "ceil": 1.0, "fmod": 1.0, "remainder": 0.5}
"""Operations that switch at every whole number; all others switch at zero."""


NOTHING = ca.SX(0)


def stated(
    *,
    ode: ca.SX = NOTHING,
    cost: ca.SX = NOTHING,
    path: ca.SX = NOTHING,
    end: ca.SX = NOTHING,
    goal: ca.SX = NOTHING,
) -> OptimalControlProblem:
    return OptimalControlProblem(
        Model(states=X, controls=U, ode=ca.vertcat(X[1] + ode, U)),
        horizon=1.0,
        intervals=2,
        stage_cost=U**2 + cost,
        terminal_cost=X[0] + end,
        bounds=Bounds(controls=(-1, 1)),
        constraints=[PathConstraint(expression=X[0] + path, upper=9)],
        terminal=[TerminalConstraint(expression=X[1] + goal, lower=-9, upper=9)],
    )


@pytest.mark.parametrize("place", ["ode", "cost", "path", "end", "goal"])
@pytest.mark.parametrize("name", OPERATIONS)
def test_operation_is_found_in_every_expression(name: str, place: str) -> None:
    kinks = kinks_of(stated(**{place: ca.sin(OPERATIONS[name](X[0] - X[1])) * X[1]}))
    assert kinks.names
    assert all(found.startswith(f"{name}(") for found in kinks.names)


def test_smooth_expressions_have_no_kinks() -> None:
    smooth = ca.sqrt(1 + X[0] ** 2) + ca.exp(X[1]) + ca.atan2(X[0], 3 + X[1] ** 2)
    kinks = kinks_of(stated(ode=smooth, cost=smooth, path=smooth, end=smooth))
    assert kinks.names == ()
    assert kinks.touched(np.empty((0, 4)), np.empty((0, 4)), 2) == ()


def test_same_switch_counts_once_and_constant_ones_do_not() -> None:
    kinks = kinks_of(stated(cost=ca.fabs(X[0]), path=ca.fabs(X[0])))
    assert kinks.names == ("fabs(x_0)",)
    two = kinks_of(stated(cost=ca.fabs(X[0]), path=ca.fabs(X[1])))
    assert set(two.names) == {"fabs(x_0)", "fabs(x_1)"}


def test_maximum_is_named_with_both_of_its_values() -> None:
    names = kinks_of(stated(cost=ca.fmax(X[0] * U, X[1]))).names
    assert names == ("fmax((x_0*u),x_1)",)


@pytest.mark.parametrize("name", OPERATIONS)
def test_every_kink_comes_with_advice(name: str) -> None:
    (found,) = kinks_of(stated(cost=OPERATIONS[name](X[0]))).names
    slack = {"fabs": "s >= -a", "fmin": "s <= b", "fmax": "s >= b"}
    assert slack.get(name, "tanh") in without_kink(found)


def test_shared_expressions_are_looked_at_once() -> None:
    """Two to the power of 60 paths lead to the innermost expression."""
    cost = ca.fabs(X[0])
    for _ in range(60):
        cost = ca.sin(cost) * ca.cos(cost)
    assert kinks_of(stated(cost=cost)).names == ("fabs(x_0)",)


def touched(name: str, path: list[list[float]]) -> bool:
    """Return whether a path of x_0, given interval by interval, touches a switch."""
    kinks = kinks_of(stated(cost=OPERATIONS[name](X[0])))
    x = np.concatenate([np.array(path, dtype=np.float64).ravel()])
    one, nothing = np.ones((1, x.size)), np.empty((0, x.size))
    both = np.vstack([x, one])
    sides, reach = kinks.sides(both, one, nothing, nothing, np.ones((2, x.size)), one)
    return bool(kinks.touched(np.array(sides), np.array(reach), len(path)))


@given(low=st.floats(0.01, 0.4), width=st.floats(0.02, 0.45))
@settings(max_examples=10, deadline=None)
@pytest.mark.parametrize("name", OPERATIONS)
def test_path_touches_exactly_the_switches_that_it_crosses(
    name: str, low: float, width: float
) -> None:
    at = NEXT_JUMP.get(name, 0.0)
    before, after = at - 0.45 + low, at + width - 0.02
    crosses = before < at < after
    if min(abs(at - before), abs(at - after)) > 1e-5:
        assert touched(name, [[before, after], [after, after]]) == crosses
    assert not touched(name, [[at + 0.03, at + 0.04]] * 2)
    assert not touched(name, [[at - 0.03, at - 0.04]] * 2)


@pytest.mark.parametrize("name", OPERATIONS)
def test_path_that_rests_on_a_switch_touches_it(name: str) -> None:
    at = NEXT_JUMP.get(name, 0.0)
    assert touched(name, [[at - 0.3, at - 0.2], [at, at]])
    assert touched(name, [[at + 0.3, at + 0.2], [at, at]])


@pytest.mark.parametrize("name", OPERATIONS)
def test_control_that_jumps_over_a_switch_does_not_touch_it(name: str) -> None:
    at = NEXT_JUMP.get(name, 0.0)
    assert not touched(name, [[at - 0.2, at - 0.2], [at + 0.2, at + 0.2]])


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("off", "is_near"), [(0.9e-6, True), (1.1e-6, False)])
def test_a_millionth_of_its_size_from_a_switch_is_at_it(
    off: float, is_near: bool, side: int
) -> None:
    """The side of fabs is at most 1; relative to 1 that of floor is 1, and rests."""
    assert touched("fabs", [[side * off, side], [side, side]]) is is_near
    assert touched("floor", [[1 + side * off] * 2] * 2) is is_near


def test_nearness_is_counted_in_the_sizes_of_states_and_controls() -> None:
    """The side x_0 - 2 u of size 100 + 2 * 30: at it up to 160 millionths."""
    kinks = kinks_of(stated(cost=ca.fabs(X[0] - 2 * U)))
    sizes, push = np.array([[100.0], [7.0]]), np.array([[30.0]])
    for off, is_near in ((1.5e-4, True), (1.7e-4, False)):
        x = np.array([[off, off], [0.0, 0.0]])
        sides, reach = kinks.sides(
            x, np.zeros((1, 2)), np.empty((0, 2)), np.empty((0, 2)),
            np.repeat(sizes, 2, axis=1), np.repeat(push, 2, axis=1),
        )  # fmt: skip
        np.testing.assert_allclose(np.array(reach), 160.0)
        found = kinks.touched(np.array(sides), np.array(reach), 1)
        assert bool(found) is is_near


def test_path_near_a_switch_touches_it_however_small_its_own_numbers() -> None:
    assert touched("fabs", [[1e-9, 2e-9], [3e-9, 4e-9]])
    assert not touched("fabs", [[1e-5, 2e-5], [3e-5, 4e-5]])


@pytest.mark.parametrize("reach", [np.inf, np.nan])
def test_reach_that_is_no_number_leaves_the_sides_as_sizes(reach: float) -> None:
    """The root of a state that is 0 has such a slope; a millionth of 3e-7 is near."""
    kinks = kinks_of(stated(cost=ca.fabs(X[0])))
    reaches = np.full((1, 2), reach)
    for off, is_near in ((1e-7, False), (2e-13, True)):
        found = kinks.touched(np.array([[off, 3e-7]]), reaches, 1)
        assert bool(found) is is_near


def least(cost: ca.SX, bound: float = 1.0) -> SolutionStatus:
    """Return the status of min over u of the cost, x' = u from 0 over 1 s."""
    x, u = ca.SX.sym("x"), U
    problem = OptimalControlProblem(
        Model(states=x, controls=u, ode=u),
        horizon=1.0,
        intervals=2,
        stage_cost=cost,
        bounds=Bounds(controls=(-bound, bound)),
    )
    return solve(
        problem,
        [0],
        search=None,
        guess=[0.3, 0.3],
        lanes=0,
        backend="casadi",
        seed=0,
    ).status


def test_optimum_on_a_kink_is_not_called_a_local_optimum() -> None:
    """The conditions for smooth functions do not apply there, but do nearby."""
    assert least((U - 0.2) ** 2 + ca.fabs(U)) is SolutionStatus.FEASIBLE
    assert least((U - 0.75) ** 2 + ca.fabs(U)) is SolutionStatus.CONVERGED
    # Stationary from the right, but it falls on the left.
    assert least(ca.if_else(U > 0, U**2, U)) is SolutionStatus.FEASIBLE
    # Resting at its bound, the control is at a jump of floor: rounding decides.
    assert least(-U - ca.floor(U)) is SolutionStatus.MISMATCH
    assert least(-U - ca.floor(U), 0.8) is SolutionStatus.CONVERGED


def test_sides_change_with_states_and_controls_alone() -> None:
    """A parameter and a signal shift the switch; they have no size."""
    p, s = ca.SX.sym("p"), ca.SX.sym("s")
    problem = OptimalControlProblem(
        Model(states=X, controls=U, parameters=p, ode=ca.vertcat(X[1], U)),
        horizon=1.0, intervals=2, signals=s,
        stage_cost=ca.fabs(X[0] - 3 * U + 7 * p - 9 * s),
    )  # fmt: skip
    side, reach = kinks_of(problem).sides([1, 0], 2, 3, 4, [10, 1], 5)
    assert float(side) == 1 - 6 + 21 - 36
    assert float(reach) == 10 + 15
