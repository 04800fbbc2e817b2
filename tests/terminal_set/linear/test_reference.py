from __future__ import annotations

import numpy as np
import pytest

from swarmstart.terminal_set import (
    InvalidShapeError,
    MovingReferenceError,
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


@pytest.mark.parametrize(
    ("bounds", "room"),
    [
        ({}, [np.inf, np.inf]),
        ({"x_lower": [10.0, -2.0]}, [5.0, 2.0]),
        ({"x_upper": [16.0, np.inf]}, [1.0, np.inf]),
        ({"x_lower": [10.0, -2.0], "x_upper": [30.0, 1.0]}, [5.0, 1.0]),
    ],
)
def test_states_without_a_bound_on_a_side_have_all_the_room_there(
    bounds: dict[str, list[float]], room: list[float]
) -> None:
    reference = Reference(
        x_ref=np.array([15.0, 0.0]), u_ref=np.zeros(1), u_lower=-np.ones(1),
        u_upper=np.ones(1),
        **{name: np.array(bound) for name, bound in bounds.items()},
    )  # fmt: skip
    np.testing.assert_array_equal(reference.e_max, room)
    np.testing.assert_array_equal(reference.rates, [0.0, 0.0])


@pytest.mark.parametrize("speed", [1.0, -1.0, 0.25, 0.0])
def test_states_with_bounds_do_not_move_and_others_may(speed: float) -> None:
    def moving(velocity: list[float]) -> Reference:
        return Reference(
            x_ref=np.array([15.0, 0.0]), u_ref=np.zeros(1), u_lower=-np.ones(1),
            u_upper=np.ones(1), x_lower=np.array([10.0, -np.inf]),
            velocity=np.array(velocity),
        )  # fmt: skip

    np.testing.assert_array_equal(moving([0.0, speed]).rates, [0.0, speed])
    if speed:
        with pytest.raises(MovingReferenceError) as told:
            moving([speed, 0.0])
        assert (told.value.entry, told.value.velocity) == (0, speed)
    with pytest.raises(InvalidShapeError, match=r"velocity must have shape \(2,\)"):
        moving([0.0])
