"""Reconfigurations, and flights that are written by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from swarmstart.cases.kinds.reconfiguration.pose import ReconfigurationFlight
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.ocp import Decision, Plan, Source, Trajectory
from swarmstart.tests.cases.kinds.flights import build
from swarmstart.tests.cases.kinds.reconfiguration.scenarios import reconfiguration

Array = NDArray[np.float64]
Make = Callable[..., ReconfigurationScenario]


class Fly(Protocol):
    """Return a flight by hand: states at the control instants, and what was planned."""

    def __call__(
        self,
        states: Array,
        *,
        controls: Array | None = None,
        costs: ArrayLike | None = None,
        agents: int = 1,
        plan: Callable[[int, int], dict[str, Any]] | None = None,
    ) -> Trajectory: ...


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
    states: Array,
    *,
    controls: Array | None = None,
    costs: ArrayLike | None = None,
    agents: int = 1,
    plan: Callable[[int, int], dict[str, Any]] | None = None,
) -> Trajectory:
    """Return a flight of five UAVs or other; the plan of (step, agent) may say more."""
    steps = states.shape[1] - 1
    flown = np.zeros((states.shape[0] // 2, steps)) if controls is None else controls
    spent = np.zeros(steps) if costs is None else np.asarray(costs, dtype=np.float64)
    decisions = []
    for step in range(steps):
        plans = []
        for agent in range(agents):
            whole: dict[str, Any] = {
                "controls": flown[:, [step]],
                "states": np.empty((0, 0)),
                "cost": float(spent[step]),
                "violation": 0.0,
                "feasible": True,
                "source": Source.SEARCH,
                "evaluations": 7,
            }
            plans.append(Plan(**(whole | (plan(step, agent) if plan else {}))))
        decisions.append(Decision(control=flown[:, step], plans=tuple(plans)))
    times = np.arange(steps + 1.0)
    return Trajectory(
        times=times,
        states=states,
        controls=flown,
        dense_times=times,
        dense_states=states,
        decisions=tuple(decisions),
        step_seconds=np.arange(1.0, steps + 1.0),
    )


@pytest.fixture(scope="session")
def by_hand() -> Fly:
    return fly_by_hand
