"""Zermelo's extremals: published numbers, first integrals, symmetry, and the grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.optimize import root

from swarmstart.arrays import Array
from swarmstart.benchmarks.hard.blocks import Box, Point
from swarmstart.benchmarks.hard.currents import Current, Vortex
from swarmstart.benchmarks.hard.extremals import arrivals, extremals, least_time

BOX: Box = ((-1.0, -1.0), (1.0, 1.0))
START: Point = (-0.83, 0.11)
GOAL: Point = (0.77, 0.23)
THREE = Current(
    vortices=(
        Vortex((0.1, 0.4), 0.12, 0.1),
        Vortex((-0.2, -0.4), -0.12, 0.1),
        Vortex((0.3, -0.2), 0.12, 0.1),
    )
)


def test_example_of_bryson_and_ho_has_its_published_answer() -> None:
    # Section 2.7, example 1: u = -y, from (3.66, -1.86) to the origin.
    against = Current(linear=((0.0, -1.0), (0.0, 0.0)))
    wide: Box = ((-9.0, -9.0), (9.0, 9.0))
    best = arrivals((3.66, -1.86), (0, 0), against, wide, latest=6)[0]
    assert np.rad2deg(best.heading) == pytest.approx(105, abs=0.5)
    assert best.time == pytest.approx(5.46, abs=0.02)


def test_shear_has_the_time_of_its_first_integrals() -> None:
    # tan(theta) falls at the rate s, and y - y0 = (sec(theta0) - sec(theta)) / s.
    s = 0.8

    def y(t: float, heading: float) -> float:
        slope = np.tan(heading) - s * t
        return float(START[1] + (1 / np.cos(heading) - np.hypot(1, slope)) / s)

    def miss(unknown: Array) -> Array:
        heading, time = unknown

        def rate(t: float) -> float:
            slope = np.tan(heading) - s * t
            return float(1 / np.hypot(1, slope) + s * y(t, heading))

        x = START[0] + quad(rate, 0, time, epsabs=1e-13)[0]
        return np.array([x - GOAL[0], y(time, heading) - GOAL[1]])

    heading, time = root(miss, [0.5, 1.4], tol=1e-13).x
    shear = Current(linear=((0.0, s), (0.0, 0.0)))
    best = arrivals(START, GOAL, shear, BOX, latest=2)[0]
    assert best.time == pytest.approx(time, rel=1e-10)
    assert best.heading == pytest.approx(heading, rel=1e-8)


def test_heading_is_the_direction_of_the_costate() -> None:
    # In a linear current the costate is exp(-A' t) times its start.
    A = np.array([[0.3, 0.2], [-0.1, -0.2]])
    rows: tuple[Point, Point] = ((0.3, 0.2), (-0.1, -0.2))
    first = np.linspace(-3, 3, 7)
    path = extremals(START, first, np.full(7, 2.0), Current(linear=rows), 1e-12)
    costate = expm(-2.0 * A.T) @ np.array([np.cos(first), np.sin(first)])
    last = path[2, -1]
    assert np.allclose(costate / np.hypot(*costate), [np.cos(last), np.sin(last)])


@pytest.mark.parametrize("goal", [(0.5, 0.0), (-0.5, 0.0), (0.0, 0.5)])
def test_an_extremal_at_an_edge_of_cells_is_found_once(goal: Point) -> None:
    (only,) = arrivals((0, 0), goal, Current(), BOX, latest=1)
    assert only.time == pytest.approx(0.5, abs=1e-12)


def test_nothing_arrives_before_the_least_time() -> None:
    assert arrivals((0, 0), (0.5, 0.0), Current(), BOX, latest=0.49) == ()


def test_the_way_back_in_the_opposite_current_takes_as_long() -> None:
    opposite = Current(
        vortices=tuple(replace(v, strength=-v.strength) for v in THREE.vortices)
    )
    there = [a.time for a in arrivals(START, GOAL, THREE, BOX, latest=1.7)]
    back = [a.time for a in arrivals(GOAL, START, opposite, BOX, latest=1.7)]
    assert len(there) > 1
    assert np.allclose(there, back, rtol=1e-8)


def test_the_grid_confirms_the_earliest_arrival_and_no_other() -> None:
    best = least_time(START, GOAL, THREE, BOX, cells=40)
    assert best.confirmed
    assert best.arrivals[0].time == pytest.approx(best.grid.time, rel=1e-3)
    assert len(best.arrivals) > 1
    assert not replace(best, arrivals=best.arrivals[1:]).confirmed
    assert not replace(best, arrivals=()).confirmed


def test_paths_out_of_the_box_do_not_count() -> None:
    best = arrivals(START, GOAL, THREE, BOX, latest=1.5)[0]
    heading, time = np.array([best.heading]), np.array([best.time])
    path = extremals(START, heading, time, THREE, 1e-10)[:2, :, 0]
    assert np.allclose(path[:, -1], GOAL, atol=1e-7)
    low: Box = ((-1.0, float(path[1].min()) + 1e-3), (1.0, 1.0))
    assert best not in arrivals(START, GOAL, THREE, low, latest=1.5)


def test_derivatives_of_a_current_are_its_differences() -> None:
    current = Current(THREE.vortices, (0.1, -0.2), ((0.3, 0.1), (-0.2, 0.05)))
    p = np.random.default_rng(0).uniform(-1, 1, (2, 50))
    step = 1e-6
    for k in (0, 1):
        by = step * np.eye(2)[:, k, None]
        change = (current.velocity(p + by) - current.velocity(p - by)) / (2 * step)
        assert np.allclose(current.jacobian(p)[:, k], change, atol=1e-7)


def test_a_vortex_turns_fastest_at_its_core() -> None:
    vortex = Current(vortices=(Vortex((0.5, 0), 0.3, 0.25),))
    p = np.array([0.5, 0])[:, None] + np.array([np.linspace(0, 1, 401), np.zeros(401)])
    speed = vortex.velocity(p)
    assert np.argmax(speed[1]) == 100
    assert speed[1, 100] == pytest.approx(0.3 / 0.5)
    assert np.allclose(speed[0], 0)


@pytest.mark.parametrize("core", [0, -1, np.nan])
def test_vortices_without_a_core_are_refused(core: float) -> None:
    with pytest.raises(ValueError, match="finite numbers and a core > 0"):
        Vortex((0, 0), 1, core)
