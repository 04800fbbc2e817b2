"""Constraints: distances to segments, excesses by hand, what is refused."""

from collections.abc import Callable

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swarmstart.ocp import (
    Connection,
    Constraint,
    InvalidProblemError,
    PathConstraint,
    Separation,
    TerminalConstraint,
    disc,
)
from swarmstart.ocp.separation import nearest_on_segment
from swarmstart.ocp.shooting import path_violation

Array = NDArray[np.float64]
X = ca.SX.sym("x", 2)
A, B = ca.SX.sym("a", 2), ca.SX.sym("b", 2)
NEAREST = ca.Function("nearest", [A, B], [nearest_on_segment(A, B, shortest=1e-22)])
coordinates = st.floats(-50, 50, allow_subnormal=False)
points = st.tuples(coordinates, coordinates).map(np.array)


def distance(a: Array, b: Array) -> float:
    return float(np.linalg.norm(np.array(NEAREST(a, b))))


def excess_of(constraint: Constraint) -> Callable[[Array, Array], float]:
    """Return what a search adds up, with scales that are given."""
    excess = constraint.excess(A, B)
    scale = np.asarray(1.0 if constraint.scale is None else constraint.scale)
    broken = path_violation(
        constraint, excess, ca.SX(1 / np.broadcast_to(scale, (excess.numel(),)))
    )
    function = ca.Function("excess", [A, B], [broken])
    return lambda a, b: float(function(a, b))


def smooth_value(constraint: Constraint) -> ca.Function:
    return ca.Function("smooth", [X], [constraint.smooth(X).values])


@given(a=points, b=points)
def test_segment_distance_is_that_of_a_dense_sampling(a: Array, b: Array) -> None:
    t = np.linspace(0, 1, 1001)
    sampled = np.linalg.norm(a[:, None] + t * (b - a)[:, None], axis=0).min()
    # No point is farther than half a spacing from a sample; 1e-6 m is the length
    # below which a segment is a point.
    spacing = np.linalg.norm(b - a) / 1000
    found = distance(a, b)
    assert sampled - spacing / 2 - 1e-6 <= found <= sampled + 1e-6
    assert distance(b, a) == pytest.approx(found, abs=1e-6)


@given(a=points)
def test_segment_without_length_is_its_point(a: Array) -> None:
    np.testing.assert_array_equal(np.array(NEAREST(a, a)).ravel(), a)


@given(a=points, b=points, along=st.sampled_from(["points", "segments"]))
def test_separation_excess_is_what_is_missing_to_the_limit(
    a: Array, b: Array, along: str
) -> None:
    options = {
        "relative": X,
        "distance": 12.0,
        "margin": 0.5,
        "along": along,
        "scale": 1.0,
    }
    near = distance(a, b) if along == "segments" else float(np.linalg.norm(b))
    graded = excess_of(Separation(**options))(a, b)  # type: ignore[arg-type]
    assert graded == pytest.approx(max(12.5 - near, 0.0), abs=1e-12)
    counted = excess_of(Separation(measure="indicator", **options))  # type: ignore[arg-type]
    assert counted(a, b) == (near <= 12.5)
    assert (graded > 0) == (near < 12.5)


@given(a=points, b=points)
def test_a_connection_is_broken_by_what_lies_beyond_its_limit(
    a: Array, b: Array
) -> None:
    limit = 11.5
    constraint = Connection(relative=X, distance=12.0, margin=0.5, scale=1.0)
    far = float(np.linalg.norm(b))
    over = excess_of(constraint)(a, b)
    assert over == pytest.approx(max(far - limit, 0.0), abs=1e-12)
    value = float(smooth_value(constraint)(b))
    assert value == pytest.approx((far - limit) * (far + limit) / 23, abs=1e-10)


@given(a=points, b=points, t=st.floats(0, 1))
def test_no_point_of_a_segment_is_farther_than_its_ends(
    a: Array, b: Array, t: float
) -> None:
    """Why a connection needs no segments."""
    farthest = max(np.linalg.norm(a), np.linalg.norm(b))
    assert np.linalg.norm(a + t * (b - a)) <= farthest + 1e-12


@given(a=points)
def test_smooth_inequality_has_the_sign_of_the_distance(a: Array) -> None:
    constraint = Separation(relative=X, distance=12.0, smooth_margin=0.25)
    value, near = float(smooth_value(constraint)(a)), float(np.linalg.norm(a))
    assert value == pytest.approx((near - 12.25) * (near + 12.25) / 24.5, abs=1e-10)
    if abs(near - 12.25) > 1e-12:
        assert (value < 0) == (near < 12.25)


def test_chord_that_jumps_a_disc_is_seen_on_the_segment_only() -> None:
    before, after = np.array([-15.0, 1.0]), np.array([15.0, 1.0])
    on_points = disc(X, centre=[0, 0], radius=12, scale=1)
    on_segments = disc(X, centre=[0, 0], radius=12, along="segments", scale=1)
    assert excess_of(on_points)(before, after) == 0
    assert excess_of(on_segments)(before, after) == pytest.approx(11.0)


def test_indicator_counts_the_limit_itself_as_a_collision() -> None:
    """(5.16) says "at or below"; the graded excess is zero there."""
    on_limit = np.array([3.0, 4.0])
    counted = Separation(relative=X, distance=5.0, measure="indicator")
    assert excess_of(counted)(on_limit, on_limit) == 1
    graded = Separation(relative=X, distance=5.0)
    assert excess_of(graded)(on_limit, on_limit) == 0


def test_disc_is_a_separation_from_its_centre() -> None:
    constraint = disc(X, centre=[3, -4], radius=2, margin=0.5)
    relative = ca.Function("relative", [X], [constraint.expression])
    np.testing.assert_array_equal(np.array(relative([3, 1])).ravel(), [0, 5])
    assert (constraint.distance, constraint.margin) == (2, 0.5)


def test_path_excess_sums_scaled_rows_at_the_end() -> None:
    limits = {"expression": X, "lower": [-1, -np.inf], "upper": [1, 2]}
    nowhere, end = np.zeros(2), np.array([-4.0, 2.5])
    graded = PathConstraint(scale=0.5, **limits)  # type: ignore[arg-type]
    assert excess_of(graded)(nowhere, end) == pytest.approx((3 + 0.5) / 0.5)
    assert excess_of(graded)(end, nowhere) == 0
    counted = PathConstraint(measure="indicator", **limits)  # type: ignore[arg-type]
    assert excess_of(counted)(nowhere, end) == 2
    assert counted.rows(X).values.numel() == 2  # a range is one row


def test_path_constraint_without_finite_limits_demands_nothing() -> None:
    constraint = PathConstraint(expression=X)
    assert excess_of(constraint)(np.full(2, -1e9), np.full(2, 1e9)) == 0


def test_terminal_excess_is_the_scaled_distance_from_the_interval() -> None:
    equality = TerminalConstraint(expression=X, scale=2.0)
    interval = TerminalConstraint(expression=X, lower=-1, upper=[1, 5])
    for constraint, beyond in ((equality, 3.5), (interval, 3 / 1 - 0 + 2)):
        value = excess_of(constraint)
        assert value(np.zeros(2), np.array([3.0, -4.0])) == beyond
        assert value(np.zeros(2), np.zeros(2)) == 0


def test_limits_are_copied_and_read_only() -> None:
    upper = np.array([1.0, 2.0])
    constraint = PathConstraint(expression=X, upper=upper)
    upper[0] = 9.0
    kept = np.asarray(constraint.upper)
    assert kept[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        kept[0] = 9.0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Separation(relative=X, distance=0), "distance must be positive"),
        (lambda: Separation(relative=X, distance=np.inf), "distance must be positive"),
        (lambda: Connection(relative=X, distance=0), "distance must be positive"),
        (
            lambda: Connection(relative=X, distance=1, margin=1),
            "distance less margin must be positive",
        ),
        (
            lambda: Separation(relative=X, distance=1, margin=-1),
            "margins must be at least 0, got -1",
        ),
        (
            lambda: Separation(relative=X, distance=1, along="segment"),  # type: ignore[arg-type]
            "along must be points or segments, got 'segment'",
        ),
        (
            lambda: Separation(relative=X, distance=1, measure="count"),  # type: ignore[arg-type]
            "measure must be excess or indicator, got 'count'",
        ),
        (
            lambda: PathConstraint(expression=X, measure="count"),  # type: ignore[arg-type]
            "measure must be excess or indicator, got 'count'",
        ),
        (lambda: disc(X, centre=[0, 0], radius=-1), "radius must be positive, got -1"),
        (
            lambda: disc(X, centre=[0, 0, 0], radius=1),
            r"centre must have shape \(2,\), got \(3,\)",
        ),
        (
            lambda: PathConstraint(expression=X, scale=0),
            "scale .* must be positive, got 0",
        ),
        (
            lambda: PathConstraint(expression=X, lower=[1, 2, 3]),
            "pair .* of 2 numbers, got",
        ),
        (lambda: PathConstraint(expression=X, lower=2, upper=1), "lower <= upper"),
        (lambda: PathConstraint(expression=X, lower=np.inf), "lower below inf"),
        (lambda: PathConstraint(expression=X, lower=np.nan), "lower <= upper"),
        (
            lambda: TerminalConstraint(expression=X, scale=-1),
            "scale .* must be positive",
        ),
        (
            lambda: TerminalConstraint(expression=ca.MX.sym("m")),  # type: ignore[arg-type]
            "expression must be a CasADi SX expression",
        ),
    ],
)
def test_refuses_what_is_no_constraint(
    make: Callable[[], object], message: str
) -> None:
    with pytest.raises(InvalidProblemError, match=message):
        make()
