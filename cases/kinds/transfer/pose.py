"""A transfer scenario -> one optimal-control problem, its search, and a plant.

minimise    the integral of R_1 a_i^2 + R_2 phi_i^2, summed over the UAVs
subject to  the model `bank_to_turn` with controls a and phi, bounds on a, phi and v,
the safe distance of every two UAVs at every check,
each UAV in its goal at the end, with any speed and heading

Here a_i is the acceleration and phi_i the bank angle of UAV i, R_1 and R_2 are weights.
The search chooses among paths p(t) of each UAV from its start p_0, with the velocity
v_0, to its goal p_f in the time T. A path has three coefficients c_1, c_2 and c_3 in
[-1, 1]; l and m are the settings `lateral` and `along`. With s = t / T, the vector d =
p_f - p_0 - v_0 T from the point that is reached at constant velocity to the goal, the
vector e = p_f - p_0 to the goal, and n, which is e turned to the left,

    p(t) = p_0 + v_0 t + d h(s) + l (c_1 b_1(s) + c_2 b_2(s)) n + m c_3 b_1(s) e
    h(s) = (3 s^2 - s^3) / 2,   b_1 = sin^2(pi s),   b_2 = sin^2(pi s) cos(pi s)

begins in p_0 with v_0 and ends in p_f for all coefficients. If all three are 0, no path
from p_0 with v_0 to p_f has a smaller integral of p''^2. Speed and heading are those of
p', and the controls follow from p as well (p is a flat output):

    v = |p'|,  a = p'.p'' / v,  phi = asin or atan of (p' x p'') / (v g)
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.kind import Flight, Posed, PosedAgent, PosedPlant
from swarmstart.cases.format.parts import bounds_of
from swarmstart.cases.format.settings import LocatedFlaw
from swarmstart.cases.kinds.planar import (
    GRAVITY_M_S2,
    METRE,
    POSITION,
    Turn,
    bank_to_turn,
    shortest_assignment,
    speed_bounds,
)
from swarmstart.cases.kinds.transfer.scenario import TransferScenario, goal_flaws
from swarmstart.heuristics import Box
from swarmstart.ocp import (
    Bounds,
    Model,
    OptimalControlProblem,
    Separation,
    TerminalConstraint,
    TrajectoryFamily,
    stack_models,
)

NX, NU = 4, 2  # Sizes of one UAV.
COEFFICIENTS = 3
SMALLEST_SPEED_M_S = 1e-3
"""Small speed that keeps a path without motion finite."""
TOLERANCE_M = 1e-4
"""Largest summed violation of a feasible plan: the error of IPOPT, rolled out."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class PosedTransfer(Posed):
    """A transfer with the goal of each UAV, shape (uavs, 2) [m]."""

    goals: Array


TransferFlight = Flight[PosedTransfer]


def pose(scenario: TransferScenario) -> PosedTransfer:
    """Return the one planning problem, with its family of paths, and the plant.

    The scenario must have been checked before.
    """
    goals = assigned_goals(scenario)
    uav = bank_to_turn(turn=scenario.vehicle.turn)
    model = stack_models([uav] * len(scenario.uavs))
    problem = transfer_problem(scenario, model, goals)
    family = flat_paths(
        problem,
        goals,
        turn=scenario.vehicle.turn,
        lateral=scenario.paths.lateral,
        along=scenario.paths.along,
    )
    return PosedTransfer(
        agents=(PosedAgent(problem=problem, family=family),),
        x0=np.concatenate([uav.start.vector() for uav in scenario.uavs]),
        plant=PosedPlant(model=model, substeps=scenario.plant.substeps),
        open_loop=True,
        repair=scenario.repair,
        goals=goals,
    )


def flaws(scenario: TransferScenario) -> Iterator[LocatedFlaw]:
    """Yield errors between parts of the scenario, with their places."""
    yield from scenario.flaws()
    # Of the assigned goals: a goal may be far for one UAV and near for another.
    for number, (x, y) in enumerate(assigned_goals(scenario)):
        yield from goal_flaws(scenario, number, (float(x), float(y)))


def assigned_goals(scenario: TransferScenario) -> Array:
    """Return the goal of each UAV, shape (uavs, 2) [m]."""
    goals = np.array([[uav.goal.x_m, uav.goal.y_m] for uav in scenario.uavs])
    if scenario.assignment == "given":
        return goals
    starts = np.array([[uav.start.x_m, uav.start.y_m] for uav in scenario.uavs])
    return goals[shortest_assignment(starts, goals)]


def transfer_problem(
    scenario: TransferScenario, model: Model, goals: Array
) -> OptimalControlProblem:
    """Return the problem of all UAVs at once.

    Args:
        scenario: The scenario.
        model: All UAVs, states and controls UAV after UAV.
        goals: Goal of each UAV, shape (uavs, 2) [m].
    """
    vehicle, uavs = scenario.vehicle, len(goals)
    positions = [state[list(POSITION)] for state in ca.vertsplit(model.states, NX)]
    R = ca.diag(ca.DM(np.tile(scenario.weights, uavs)))
    lower, upper = bounds_of((vehicle.acceleration_m_s2, vehicle.bank_rad))
    return OptimalControlProblem(
        model,
        stage_cost=ca.bilin(R, model.controls, model.controls),
        bounds=Bounds(
            controls=(np.tile(lower, uavs), np.tile(upper, uavs)),
            states=speed_bounds(vehicle.speed_m_s, uavs=uavs),
            state_scale=METRE,
        ),
        constraints=[
            Separation(
                relative=a - b,
                distance=scenario.safe_distance_m,
                margin=scenario.margin_m,
                # The polish keeps the same margin, but at the check points only.
                smooth_margin=scenario.margin_m,
                along=scenario.along,
                scale=METRE,
                name=f"distance of UAV {i} and UAV {j}",
            )
            for (i, a), (j, b) in itertools.combinations(enumerate(positions, 1), 2)
        ],
        terminal=[
            TerminalConstraint(
                expression=position - ca.DM(goal),
                scale=METRE,
                name=f"goal of UAV {number}",
            )
            for number, (position, goal) in enumerate(
                zip(positions, goals, strict=True), start=1
            )
        ],
        **scenario.prediction.grid(),
        tolerance=TOLERANCE_M,
        path_tolerance=scenario.path_tolerance_m,
    )


def flat_paths(
    problem: OptimalControlProblem,
    goals: Array,
    *,
    turn: Turn,
    lateral: float,
    along: float,
) -> TrajectoryFamily:
    """Return the paths of all UAVs, three coefficients each.

    Args:
        problem: Problem of all UAVs, states and controls UAV after UAV.
        goals: Goal of each UAV, shape (uavs, 2) [m].
        turn: As in `bank_to_turn`.
        lateral: Bump of a path to the side if the first coefficient is 1, divided by
            the straight distance to the goal.
        along: Bump of a path along the straight line to the goal if the third
            coefficient is 1, divided by the same distance.
    """
    uavs = len(goals)
    c, x0 = ca.SX.sym("c", COEFFICIENTS * uavs), ca.SX.sym("x0", NX * uavs)
    path = flat_path(problem.length, turn=turn, lateral=lateral, along=along)
    states, controls = [], []
    for time in problem.times:
        parts = [
            path(own, start, goal, time)
            for own, start, goal in zip(
                ca.vertsplit(c, COEFFICIENTS), ca.vertsplit(x0, NX), goals,
                strict=True,
            )
        ]  # fmt: skip
        states.append(ca.vertcat(*[x for x, _ in parts]))
        controls.append(ca.vertcat(*[u for _, u in parts]))
    one = np.ones(COEFFICIENTS * uavs)
    return TrajectoryFamily(
        box=Box(lower=-one, upper=one),
        trajectory=ca.Function(
            "paths",
            # A family has parameters as its third argument, also if there are none.
            [c, x0, ca.SX.sym("p", problem.model.np)],
            [ca.horzcat(*states), ca.horzcat(*controls)],
        ),
    )


def flat_path(
    duration: float, *, turn: Turn, lateral: float, along: float
) -> ca.Function:
    """Return a function: (c (3,), x0 (4,), goal (2,), t) -> state (4,) and (a, phi).

    It gives a point of the path of one UAV: c are the coefficients of the path, x0 is
    the initial state, t the time, a the acceleration and phi the bank angle.

    Args:
        duration: Duration T of the transfer [s].
        turn: As in `bank_to_turn`.
        lateral: As in `flat_paths`.
        along: As in `flat_paths`.
    """
    c, x0 = ca.SX.sym("c", COEFFICIENTS), ca.SX.sym("x0", NX)
    goal, t = ca.SX.sym("goal", 2), ca.SX.sym("t")
    speed, psi, begin = x0[0], x0[1], x0[2:]
    velocity = speed * ca.vertcat(ca.cos(psi), ca.sin(psi))
    straight = goal - begin
    left = ca.vertcat(-straight[1], straight[0])
    s = t / duration
    bump = ca.sin(ca.pi * s) ** 2
    place = (
        begin
        + velocity * t
        + (straight - velocity * duration) * (3 * s**2 - s**3) / 2
        + lateral * (c[0] * bump + c[1] * bump * ca.cos(ca.pi * s)) * left
        + along * c[2] * bump * straight
    )
    rate = ca.jacobian(place, t)
    # Smooth at rest, too, where the square root has no derivative.
    v = ca.sqrt(ca.sumsqr(rate) + SMALLEST_SPEED_M_S**2)
    bent = ca.jacobian(rate, t)
    turned = (rate[0] * bent[1] - rate[1] * bent[0]) / (v * GRAVITY_M_S2)
    # asin has no value beyond 1: such a path turns faster than any bank can.
    bank = (
        ca.atan(turned) if turn == "tan" else ca.asin(ca.fmin(ca.fmax(turned, -1), 1))
    )
    # The heading continues from the initial one: the angle between the two, not atan2.
    ahead = velocity[0] * rate[0] + velocity[1] * rate[1]
    aside = velocity[0] * rate[1] - velocity[1] * rate[0]
    heading = psi + ca.atan2(aside, ahead)
    state = ca.vertcat(v, heading, place)
    return ca.Function(
        "path", [c, x0, goal, t], [state, ca.vertcat(ca.dot(rate, bent) / v, bank)]
    )
