"""Flights of scenarios, made as the commands make them."""

from __future__ import annotations

from typing import Any

from swarmstart.cases.format.kind import Flight
from swarmstart.cases.format.registry import KINDS, load
from swarmstart.cases.format.settings import Scenario
from swarmstart.cases.kinds.flight import flight_of


def build(scenario: Scenario) -> Flight[Any]:
    return flight_of(load(KINDS[scenario.kind].kind).pose(scenario), scenario)
