"""Radau IIA collocation: its coefficients, and its order against closed forms."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from swarmstart.arrays import Array
from swarmstart.ocp import InvalidProblemError, Model, OptimalControlProblem, Radau
from swarmstart.ocp.integration.radau import as_transcription, radau_coefficients
from swarmstart.ocp.nlp.collocation import collocated_check
from swarmstart.ocp.rollout.shooting import Shooting


@pytest.mark.parametrize("points", range(1, 10))
def test_points_are_those_of_casadi(points: int) -> None:
    expected = ca.collocation_points(points, "radau")
    np.testing.assert_allclose(radau_coefficients(points).times, expected, atol=1e-13)


def test_three_points_are_those_of_the_textbook() -> None:
    # Hairer and Wanner, table IV.5.6.
    found, root = radau_coefficients(3), np.sqrt(6.0)
    np.testing.assert_allclose(
        found.times, [(4 - root) / 10, (4 + root) / 10, 1.0], rtol=1e-14
    )
    weights = [(16 - root) / 36, (16 + root) / 36, 1 / 9]
    np.testing.assert_allclose(found.weights, weights, rtol=1e-13)


@pytest.mark.parametrize("points", range(1, 10))
def test_polynomials_are_differentiated_and_integrated_exactly(points: int) -> None:
    found = radau_coefficients(points)
    at = np.append(0.0, found.times)
    for degree in range(points + 1):
        slope = degree * found.times ** max(degree - 1, 0)
        np.testing.assert_allclose(found.slopes @ at**degree, slope, atol=1e-9)
    for degree in range(2 * points - 1):
        integral = found.weights @ found.times**degree
        assert integral == pytest.approx(1 / (degree + 1), rel=1e-11)


def end_of(
    model: Model, x0: Array, *, points: int, elements: int
) -> tuple[Array, float]:
    """Return the state after 1 s, and the integral of its first entry squared."""
    problem = OptimalControlProblem(
        model,
        horizon=1.0,
        intervals=1,
        stage_cost=model.states[0] ** 2,
        transcription=Radau(points=points, elements=elements),
    )
    unknown = ca.SX.sym("X", model.nx, points * elements)
    none = ca.SX(0, 1)
    reached = collocated_check(
        Shooting(problem), ca.SX(x0), (none, none), (none, none), unknown
    )
    rows = ca.Function("rows", [ca.vec(unknown)], [ca.vertcat(*reached.defects)])
    solve = ca.rootfinder("solve", "newton", rows, {"abstol": 1e-14})
    found = solve(np.tile(x0, points * elements))
    both = ca.Function("both", [ca.vec(unknown)], [reached.state, reached.cost])(found)
    unit = Shooting(problem).costs[0]
    return np.array(both[0]).ravel(), unit * float(both[1])


A = np.array([[0.0, 1.0], [-9.0, -0.4]])


def linear() -> Model:
    """A damped oscillation."""
    x = ca.SX.sym("x", 2)
    return Model(states=x, controls=ca.SX(0, 1), ode=ca.DM(A) @ x)


@pytest.mark.parametrize(("points", "order"), [(1, 1), (2, 3), (3, 5), (4, 7)])
def test_order_is_twice_the_points_less_one(points: int, order: int) -> None:
    x0 = np.array([1.0, 0.5])
    exact = expm(A) @ x0
    errors = [
        np.abs(end_of(linear(), x0, points=points, elements=n)[0] - exact).max()
        for n in (4, 8)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.4)


def test_integral_of_a_cost_has_the_same_order() -> None:
    x0 = np.array([1.0, 0.5])
    fine = solve_ivp(
        lambda _, y: [*(A @ y[:2]), y[0] ** 2], (0, 1), [*x0, 0.0],
        method="DOP853", rtol=1e-13, atol=1e-13,
    ).y[-1, -1]  # fmt: skip
    errors = [
        abs(end_of(linear(), x0, points=3, elements=n)[1] - fine) for n in (8, 16)
    ]
    assert np.log2(errors[0] / errors[1]) > 4.5
    assert errors[1] < 1e-6


def test_fast_mode_is_damped_however_long_the_element() -> None:
    x = ca.SX.sym("x")
    fast = Model(states=x, controls=ca.SX(0, 1), ode=-1e6 * (x - 3.0))
    end, _ = end_of(fast, np.array([1.0]), points=3, elements=1)
    assert end[0] == pytest.approx(3.0, abs=1e-5)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"points": 0}, "points must be an integer of at least 1, got 0"),
        ({"points": 10}, "points must be at most 9, got 10"),
        ({"elements": 0}, "elements must be an integer of at least 1, got 0"),
    ],
)
def test_numbers_out_of_range_are_refused(
    options: dict[str, int], message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        Radau(**options)


@pytest.mark.parametrize("given", ["gauss", 3, ("radau",)])
def test_another_transcription_is_refused(given: object) -> None:
    with pytest.raises(InvalidProblemError, match="must be 'shooting', 'radau'"):
        as_transcription(given)


def test_discrete_time_is_refused() -> None:
    x = ca.SX.sym("x")
    steps = Model(states=x, controls=ca.SX(0, 1), next_state=x / 2)
    with pytest.raises(InvalidProblemError, match="nothing to collocate"):
        OptimalControlProblem(steps, horizon=1, intervals=1, transcription="radau")
