"""Least times on grids: closed forms, order of convergence, extremals beside them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.benchmarks.hard.blocks import Box, Point
from swarmstart.benchmarks.hard.currents import Current, Vortex
from swarmstart.benchmarks.hard.extremals import arrivals
from swarmstart.benchmarks.hard.fast_sweeping import minimum_time, time_on_grid

BOX: Box = ((-1.0, -1.0), (1.0, 1.0))
START: Point = (-0.83, 0.11)
GOAL: Point = (0.77, 0.23)
VORTEX = Current(vortices=(Vortex((0.1, -0.1), 0.2, 0.15),))

inside = st.integers(-99, 99).map(lambda n: n / 100)
points = st.tuples(inside, inside)


@settings(max_examples=30)
@given(points, points, st.floats(0, 0.95), st.floats(-np.pi, np.pi))
def test_times_in_a_uniform_current_are_exact(
    start: Point, goal: Point, speed: float, direction: float
) -> None:
    # Zermelo's closed form: the boat's own way |d - w t| is as long as t.
    w = speed * np.array([np.cos(direction), np.sin(direction)])
    current = Current(uniform=(float(w[0]), float(w[1])))
    time = time_on_grid(start, goal, current, ((-1, -1), (1, 1.25)), cells=9)
    way = np.subtract(goal, start)
    assert np.hypot(*(way - w * time)) == pytest.approx(time, abs=1e-11)


def test_a_box_that_is_no_square_has_cells_of_one_size() -> None:
    narrow: Box = ((-1.0, -0.25), (1.0, 0.375))
    ends = ((-0.9, 0.1), (0.9, -0.2))
    shear = Current(linear=((0.0, 0.8), (0.0, 0.0)))
    wide = minimum_time(*ends, shear, BOX, cells=16)
    assert minimum_time(*ends, shear, narrow, cells=16).time == pytest.approx(
        wide.time, rel=1e-3
    )


def test_error_halves_with_the_cells_and_extrapolation_removes_it() -> None:
    exact = arrivals(START, GOAL, VORTEX, BOX, latest=1.6)[0].time
    found = minimum_time(START, GOAL, VORTEX, BOX, cells=25)
    errors = np.array(found.grids) - exact
    ratios = errors[:-1] / errors[1:]
    assert np.all((1.8 < ratios) & (ratios < 2.3))
    assert abs(found.time - exact) <= found.error < 1e-3 * exact
    assert abs(errors[-1]) > 5 * abs(found.time - exact)


def test_the_other_way_in_the_opposite_current_takes_as_long() -> None:
    opposite = Current(vortices=(Vortex((0.1, -0.1), -0.2, 0.15),))
    there = minimum_time(START, GOAL, VORTEX, BOX, cells=25)
    back = minimum_time(GOAL, START, opposite, BOX, cells=25)
    assert back.time == pytest.approx(there.time, abs=there.error + back.error)


def test_the_box_limits_the_way() -> None:
    # A current against the boat that is weak far out: the box closes that way.
    shear = Current(linear=((0.0, -0.3), (0.0, 0.0)), uniform=(-0.6, 0.0))
    ends = ((-0.9, 0.0), (0.9, 0.0))
    low: Box = ((-1.0, -0.2), (1.0, 0.2))
    free = minimum_time(*ends, shear, ((-1, -1.2), (1, 0.2)), cells=20)
    held = minimum_time(*ends, shear, low, cells=20)
    # At full speed along the lower side it takes 1.8/(1 - 0.54).
    assert free.time < held.time - held.error
    assert held.time > 1.8 / (1 - 0.54)


@pytest.mark.parametrize(
    ("start", "goal", "current", "cells", "message"),
    [
        ((2, 0), GOAL, VORTEX, 10, r"start must be in the box .*, got \(2, 0\)"),
        (START, (0, -2), VORTEX, 10, "goal must be in the box"),
        (START, GOAL, Current(uniform=(0.6, 0.8)), 10, "slower than 1 m/s, got 1"),
        (START, GOAL, VORTEX, 7, "cells must be at least 8, got 7"),
    ],
)
def test_what_has_no_time_is_refused(
    start: Point, goal: Point, current: Current, cells: int, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        time_on_grid(start, goal, current, BOX, cells=cells)
