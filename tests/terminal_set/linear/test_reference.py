from __future__ import annotations

import numpy as np
import pytest

from swarmstart.terminal_set import (
    InvalidShapeError,
    NotFiniteError,
    Reference,
    SaturatedReferenceError,
)


def test_the_room_is_that_to_the_nearer_bound() -> None:
    reference = Reference(
        x_ref=np.array([15.0, 0.0]),
        u_ref=np.array([1.0]),
        u_lower=np.array([-5.0]),
        u_upper=np.array([5.0]),
        x_lower=np.array([10.0, -np.inf]),
    )
    np.testing.assert_allclose(reference.u_max, [4.0])
    np.testing.assert_allclose(reference.e_max, [5.0, np.inf])


def test_a_saturated_reference_is_refused() -> None:
    one = np.ones(1)
    with pytest.raises(SaturatedReferenceError, match=r"u_ref\[0\] must lie between"):
        Reference(x_ref=one, u_ref=one, u_lower=-one, u_upper=one)
    with pytest.raises(SaturatedReferenceError, match=r"x_ref\[0\] must lie between"):
        Reference(x_ref=one, u_ref=0 * one, u_lower=-one, u_upper=one, x_upper=one / 2)


def test_arrays_of_the_wrong_kind_are_refused() -> None:
    one, two = np.ones(1), np.ones(2)
    with pytest.raises(InvalidShapeError, match=r"u_upper must have shape \(1,\)"):
        Reference(x_ref=one, u_ref=one, u_lower=-one, u_upper=two)
    with pytest.raises(InvalidShapeError, match=r"x_lower must have shape \(2,\)"):
        Reference(x_ref=two, u_ref=0 * one, u_lower=-one, u_upper=one, x_lower=-2 * one)
    with pytest.raises(NotFiniteError, match="x_ref must hold finite real numbers"):
        Reference(x_ref=one * np.inf, u_ref=0 * one, u_lower=-one, u_upper=one)
