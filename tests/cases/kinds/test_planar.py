"""Distances over whole flights, against an independent integration."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.cases.campaign.running.run import run
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import (
    Point,
    largest_pair_distance,
    pair_distances,
    smallest_pair_distance,
    smallest_range,
)

UAVS = 5


def rate(_: float, states: Array, controls: Array) -> Array:
    """The unicycles of (5.1), one after the other."""
    (v, psi, _x, _y), (u, omega) = states.reshape(-1, 4).T, controls.reshape(-1, 2).T
    return np.stack([u, omega, v * np.cos(psi), v * np.sin(psi)], axis=1).ravel()


def dop853(x0: Array, controls: Array) -> Array:
    """Return the states of a flight every 0.1 ms; controls are held for 1 s."""
    exact, parts = {"method": "DOP853", "rtol": 1e-10, "atol": 1e-10}, [x0[:, None]]
    for held in controls.T:
        start = parts[-1][:, -1]
        found = solve_ivp(rate, (0, 1), start, dense_output=True, args=(held,), **exact)
        parts.append(found.sol(np.linspace(0.0, 1.0, 10_001)))
    return np.hstack(parts)


def test_reported_distances_are_those_of_dop853() -> None:
    """At 0.1 ms a grid is off by 1e-6 m, as UAVs pass at 30 m/s; at 50 ms by 0.1 m."""
    short = ["steps=6", "budget.evaluations=1000"]
    resolved = resolve(
        read_document("formation_obstacle"), variant="corrected", assignments=short
    )
    scenario, flown = resolved.scenario, run(resolved, seed=0)
    assert isinstance(scenario, FormationScenario)
    exact = dop853(flown.flight.x0, flown.trajectory.controls)
    smallest = pair_distances(exact, UAVS).min()
    assert flown.measures["min_distance_m"] == pytest.approx(smallest, abs=1e-5)
    (disc,) = scenario.obstacles
    x, y = exact[2::4] - disc.x_m, exact[3::4] - disc.y_m
    nearest = np.hypot(x, y).min() - disc.radius_m
    assert flown.measures["obstacle_clearance_m"] == pytest.approx(nearest, abs=1e-5)
    # The steps of the plant alone do not see it.
    assert pair_distances(flown.trajectory.dense_states, UAVS).min() > smallest + 1e-4


def standing(*places: tuple[float, float]) -> Array:
    return np.tile(np.array(places)[:, :, None, None], (1, 1, 3, 6))


def test_distances_of_pairs_and_of_those_asked_for() -> None:
    positions = standing((0, 0), (3, 4), (3, 0))
    assert smallest_pair_distance(positions) == 3.0
    assert largest_pair_distance(positions) == 5.0
    assert largest_pair_distance(positions, pairs=[(0, 2), (2, 1)]) == 4.0
    assert smallest_range(positions, Point(x_m=3, y_m=-2)) == 2.0


def test_without_a_pair_there_is_no_distance() -> None:
    assert smallest_pair_distance(standing((1, 2))) is None
    assert largest_pair_distance(standing((1, 2))) is None
    assert largest_pair_distance(standing((0, 0), (3, 4)), pairs=[]) is None
