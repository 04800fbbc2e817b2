"""Slots of the UAVs, and their distances from them.

The assignment `shortest` minimises the sum of squared distances. The leader keeps the
slot at (0, 0).
"""

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.kinds.assignment import shortest_assignment
from swarmstart.cases.kinds.planar import POSITION, by_uav
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario


def assigned_slots(scenario: ReconfigurationScenario) -> Array:
    """Return the slot of each UAV relative to the leader, shape (uavs, 2) [m]."""
    slots = np.array([[slot.x_m, slot.y_m] for slot in scenario.slots])
    if scenario.assignment == "given":
        return slots
    starts = np.array([[uav.x_m, uav.y_m] for uav in scenario.uavs])
    leader, own = scenario.leader_index, int(np.argmin(np.hypot(*slots.T)))
    others = np.delete(np.arange(len(starts)), leader)
    free = np.delete(slots, own, axis=0)
    chosen = np.empty_like(slots)
    chosen[leader] = slots[own]
    chosen[others] = free[shortest_assignment(starts[others], free)]
    return chosen


def slots_in_plane(slots: Array, headings: Array, *, turned: bool) -> Array:
    """Return the slots relative to the leader in the plane, shape (uavs, 2, T) [m].

    Args:
        slots: Relative to the leader, shape (uavs, 2) [m].
        headings: Headings of the leader, shape (T,) [rad].
        turned: Whether the slots turn with the leader.
    """
    psi = headings if turned else np.zeros_like(headings)
    ahead, left = slots[:, 0, None], slots[:, 1, None]
    return np.stack(
        [
            ahead * np.cos(psi) - left * np.sin(psi),
            ahead * np.sin(psi) + left * np.cos(psi),
        ],
        axis=1,
    )


def position_errors(states: Array, slots: Array, *, leader: int, turned: bool) -> Array:
    """Return the distance of each UAV from its slot, shape (uavs, T) [m].

    Args:
        states: Stacked, shape (uavs * 4, T).
        slots: As in `slots_in_plane`.
        leader: The leader's number from 0.
        turned: As in `slots_in_plane`.
    """
    flown = by_uav(states, len(slots))
    positions = flown[:, list(POSITION)]
    wanted = slots_in_plane(slots, flown[leader, 1], turned=turned)
    off = positions - positions[leader] - wanted
    return np.asarray(np.linalg.norm(off, axis=1))
