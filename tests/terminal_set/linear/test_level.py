from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmstart.terminal_set import (
    Ellipsoid,
    IndefiniteMatrixError,
    InvalidShapeError,
    NotPositiveError,
    SaturatedReferenceError,
    input_excess,
    level_from_inputs,
    level_from_states,
    smaller_side,
)


@st.composite
def random_design(
    draw: st.DrawFn,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """K, P (condition up to 1e6) and u_max of a random size."""
    nx, nu = draw(st.integers(1, 6)), draw(st.integers(1, 3))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    U, _ = np.linalg.qr(rng.normal(size=(nx, nx)))
    P = U @ np.diag(10 ** rng.uniform(-3, 3, size=nx)) @ U.T
    u_max = 10 ** rng.uniform(-2, 2, size=nu)
    return rng.normal(size=(nu, nx)), (P + P.T) / 2, u_max


@settings(max_examples=100, deadline=None, derandomize=True)
@given(random_design())
def test_inputs_keep_their_bounds_on_the_set_and_one_touches(
    design: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
) -> None:
    K, P, u_max = design
    ellipsoid = Ellipsoid(P=P, alpha=level_from_inputs(K, P, u_max))
    # Uniform directions, and for each row the one that reaches farthest, L^-1 K_i'.
    spread = np.random.default_rng(0).normal(size=(len(P), 500))
    farthest = np.linalg.solve(np.linalg.cholesky(P), K.T)
    points = ellipsoid.boundary(np.hstack([spread, farthest]))
    reached = np.max(np.abs(K @ points) / u_max[:, None], axis=1)
    # Two solves with P, each as exact as its condition (1e6 of 1e-16) lets it be.
    np.testing.assert_allclose(ellipsoid.value(points), ellipsoid.alpha, rtol=1e-8)
    assert np.all(reached <= 1 + 1e-8)
    assert np.max(reached) == pytest.approx(1, abs=1e-8)
    excess = input_excess(K, P, ellipsoid.alpha, u_max)
    np.testing.assert_allclose(excess, reached, rtol=1e-8)


def test_a_box_and_a_ball_give_the_half_width_squared() -> None:
    assert level_from_states(np.eye(2), [3.0, 2.0]) == pytest.approx(4.0)
    assert level_from_inputs(np.eye(2), np.eye(2), [3.0, 2.0]) == pytest.approx(4.0)


def test_a_bound_does_not_depend_on_its_unit() -> None:
    K, P = np.array([[1.0, 2.0], [0.5, -1.0]]), np.array([[2.0, 0.3], [0.3, 1.0]])
    alpha = level_from_inputs(K, P, [1.0, 4.0])
    in_degrees = K * [[1.0], [180 / np.pi]]
    assert level_from_inputs(in_degrees, P, [1.0, 720 / np.pi]) == pytest.approx(alpha)
    # e'Pe and alpha in other units of cost: the same set.
    assert level_from_inputs(K, 7 * P, [1.0, 4.0]) == pytest.approx(7 * alpha)


def test_without_a_bound_the_level_is_infinite() -> None:
    assert level_from_states(np.eye(2), [np.inf, np.inf]) == np.inf
    assert level_from_inputs([[0.0, 0.0]], np.eye(2), [1.0]) == np.inf
    assert level_from_inputs(np.eye(2), np.eye(2), [np.inf, 2.0]) == pytest.approx(4.0)


def test_of_unequal_bounds_the_nearer_one_counts() -> None:
    room = smaller_side(
        "u_ref", [1.0, 0.0, 0.0], lower=[-5.0, -0.5, -np.inf], upper=[2.0, 3.0, 4.0]
    )
    np.testing.assert_allclose(room, [1.0, 0.5, 4.0])


@pytest.mark.parametrize("value", [1.0, -1.0, 1.5])
def test_a_reference_on_or_outside_a_bound_is_refused(value: float) -> None:
    message = r"u_ref\[1\] must lie between its bounds -1 and 1, not on or outside"
    with pytest.raises(SaturatedReferenceError, match=message) as caught:
        smaller_side("u_ref", [0.0, value], lower=[-1.0, -1.0], upper=[1.0, 1.0])
    assert (caught.value.index, caught.value.value) == (1, value)


def test_arrays_of_the_wrong_kind_are_refused() -> None:
    K, P = [[1.0, 0.0]], np.eye(2)
    with pytest.raises(NotPositiveError, match="u_max must be a positive number"):
        level_from_inputs(K, P, [0.0])
    with pytest.raises(NotPositiveError, match="e_max must be a positive number"):
        level_from_states(P, [1.0, -1.0])
    with pytest.raises(NotPositiveError, match="alpha must be a positive number"):
        input_excess(K, P, np.nan, [1.0])
    with pytest.raises(InvalidShapeError, match=r"u_max must have shape \(1,\)"):
        level_from_inputs(K, P, [1.0, 1.0])
    with pytest.raises(InvalidShapeError, match=r"K must have shape \(any, 2\)"):
        level_from_inputs(np.eye(3), P, [1.0])
    with pytest.raises(IndefiniteMatrixError, match="P must be positive definite"):
        level_from_inputs(K, np.diag([1.0, 0.0]), [1.0])


@pytest.mark.parametrize("alpha", [0.0, -1.0, np.inf, np.nan])
def test_excess_at_a_level_that_is_none_is_refused(alpha: float) -> None:
    one = np.ones((1, 1))
    assert input_excess(2 * one, 4 * one, 9.0, [6.0]) == pytest.approx([0.5])
    with pytest.raises(NotPositiveError, match="alpha must be a positive number"):
        input_excess(one, one, alpha, [1.0])
