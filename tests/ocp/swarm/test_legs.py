"""Cubic legs: SciPy's Hermite spline as the oracle of path, bounds and bulges."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from swarmstart.arrays import Array
from swarmstart.ocp.swarm.legs import (
    LONGEST,
    PointMass,
    State,
    is_feasible,
    least_steps,
    rest,
    write_leg,
)
from swarmstart.ocp.swarm.plans import no_plans

STEP_S = 0.1
BODY = PointMass(np.array([1.0, 1.0, 0.5]), np.array([2.0, 2.0, 1.0]), STEP_S)
NOWHERE = np.zeros(3)


def states(most: float) -> st.SearchStrategy[State]:
    """Return states whose positions and velocities have at most a size."""
    triple = st.tuples(*[st.floats(-most, most)] * 3).map(np.array)
    return st.builds(State, triple, triple)


def spline(start: State, end: State, steps: int) -> CubicHermiteSpline:
    """Return the leg by SciPy."""
    return CubicHermiteSpline(
        [0.0, steps * STEP_S],
        np.stack([start.position, end.position]),
        np.stack([start.velocity, end.velocity]),
    )


def excess(start: State, end: State, steps: int) -> float:
    """Return the largest ratio of accelerations and speeds to their bounds."""
    path, times = spline(start, end, steps), np.linspace(0, steps * STEP_S, 2001)
    accelerations = np.abs(path(times, 2)) / BODY.acceleration
    speeds = np.abs(path(times, 1)) / BODY.speed
    return float(max(accelerations.max(), speeds.max()))


@settings(deadline=None)
@given(states(1.5), states(1.5), st.integers(1, 80))
def test_a_leg_is_feasible_if_its_bounds_hold_everywhere(
    start: State, end: State, steps: int
) -> None:
    ratio = excess(start, end, steps)
    if abs(ratio - 1) > 1e-3:
        assert is_feasible(start, end, steps, BODY) == (ratio < 1)


@settings(deadline=None)
@given(states(1.0), states(1.0), st.integers(1, 40))
def test_samples_are_on_the_path_and_the_path_keeps_to_its_chords(
    start: State, end: State, steps: int
) -> None:
    plans = no_plans(1, 60)
    plans.samples[0, 3] = start.position
    length = write_leg(0, 3, (start, end), steps, BODY, plans)
    path = spline(start, end, steps)
    times = np.arange(steps + 1) * STEP_S
    samples: Array = plans.samples[0, 3 : 4 + steps]
    assert samples == pytest.approx(path(times), abs=1e-9)
    assert length == pytest.approx(
        np.linalg.norm(np.diff(samples, axis=0), axis=1).sum()
    )
    assert (samples[-1] == end.position).all()
    for share in np.linspace(0, 1, 11):
        chord = (1 - share) * samples[:-1] + share * samples[1:]
        off = np.linalg.norm(path(times[:-1] + share * STEP_S) - chord, axis=1)
        assert (off <= plans.bulges[0, 3 : 3 + steps] + 1e-9).all()
    # The bound is that of the largest acceleration, not much more.
    largest = np.linalg.norm(path(np.linspace(0, times[-1], 999), 2), axis=1).max()
    most = plans.bulges[0, 3 : 3 + steps].max()
    assert most <= np.sqrt(3) * largest * STEP_S**2 / 8 + 1e-9


@settings(deadline=None)
@given(states(1.0), states(1.0))
def test_no_shorter_leg_is_feasible_than_the_least(start: State, end: State) -> None:
    steps = least_steps(start, end, 300, BODY)
    shorter = range(1, min(steps, 300))
    assert not any(is_feasible(start, end, each, BODY) for each in shorter)
    if steps < LONGEST:
        assert is_feasible(start, end, steps, BODY)


def test_from_rest_to_rest_the_least_time_is_that_of_the_peak_acceleration() -> None:
    # 6 d / T^2 <= a along x: T = sqrt(6) s for a metre.
    start, end = State(NOWHERE, NOWHERE), State(np.array([1.0, 0, 0]), NOWHERE)
    assert least_steps(start, end, 300, BODY) == np.ceil(np.sqrt(6) / STEP_S)
    assert least_steps(start, end, 24, BODY) == LONGEST


def test_what_is_no_number_is_not_feasible() -> None:
    end = State(np.array([np.nan, 0, 0]), NOWHERE)
    assert not is_feasible(State(NOWHERE, NOWHERE), end, 50, BODY)
    assert least_steps(State(NOWHERE, NOWHERE), end, 50, BODY) == LONGEST


def test_a_leg_ends_with_the_plan_and_a_rest_is_without_bulge() -> None:
    plans = no_plans(1, 10)
    plans.samples[0, 4] = 0.0
    start, end = State(NOWHERE, NOWHERE), State(np.ones(3), NOWHERE)
    write_leg(0, 4, (start, end), 50, BODY, plans)
    assert np.isfinite(plans.samples[0, 4:]).all()
    rest(0, 7, plans)
    assert (plans.samples[0, 7:] == plans.samples[0, 7]).all()
    assert (plans.bulges[0, 7:] == 0).all()
    assert (plans.bulges[0, 4:7] > 0).all()
