"""Smallest and largest distances, against closed forms and a fine grid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import comb

from swarmstart.arrays import Array
from swarmstart.ocp import (
    InvalidProblemError,
    Model,
    Plant,
    interpolate,
    largest_distance,
    smallest_distance,
)
from swarmstart.ocp.loop import dense_output as distances
from swarmstart.tests.ocp.flights_by_hand import written

FIRST, SECOND = np.array([0]), np.array([1])
ALL = np.triu_indices(4, k=1)
S = np.linspace(0.0, 1.0, 6)

coordinates = st.floats(-50, 50)
places = st.tuples(coordinates, coordinates)


def line(begin: tuple[float, float], end: tuple[float, float]) -> Array:
    """Return a uniform motion, one piece: (2, 1, 6)."""
    a, b = np.array(begin), np.array(end)
    return (a[:, None] + np.outer(b - a, S))[:, None, :]


def standing(place: tuple[float, float], like: Array) -> Array:
    """Return a point at rest for as long as another one moves."""
    return np.broadcast_to(np.array(place)[:, None, None], like.shape)


def orbit(model: Model, *, radius: float, phase: float, steps: int = 40) -> Array:
    """Return curves of a UAV on a full circle about the origin at 1 rad/s."""
    plant = Plant(model, dt=2 * np.pi / steps, substeps=1)
    t = phase + np.linspace(0.0, 2 * np.pi, steps + 1)
    states = [0 * t + radius, t, radius * np.sin(t), -radius * np.cos(t)]
    controls = np.tile([[0.0], [1.0]], steps)
    return interpolate(plant, written(plant, states, controls)).curves[2:]


@settings(deadline=None)
@given(a=places, b=places, c=places, d=places)
def test_lines_pass_at_their_closed_form_distance(
    a: tuple[float, float],
    b: tuple[float, float],
    c: tuple[float, float],
    d: tuple[float, float],
) -> None:
    both = np.stack([line(a, b), line(c, d)])
    begin, end = np.subtract(a, c), np.subtract(b, d)
    way = end - begin
    nearest = -begin @ way / (way @ way) if way @ way > 0 else 0.0
    apart = np.hypot(*(begin + np.clip(nearest, 0.0, 1.0) * way))
    assert smallest_distance(both, FIRST, SECOND) == pytest.approx(apart, abs=1e-7)
    farthest = max(np.hypot(*begin), np.hypot(*end))
    assert largest_distance(both, FIRST, SECOND) == pytest.approx(farthest, abs=1e-7)


@settings(deadline=None)
@given(radius=st.floats(0.5, 50), phase=st.floats(0, 6), place=places)
def test_a_circle_passes_a_point_at_the_difference_of_radii(
    unicycle: Model, radius: float, phase: float, place: tuple[float, float]
) -> None:
    """It is farthest at the sum of the radii; 40 steps a turn leave 3e-10 radii."""
    turning = orbit(unicycle, radius=radius, phase=phase)
    both = np.stack([turning, standing(place, turning)])
    away = np.hypot(*place)
    found = smallest_distance(both, FIRST, SECOND)
    assert found == pytest.approx(abs(away - radius), abs=1e-6)
    found = largest_distance(both, FIRST, SECOND)
    assert found == pytest.approx(away + radius, abs=1e-6)


def test_a_minimum_inside_a_piece_is_found_where_both_ends_are_far() -> None:
    both = np.stack(
        [line((-100, 0.5), (100, 0.5)), standing((3, 0), line((0, 0), (0, 0)))]
    )
    assert smallest_distance(both, FIRST, SECOND) == pytest.approx(0.5, abs=1e-9)


def test_a_maximum_inside_a_piece_is_found_where_both_ends_are_near() -> None:
    """x = 4 s (1 - s) is 1 in the middle; its coefficients are 0, 2/5, 3/5, 3/5, 2/5, 0
    times 4 / 2."""
    hump = np.array([[[0, 4 / 5, 6 / 5, 6 / 5, 4 / 5, 0]], [[0] * 6]], dtype=np.float64)
    both = np.stack([hump, standing((0, 0), hump)])
    assert largest_distance(both, FIRST, SECOND) == pytest.approx(1.0, abs=1e-7)
    assert smallest_distance(both, FIRST, SECOND) == 0.0


def test_after_a_jump_of_the_control_the_turning_point_is_found(
    double_integrator: Model,
) -> None:
    """After the jump 3 - 3 t + 3 t^2, at least 2.25 m; the ends show 3 m and 5 m."""
    plant = Plant(double_integrator, dt=1.0, substeps=1)
    flight = written(plant, [[5.0, 3.0, 3.0], [-1.0, -3.0, 3.0]], [[-2.0, 6.0]])
    height = interpolate(plant, flight).curves[:1]
    both = np.stack([height, np.zeros_like(height)])
    assert smallest_distance(both, FIRST, SECOND) == pytest.approx(2.25, abs=1e-7)


def test_a_collision_between_two_looks_is_a_distance_of_zero() -> None:
    both = np.stack([line((-1, -2), (2, 4)), line((1, -1), (-2, 2))])  # at a third
    assert smallest_distance(both, FIRST, SECOND) == pytest.approx(0.0, abs=1e-7)


def test_a_constant_distance_is_both_the_smallest_and_the_largest(
    unicycle: Model,
) -> None:
    """Two UAVs opposite each other on a circle: all pieces are equally near."""
    both = np.stack(
        [orbit(unicycle, radius=7.0, phase=p, steps=4000) for p in (0.0, np.pi)]
    )
    for extreme in (smallest_distance, largest_distance):
        assert extreme(both, FIRST, SECOND) == pytest.approx(14.0, abs=1e-7)


@pytest.mark.parametrize("seed", range(10))
def test_no_point_of_a_fine_grid_is_nearer_or_farther(seed: int) -> None:
    curves = 10 * np.random.default_rng(seed).normal(size=(4, 2, 3, 6))
    s, k = np.linspace(0.0, 1.0, 20_001)[:, None], np.arange(6)
    weights = comb(5, k) * s**k * (1 - s) ** (5 - k)
    relative = (curves[ALL[0]] - curves[ALL[1]]) @ weights.T
    seen = np.linalg.norm(relative, axis=1)
    # Between two instants of the grid |r| changes by |r'| 2.5e-5, |r'| < 1000.
    for extreme, grid, sign in (
        (smallest_distance, seen.min(), 1),
        (largest_distance, seen.max(), -1),
    ):
        gained = sign * (grid - extreme(curves, *ALL))
        assert -1e-7 <= gained < 0.025


def test_the_answer_does_not_depend_on_how_many_are_looked_at_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    curves = np.random.default_rng(0).normal(size=(4, 2, 30, 6))
    whole = [f(curves, *ALL) for f in (smallest_distance, largest_distance)]
    monkeypatch.setattr(distances, "BLOCK", 1)
    parts = [f(curves, *ALL) for f in (smallest_distance, largest_distance)]
    np.testing.assert_allclose(parts, whole, atol=2e-8)


def test_only_the_pairs_asked_for_are_looked_at() -> None:
    points = np.stack([line((x, 0), (x, 0)) for x in (0, 1, 10)])
    pairs = np.array([0, 1]), np.array([2, 2])
    assert smallest_distance(points, *pairs) == 9.0
    assert largest_distance(points, *pairs) == 10.0


def test_no_pair_is_refused() -> None:
    nothing = np.array([], dtype=np.intp)
    with pytest.raises(InvalidProblemError, match="at least one pair"):
        smallest_distance(np.zeros((1, 2, 1, 6)), nothing, nothing)
