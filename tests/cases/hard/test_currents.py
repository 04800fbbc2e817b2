"""Currents: slower than the boat, free of divergence, and as the YAML states them."""

import numpy as np
import pytest

from swarmstart.cases.hard.currents import STRONGEST, current, drawn_currents
from swarmstart.tests.cases.hard.problems import rates, shipped_problem


@pytest.mark.parametrize("vortices", [4, 8, 16])
def test_the_boat_is_faster_than_the_current_everywhere(vortices: int) -> None:
    field, _ = drawn_currents(vortices=vortices, seed=1)
    rng = np.random.default_rng(0)
    low, high = np.array(field.low)[:, None], np.array(field.high)[:, None]
    points = rng.uniform(low, high, (2, 20_000))
    speeds = np.linalg.norm(current(field, points), axis=0)
    # Between the points of the grid that scales it, it is a little faster.
    assert 0.9 * STRONGEST < speeds.max() < STRONGEST * 1.01 < 1


def test_the_rates_are_the_heading_and_the_current() -> None:
    field, _ = drawn_currents(vortices=4, seed=1)
    points = np.random.default_rng(1).uniform(-2, 6, (2, 50))
    headings = np.linspace(-3, 3, 50)
    found = rates(shipped_problem("currents_4"), points, headings[None])
    still = np.stack([np.cos(headings), np.sin(headings)])
    assert np.allclose(found, still + current(field, points), atol=1e-12)


def test_the_current_has_no_divergence_and_the_curl_of_its_vortices() -> None:
    """Central differences; the curl of a vortex is 2 G core^2 / (d^2 + core^2)^2."""
    field, _ = drawn_currents(vortices=4, seed=1)
    points, h = np.random.default_rng(2).uniform(-2, 6, (2, 30)), 1e-5
    east, north = np.array([[h], [0]]), np.array([[0], [h]])
    by_x = (current(field, points + east) - current(field, points - east)) / (2 * h)
    by_y = (current(field, points + north) - current(field, points - north)) / (2 * h)
    assert np.allclose(by_x[0] + by_y[1], 0, atol=1e-7)
    squares = ((points[:, :, None] - field.centres.T[:, None]) ** 2).sum(axis=0)
    curl = 2 * field.strengths * field.core**2 / (squares + field.core**2) ** 2
    assert np.allclose(by_x[1] - by_y[0], curl.sum(axis=1), atol=1e-6)
