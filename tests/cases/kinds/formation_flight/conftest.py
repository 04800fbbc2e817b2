"""Small formations, and flights that are written by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import pytest

from swarmstart.arrays import Array
from swarmstart.cases.format.scenario import read_document, resolve
from swarmstart.cases.kinds.formation_flight.pose import FormationFlight
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.ocp import Decision, Mode, Plan, Source, Trajectory
from swarmstart.tests.cases.kinds.flights import build


class Fly(Protocol):
    """Return a flight by hand: every UAV in its slot, plus the offsets."""

    def __call__(
        self,
        offsets: Array,
        *,
        controls: Array | None = None,
        linear: set[int] = ...,
        plan: Callable[[int, int], dict[str, Any]] | None = None,
    ) -> Trajectory: ...


def formation(
    name: str = "formation_v", *assignments: str, variant: str = "corrected"
) -> FormationScenario:
    resolved = resolve(read_document(name), variant=variant, assignments=assignments)
    assert isinstance(resolved.scenario, FormationScenario)
    return resolved.scenario


@pytest.fixture(scope="session")
def make() -> Callable[..., FormationScenario]:
    return formation


@pytest.fixture(scope="session")
def scenario() -> FormationScenario:
    """Five UAVs past an obstacle behind a leader that turned, as corrected."""
    return formation("formation_obstacle", "plant.substeps=4")


@pytest.fixture(scope="session")
def flight(scenario: FormationScenario) -> FormationFlight:
    return build(scenario)


@pytest.fixture(scope="session")
def by_hand(flight: FormationFlight) -> Fly:
    def fly(
        offsets: Array,
        *,
        controls: Array | None = None,
        linear: set[int] = frozenset(),  # type: ignore[assignment]
        plan: Callable[[int, int], dict[str, Any]] | None = None,
    ) -> Trajectory:
        """Return a flight with offsets (uavs, 4, steps * substeps + 1) from slots."""
        substeps = flight.plant.substeps
        steps = (offsets.shape[2] - 1) // substeps
        dense_times = np.linspace(0.0, steps * flight.plant.dt, steps * substeps + 1)
        dense = (flight.posed.slots(dense_times) + offsets).reshape(
            -1, dense_times.size
        )
        flown = np.zeros((2 * flight.agents, steps)) if controls is None else controls
        decisions = []
        for step in range(steps):
            plans = []
            for number in range(flight.agents):
                says = plan(step, number) if plan else {}
                whole = {"cost": 0.0, "violation": 0.0, "feasible": True, **says}
                whole = {"source": Source.SEARCH, "evaluations": 10, **whole}
                empty = np.empty((0, 0))
                plans.append(Plan(controls=empty, states=empty, **whole))
            mode = Mode.LINEAR if step in linear else Mode.PLANNED
            control = flown[:, step]
            decisions.append(Decision(control=control, plans=tuple(plans), mode=mode))
        return Trajectory(
            times=dense_times[::substeps],
            states=dense[:, ::substeps],
            controls=flown,
            dense_times=dense_times,
            dense_states=dense,
            decisions=tuple(decisions),
            step_seconds=np.arange(1.0, steps + 1.0),
        )

    return fly
