"""The planning problem of one UAV of a formation flight.

e = x - x_L - slot, (v, psi, x, y), slots in axes that do not turn (5.4);

    J = sum_k dt (e_k'Q e_k + u_k'R u_k) + e_N'P e_N                      (5.5)-(5.7)

plus the distances to obstacles and to the UAVs that planned before it (5.15), (5.16).
The sampled-data P belongs to this sum over the steps.
"""

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.settings import bounds_of
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.planar import METRE, POSITION, speed_bounds
from swarmstart.ocp import (
    Bounds,
    Model,
    OptimalControlProblem,
    Separation,
    disc,
    right_hand_side,
)
from swarmstart.terminal_set import Reference, hold, linearise, sampled_lqr


def planning_problem(
    scenario: FormationScenario, model: Model, terminal_cost: Array, *, others: int
) -> OptimalControlProblem:
    """Return a UAV's planning problem: signals are its slot, then others' positions."""
    signals = ca.vertcat(ca.SX.sym("slot", 4), ca.SX.sym("others", 2 * others))
    error = model.states - signals[:4]
    position = model.states[list(POSITION)]
    avoid = scenario.avoidance
    separations = [
        Separation(
            relative=position - signals[4 + 2 * j : 6 + 2 * j],
            distance=avoid.safe_distance_m,
            margin=avoid.distance_margin_m,
            smooth_margin=avoid.polish_distance_margin_m,
            along=avoid.along,
            measure=avoid.measure,
            scale=METRE,
        )
        for j in range(others)
    ]
    obstacles = [
        disc(
            position,
            centre=[obstacle.x_m, obstacle.y_m],
            radius=obstacle.radius_m,
            margin=avoid.obstacle_margin_m,
            smooth_margin=avoid.polish_obstacle_margin_m,
            along=avoid.along,
            measure=avoid.measure,
            scale=METRE,
        )
        for obstacle in scenario.obstacles
    ]
    Q, R = ca.diag(scenario.weights.Q), ca.diag(scenario.weights.R)
    return OptimalControlProblem(
        model,
        stage_cost=ca.bilin(Q, error, error)
        + ca.bilin(R, model.controls, model.controls),
        terminal_cost=ca.bilin(ca.DM(terminal_cost), error, error),
        bounds=Bounds(
            controls=_control_limits(scenario),
            states=speed_bounds(scenario.vehicle.speed_m_s),
            state_scale=METRE,
        ),
        constraints=[*obstacles, *separations],
        signals=signals,
        quadrature="left",
        **scenario.prediction.grid(),
    )


def slot_states(scenario: FormationScenario, number: int, times: Array) -> Array:
    """Return the slot of a UAV, moving with the leader, shape (4, n).

    Args:
        scenario: The scenario; its leader keeps speed and heading.
        number: The UAV's index from 0.
        times: Times since the start, shape (n,) [s].
    """
    leader, slot = scenario.leader, scenario.uavs[number].slot
    speed, heading = leader.speed_m_s, leader.heading_rad
    return np.stack(
        [
            np.full_like(times, speed),
            np.full_like(times, heading),
            leader.x_m + slot.x_m + speed * np.cos(heading) * times,
            leader.y_m + slot.y_m + speed * np.sin(heading) * times,
        ]
    )


def dynamics_of(model: Model) -> ca.Function:
    """Return f(x, u) without parameters, as terminal_set needs it."""
    x, u = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    return ca.Function("dynamics", [x, u], [right_hand_side(model)(x, u, ca.SX(0, 1))])


def reference_of(scenario: FormationScenario) -> Reference:
    """Return the leader's motion as the reference of a terminal set."""
    lower, upper = _control_limits(scenario)
    x_lower, x_upper = speed_bounds(scenario.vehicle.speed_m_s) or (None, None)
    return Reference(
        x_ref=np.array(scenario.leader.vector()),
        u_ref=np.zeros(len(lower)),
        u_lower=lower,
        u_upper=upper,
        x_lower=x_lower,
        x_upper=x_upper,
    )


def terminal_cost_of(
    scenario: FormationScenario, dynamics: ca.Function, reference: Reference
) -> Array:
    """Return P of the terminal cost, shape (4, 4)."""
    if scenario.terminal_cost.design == "given":
        return np.array(scenario.terminal_cost.P)
    dt, weights = scenario.prediction.dt, scenario.weights
    A, B = linearise(dynamics, reference.x_ref, reference.u_ref)
    Q, R = np.diag(weights.Q) * dt, np.diag(weights.R) * dt
    return sampled_lqr(*hold(A, B, dt), Q, R).P


def _control_limits(scenario: FormationScenario) -> tuple[Array, Array]:
    vehicle = scenario.vehicle
    return bounds_of((vehicle.acceleration_m_s2, vehicle.turn_rate_rad_s))
