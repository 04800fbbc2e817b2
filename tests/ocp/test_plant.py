"""The plant against scipy, and its parameters."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.ocp import (
    Bounds,
    InvalidProblemError,
    IpoptOptions,
    Model,
    OptimalControlProblem,
    Planner,
    Plant,
    RecedingHorizon,
    simulate,
)


@pytest.fixture(scope="module")
def plant(pendulum: Model) -> Plant:
    return Plant(pendulum, dt=0.2, substeps=10)


def test_plant_is_what_scipy_integrates(plant: Plant) -> None:
    states = plant(np.array([1.0, -0.5]), np.array([2.0]))
    exact = solve_ivp(
        lambda _, y: [y[1], 2 - 9.81 * np.sin(y[0])],
        (0, 0.2),
        [1.0, -0.5],
        t_eval=0.02 * np.arange(1, 11),
        rtol=1e-12,
        atol=1e-12,
    )
    # Ten RK4 steps of 20 ms.
    np.testing.assert_allclose(states, exact.y, atol=1e-7)


@pytest.mark.parametrize(
    ("dt", "substeps", "message"),
    [
        (0.2, 0, "substeps must be an integer of at least 1, got 0"),
        (-0.2, 4, "dt must be positive, got -0.2"),
    ],
)
def test_refuses_what_is_no_plant(
    pendulum: Model, dt: float, substeps: int, message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        Plant(pendulum, dt=dt, substeps=substeps)


def test_a_plants_parameters_are_held_over_each_of_its_steps() -> None:
    """x' = p: the integral of a staircase."""
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    model = Model(states=x, controls=ca.SX.sym("u"), parameters=p, ode=p)
    plant = Plant(model, dt=0.5, substeps=5, parameters=lambda t: 10 * t[None])
    dense = plant(np.array([1.0]), np.zeros(1), 2.0)
    steps = 10 * (2.0 + 0.1 * np.arange(5)) * 0.1
    np.testing.assert_allclose(dense[0], 1 + np.cumsum(steps), rtol=1e-14)


def test_refuses_a_plant_whose_parameters_nobody_gives() -> None:
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    model = Model(states=x, controls=ca.SX.sym("u"), parameters=p, ode=p * x)
    with pytest.raises(InvalidProblemError, match="has 1 parameters: expected a func"):
        Plant(model, dt=0.1, substeps=1)


def test_signals_of_costs_alone_are_none_of_the_model() -> None:
    """x' = t, beside a signal that no rate depends on."""
    x, t = ca.SX.sym("x"), ca.SX.sym("t")
    model = Model(states=x, controls=ca.SX.sym("u"), ode=t, time=t)
    plant = Plant(model, dt=0.5, substeps=5, signals=lambda at: np.ones((3, at.size)))
    dense = plant(np.array([0.0]), np.zeros(1), 2.0)
    assert dense[0, -1] == pytest.approx((2.5**2 - 2**2) / 2)


def test_clock_is_the_time_of_a_flight() -> None:
    """s' = 3: three seconds pass in each of the plant's."""
    s, u = ca.SX.sym("s"), ca.SX.sym("u")
    model = Model(states=s, controls=u, ode=ca.SX(3))
    one = OptimalControlProblem(
        model, horizon=1.0, intervals=2, bounds=Bounds(controls=(-1, 1))
    )
    plant = Plant(model, dt=0.5, substeps=5, clock="s")
    loop = RecedingHorizon(planner=Planner(one, search=None, polish=IpoptOptions()))
    flight = simulate(plant, loop, [0.5], steps=2, seed=0)
    np.testing.assert_allclose(flight.times, [0.5, 2.0, 3.5])
    np.testing.assert_allclose(flight.dense_times, 0.5 + 0.3 * np.arange(11))
    assert plant.with_interval(0.25).clock == "s"
    with pytest.raises(InvalidProblemError, match="clock must name a state, one of s"):
        Plant(model, dt=0.5, substeps=5, clock="time")
