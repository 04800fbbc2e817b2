"""The path between the plant's steps, against closed forms and SciPy's DOP853."""

from __future__ import annotations

import doctest

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.ocp import InvalidProblemError, Model, Plant, interpolate
from swarmstart.ocp.loop import dense_output
from swarmstart.ocp.loop import dense_output as distances
from swarmstart.tests.ocp.flights_by_hand import written


def flown(plant: Plant, x0: list[float], controls: Array) -> Array:
    """Return the plant's states after each of its steps, and before the first."""
    states = np.array(x0)[:, None]
    for number, control in enumerate(controls.T):
        after = plant(states[:, -1], control, number * plant.dt)
        states = np.hstack([states, after])
    return states


def test_a_flight_is_on_its_path_at_the_plants_steps(pendulum: Model) -> None:
    plant, controls = Plant(pendulum, dt=0.5, substeps=5), np.array([[3.0, -8.0, 5.0]])
    states = flown(plant, [0.1, 0.0], controls)
    path = interpolate(plant, written(plant, states, controls))
    assert path.step == pytest.approx(0.1)
    np.testing.assert_allclose(path(0.1 * np.arange(16)), states, atol=1e-12)


def test_a_jump_of_the_control_bends_the_path_at_once(double_integrator: Model) -> None:
    """Braked at -2 m/s^2 for 1 s, then thrown back at 6 m/s^2; quadratic in both."""
    plant = Plant(double_integrator, dt=1.0, substeps=1)
    states = [[5.0, 3.0, 3.0], [-1.0, -3.0, 3.0]]
    path = interpolate(plant, written(plant, states, [[-2.0, 6.0]]))
    before, after = np.linspace(0.0, 1.0, 11), np.linspace(0.0, 1.0, 11)
    np.testing.assert_allclose(path(before)[0], 5 - before - before**2, atol=1e-12)
    bounced = 3 - 3 * after + 3 * after**2
    np.testing.assert_allclose(path(1 + after)[0], bounced, atol=1e-12)


def test_parameters_are_those_held_over_each_step() -> None:
    """x' = p where p jumps at every step of the plant: a line from step to step."""
    x, u, p = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("p")
    model = Model(states=x, controls=u, ode=p + 0 * u, parameters=p)
    rates = np.array([1.0, -4.0, 3.0, 0.5, 9.0, -2.0])

    def parameters(times: Array) -> Array:
        return rates[None, np.rint(times / 0.25).astype(int)]

    plant = Plant(model, dt=0.75, substeps=3, parameters=parameters)
    controls = np.zeros((1, 2))
    states = flown(plant, [0.0], controls)
    path = interpolate(plant, written(plant, states, controls))
    times = np.linspace(0.0, 1.5, 61)
    line = np.interp(times, 0.25 * np.arange(7), states[0])
    np.testing.assert_allclose(path(times)[0], line, atol=1e-12)


def test_the_error_falls_with_the_sixth_power_of_the_step(unicycle: Model) -> None:
    """A full turn of radius 10 m in closed form, with 16 and 32 steps."""
    errors = []
    for steps in (16, 32):
        dt = 2 * np.pi / steps  # 1 rad/s
        plant = Plant(unicycle, dt=dt, substeps=1)
        turn = np.tile([[0.0], [1.0]], steps)
        path = interpolate(plant, written(plant, circle(steps + 1), turn))
        errors.append(np.abs(path(np.linspace(0, 2 * np.pi, 1001)) - circle(1001)))
    largest = [error.max() for error in errors]
    assert largest[0] < 1e-6
    assert np.log2(largest[0] / largest[1]) == pytest.approx(6.0, abs=0.2)


def circle(count: int) -> Array:
    t = np.linspace(0.0, 2 * np.pi, count)
    return np.stack([0 * t + 10, t, 10 * np.sin(t), -10 * np.cos(t)])


def test_the_path_is_that_of_dop853(unicycle: Model) -> None:
    rng = np.random.default_rng(0)
    low, high = np.array([[-5.0], [-0.17]]), np.array([[5.0], [0.17]])
    controls = rng.uniform(low, high, (2, 4))
    plant = Plant(unicycle, dt=1.0, substeps=20)
    x0 = [20.0, 0.3, -5.0, 8.0]
    path = interpolate(
        plant, written(plant, flown(plant, x0, controls), controls)
    )  # fmt: skip
    state = np.array(x0)
    for number, (u, omega) in enumerate(controls.T):

        def rate(_: float, x: Array, u: float = u, omega: float = omega) -> list[float]:
            return [u, omega, x[0] * np.cos(x[1]), x[0] * np.sin(x[1])]

        exact = solve_ivp(
            rate, (0, 1), state, "DOP853", dense_output=True, rtol=1e-10, atol=1e-10
        )
        inside = np.linspace(0.0, 1.0, 333)
        found = path(number + inside)
        # The last instant also starts the next step.
        np.testing.assert_allclose(found, exact.sol(inside), atol=1e-7)
        state = exact.y[:, -1]


def test_a_flight_of_another_plant_is_refused(
    unicycle: Model, double_integrator: Model
) -> None:
    plant = Plant(double_integrator, dt=1.0, substeps=1)
    flight = written(Plant(unicycle, dt=1.0, substeps=1), circle(3), np.zeros((2, 2)))
    message = "2 states and 1 controls like the plant, got 4 and 2"
    with pytest.raises(InvalidProblemError, match=message):
        interpolate(plant, flight)


@pytest.mark.parametrize(("steps", "pieces"), [(2, 3), (2, 1), (2, 0), (0, 2)])
def test_intervals_with_different_steps_are_refused(
    double_integrator: Model, steps: int, pieces: int
) -> None:
    plant = Plant(double_integrator, dt=1.0, substeps=1)
    flight = written(plant, np.zeros((2, pieces + 1)), np.zeros((1, steps)))
    message = f"same number of steps in each of the {steps} control.*, got {pieces}"
    with pytest.raises(InvalidProblemError, match=message):
        interpolate(plant, flight)


def test_the_examples_print_what_they_say() -> None:
    for module in (dense_output, distances):
        failed, tried = doctest.testmod(module)
        assert tried > 0 and failed == 0
