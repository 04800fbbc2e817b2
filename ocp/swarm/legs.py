"""Flights of point masses: legs of held accelerations, at rest after the last.

On a leg of N steps of h seconds each coordinate has the accelerations a_k = b + c k,
each held for a step, that lead from a given position and velocity to another. With
d = (p_N - p_0) / h^2 - N v_0 / h and w = (v_N - v_0) / h,

    c = 12 (N w / 2 - d) / (N (N^2 - 1)),   b = w / N - c (N - 1) / 2.

They are linear in k: bounds of acceleration hold if they hold in the first and the last
step, and the speed is largest at an end or where the accelerations change their sign.
In a step the path keeps to its chord within |a_k| h^2 / 8. So a plant that holds its
accelerations follows a plan exactly.

Coordinates are scaled, so bounds are given for each axis.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import kernel
from swarmstart.ocp.swarm.plans import Plans

LONGEST = 1_000_000
"""Number of steps that no leg has."""
SAME = 1e-9
"""Difference of accelerations, or relative excess over a bound, that is rounding."""
STILL = 1e-12
"""Product of velocity and acceleration that is rounding, as at the end of a leg."""


class PointMass(NamedTuple):
    """Bounds of a point mass, and the grid of its plans.

    Attributes:
        acceleration: Largest acceleration along each axis, scaled, shape (3,) [m/s^2].
        speed: Largest speed along each axis, scaled, shape (3,) [m/s].
        step_s: Step of the grid [s].
        turn_rate: Largest turn rate of a vehicle that moves in the direction of its
            heading, in the plane [rad/s]; the bounds of the first axis then hold for
            the sizes of acceleration and velocity. Infinite for other vehicles.
        drift_x: Velocity of the frame along x, scaled, which turns take into account
            [m/s].
        drift_y: Velocity of the frame along y, scaled, likewise [m/s].
    """

    acceleration: Array
    speed: Array
    step_s: float
    turn_rate: float = math.inf
    drift_x: float = 0.0
    drift_y: float = 0.0


class State(NamedTuple):
    """Scaled position [m] and velocity [m/s], each of shape (3,)."""

    position: Array
    velocity: Array


@kernel
def is_feasible(start: State, end: State, steps: int, body: PointMass) -> bool:
    """Return whether a leg of a number of steps keeps the bounds, but for rounding."""
    for axis in range(3):
        first, change = accelerations(start, end, (axis, steps), body)
        last = first + change * (steps - 1)
        if not max(abs(first), abs(last)) <= body.acceleration[axis] * (1.0 + SAME):
            return False
        v0, v1 = start.velocity[axis], end.velocity[axis]
        fastest = max(abs(v0), abs(v1))
        if first * last < 0:
            # At the vertex of the speed as a parabola in k, which the samples keep to.
            k = 0.5 - first / change
            speed = v0 + body.step_s * (k * first + change * k * (k - 1.0) / 2.0)
            fastest = max(fastest, abs(speed))
        if not fastest <= body.speed[axis] * (1.0 + SAME):
            return False
    return body.turn_rate == math.inf or _can_turn(start, end, steps, body)


@kernel
def _can_turn(start: State, end: State, steps: int, body: PointMass) -> bool:
    """Return whether a leg in the plane keeps the bounds of size and turn rate.

    In a step of acceleration a from velocity v over the ground on, v x a does not
    change, so that the turn rate v x a / |v|^2 is largest at the least speed.
    """
    h = body.step_s
    ax, cx = accelerations(start, end, (0, steps), body)
    ay, cy = accelerations(start, end, (1, steps), body)
    vx, vy = start.velocity[0], start.velocity[1]
    # The last velocity over the ground that has a direction.
    dx, dy = vx + body.drift_x, vy + body.drift_y
    for _ in range(steps):
        size = ax**2 + ay**2
        if not math.sqrt(size) <= body.acceleration[0] * (1.0 + SAME):
            return False
        gx, gy = vx + body.drift_x, vy + body.drift_y
        # The time of the least speed within the step.
        t = min(h, max(0.0, -(gx * ax + gy * ay) / size)) if size > 0 else 0.0
        slowest = (gx + t * ax) ** 2 + (gy + t * ay) ** 2
        turning = abs(gx * ay - gy * ax)
        if turning > STILL and not turning <= body.turn_rate * slowest:
            return False
        vx, vy, ax, ay = vx + h * ax, vy + h * ay, ax + cx, ay + cy
        gx, gy = vx + body.drift_x, vy + body.drift_y
        # Through rest, a straight way back has no turn rate, but another heading.
        if dx * gx + dy * gy < -STILL:
            return False
        if gx**2 + gy**2 > STILL:
            dx, dy = gx, gy
        if not math.sqrt(vx**2 + vy**2) <= body.speed[0] * (1.0 + SAME):
            return False
    return True


@kernel
def accelerations(
    start: State, end: State, leg: tuple[int, int], body: PointMass
) -> tuple[float, float]:
    """Return the first acceleration of a leg and its change in each step [m/s^2].

    Args:
        start: State at its beginning.
        end: State at its end.
        leg: Axis, and number of steps. A leg of one step has no change, and need not
            lead to `end`.
        body: Bounds of the point mass, and the grid of its plans.
    """
    axis, n = leg
    h = body.step_s
    v0 = start.velocity[axis]
    gained = (end.velocity[axis] - v0) / h
    way = (end.position[axis] - start.position[axis]) / h**2 - n * v0 / h
    if n == 1:
        # Only if both conditions ask for the same.
        return (gained if abs(2.0 * way - gained) < SAME else math.inf), 0.0
    change = 12.0 * (n * gained / 2.0 - way) / (n * (n**2 - 1.0))
    return gained / n - change * (n - 1.0) / 2.0, change


@kernel
def least_steps(start: State, end: State, most: int, body: PointMass) -> int:
    """Return the least number of steps of a leg, or LONGEST if it is above `most`.

    A leg with more steps need not be feasible: with a velocity at an end it bends more.
    """
    # None is shorter than its longest axis at the largest speed.
    steps = 1
    for axis in range(3):
        way = abs(end.position[axis] - start.position[axis])
        if body.speed[axis] > 0.0:
            steps = max(steps, math.ceil(way / body.speed[axis] / body.step_s))
    while steps <= most:
        if is_feasible(start, end, steps, body):
            return steps
        steps += 1
    return LONGEST


@kernel
def write_leg(
    plan: int, index: int, ends: tuple[State, State], steps: int, body: PointMass,
    plans: Plans,
) -> float:  # fmt: skip
    """Write a leg into a plan, and return its length.

    Args:
        plan: Row of the plan.
        index: Index of the sample at which the leg begins, which is not written.
        ends: First and last state of the leg.
        steps: Number of steps of the leg; those after the plan's last sample are left
            out.
        body: Bounds of the point mass, and the grid of its plans.
        plans: All plans of the vehicles, each a row.
    """
    start, end = ends
    last = plans.bulges.shape[1] - 1
    h, length = body.step_s, 0.0
    velocity = start.velocity.copy()
    first, change = np.empty(3), np.empty(3)
    for axis in range(3):
        first[axis], change[axis] = accelerations(start, end, (axis, steps), body)
    for k in range(min(steps, last - index)):
        bend, moved = 0.0, 0.0
        for axis in range(3):
            push = first[axis] + change[axis] * k
            way = h * (velocity[axis] + h * push / 2.0)
            point = plans.samples[plan, index + k, axis] + way
            if k + 1 == steps:
                point = end.position[axis]
            velocity[axis] += h * push
            plans.samples[plan, index + k + 1, axis] = point
            bend += push**2
            moved += way**2
        plans.bulges[plan, index + k] = math.sqrt(bend) * h**2 / 8.0
        length += math.sqrt(moved)
    return length


@kernel
def rest(plan: int, index: int, plans: Plans) -> None:
    """Let a plan stay for ever at the sample with a given index."""
    last = plans.bulges.shape[1] - 1
    for k in range(index, last + 1):
        plans.bulges[plan, k] = 0.0
        for axis in range(3):
            plans.samples[plan, k, axis] = plans.samples[plan, index, axis]
