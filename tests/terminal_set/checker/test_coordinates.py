"""Coordinates of the ellipsoid: factors and rotations."""

from __future__ import annotations

import math

import numpy as np
import pytest

flint = pytest.importorskip("flint")

from flint import arb, arb_mat  # noqa: E402

from swarmstart.arrays import Array  # noqa: E402
from swarmstart.terminal_set.checker.coordinates import (  # noqa: E402
    IndefiniteError,
    distance_from_identity,
    identity,
    is_positive_definite,
    middle,
    root_of_inverse,
    rotation,
    symmetric,
)

Intervals = list[tuple[float, float]]


def floats(matrix: arb_mat) -> Array:
    return np.array(middle(matrix))


def ends(ball: arb) -> list[float]:
    return [float(ball.lower()), float(ball.upper())]


def definite(rng: np.random.Generator, n: int) -> Array:
    L = rng.normal(size=(n, n))
    return np.asarray(L @ L.T + 0.1 * np.eye(n))


def test_symmetric_part_is_the_mean_with_the_transpose() -> None:
    rows = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]
    np.testing.assert_array_equal(
        floats(symmetric(rows)), [[1, 3, 5], [3, 5, 7], [5, 7, 9]]
    )
    np.testing.assert_array_equal(floats(identity(3)), np.eye(3))


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_definiteness_is_that_of_the_least_eigenvalue(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(10):
        P = definite(rng, n)
        least = float(np.linalg.eigvalsh(P)[0])
        for share, is_definite in ((0.999, True), (1.001, False)):
            shifted = P - share * least * np.eye(n)
            assert is_positive_definite(symmetric(shifted.tolist())) is is_definite
    assert not is_positive_definite(symmetric(np.zeros((n, n)).tolist()))
    assert not is_positive_definite(symmetric((-np.eye(n)).tolist()))
    # Where a ball holds an indefinite matrix, nothing can be said.
    wide = arb_mat(
        n, n, [arb(-1).union(arb(3)) if i == 0 else arb(0) for i in range(n * n)]
    )
    assert not is_positive_definite(wide + identity(n))


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_root_of_the_inverse_makes_the_identity(n: int) -> None:
    rng = np.random.default_rng(n)
    P = definite(rng, n)
    T = np.array(root_of_inverse(symmetric(P.tolist())))
    np.testing.assert_allclose(T.T @ P @ T, np.eye(n), atol=1e-11)
    np.testing.assert_allclose(T, np.triu(T), atol=1e-14)  # L^-T.
    with pytest.raises(IndefiniteError):
        root_of_inverse(symmetric((P - 10 * np.trace(P) * np.eye(n)).tolist()))


def test_distance_from_the_identity_is_that_of_frobenius() -> None:
    off = np.array([[0.5, -2.0], [1.0, 4.0]])
    found = distance_from_identity(arb_mat((np.eye(2) + off).tolist()))
    exact = math.sqrt(0.25 + 4 + 1 + 16)
    assert exact <= float(found) < exact * (1 + 1e-6)
    assert float(distance_from_identity(identity(3))) == 0


def test_distance_is_a_number_however_near_the_identity_a_matrix_is() -> None:
    """The ball of a tiny sum of squares may reach below 0, if it has no root."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        n = int(rng.integers(1, 5))
        U, _ = np.linalg.qr(rng.normal(size=(n, n)))
        matrix = arb_mat(U.T.tolist()) * arb_mat(U.tolist())
        assert 0 <= float(distance_from_identity(matrix)) < 1e-14


@pytest.mark.parametrize("n", [1, 2, 3, 6])
def test_rotation_has_the_eigenvectors_as_columns(n: int) -> None:
    rng = np.random.default_rng(n)
    for scale in (1.0, 1e-9, 1e9):
        M = scale * (definite(rng, n) - np.eye(n))
        V = np.array(rotation(M.tolist()))
        np.testing.assert_allclose(V.T @ V, np.eye(n), atol=1e-12)
        turned = V.T @ M @ V
        np.testing.assert_allclose(
            turned, np.diag(np.diag(turned)), atol=1e-12 * np.abs(M).max()
        )
    np.testing.assert_array_equal(rotation(np.diag([3.0, 1, 2]).tolist()), np.eye(3))
