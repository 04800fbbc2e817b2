from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from swarmstart.terminal_set import (
    Ellipsoid,
    IndefiniteMatrixError,
    InvalidPlaneError,
    InvalidShapeError,
    NotPositiveError,
)


@pytest.fixture
def ellipsoid() -> Ellipsoid:
    rng = np.random.default_rng(5)
    L = rng.normal(size=(4, 4))
    return Ellipsoid(P=L @ L.T + np.eye(4), alpha=2.5)


@pytest.fixture
def shell(ellipsoid: Ellipsoid) -> NDArray[np.float64]:
    return ellipsoid.boundary(np.random.default_rng(0).normal(size=(4, 200_000)))


def test_value_and_membership_of_one_point_and_of_many(ellipsoid: Ellipsoid) -> None:
    points = np.random.default_rng(2).normal(size=(4, 50))
    values = ellipsoid.value(points)
    expected = [e @ ellipsoid.P @ e for e in points.T]
    np.testing.assert_allclose(values, expected, rtol=1e-13)
    np.testing.assert_array_equal(ellipsoid.contains(points), values <= 2.5)
    assert ellipsoid.value(points[:, 7]).shape == ()
    assert ellipsoid.contains(np.zeros(4))


def test_the_boundary_is_where_membership_ends(ellipsoid: Ellipsoid) -> None:
    on = ellipsoid.boundary(np.array([1.0, -2.0, 0.5, 0.0]))
    assert ellipsoid.contains(0.999999 * on)
    assert not ellipsoid.contains(1.000001 * on)
    assert ellipsoid.contains(1.000001 * on, tolerance=1e-5)
    assert not ellipsoid.contains(np.nan * on)


def test_the_extent_is_what_points_reach(
    ellipsoid: Ellipsoid, shell: NDArray[np.float64]
) -> None:
    reached = np.max(shell, axis=1)
    assert np.all(reached <= ellipsoid.extent() * (1 + 1e-12))
    # 2e5 points in 4D: the best direction is met to about 2 deg, cos = 0.9994.
    np.testing.assert_allclose(reached, ellipsoid.extent(), rtol=5e-3)


def test_the_shadow_outlines_the_projected_points(
    ellipsoid: Ellipsoid, shell: NDArray[np.float64]
) -> None:
    outline = ellipsoid.shadow(1, 3, count=361)
    np.testing.assert_allclose(outline[:, 0], outline[:, -1], atol=1e-12)
    normals = np.array([[0.6, 0.8], [-1.0, 0.3], [0.0, 1.0]])
    supports = np.max(normals @ outline, axis=1)
    np.testing.assert_allclose(
        np.max(normals @ shell[[1, 3]], axis=1), supports, rtol=5e-3
    )
    np.testing.assert_allclose(
        np.max(outline, axis=1), ellipsoid.extent()[[1, 3]], rtol=1e-4
    )


def test_the_shape_is_copied_and_locked() -> None:
    P = np.eye(2)
    ellipsoid = Ellipsoid(P=P, alpha=1.0)
    P[0, 0] = 9.0
    assert ellipsoid.P[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        ellipsoid.P[0, 0] = 2.0


def test_what_is_no_ellipsoid_is_refused(ellipsoid: Ellipsoid) -> None:
    with pytest.raises(IndefiniteMatrixError, match="P must be positive definite"):
        Ellipsoid(P=np.diag([1.0, -1.0]), alpha=1.0)
    for alpha in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(NotPositiveError, match="alpha must be a positive number"):
            Ellipsoid(P=np.eye(2), alpha=alpha)
    with pytest.raises(InvalidShapeError, match=r"e must have shape \(4,\)"):
        ellipsoid.contains(np.zeros(3))
    with pytest.raises(InvalidShapeError, match=r"directions must have shape \(4, any"):
        ellipsoid.boundary(np.zeros((5, 4)))
    with pytest.raises(NotPositiveError, match="length of a direction"):
        ellipsoid.boundary(np.zeros(4))


def test_the_shadow_of_every_two_axes_is_as_wide_as_the_set(
    ellipsoid: Ellipsoid,
) -> None:
    for i, j in itertools.permutations(range(4), 2):
        width = ellipsoid.shadow(i, j, count=3601).max(axis=1)
        np.testing.assert_allclose(width, ellipsoid.extent()[[i, j]], rtol=1e-5)


@pytest.mark.parametrize(("i", "j"), [(1, 1), (0, 0), (0, 4), (4, 0), (-1, 2), (2, -1)])
def test_a_plane_that_is_none_is_refused(ellipsoid: Ellipsoid, i: int, j: int) -> None:
    with pytest.raises(InvalidPlaneError, match="two different axes from 0 to 3"):
        ellipsoid.shadow(i, j)
