"""Paths of a UAV to its goal, with three coefficients, and what they ask of it.

With s = t / T, the way d = p_f - p_0 - v_0 T that the initial velocity leaves, e along
the straight line to the goal and n to the left of it,

    p(t) = p_0 + v_0 t + d h(s) + l (c_1 b_1(s) + c_2 b_2(s)) n + m c_3 b_1(s) e
    h(s) = (3 s^2 - s^3) / 2,   b_1 = sin^2(pi s),   b_2 = sin^2(pi s) cos(pi s)

begins in p_0 with v_0 and ends in p_f, whatever the coefficients in [-1, 1] are; h is
the least acceleration that does so. The speed and heading are those of p', and the
aircraft is flat in p:

    v = |p'|,  a = p'.p'' / v,  phi = asin or atan of (p' x p'') / (v g)
"""

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.kinds.models.bank_to_turn import GRAVITY_M_S2, Turn
from swarmstart.heuristics import Box
from swarmstart.ocp import OptimalControlProblem, TrajectoryFamily

Array = NDArray[np.float64]

COEFFICIENTS = 3
SMALLEST_SPEED_M_S = 1e-3
"""Keeps a path that stands still finite."""
NX = 4


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
        problem: Of all UAVs, states and controls UAV after UAV.
        goals: Shape (uavs, 2) [m].
        turn: As in `bank_to_turn`.
        lateral: l, a part of the straight way to the goal.
        along: m, likewise.
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
            [c, x0, ca.SX.sym("p", problem.model.np)],
            [ca.horzcat(*states), ca.horzcat(*controls)],
        ),
    )


def flat_path(
    duration: float, *, turn: Turn, lateral: float, along: float
) -> ca.Function:
    """Return (c (3,), x0 (4,), goal (2,), t) -> state (4,) and controls (a, phi).

    Args:
        duration: T [s].
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
    v = ca.sqrt(ca.sumsqr(rate) + SMALLEST_SPEED_M_S**2)
    bent = ca.jacobian(rate, t)
    turned = (rate[0] * bent[1] - rate[1] * bent[0]) / (v * GRAVITY_M_S2)
    bank = (
        ca.atan(turned) if turn == "tan" else ca.asin(ca.fmin(ca.fmax(turned, -1), 1))
    )
    # The heading goes on from the initial one: the angle between the two, not atan2.
    ahead = velocity[0] * rate[0] + velocity[1] * rate[1]
    aside = velocity[0] * rate[1] - velocity[1] * rate[0]
    heading = psi + ca.atan2(aside, ahead)
    state = ca.vertcat(v, heading, place)
    return ca.Function(
        "path", [c, x0, goal, t], [state, ca.vertcat(ca.dot(rate, bent) / v, bank)]
    )
