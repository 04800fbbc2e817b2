"""Coordinates of the ellipsoid: factors, rotations, and boxes of directions."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest

flint = pytest.importorskip("flint")

from flint import arb, arb_mat  # noqa: E402

from swarmstart.arrays import Array  # noqa: E402
from swarmstart.terminal_set.checker.coordinates import (  # noqa: E402
    IndefiniteError,
    QuadraticPart,
    direction,
    direction_box,
    distance_from_identity,
    hull,
    identity,
    is_positive_definite,
    middle,
    root_of_inverse,
    rotation,
    scaled_by,
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
    wide = arb_mat(n, n, [hull(-1, 3) if i == 0 else arb(0) for i in range(n * n)])
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


def test_hull_and_products_go_by_their_ends() -> None:
    assert ends(hull(-1.0, 3.0)) == pytest.approx([-1, 3], abs=1e-6)
    assert ends(hull(2.0, 2.0)) == [2, 2]
    for low, high, expected in (
        (0.0, 2.0, [-2, 6]), (1.0, 2.0, [-2, 6]), (-2.0, 1.0, [-6, 3]),
        (3.0, 3.0, [-3, 9]),
    ):  # fmt: skip
        found = scaled_by(hull(-1.0, 3.0), low, high)
        assert ends(found) == pytest.approx(expected, abs=1e-5)
        assert ends(found)[0] <= expected[0] or low == high


def faces(rng: np.random.Generator, n: int) -> Intervals:
    """A box of w on a face of the cube."""
    lower = rng.uniform(-1, 1, n)
    upper = np.minimum(lower + rng.uniform(0, 1.2, n), 1)
    if rng.random() < 0.3:
        lower[0] = 0.0
        upper[0] = 0.5
    face = int(rng.integers(n))
    lower[face] = upper[face] = rng.choice([-1.0, 1.0])
    return list(zip(lower.tolist(), upper.tolist(), strict=True))


def corners(w: Intervals) -> Array:
    """The ends, and 0 if it lies between: there entries of w / |w| are extreme."""
    ends = [{low, high} | ({0.0} if low < 0 < high else set()) for low, high in w]
    return np.array(list(product(*ends)))


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_box_of_directions_is_the_smallest_but_for_rounding(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(30):
        w = faces(rng, n)
        points = corners(w)
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        for found, entries in zip(direction_box(w), points.T, strict=True):
            exact = [entries.min(), entries.max()]
            assert ends(found) == pytest.approx(exact, abs=1e-8)
            assert ends(found)[0] < exact[0] and exact[1] < ends(found)[1]


def test_direction_is_of_length_one() -> None:
    found = direction([3.0, -4.0, 0.0])
    assert [float(entry.mid()) for entry in found] == pytest.approx([0.6, -0.8, 0])


@pytest.mark.parametrize("n", [1, 2, 3, 4])
@pytest.mark.parametrize("off", [0.0, 1e-12, 0.3])
def test_quadratic_form_of_a_nearly_diagonal_matrix_is_bounded_closely(
    n: int, off: float
) -> None:
    """A ratio of linear functions of the squares, largest at one of their corners."""
    rng = np.random.default_rng(n)
    for _ in range(20):
        diagonal = rng.normal(size=n)
        beside = off * np.triu(rng.uniform(0.5, 1, (n, n)), 1)
        beside *= rng.choice([-1, 1], (n, n))
        B = np.diag(diagonal) + beside + beside.T
        part = QuadraticPart(arb_mat(B.tolist()))
        w = faces(rng, n)
        u = direction_box(w)
        squares = [
            [0.0 if low <= 0 <= high else min(low**2, high**2), max(low**2, high**2)]
            for low, high in w
        ]
        values = [
            float(diagonal @ s) / sum(s)
            for s in map(np.array, product(*squares))
            if any(s)
        ]
        bound = max(values)
        reach = 0.0
        for i in range(n):
            for j in range(i + 1, n):
                if off > 1e-11:
                    bound += float((2 * arb(B[i, j]) * u[i] * u[j]).upper())
                else:
                    bound += abs(B[i, j])
                reach += 2 * abs(B[i, j]) if off > 1e-11 else abs(B[i, j])
        found = float(part.upper(w, u).upper())
        assert found == pytest.approx(bound, abs=1e-7 if off > 1e-11 else 1e-13)
        points = corners(w)
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        seen = np.einsum("ki,ij,kj->k", points, B, points).max()
        assert found >= seen - 1e-15  # Its own rounding, in floats.
        largest = float(part.largest)
        assert largest == pytest.approx(diagonal.max() + reach, abs=1e-13 + 1e-8 * off)
        assert largest >= np.linalg.eigvalsh(B)[-1]
