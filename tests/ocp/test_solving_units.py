"""The same problem in other units has the same answer.

A problem is restated with z = c x for every state and control, and with its cost
multiplied by a factor. Sizes are homogeneous (test_scaling.py), and so is all that
depends on them.
"""

from collections.abc import Callable
from typing import NamedTuple

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
    Solution,
    disc,
    solve,
)


class Units(NamedTuple):
    """Ratio of new to old unit, of each state, each control and the cost."""

    states: Array
    controls: Array
    cost: float


Stated = Callable[[Units], tuple[OptimalControlProblem, Array]]


def pendulum(units: Units) -> tuple[OptimalControlProblem, Array]:
    """Half a swing with a bounded torque."""
    z, v = ca.SX.sym("z", 2), ca.SX.sym("v")
    x, u = z / units.states, v / units.controls
    ode = ca.vertcat(x[1], u - 9.81 * ca.sin(x[0])) * units.states
    problem = OptimalControlProblem(
        Model(states=z, controls=v, ode=ode),
        horizon=1.5,
        intervals=8,
        stage_cost=units.cost * (u**2 + x[1] ** 2),
        bounds=Bounds(controls=(-6 * units.controls, 6 * units.controls)),
        terminal=[z - units.states * np.array([0.7, 0.5])],
    )
    return problem, np.zeros(2)


def unicycle(units: Units) -> tuple[OptimalControlProblem, Array]:
    """Around a disc, with the position in two different units."""
    z, v = ca.SX.sym("z", 3), ca.SX.sym("v", 2)
    x, u = z / units.states, v / units.controls
    ode = ca.vertcat(u[0] * ca.cos(x[2]), u[0] * ca.sin(x[2]), u[1]) * units.states
    problem = OptimalControlProblem(
        Model(states=z, controls=v, ode=ode),
        horizon=4.0,
        intervals=6,
        stage_cost=units.cost * (u[0] ** 2 + u[1] ** 2),
        bounds=Bounds(
            controls=(np.array([0.5, -1]) * units.controls,
                      np.array([2, 1]) * units.controls)
        ),
        constraints=[disc(x[:2], centre=[2, 0.3], radius=0.8)],
        terminal=[z[:2] - units.states[:2] * np.array([4, 0])],
        checks=2,
    )  # fmt: skip
    return problem, np.zeros(3)


def double_integrator(units: Units) -> tuple[OptimalControlProblem, Array]:
    """To a place with a bound on the speed, and one on the sum of speed and push."""
    z, v = ca.SX.sym("z", 2), ca.SX.sym("v")
    x, u = z / units.states, v / units.controls
    speed = 0.8 * units.states[1]
    problem = OptimalControlProblem(
        Model(states=z, controls=v, ode=ca.vertcat(x[1], u) * units.states),
        horizon=3.0,
        intervals=8,
        stage_cost=units.cost * u**2,
        terminal_cost=units.cost * 10 * (x[0] - 2) ** 2,
        bounds=Bounds(
            controls=(-units.controls, units.controls),
            states=([-np.inf, -speed], [np.inf, speed]),
        ),
        constraints=[
            PathConstraint(expression=z[1] / units.states[1] + u / 2, upper=0.9)
        ],
    )
    return problem, np.zeros(2)


PROBLEMS: dict[str, tuple[Stated, int, int]] = {
    "pendulum": (pendulum, 2, 1),
    "unicycle": (unicycle, 3, 2),
    "double_integrator": (double_integrator, 2, 1),
}


def answer(
    name: str, units: Units, search: str | None, polish: str | None = "ipopt"
) -> Solution:
    problem, x0 = PROBLEMS[name][0](units)
    guess = np.tile(units.controls[:, None] * 0.3, (1, problem.intervals))
    return solve(
        problem, units.states * x0, search=search, budget=400, polish=polish,
        guess=guess, backend="casadi", seed=3,
    )  # fmt: skip


def plain(name: str) -> Units:
    _, nx, nu = PROBLEMS[name]
    return Units(np.ones(nx), np.ones(nu), 1.0)


@pytest.fixture(scope="module")
def in_old_units() -> Callable[[str, str | None, str | None], Solution]:
    """Return answers in the old units, each solved once."""
    known: dict[tuple[str, str | None, str | None], Solution] = {}

    def found(name: str, search: str | None, polish: str | None) -> Solution:
        key = name, search, polish
        if key not in known:
            known[key] = answer(name, plain(name), search, polish)
        return known[key]

    return found


exponents = st.lists(st.floats(-3, 3), min_size=5, max_size=5)


@pytest.mark.parametrize("name", PROBLEMS)
@given(drawn=exponents, cost=st.floats(-8, 8))
@settings(max_examples=6, deadline=None)
def test_answer_does_not_depend_on_units(
    in_old_units: Callable[..., Solution], name: str, drawn: list[float], cost: float
) -> None:
    _, nx, nu = PROBLEMS[name]
    tens = 10.0 ** np.array(drawn)
    units = Units(tens[:nx], tens[nx : nx + nu], 10.0**cost)
    old, new = in_old_units(name, None, "ipopt"), answer(name, units, None)
    assert new.status is old.status
    assert new.plan.feasible
    assert new.cost == pytest.approx(units.cost * old.cost, rel=1e-8)
    moved = new.controls / units.controls[:, None]
    np.testing.assert_allclose(moved, old.controls, atol=1e-6)


powers = st.integers(-20, 20).map(lambda k: 2.0**k)


@pytest.mark.parametrize("name", PROBLEMS)
@pytest.mark.parametrize("polish", [None, "ipopt"])
@given(cost=powers)
@settings(max_examples=3, deadline=None)
def test_power_of_two_before_the_cost_changes_no_bit(
    in_old_units: Callable[..., Solution], name: str, polish: str | None, cost: float
) -> None:
    old = in_old_units(name, "lshade", polish)
    new = answer(name, plain(name)._replace(cost=cost), "lshade", polish)
    np.testing.assert_array_equal(new.controls, old.controls)
    assert new.cost == cost * old.cost
    assert new.violation == old.violation
    assert new.status is old.status


@pytest.mark.parametrize("name", PROBLEMS)
@given(drawn=st.lists(powers, min_size=5, max_size=5))
@settings(max_examples=3, deadline=None)
def test_conversions_by_powers_of_two_change_the_last_bits_of_the_polish_only(
    in_old_units: Callable[..., Solution], name: str, drawn: list[float]
) -> None:
    """In the polish, CasADi adds the derivatives of x / c in another order."""
    _, nx, nu = PROBLEMS[name]
    twos = np.array(drawn)
    units = Units(twos[:nx], twos[nx : nx + nu], 1.0)
    for polish in (None, "ipopt"):
        old = in_old_units(name, "lshade", polish)
        new = answer(name, units, "lshade", polish)
        moved = new.controls / units.controls[:, None]
        if polish is None:
            np.testing.assert_array_equal(moved, old.controls)
            assert new.violation == old.violation
        else:
            np.testing.assert_allclose(moved, old.controls, rtol=0, atol=1e-12)


@given(length=powers)
@settings(max_examples=3, deadline=None)
def test_unit_of_length_of_a_model_without_conversions_changes_no_bit(
    length: float,
) -> None:
    """A unicycle has no length: only its speeds, places and discs are larger."""

    def solved(unit: float) -> Solution:
        x, u = ca.SX.sym("x", 3), ca.SX.sym("u", 2)
        problem = OptimalControlProblem(
            Model(
                states=x, controls=u,
                ode=ca.vertcat(u[0] * ca.cos(x[2]), u[0] * ca.sin(x[2]), u[1]),
            ),
            horizon=4.0, intervals=6, stage_cost=u[1] ** 2,
            bounds=Bounds(controls=([0.5 * unit, -1], [2 * unit, 1])),
            constraints=[disc(x[:2], centre=[2 * unit, 0.25 * unit], radius=unit)],
            terminal=[x[:2] - ca.vertcat(4 * unit, 0)], checks=2,
        )  # fmt: skip
        return solve(
            problem, [0, 0, 0], search="lshade", budget=400, backend="casadi", seed=1
        )

    old, new = solved(1.0), solved(length)
    np.testing.assert_array_equal(new.controls, old.controls * [[length], [1]])
    np.testing.assert_array_equal(new.states[:2], old.states[:2] * length)
    assert (new.cost, new.violation) == (old.cost, old.violation)
    assert new.status is old.status
