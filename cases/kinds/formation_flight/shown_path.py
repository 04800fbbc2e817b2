"""The path that figures and animations show: that of a flight, or of its one plan."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.drawing.sheet import settled_at
from swarmstart.cases.kinds.formation_flight.measures import SETTLED_M, linear_mask
from swarmstart.cases.kinds.formation_flight.pose import FormationFlight
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import POSITION, by_uav, unicycle
from swarmstart.ocp import Mode, Plant, Trajectory

_ROUNDING_S = 1e-9
"""By which a time may be off."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Shown:
    """A path that the figures show: that of the flight, or that of its one plan.

    Attributes:
        dense_times: Times of the path, also between control instants, shape (n,) [s].
        dense: States of each UAV at `dense_times`, shape (uavs, 4, n).
        times: Control instants, shape (T + 1,) [s].
        states: States of each UAV at `times`, shape (uavs, 4, T + 1).
        controls: Controls held from each of `times` to the next, UAV after UAV, shape
            (uavs * 2, T).
        linear: Whether the linear law was in use in each step, shape (T,).
        is_plan: Whether the path is that of a plan, and not that of a flight.
    """

    dense_times: Array
    dense: Array
    times: Array
    states: Array
    controls: Array
    linear: NDArray[np.bool_]
    is_plan: bool

    def errors(self, flight: FormationFlight) -> Array:
        """Return max(|dx|, |dy|) of each UAV from its slot, shape (uavs, n) [m]."""
        return _offsets(flight, self.dense_times, self.dense)

    def until(self, end: float) -> "Shown":
        """Return the part of the path up to a time [s], in whole steps."""
        steps = int(np.searchsorted(self.times, end - _ROUNDING_S))
        last = float(self.times[min(steps, self.linear.size)])
        kept = self.dense_times <= last + _ROUNDING_S
        return replace(
            self,
            dense_times=self.dense_times[kept],
            dense=self.dense[:, :, kept],
            times=self.times[: steps + 1],
            states=self.states[:, :, : steps + 1],
            controls=self.controls[:, :steps],
            linear=self.linear[:steps],
        )

    def settled(self, flight: FormationFlight) -> float | None:
        """Return the time from which all UAVs are in their slots [s]; None if never."""
        return settled_at(
            self.times, _offsets(flight, self.times, self.states), SETTLED_M
        )


def _offsets(flight: FormationFlight, times: Array, states: Array) -> Array:
    off = states - flight.posed.slots(times)
    return np.asarray(np.abs(off[:, list(POSITION)]).max(axis=1))


def shown_of(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> Shown:
    """Return the path of the flight, or of its plan if only one step was planned."""
    first = trajectory.decisions[0]
    if len(trajectory.decisions) == 1 and first.mode is Mode.PLANNED:
        times, paths = planned_paths(scenario, flight, trajectory)
        controls = np.vstack([plan.controls for plan in first.plans])
        steps = controls.shape[1]
        # The plant's steps in a control interval, one of which ends at its instant.
        every = (times.size - 1) // steps
        return Shown(
            dense_times=times,
            dense=paths,
            times=times[::every],
            states=paths[:, :, ::every],
            controls=controls,
            linear=np.zeros(steps, dtype=bool),
            is_plan=True,
        )
    return Shown(
        dense_times=trajectory.dense_times,
        dense=by_uav(trajectory.dense_states, flight.agents),
        times=trajectory.times,
        states=by_uav(trajectory.states, flight.agents),
        controls=trajectory.controls,
        linear=linear_mask(trajectory),
        is_plan=False,
    )


def planned_paths(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> tuple[Array, Array]:
    """Return the paths of the UAVs if they follow their first plans to the end.

    Returns:
        Times, shape (n,) [s], and the states of each UAV, shape (uavs, 4, n).
    """
    # The plant of a flight has all UAVs at once; plans are of one each.
    plant = Plant(unicycle(), dt=flight.plant.dt, substeps=flight.plant.substeps)
    paths = []
    for start, plan in zip(
        by_uav(flight.x0[:, None], flight.agents),
        trajectory.decisions[0].plans,
        strict=True,
    ):
        path = [start]
        for control in plan.controls.T:
            # Without the start of the interval, which is the end of the one before.
            path.append(plant(path[-1][:, -1], control))
        paths.append(np.hstack(path))
    horizon = flight.plant.dt * scenario.prediction.intervals
    return np.linspace(0.0, horizon, paths[0].shape[1]), np.stack(paths)
