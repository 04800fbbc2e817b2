"""Reconfigurations, and flights that are written by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.cases.kinds.reconfiguration.pose import ReconfigurationFlight
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.ocp import Trajectory
from swarmstart.tests.cases.kinds.flights import build, flown_by_hand
from swarmstart.tests.cases.kinds.reconfiguration.scenarios import reconfiguration

Make = Callable[..., ReconfigurationScenario]
Fly = Callable[..., Trajectory]


@pytest.fixture(scope="session")
def make() -> Make:
    return reconfiguration


@pytest.fixture(scope="session")
def scenario() -> ReconfigurationScenario:
    """The text's experiment as printed."""
    return reconfiguration()


@pytest.fixture(scope="session")
def flight(scenario: ReconfigurationScenario) -> ReconfigurationFlight:
    return build(scenario)


def fly_by_hand(
    states: Array, *, controls: Array | None = None, **planned: Any
) -> Trajectory:
    """Return a flight of five UAVs or other; see `flown_by_hand`."""
    shape = len(states) // 2, states.shape[1] - 1
    flown = np.zeros(shape) if controls is None else controls
    return flown_by_hand(states, flown, **planned)


@pytest.fixture(scope="session")
def by_hand() -> Fly:
    return fly_by_hand
