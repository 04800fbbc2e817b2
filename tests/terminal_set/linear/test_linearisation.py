from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from swarmstart.terminal_set import (
    InvalidDynamicsError,
    InvalidShapeError,
    NotFiniteError,
    NotPositiveError,
    continuous_lqr,
    held_spectral_radius,
    hold,
    linearise,
)
from swarmstart.terminal_set.linear.linearisation import (
    _is_exponential,
    runge_kutta_hold,
)

Matrices = tuple[NDArray[np.float64], NDArray[np.float64]]


def test_the_formation_model_is_linearised_about_the_moving_leader(
    matrices: Matrices,
) -> None:
    A, B = matrices
    expected = np.zeros((4, 4))
    expected[2, 0], expected[3, 1] = 1.0, 15.0  # x' = dv, y' = v_L dpsi
    np.testing.assert_array_equal(A, expected)
    np.testing.assert_array_equal(B, np.eye(4, 2))


def test_derivatives_agree_with_finite_differences(formation: ca.Function) -> None:
    x, u, step = np.array([12.0, 0.4, 3.0, -2.0]), np.array([1.0, 0.1]), 1e-6
    A, B = linearise(formation, x, u)

    def differences(place: int, size: int) -> NDArray[np.float64]:
        columns = []
        for h in step * np.eye(size):
            shift = [h, 0 * u] if place == 0 else [0 * x, h]
            ahead = formation(x + shift[0], u + shift[1])
            behind = formation(x - shift[0], u - shift[1])
            columns.append(((ahead - behind) / (2 * step)).full().ravel())
        return np.array(columns).T

    # Central differences: step^2 from the third derivative, 1e-10 from rounding.
    np.testing.assert_allclose(A, differences(0, 4), atol=1e-8)
    np.testing.assert_allclose(B, differences(1, 2), atol=1e-8)


def test_the_held_formation_model_is_its_closed_form(matrices: Matrices) -> None:
    dt = 0.7
    Ad, Bd = hold(*matrices, dt)
    # Two double integrators, v -> x and psi -> v_L y.
    expected = np.eye(4)
    expected[2, 0], expected[3, 1] = dt, 15 * dt
    np.testing.assert_allclose(Ad, expected, atol=1e-13)
    np.testing.assert_allclose(
        Bd, [[dt, 0], [0, dt], [dt**2 / 2, 0], [0, 15 * dt**2 / 2]], atol=1e-13
    )


def test_two_half_steps_are_one_step() -> None:
    rng = np.random.default_rng(3)
    A, B = rng.normal(size=(3, 3)), rng.normal(size=(3, 2))
    half, once = hold(A, B, 0.25), hold(A, B, 0.5)
    np.testing.assert_allclose(once[0], half[0] @ half[0], atol=1e-12)
    np.testing.assert_allclose(once[1], half[0] @ half[1] + half[1], atol=1e-12)


def test_the_continuous_gain_does_not_survive_the_chapters_hold(
    matrices: Matrices,
) -> None:
    K = continuous_lqr(*matrices, np.eye(4), np.eye(2)).K

    def radius(dt: float) -> float:
        return held_spectral_radius(*matrices, K, dt)

    assert radius(1.0) == pytest.approx(10.80, abs=0.05)
    assert radius(0.4) == pytest.approx(1.45, abs=0.01)
    assert radius(0.35) < 1 < radius(0.36)


@pytest.mark.parametrize("dt", [0.0, -1.0, np.inf, np.nan])
def test_a_step_that_is_none_is_refused(matrices: Matrices, dt: float) -> None:
    with pytest.raises(NotPositiveError, match="dt must be a positive number"):
        hold(*matrices, dt)


def test_a_gain_of_another_system_is_refused(matrices: Matrices) -> None:
    with pytest.raises(InvalidShapeError, match=r"K must have shape \(2, 4\)"):
        held_spectral_radius(*matrices, np.eye(2), 1.0)


def test_a_function_of_another_form_is_refused() -> None:
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p")
    with pytest.raises(InvalidDynamicsError, match="dynamics must map columns"):
        linearise(ca.Function("f", [x, u, p], [x]), np.zeros(2), np.zeros(1))
    with pytest.raises(InvalidDynamicsError, match=r"to \[\(1, 1\)\]"):
        linearise(ca.Function("f", [x, u], [u]), np.zeros(2), np.zeros(1))


def test_a_reference_of_another_size_is_refused(formation: ca.Function) -> None:
    with pytest.raises(InvalidShapeError, match=r"x_ref must have shape \(4,\)"):
        linearise(formation, np.zeros(3), np.zeros(2))


def test_a_derivative_that_does_not_exist_is_refused() -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    with pytest.raises(NotFiniteError, match="df/dx at the reference"):
        linearise(ca.Function("f", [x, u], [ca.sqrt(x) + u]), [0.0], [0.0])


@pytest.mark.parametrize("substeps", [1, 3])
def test_runge_kutta_hold_is_casadis_map_of_the_linear_system(
    matrices: Matrices, substeps: int
) -> None:
    A, B = matrices
    A = A - 2 * np.eye(4)  # So that the series does not end.
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    linear = ca.Function("linear", [x, u], [ca.DM(A) @ x + ca.DM(B) @ u])
    after = ca.simpleRK(linear, substeps, 4)(x, u, 0.7)
    expected = ca.Function("d", [x, u], [ca.jacobian(after, x), ca.jacobian(after, u)])
    Ad, Bd = runge_kutta_hold(A, B, 0.7, substeps=substeps)
    np.testing.assert_allclose(Ad, expected(0, 0)[0].full(), rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(Bd, expected(0, 0)[1].full(), rtol=1e-13, atol=1e-14)


def test_a_runge_kutta_hold_beyond_all_numbers_is_refused() -> None:
    with pytest.raises(NotFiniteError, match="the Runge-Kutta map of the hold"):
        runge_kutta_hold([[-1e100]], [[1.0]], 1.0, substeps=1)


@pytest.mark.parametrize("size", [1e-3, 1.0, 30.0])
def test_a_kept_exponential_is_known_by_its_series(size: float) -> None:
    block = size * np.random.default_rng(0).standard_normal((4, 4)) / 4
    found = expm(block)
    assert _is_exponential(found, block)
    other = found.copy()
    other[1, 2] += 1e-6 * np.abs(found).max()
    assert not _is_exponential(other, block)
    # Its series is not begun, since the number of squarings would have no end.
    with np.errstate(all="raise"):
        assert not _is_exponential(found, 1e300 * np.ones((4, 4)))
