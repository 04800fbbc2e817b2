"""The plant against SciPy, and its parameters."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.ocp import (
    AlgebraicEquations,
    Bounds,
    DivergedError,
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
        (-0.2, 4, "dt must be a finite number above 0, got -0.2"),
    ],
)
def test_refuses_what_is_no_plant(
    pendulum: Model, dt: float, substeps: int, message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        Plant(pendulum, dt=dt, substeps=substeps)


def test_a_plants_parameters_are_held_over_each_of_its_steps() -> None:
    """x' = p: the integral of a step function."""
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
    """x' = t, with a signal that no rate depends on."""
    x, t = ca.SX.sym("x"), ca.SX.sym("t")
    model = Model(states=x, controls=ca.SX.sym("u"), ode=t, time=t)
    plant = Plant(model, dt=0.5, substeps=5, signals=lambda at: np.ones((3, at.size)))
    dense = plant(np.array([0.0]), np.zeros(1), 2.0)
    assert dense[0, -1] == pytest.approx((2.5**2 - 2**2) / 2)


def test_clock_is_the_time_of_a_flight() -> None:
    """s' = 3: three seconds pass in each second of the plant."""
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


def exponential(offset: float) -> Model:
    """x' = -z with z^2 + offset = x, which has no solution below the offset."""
    x, z = ca.SX.sym("x"), ca.SX.sym("z")
    equations = AlgebraicEquations(symbols=z, residual=z**2 + offset - x, start=1.0)
    return Model(states=x, controls=ca.SX(0, 1), ode=-z, algebraic=equations)


def test_plant_with_algebraic_equations_has_its_closed_form() -> None:
    # sqrt(x)' = -1/2.
    plant = Plant(exponential(0.0), dt=0.5, substeps=20)
    end = plant(np.array([1.0]), np.empty(0))[0, -1]
    assert end == pytest.approx(0.75**2, abs=1e-8)  # Twenty RK4 steps.


def test_plant_whose_algebraic_equations_have_no_solution_says_so() -> None:
    plant = Plant(exponential(0.5), dt=1.0, substeps=20)
    solved = plant.with_interval(0.5)
    assert np.isfinite(solved(np.array([1.0]), np.empty(0))).all()
    with pytest.raises(DivergedError, match=r"not solved for z at 2\..* residual is"):
        plant(np.array([0.5 + 1e-3]), np.empty(0), 2.0)


def test_flight_ends_where_the_algebraic_equations_have_no_solution() -> None:
    model = exponential(0.5)
    problem = OptimalControlProblem(model, horizon=1.0, intervals=1)
    loop = RecedingHorizon(planner=Planner(problem, search=None))
    with pytest.raises(DivergedError, match="algebraic equations are not solved"):
        simulate(Plant(model, dt=1.0, substeps=20), loop, [1.0], steps=4, seed=0)


def test_linear_controls_end_where_the_equations_have_no_solution() -> None:
    x, z, u = (ca.SX.sym(n) for n in "xzu")
    equations = AlgebraicEquations(symbols=z, residual=z**2 - u, start=1.0)
    model = Model(states=x, controls=u, ode=z, algebraic=equations)
    plant = Plant(model, dt=1.0, substeps=10)
    assert np.isfinite(plant.along(np.zeros(1), np.linspace(1, 2, 11)[None, :])).all()
    with pytest.raises(DivergedError, match=r"not solved for z at 0\.5 s"):
        plant.along(np.zeros(1), np.linspace(1, -1, 11)[None, :])
