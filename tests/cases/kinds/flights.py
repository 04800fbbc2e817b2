"""Flights of scenarios, built as in the commands, and flights by hand."""

from __future__ import annotations

from collections.abc import Callable
from pkgutil import resolve_name
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Flight
from swarmstart.cases.format.registry import words_of
from swarmstart.cases.format.settings import Scenario
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.ocp import Decision, Plan, Source, Trajectory


def build(scenario: Scenario) -> Flight[Any]:
    return flight_of(
        resolve_name(words_of(scenario.kind).kind).pose(scenario), scenario
    )


def flown_by_hand(
    states: Array,
    controls: Array,
    *,
    costs: ArrayLike | None = None,
    agents: int = 1,
    plan: Callable[[int, int], dict[str, Any]] | None = None,
    dt: float = 1.0,
) -> Trajectory:
    """Return a flight of known states, with changed plans for some (step, agent)."""
    steps = controls.shape[1]
    spent = np.zeros(steps) if costs is None else np.asarray(costs, dtype=np.float64)

    def planned(step: int, agent: int) -> Plan:
        whole: dict[str, Any] = {
            "controls": controls[:, [step]],
            "states": np.empty((0, 0)),
            "cost": float(spent[step]),
            "violation": 0.0,
            "feasible": True,
            "source": Source.SEARCH,
            "evaluations": 7,
        }
        return Plan(**(whole | (plan(step, agent) if plan else {})))

    decisions = tuple(
        Decision(
            control=controls[:, step],
            plans=tuple(planned(step, agent) for agent in range(agents)),
        )
        for step in range(steps)
    )
    times = np.arange(steps + 1) * dt
    return Trajectory(
        times=times,
        states=states,
        controls=controls,
        dense_times=times,
        dense_states=states,
        decisions=decisions,
        step_seconds=np.arange(1.0, steps + 1.0),
    )
