"""Distances to keep: measured rows, their smooth form, and what is refused."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmstart.ocp import Connection, InvalidProblemError, Separation, disc

Array = NDArray[np.float64]
X, Y = ca.SX.sym("x", 2), ca.SX.sym("y", 3)
distances = st.floats(1e-6, 1e6)
angles = st.floats(0, 2 * np.pi)
KINDS: list[type[Separation] | type[Connection]] = [Separation, Connection]


def smooth(constraint: Separation | Connection) -> ca.Function:
    value = constraint.smooth(X).values
    return ca.Function("smooth", [X], [value, ca.gradient(value, X)])


@pytest.mark.parametrize("kind", KINDS)
@given(distance=distances, angle=angles, share=st.floats(-1e-6, 1e-6))
@settings(max_examples=30, deadline=None)
def test_smooth_row_is_the_measured_one_near_the_limit(
    kind: type[Separation] | type[Connection],
    distance: float,
    angle: float,
    share: float,
) -> None:
    """(r^2 - d^2) / 2d = (r - d) + (r - d)^2 / 2d."""
    constraint = kind(relative=X, distance=distance)
    direction = np.array([np.cos(angle), np.sin(angle)])
    r = distance * (1 + share)
    value, slope = smooth(constraint)(r * direction)
    off = distance * (share + share**2 / 2)
    assert float(value) == pytest.approx(off, abs=1e-14 * distance)
    np.testing.assert_allclose(np.array(slope).ravel(), direction * (1 + share))
    rows = constraint.rows(X)
    measured = float(ca.Function("measured", [X], [rows.values])(r * direction))
    assert measured == pytest.approx(r)


@pytest.mark.parametrize("kind", KINDS)
def test_smooth_row_has_a_slope_at_the_centre(
    kind: type[Separation] | type[Connection],
) -> None:
    """The distance itself has none: it would give NaN."""
    value, slope = smooth(kind(relative=X, distance=2.0))([0, 0])
    assert float(value) == -1  # (0 - 4) / 4
    np.testing.assert_array_equal(np.array(slope).ravel(), [0, 0])


@given(unit=st.integers(-30, 30).map(lambda k: 2.0**k))
@settings(max_examples=20, deadline=None)
def test_rows_and_excess_have_the_unit_of_the_distance(unit: float) -> None:
    a, b = np.array([3.0, 1.0]), np.array([-2.0, 0.5])
    A, B = ca.SX.sym("a", 2), ca.SX.sym("b", 2)

    def values(times: float) -> Array:
        found = []
        for along in ("points", "segments"):
            stated = Separation(
                relative=X, distance=1.5 * times, margin=0.25 * times,
                smooth_margin=0.5 * times, along=along,
            )  # fmt: skip
            outputs = [stated.excess(A, B), stated.smooth(B).values]
            found.append(ca.Function("f", [A, B], outputs)(times * a, times * b))
        return np.array(found, dtype=np.float64).ravel()

    np.testing.assert_array_equal(values(unit), unit * values(1.0))


def test_scale_is_the_distance_unless_given() -> None:
    for kind in KINDS:
        assert np.asarray(kind(relative=X, distance=3.0).scale) == 3
        assert np.asarray(kind(relative=X, distance=3.0, scale=7).scale) == 7


def test_ball_is_a_disc_in_space() -> None:
    ball = disc(Y, centre=[1, 2, 2], radius=1.0)
    value = ca.Function("value", [Y], [ball.rows(ball.expression).values])
    assert float(value([0, 0, 0])) == 3


@pytest.mark.parametrize(
    "centre", [[1, 2], (1.0, 2.0), ca.DM([1, 2]), np.array([1, 2])]
)
def test_centre_comes_in_many_forms(centre: object) -> None:
    stated = disc(X, centre=centre, radius=1)  # type: ignore[arg-type]
    value = ca.Function("value", [X], [stated.expression])
    np.testing.assert_array_equal(np.array(value([1, 2])).ravel(), [0, 0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: disc(X, centre="ab", radius=1), "centre must be 2 numbers, got ab"),  # type: ignore[arg-type]
        (lambda: disc(X, centre=None, radius=1), "centre must be 2 numbers, got None"),  # type: ignore[arg-type]
        (lambda: disc(X, centre=[[1], 2], radius=1), "centre must be 2 numbers"),  # type: ignore[list-item]
        (lambda: disc(X, centre=[np.nan, 0], radius=1), "centre must be finite"),
        (lambda: disc(X, centre=[np.inf, 0], radius=1), "centre must be finite"),
        (lambda: disc(X, centre=[], radius=1), r"centre must have shape \(2,\)"),
        (lambda: Separation(relative=[], distance=1), "at least one row, got none"),  # type: ignore[arg-type]
        (
            lambda: Connection(relative=ca.SX(0, 1), distance=1),
            "relative must have at least one row",
        ),
        (lambda: Separation(relative=X, distance=np.nan), "distance must be positive"),
        (lambda: Separation(relative=X, distance="1"), "distance must be a number"),  # type: ignore[arg-type]
        (
            lambda: Separation(relative=X, distance=1, scale=[1, 2]),
            "scale of the separation must be a positive number or 1 of them",
        ),
    ],
)
def test_refuses_what_is_no_distance(make: Callable[[], object], message: str) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        make()
