from __future__ import annotations

from collections.abc import Callable

import control
import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from swarmstart.terminal_set import (
    IndefiniteMatrixError,
    InvalidShapeError,
    NotFiniteError,
    UnreliableSolutionError,
    UnstableLoopError,
    continuous_lqr,
    continuous_lyapunov,
    hold,
    sampled_lqr,
    sampled_lyapunov,
)

Matrices = tuple[NDArray[np.float64], NDArray[np.float64]]
I2, I4 = np.eye(2), np.eye(4)


def test_the_riccati_matrix_is_the_lyapunov_matrix_of_its_loop(
    matrices: Matrices,
) -> None:
    for (A, B), design, solve in [
        (matrices, continuous_lqr, continuous_lyapunov),
        (hold(*matrices, 1.0), sampled_lqr, sampled_lyapunov),
    ]:
        gain = design(A, B, I4, I2)
        P = solve(A - B @ gain.K, I4 + gain.K.T @ gain.K)
        np.testing.assert_allclose(P, gain.P, rtol=1e-12, atol=1e-12)


def test_the_value_falls_by_the_weight_along_the_loop() -> None:
    rng = np.random.default_rng(1)
    F, Q = rng.normal(size=(3, 3)), np.diag([1.0, 2.0, 3.0])
    F *= 0.9 / np.max(np.abs(np.linalg.eigvals(F)))
    P = sampled_lyapunov(F, Q)
    e = rng.normal(size=3)
    assert e @ P @ e - F @ e @ P @ (F @ e) == pytest.approx(e @ Q @ e, rel=1e-12)


def test_an_unstable_loop_is_refused_with_its_growth() -> None:
    message = r"largest real part is 0\.25, allowed is less than -1e-09"
    with pytest.raises(UnstableLoopError, match=message) as caught:
        continuous_lyapunov([[0.25, 1.0], [0.0, -1.0]], I2)
    np.testing.assert_allclose(np.sort(caught.value.eigenvalues.real), [-1, 0.25])
    with pytest.raises(UnstableLoopError, match=r"spectral radius is 1,"):
        sampled_lyapunov(-I2, I2)
    with pytest.raises(UnstableLoopError, match="real part is 0,"):
        continuous_lyapunov(0 * I2, I2)


def test_a_weight_that_leaves_a_direction_free_gives_no_lyapunov_matrix() -> None:
    with pytest.raises(UnreliableSolutionError, match="smallest eigenvalue of P is 0"):
        continuous_lyapunov(-I2, np.diag([1.0, 0.0]))


def test_arrays_of_the_wrong_kind_are_refused() -> None:
    with pytest.raises(IndefiniteMatrixError, match="Q must be positive semidefinite"):
        sampled_lyapunov(0.5 * I2, -I2)
    with pytest.raises(InvalidShapeError, match=r"Q must have shape \(2, 2\)"):
        continuous_lyapunov(-I2, I4)
    with pytest.raises(NotFiniteError, match="F must hold finite real numbers"):
        continuous_lyapunov(np.nan * I2, I2)


@pytest.mark.parametrize("seed", range(5))
def test_matrices_solve_their_equations_as_linear_systems(seed: int) -> None:
    """vec(P) solves a linear system made of Kronecker products."""
    F = np.random.default_rng(seed).normal(size=(4, 4))
    decaying = F - (1.0 + np.abs(np.linalg.eigvals(F)).max()) * I4
    system = np.kron(I4, decaying.T) + np.kron(decaying.T, I4)
    P = np.linalg.solve(system, -I4.ravel()).reshape(4, 4)
    np.testing.assert_allclose(
        continuous_lyapunov(decaying, I4), P, rtol=0, atol=1e-12 * np.abs(P).max()
    )
    contracting = F / (1.1 * np.abs(np.linalg.eigvals(F)).max())
    system = np.eye(16) - np.kron(contracting.T, contracting.T)
    P = np.linalg.solve(system, I4.ravel()).reshape(4, 4)
    np.testing.assert_allclose(
        sampled_lyapunov(contracting, I4), P, rtol=0, atol=1e-10 * np.abs(P).max()
    )


@pytest.mark.parametrize(
    ("solve", "name"), [(continuous_lyapunov, "lyap"), (sampled_lyapunov, "dlyap")]
)
def test_python_control_solves_the_equation(
    solve: Callable[[ArrayLike, ArrayLike], object],
    name: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise RuntimeError(f"{name} was called")

    monkeypatch.setattr(control, name, refuse)
    with pytest.raises(RuntimeError, match=f"{name} was called"):
        solve(-0.5 * I2, I2)
