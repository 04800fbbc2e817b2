"""A scenario as controller and plant."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from swarmstart.cases.kinds.reconfiguration.pose import ReconfigurationFlight
from swarmstart.ocp import LocalTeam, simulate
from swarmstart.tests.cases.kinds.flights import build

if TYPE_CHECKING:
    from swarmstart.tests.cases.kinds.reconfiguration.conftest import Make

UAVS, LEADER = 5, 2


def test_the_text_decides_all_controls_at_once(flight: ReconfigurationFlight) -> None:
    assert flight.loop is flight.controller
    assert flight.agents == 1 and flight.posed.steered == (0, 1, 2, 3, 4)
    assert flight.loop.planner.problem.model.nu == flight.plant.model.nu == 10
    assert flight.plant.dt == flight.loop.dt == 1.0
    assert flight.posed.links == tuple(itertools.combinations(range(UAVS), 2))
    assert np.array_equal(
        flight.x0.reshape(UAVS, 4), [[2, 0, 0, y] for y in (20, 10, 0, -10, -20)]
    )


def test_controls_of_a_leader_that_flies_straight_are_the_trim(make: Make) -> None:
    flight = build(make("leader=straight"))
    assert flight.posed.steered == (0, 1, 3, 4)
    decided = np.arange(24.0).reshape(8, 3)
    stacked = flight.posed.controls_by_uav(decided)
    assert stacked.shape == (UAVS, 2, 3)
    assert np.array_equal(stacked[LEADER], [[2000.0] * 3, [0.0] * 3])
    assert np.array_equal(np.delete(stacked, LEADER, axis=0).reshape(8, 3), decided)


def test_where_each_plans_alone_all_are_steered(make: Make) -> None:
    flight = build(
        make(
            "planning={name: priority, range_m: 45}", "leader=straight",
            variant="corrected",
        )
    )  # fmt: skip
    assert isinstance(flight.controller, LocalTeam) and flight.posed.nearby
    assert flight.agents == UAVS and flight.posed.steered == (0, 1, 2, 3, 4)
    assert sorted(flight.posed.links) == [(0, 1), (1, 2), (3, 2), (4, 3)]


def test_a_flight_repeats_itself_with_its_seed(flight: ReconfigurationFlight) -> None:
    def end(seed: int) -> np.ndarray:
        rng = np.random.default_rng(seed)
        return simulate(
            flight.plant, flight.controller, flight.x0, steps=2, rng=rng
        ).states[:, -1]

    assert np.array_equal(end(3), end(3))
    assert not np.array_equal(end(3), end(4))
