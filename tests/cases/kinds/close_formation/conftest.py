"""A small close formation, and flights that are written by hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.close_formation.pose import CloseFormationFlight
from swarmstart.cases.kinds.close_formation.scenario import CloseFormationScenario
from swarmstart.ocp import Trajectory
from swarmstart.tests.cases.kinds.flights import build, flown_by_hand

Make = Callable[..., CloseFormationScenario]
Fly = Callable[..., Trajectory]
DT, STEPS = 0.1, 300


def close(
    *assignments: str, name: str = "close_formation", variant: str | None = None
) -> CloseFormationScenario:
    resolved = resolve(read_document(name), variant=variant, assignments=assignments)
    assert isinstance(resolved.scenario, CloseFormationScenario)
    return resolved.scenario


@pytest.fixture(scope="session")
def make() -> Make:
    return close


@pytest.fixture(scope="session")
def scenario() -> CloseFormationScenario:
    return close()


@pytest.fixture(scope="session")
def flight(scenario: CloseFormationScenario) -> CloseFormationFlight:
    return build(scenario)


def fly_by_hand(
    offsets: Array, *, costs: Array | None = None, controls: Array | None = None
) -> Trajectory:
    """Return a flight with offsets (6, T + 1) from the slot, 200 ft/s and heading 0."""
    at_rest = np.array([60.0, 23.6, 0.0, 200.0, 0.0, 0.0])
    states = at_rest[:, None] + offsets
    flown = np.zeros((3, states.shape[1] - 1)) if controls is None else controls
    return flown_by_hand(states, flown, costs=costs, dt=DT)


@pytest.fixture(scope="session")
def by_hand() -> Fly:
    return fly_by_hand
