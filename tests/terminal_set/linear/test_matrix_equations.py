from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import control
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import solve, solve_continuous_are, solve_discrete_are

from swarmstart.terminal_set import (
    AsymmetricMatrixError,
    Gain,
    IndefiniteMatrixError,
    InvalidShapeError,
    NotFiniteError,
    NotStabilisableError,
    UnreliableSolutionError,
    UnweightedModeError,
    continuous_lqr,
    hold,
    linearise,
    sampled_lqr,
)

Matrices = tuple[NDArray[np.float64], NDArray[np.float64]]
Design = Callable[[ArrayLike, ArrayLike, ArrayLike, ArrayLike], Gain]
BOTH = pytest.mark.parametrize("design", [continuous_lqr, sampled_lqr])
I2, I4 = np.eye(2), np.eye(4)


def paired(v: list[float], psi: list[float]) -> NDArray[np.float64]:
    """P of the formation model from its blocks (v, x) and (psi, y)."""
    P = np.diag([v[0], psi[0], v[2], psi[2]])
    P[[0, 2, 1, 3], [2, 0, 3, 1]] = [v[1], v[1], psi[1], psi[1]]
    return P


def test_the_continuous_gain_of_the_formation_model(matrices: Matrices) -> None:
    gain = continuous_lqr(*matrices, I4, I2)
    np.testing.assert_allclose(
        gain.K, [[1.7321, 0, 1, 0], [0, 5.5678, 0, 1]], atol=1e-4
    )
    expected = paired([1.7321, 1, 1.7321], [5.5678, 1, 0.37118])
    np.testing.assert_allclose(gain.P, expected, atol=1e-4)
    # (v, x) is a double integrator: P = [sqrt 3, 1; 1, sqrt 3] in closed form.
    assert gain.P[0, 0] == pytest.approx(np.sqrt(3), rel=1e-12)


def test_the_sampled_gain_of_the_formation_model(matrices: Matrices) -> None:
    gain = sampled_lqr(*hold(*matrices, 1.0), I4, I2)
    np.testing.assert_allclose(
        gain.K, [[1.02847, 0, 0.43448, 0], [0, 1.76786, 0, 0.10382]], atol=1e-4
    )
    expected = paired([2.58748, 1.11803, 2.36710], [11.15311, 1.11803, 1.13523])
    np.testing.assert_allclose(gain.P, expected, atol=1e-4)
    np.testing.assert_allclose(
        np.sort(np.abs(gain.eigenvalues)), [0.020, 0.434, 0.434, 0.526], atol=5e-4
    )


def test_one_state_is_solved_in_closed_form() -> None:
    gain = continuous_lqr([[1.0]], [[1.0]], [[3.0]], [[1.0]])
    assert gain.K[0, 0] == pytest.approx(3.0)  # P^2 - 2 P - 3 = 0
    assert gain.eigenvalues[0] == pytest.approx(-2.0)
    gain = sampled_lqr([[1.0]], [[1.0]], [[1.0]], [[1.0]])
    assert gain.P[0, 0] == pytest.approx((1 + np.sqrt(5)) / 2)  # P^2 - P - 1 = 0


def test_the_cost_to_go_is_what_the_loop_really_costs(matrices: Matrices) -> None:
    Ad, Bd = hold(*matrices, 1.0)
    gain = sampled_lqr(Ad, Bd, I4, I2)
    start = np.array([1.0, -0.2, 5.0, 3.0])
    e, cost = start, 0.0
    for _ in range(200):  # 0.526^200 is nothing
        du = -gain.K @ e
        cost += e @ e + du @ du
        e = Ad @ e + Bd @ du
    assert cost == pytest.approx(start @ gain.P @ start, rel=1e-12)


def test_the_units_of_a_cost_do_not_change_the_gain(matrices: Matrices) -> None:
    gain = continuous_lqr(*matrices, I4, I2)
    scaled = continuous_lqr(*matrices, 1e-9 * I4, 1e-9 * I2)
    np.testing.assert_allclose(scaled.K, gain.K, rtol=1e-9, atol=1e-9)


def test_a_unicycle_at_rest_is_refused_by_its_mode(formation: ca.Function) -> None:
    A, B = linearise(formation, np.zeros(4), np.zeros(2))
    message = r"cannot be stabilised.*eigenvalue 0 along \(0, 0, 0, 1\)"
    with pytest.raises(NotStabilisableError, match=message):
        continuous_lqr(A, B, I4, I2)
    with pytest.raises(NotStabilisableError, match="eigenvalue 1 along") as caught:
        sampled_lqr(*hold(A, B, 1.0), I4, I2)
    np.testing.assert_allclose(caught.value.modes, [1.0])
    np.testing.assert_allclose(np.abs(caught.value.directions.T), [[0, 0, 0, 1]])


def test_no_weight_on_an_integrator_is_refused_by_its_mode(matrices: Matrices) -> None:
    with pytest.raises(UnweightedModeError, match="eigenvalue 0 along"):
        continuous_lqr(*matrices, 0 * I4, I2)
    with pytest.raises(UnweightedModeError, match="eigenvalue 1 along") as caught:
        sampled_lqr(*hold(*matrices, 1.0), 0 * I4, I2)
    np.testing.assert_allclose(caught.value.modes, [1.0, 1.0])  # x and y


@BOTH
def test_no_weight_on_a_stable_system_has_no_lyapunov_matrix(design: Design) -> None:
    A = [[-0.5]]  # decays in both senses, so the best input is zero: P = 0
    message = "smallest eigenvalue of P is 0"
    with pytest.raises(UnreliableSolutionError, match=message) as caught:
        design(A, [[1.0]], [[0.0]], [[1.0]])
    assert caught.value.value == 0.0


def test_an_input_too_weak_to_help_is_refused_with_the_spectral_radius() -> None:
    message = r"spectral radius of A - B K is 0\.999999999, the limit is 0\.999999"
    with pytest.raises(UnreliableSolutionError, match=message):
        sampled_lqr([[1.0]], [[1e-9]], [[1.0]], [[1.0]])


def test_a_riccati_solution_that_solves_nothing_is_refused() -> None:
    message = r"\|residual\| / \|P\| is .*, the limit is 1e-08"
    with pytest.raises(UnreliableSolutionError, match=message) as caught:
        sampled_lqr([[1.1]], [[1e-9]], [[1.0]], [[1.0]])
    assert caught.value.value > 1e-8


def test_where_the_solver_gives_up_the_error_is_still_ours() -> None:
    # SciPy: "the associated symplectic pencil has eigenvalues too close to the circle".
    turn = [[0.0, 1.0], [-1.0, 0.0]]
    with pytest.raises(UnreliableSolutionError, match="the sampled Riccati equation"):
        sampled_lqr(turn, [[0.0], [1.0]], 1e-17 * I2, [[1.0]])


def test_an_ill_conditioned_matrix_is_refused(matrices: Matrices) -> None:
    Q = np.diag([1e12, 1.0, 1.0, 1e-8])
    with pytest.raises(UnreliableSolutionError, match="condition of P"):
        sampled_lqr(*hold(*matrices, 1.0), Q, I2)


@BOTH
def test_weights_of_the_wrong_sign_are_refused(
    design: Design, matrices: Matrices
) -> None:
    with pytest.raises(IndefiniteMatrixError, match="R must be positive definite"):
        design(*matrices, I4, np.diag([1.0, 0.0]))
    with pytest.raises(IndefiniteMatrixError, match="eigenvalue is -1") as caught:
        design(*matrices, np.diag([1.0, -1.0, 1.0, 1.0]), I2)
    assert (caught.value.name, caught.value.smallest_eigenvalue) == ("Q", -1.0)
    with pytest.raises(AsymmetricMatrixError, match="R must be symmetric"):
        design(*matrices, I4, [[1.0, 0.5], [0.0, 1.0]])


@BOTH
def test_arrays_of_the_wrong_kind_are_refused(
    design: Design, matrices: Matrices
) -> None:
    A, B = matrices
    with pytest.raises(InvalidShapeError, match=r"Q must have shape \(4, 4\)"):
        design(A, B, np.eye(3), I2)
    with pytest.raises(InvalidShapeError, match=r"B must have shape \(4, any\)"):
        design(A, B.T, I4, I2)
    with pytest.raises(InvalidShapeError, match="A must have shape"):
        design(A[:3], B, I4, I2)
    with pytest.raises(NotFiniteError, match="A must hold finite real numbers"):
        design(A * np.nan, B, I4, I2)


def test_weights_that_no_solver_can_handle_are_named_as_such(
    matrices: Matrices,
) -> None:
    """Twelve orders of magnitude apart: SciPy gives up with a ValueError."""
    with pytest.raises(UnreliableSolutionError, match="sampled Riccati equation"):
        sampled_lqr(*hold(*matrices, 1.0), I4, np.diag([1.0, 1e12]))


@pytest.mark.parametrize("seed", range(5))
def test_gains_are_those_of_scipy_bit_for_bit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(4, 4)), rng.normal(size=(4, 2))
    P = solve_continuous_are(A, B, I4, I2)
    gain = continuous_lqr(A, B, I4, I2)
    np.testing.assert_array_equal(gain.P, P)
    np.testing.assert_array_equal(gain.K, np.linalg.solve(I2, B.T @ P))
    P = solve_discrete_are(A, B, I4, I2)
    gain = sampled_lqr(A, B, I4, I2)
    np.testing.assert_array_equal(gain.P, P)
    np.testing.assert_array_equal(gain.K, solve(B.T @ P @ B + I2, B.T @ P @ A))


@pytest.mark.parametrize("seed", range(5))
def test_a_continuous_p_spans_the_stable_space_of_the_hamiltonian(seed: int) -> None:
    """(I; P) spans the eigenvectors of ((A, -BB'), (-Q, -A')) that decay."""
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(4, 4)), rng.normal(size=(4, 2))
    values, vectors = np.linalg.eig(np.block([[A, -B @ B.T], [-I4, -A.T]]))
    upper, lower = np.split(vectors[:, values.real < 0], 2)
    P = np.real(lower @ np.linalg.inv(upper))
    gain = continuous_lqr(A, B, I4, I2)
    np.testing.assert_allclose(gain.P, P, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(gain.K, B.T @ P, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_kleinmans_iteration_ends_at_the_sampled_gain(seed: int) -> None:
    """Hewer (1971): P of the loop by its series, K of P, again, from a stable start."""
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(4, 4)), rng.normal(size=(4, 2))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()  # so that K = 0 is a stable start
    K: NDArray[np.float64] = np.zeros((2, 4))
    for _ in range(20):
        power, P = A - B @ K, I4 + K.T @ K
        for _ in range(12):  # 2^12 terms of the series of the loop's cost
            P, power = P + power.T @ P @ power, power @ power
        K = np.asarray(np.linalg.solve(I2 + B.T @ P @ B, B.T @ P @ A), np.float64)
    gain = sampled_lqr(A, B, I4, I2)
    np.testing.assert_allclose(gain.K, K, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(gain.P, P, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(
    ("design", "name"), [(continuous_lqr, "lqr"), (sampled_lqr, "dlqr")]
)
def test_python_control_designs_the_gain(
    design: Design, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise RuntimeError(f"{name} was called")

    monkeypatch.setattr(control, name, refuse)
    with pytest.raises(RuntimeError, match=f"{name} was called"):
        design(0.5 * I2, I2, I2, I2)
