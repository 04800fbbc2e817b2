"""Transfers as they ship, and with settings changed."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.transfer.pose import TransferFlight
from swarmstart.cases.kinds.transfer.scenario import TransferScenario
from swarmstart.tests.cases.kinds.flights import build

Make = Callable[..., TransferScenario]


def transfer(name: str = "swap_5", *assignments: str) -> TransferScenario:
    scenario = resolve(read_document(name), assignments=assignments).scenario
    assert isinstance(scenario, TransferScenario)
    return scenario


@pytest.fixture(scope="session")
def make() -> Make:
    return transfer


@pytest.fixture(scope="session")
def scenario() -> TransferScenario:
    return transfer()


@pytest.fixture(scope="session")
def flight(scenario: TransferScenario) -> TransferFlight:
    return build(scenario)
