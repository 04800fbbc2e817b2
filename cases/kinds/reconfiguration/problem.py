"""The planning problem of a reconfiguration, and the slots of its UAVs.

    J = sum over the horizon's intervals and the UAVs of e_i'Q e_i            (5.38)
    e_i = x_ref,i - (x_i - x_L)     at the ends of the intervals

with x = (v, psi, x, y) the state of a UAV, x_L that of the leader, x_ref = (0, 0, slot)
and the weights Q; headings are not wrapped. Constraints are (5.33) and (5.34), the
limits of the distance of every two UAVs, at every check. Numbers such as (5.38) are
equations of the chapter (docs/chapter).

The assignment `shortest` of slots minimises the sum of squared distances. The leader
keeps the slot at (0, 0).
"""

import itertools
from collections.abc import Sequence

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.parts import bounds_of
from swarmstart.cases.kinds.planar import (
    METRE,
    POSITION,
    Thrust,
    bank_to_turn,
    by_uav,
    shortest_assignment,
    speed_bounds,
)
from swarmstart.cases.kinds.reconfiguration.scenario import (
    Distances,
    ReconfigurationScenario,
    Vehicle,
)
from swarmstart.ocp import (
    Bounds,
    Connection,
    Constraint,
    Model,
    OptimalControlProblem,
    Separation,
    right_hand_side,
    stack_models,
)

NX, NU = 4, 2  # Sizes of one UAV.


def trim(vehicle: Vehicle) -> Array:
    """Return the controls of straight flight at constant speed, shape (2,)."""
    return np.array([vehicle.drag_n, 0.0])


def uav_model(vehicle: Vehicle) -> Model:
    """Return the model of one UAV, (5.30) of the chapter."""
    thrust = Thrust(
        drag=vehicle.drag_n, weight=vehicle.weight_n, equation=vehicle.thrust_equation
    )
    return bank_to_turn(turn=vehicle.turn, thrust=thrust)


def team_model(scenario: ReconfigurationScenario, steered: Sequence[int]) -> Model:
    """Return all UAVs as one model; its controls are those of the steered ones."""
    uavs = len(scenario.uavs)
    stacked = stack_models([uav_model(scenario.vehicle)] * uavs)
    if len(steered) == uavs:
        return stacked
    u = ca.SX.sym("u", NU * len(steered))
    own = dict(zip(steered, ca.vertsplit(u, NU), strict=True))
    # A UAV that is not steered has the controls of straight flight in its rates.
    straight = ca.SX(trim(scenario.vehicle))
    every = ca.vertcat(*[own.get(i, straight) for i in range(uavs)])
    names = [stacked.control_names[NU * i + row] for i in steered for row in range(NU)]
    return Model(
        states=stacked.states,
        controls=u,
        ode=right_hand_side(stacked)(stacked.states, every, ca.SX(0, 1)),
        state_names=stacked.state_names,
        control_names=tuple(names),
    )


def joint_problem(
    scenario: ReconfigurationScenario, model: Model, slots: Array
) -> OptimalControlProblem:
    """Return the planning problem of all UAVs at once, (5.38) of the chapter.

    Args:
        scenario: The scenario.
        model: Model of all UAVs, from `team_model`.
        slots: Slot of each UAV relative to the leader, shape (uavs, 2) [m].
    """
    prediction, uavs = scenario.prediction, ca.vertsplit(model.states, NX)
    leader = uavs[scenario.leader_index]
    turned = scenario.frame == "leader"
    Q, dt = ca.diag(ca.DM(scenario.weights)), prediction.dt
    errors = [
        error(uav, leader, ca.DM(slot), turned=turned)
        for uav, slot in zip(uavs, slots, strict=True)
    ]
    lower, upper = control_limits(scenario.vehicle)
    steered = model.nu // NU
    return OptimalControlProblem(
        model,
        # The quadrature multiplies by dt; (5.38) is a plain sum.
        stage_cost=sum((ca.bilin(Q, e, e) for e in errors), ca.SX(0)) / dt,
        bounds=Bounds(
            controls=(np.tile(lower, steered), np.tile(upper, steered)),
            states=speed_bounds(scenario.vehicle.speed_m_s, uavs=len(uavs)),
            state_scale=METRE,
        ),
        constraints=_pair_constraints(scenario.distances, uavs),
        quadrature="right",  # e_i at the ends of the intervals.
        **prediction.grid(),
    )


def error(state: ca.SX, leader: ca.SX, slot: ca.SX | ca.DM, *, turned: bool) -> ca.SX:
    """Return a UAV's error (0, 0, slot) - (state - leader), shape (4, 1).

    Args:
        state: State of the UAV.
        leader: State of the leader.
        slot: Slot relative to the leader, shape (2, 1) [m].
        turned: Whether the slot turns with the leader.
    """
    ahead, left = slot[0], slot[1]
    if turned:
        cos, sin = ca.cos(leader[1]), ca.sin(leader[1])
        ahead, left = ahead * cos - left * sin, ahead * sin + left * cos
    return ca.vertcat(0, 0, ahead, left) - (state - leader)


def control_limits(vehicle: Vehicle) -> tuple[Array, Array]:
    """Return lower and upper bounds of (thrust, bank), each (2,)."""
    return bounds_of((vehicle.thrust_n, vehicle.bank_rad))


def _pair_constraints(distances: Distances, uavs: Sequence[ca.SX]) -> list[Constraint]:
    """Return (5.33) and (5.34) for every pair."""
    positions = [uav[list(POSITION)] for uav in uavs]
    pairs = [a - b for a, b in itertools.combinations(positions, 2)]
    return [
        constraint
        for pair in pairs
        for constraint in (separation(distances, pair), connection(distances, pair))
    ]


def separation(distances: Distances, relative: ca.SX) -> Separation:
    """Return the constraint that keeps the safe distance, (5.33) of the chapter."""
    return Separation(
        relative=relative,
        distance=distances.safe_m,
        margin=distances.margin_m,
        smooth_margin=distances.margin_m,
        along=distances.along,
        scale=METRE,
    )


def connection(distances: Distances, relative: ca.SX) -> Connection:
    """Return the constraint of the communication distance, (5.34) of the chapter."""
    # Points are enough: along a straight segment a distance is largest at an end.
    return Connection(
        relative=relative,
        distance=distances.communication_m,
        margin=distances.margin_m,
        scale=METRE,
    )


def assigned_slots(scenario: ReconfigurationScenario) -> Array:
    """Return the slot of each UAV relative to the leader, shape (uavs, 2) [m]."""
    slots = np.array([[slot.x_m, slot.y_m] for slot in scenario.slots])
    if scenario.assignment == "given":
        return slots
    # The leader takes its slot first, so that all others stay relative to it.
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
        slots: Slots relative to the leader, shape (uavs, 2) [m].
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
        states: States of all UAVs, stacked, shape (uavs * 4, T).
        slots: As in `slots_in_plane`.
        leader: The leader's number from 0.
        turned: As in `slots_in_plane`.
    """
    flown = by_uav(states, len(slots))
    positions = flown[:, list(POSITION)]
    wanted = slots_in_plane(slots, flown[leader, 1], turned=turned)
    off = positions - positions[leader] - wanted
    return np.asarray(np.linalg.norm(off, axis=1))
