"""Bounds of the errors of disturbed vehicles hold, and the worst case reaches them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarmstart.arrays import Array
from swarmstart.ocp.swarm.tracking import EXACT, _integral, tracking_of

PARTS = 8
"""Number of pieces of a step in which the disturbance is constant."""


def errors(gain: Array, pushes: Array, h: float) -> Array:
    """Return position, velocity and correction of a vehicle that is pushed.

    Args:
        gain: K, shape (2,).
        pushes: Disturbances, shape (steps, PARTS) [m/s^2].
        h: Length of a step [s].
    """
    x, v, found, t = 0.0, 0.0, [], h / PARTS
    for row in pushes:
        held = -(gain[0] * x + gain[1] * v)
        for push in row:
            x, v = x + t * v + t**2 / 2 * (held + push), v + t * (held + push)
            found.append((abs(x), abs(v), abs(held)))
    return np.asarray(np.array(found).max(axis=0))


def worst_pushes(gain: Array, h: float, steps: int) -> Array:
    """Return the pushes of size 1 after which the position is largest."""
    A, B = np.array([[1.0, h], [0.0, 1.0]]), np.array([[h**2 / 2], [h]])
    F, t = A - B @ gain[None], h / PARTS
    part = np.array([[1.0, t], [0.0, 1.0]])
    found, after = [], np.array([1.0, 0.0])
    for _ in range(steps):
        row = [
            after @ np.linalg.matrix_power(part, PARTS - 1 - j) @ [t**2 / 2, t]
            for j in range(PARTS)
        ]
        found.append(np.sign(row))
        after = after @ F
    return np.array(found[::-1])


@pytest.mark.parametrize("h", [0.02, 0.1, 0.5])
def test_the_worst_disturbance_comes_near_the_bound_and_not_beyond(h: float) -> None:
    tracking = tracking_of(0.3, h)
    steps = int(30 / h)
    reached = errors(tracking.gain, 0.3 * worst_pushes(tracking.gain, h, steps), h)
    # Between samples the bound is that of the chord, so it is not reached.
    assert 0.85 * tracking.position < reached[0] <= tracking.position


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.05, 0.1, 0.3]), st.floats(0.01, 2.0))
def test_no_random_disturbance_exceeds_a_bound(
    seed: int, h: float, size: float
) -> None:
    tracking = tracking_of(size, h)
    rng = np.random.default_rng(seed)
    pushes = rng.choice([-size, 0.0, size], size=(150, PARTS))
    pushes[rng.integers(150) :] = size
    bounds = tracking.position, tracking.velocity, tracking.correction
    assert (errors(tracking.gain, pushes, h) <= bounds).all()


def test_bounds_are_proportional_to_the_disturbance_and_zero_without() -> None:
    one, three = tracking_of(0.1, 0.1), tracking_of(0.3, 0.1)
    for name in ("position", "velocity", "correction"):
        assert getattr(three, name) == pytest.approx(3 * getattr(one, name), rel=1e-12)
    assert tracking_of(0.0, 0.1) is EXACT


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(0.01, 2))
def test_the_integral_of_a_size_is_that_of_a_sum(
    slope: float, offset: float, h: float
) -> None:
    middle = (np.arange(20_000) + 0.5) * h / 20_000
    summed = np.abs(slope * middle + offset).mean() * h
    assert _integral(slope, offset, h) == pytest.approx(summed, rel=1e-6, abs=1e-7)
