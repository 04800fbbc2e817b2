"""Distances to keep: measured rows, their smooth form, and errors."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.ocp import (
    Connection,
    Constraint,
    InvalidProblemError,
    PathConstraint,
    Separation,
    TerminalConstraint,
    disc,
)
from swarmstart.ocp.system.separation import (
    as_path,
    as_terminal,
    known_scales,
    label,
    nearest_on_segment,
)
from swarmstart.tests.ocp.excesses import excess_of

X, Y = ca.SX.sym("x", 2), ca.SX.sym("y", 3)
distances = st.floats(1e-6, 1e6)
angles = st.floats(0, 2 * np.pi)
A, B = ca.SX.sym("a", 2), ca.SX.sym("b", 2)
NEAREST = ca.Function("nearest", [A, B], [nearest_on_segment(A, B, shortest=1e-22)])
coordinates = st.floats(-50, 50, allow_subnormal=False)
points = st.tuples(coordinates, coordinates).map(np.array)
KINDS: list[type[Separation] | type[Connection]] = [Separation, Connection]


def smooth(constraint: Separation | Connection) -> ca.Function:
    value = constraint.smooth(X).values
    return ca.Function("smooth", [X], [value, ca.gradient(value, X)])


def distance(a: Array, b: Array) -> float:
    return float(np.linalg.norm(np.array(NEAREST(a, b))))


def smooth_value(constraint: Constraint) -> ca.Function:
    return ca.Function("smooth", [X], [constraint.smooth(X).values])


@given(a=points, b=points)
def test_segment_distance_is_that_of_a_dense_sampling(a: Array, b: Array) -> None:
    t = np.linspace(0, 1, 1001)
    sampled = np.linalg.norm(a[:, None] + t * (b - a)[:, None], axis=0).min()
    # No point is farther than half a spacing from a sample. A segment shorter than 1e-6
    # m counts as a point.
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
    """A connection needs no segments."""
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


@pytest.mark.parametrize("kind", KINDS)
def test_smooth_row_and_measured_row_have_the_same_limit(
    kind: type[Separation] | type[Connection],
) -> None:
    """The smooth row is in metres to the limit, the measured one in metres."""
    stated = kind(relative=X, distance=3.0)
    smoothed, measured = stated.smooth(X), stated.rows(X)
    far = kind is Separation
    for rows, limit in ((smoothed, 0.0), (measured, 3.0)):
        expected = [limit, np.inf] if far else [-np.inf, limit]
        assert [float(rows.lower[0]), float(rows.upper[0])] == expected


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
    np.testing.assert_allclose(
        np.array(slope).ravel(), direction * (1 + share), atol=1e-12
    )
    rows = constraint.rows(X)
    measured = float(ca.Function("measured", [X], [rows.values])(r * direction))
    assert measured == pytest.approx(r)


@pytest.mark.parametrize("kind", KINDS)
def test_smooth_row_has_a_slope_at_the_centre(
    kind: type[Separation] | type[Connection],
) -> None:
    """The distance itself has no derivative at 0: it would give NaN."""
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
        (lambda: disc(X, centre=[0, 0], radius=-1), "radius must be positive, got -1"),
        (
            lambda: disc(X, centre=[0, 0, 0], radius=1),
            r"centre must have shape \(2,\), got \(3,\)",
        ),
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


@pytest.mark.parametrize(
    ("limits", "scales"),
    [
        ({"lower": [-1, 0], "upper": [2, 0.5]}, [3.0, 0.5]),  # The widths of ranges.
        ({"lower": [-1, 7], "upper": [np.inf, 7]}, [np.nan, np.nan]),
        ({"lower": 4, "upper": 9, "scale": [2, 3]}, [2.0, 3.0]),
    ],
)
def test_scale_of_a_range_is_its_width_unless_one_is_given(
    limits: dict[str, Any], scales: list[float]
) -> None:
    found = known_scales(PathConstraint(expression=X, **limits))
    np.testing.assert_array_equal(found, scales)


def test_connection_that_is_as_long_as_allowed_is_not_counted() -> None:
    tied = Connection(relative=X, distance=5.0)
    excess = tied.excess(X, X)
    counted = ca.Function("counted", [X], [tied.indicated(excess)])
    for place, count in (((3.0, 4.0), 0), ((3.0, 4.1), 1), ((0.5, 5.25), 1)):
        assert float(counted(place)) == count


def test_constraint_is_named_by_its_name_its_expression_or_its_symbols() -> None:
    part = ca.sin(X[0]) * ca.exp(X[1])
    folded = part + ca.sqrt(part**2 + part)
    for expression, name, told in (
        (X[0], "mine", "mine"),
        (X[0] - X[1], "", "(x_0-x_1)"),
        (folded, "", "a constraint of x_0, x_1"),
        (folded, "mine", "mine"),
    ):
        stated = PathConstraint(expression=expression, upper=1, name=name)
        assert label(stated) == told
    # A long text that begins with its symbols is cut.
    cut = label(PathConstraint(expression=ca.vertcat(X, X, X, X, X, X), upper=1))
    assert cut.startswith("[x_0, x_1") and not cut.startswith("a constraint")


class Own:
    """A constraint of a user."""

    expression = X

    def excess(self) -> None:
        """The parts that are looked for."""

    def smooth(self) -> None:
        """The other part."""


def test_path_constraints_are_taken_in_every_form_and_nothing_else() -> None:
    stated = as_path(X[0] <= 3)
    assert isinstance(stated, PathConstraint)
    assert (stated.upper, stated.lower) == ([3.0], [-np.inf])
    assert stated.name == "(x_0<=3)"
    for own in (Own(), Separation(relative=X, distance=1.0)):
        kept: object = as_path(own)
        assert kept is own
    lacking = SimpleNamespace(expression=X, excess=None)
    for refused in (5.0, "x", (X, 1), lacking):
        with pytest.raises(InvalidProblemError, match="constraints must hold Path"):
            as_path(refused)
    with pytest.raises(InvalidProblemError, match="belongs in the list `terminal`"):
        as_path(TerminalConstraint(expression=X))


def test_terminal_constraints_are_taken_in_every_form_and_nothing_else() -> None:
    own = TerminalConstraint(expression=X)
    assert as_terminal(own) is own
    for entry, lower, upper in (
        (X, [0, 0], [0, 0]),
        (X[0] >= 3, [3], [np.inf]),
        ((X, 2.0), [2, 2], [2, 2]),
        ((X, [2.0, 5.0]), [2, 5], [2, 5]),
    ):
        found = as_terminal(entry)
        np.testing.assert_array_equal(found.lower, lower)
        np.testing.assert_array_equal(found.upper, upper)
    for refused in ((X,), (X, 1.0, 2.0), [X, 1.0], "x", 5.0, ()):
        with pytest.raises(InvalidProblemError, match="terminal must hold TerminalCo"):
            as_terminal(refused)
    apart = Separation(relative=X, distance=1.0)
    for path in (PathConstraint(expression=X), apart):
        with pytest.raises(InvalidProblemError, match=r"got a .*: use TerminalConstr"):
            as_terminal(path)
