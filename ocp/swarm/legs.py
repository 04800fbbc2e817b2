"""Flights of point masses: cubic legs from state to state, at rest after the last.

On a leg of duration T each coordinate is the cubic that has the given positions and
velocities at both ends (Hermite). With d = p_1 - p_0 its accelerations at the ends are

    a(0) = (6 d - T (4 v_0 + 2 v_1)) / T^2,   a(T) = (T (2 v_0 + 4 v_1) - 6 d) / T^2,

and it is linear between; so bounds of acceleration hold if they hold at the ends, and
the speed is largest at an end or at the zero of the acceleration. A piece of h seconds
keeps to its chord within the larger |a| at its ends times h^2 / 8.

Coordinates are scaled, so bounds are given for each axis.
"""

import math
from typing import NamedTuple

from swarmstart.arrays import Array
from swarmstart.machine_code import kernel
from swarmstart.ocp.swarm.plans import Plans

LONGEST = 1_000_000
"""Number of steps that no leg has."""


class PointMass(NamedTuple):
    """Bounds of a point mass, and the grid of its plans.

    Attributes:
        acceleration: Largest one along each axis, scaled, shape (3,) [m/s^2].
        speed: Largest one along each axis, scaled, shape (3,) [m/s].
        step_s: Step of the grid [s].
    """

    acceleration: Array
    speed: Array
    step_s: float


class State(NamedTuple):
    """Scaled position [m] and velocity [m/s], each of shape (3,)."""

    position: Array
    velocity: Array


@kernel
def is_feasible(start: State, end: State, steps: int, body: PointMass) -> bool:
    """Return whether a leg of so many steps keeps the bounds of a point mass."""
    duration = steps * body.step_s
    for axis in range(3):
        v0, v1 = start.velocity[axis], end.velocity[axis]
        way = 6.0 * (end.position[axis] - start.position[axis])
        first = (way - duration * (4.0 * v0 + 2.0 * v1)) / duration**2
        last = (duration * (2.0 * v0 + 4.0 * v1) - way) / duration**2
        if not max(abs(first), abs(last)) <= body.acceleration[axis]:
            return False
        fastest = max(abs(v0), abs(v1))
        if first * last < 0:
            share = first / (first - last)
            fastest = max(fastest, abs(v0 + 0.5 * first * share * duration))
        if not fastest <= body.speed[axis]:
            return False
    return True


@kernel
def least_steps(start: State, end: State, most: int, body: PointMass) -> int:
    """Return the least number of steps of a leg, or LONGEST if it is above `most`.

    Longer legs than the least one need not be feasible, as those with a velocity at an
    end bend more.
    """
    # No leg is shorter than along its longest axis, at rest at both ends or at speed.
    steps = 1
    for axis in range(3):
        way = abs(end.position[axis] - start.position[axis])
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
        ends: Its first and last state.
        steps: Its number of steps; samples after the plan's last are left out.
        body: The point mass.
        plans: The plans.
    """
    start, end = ends
    duration = steps * body.step_s
    last = plans.bulges.shape[1] - 1
    length = 0.0
    for k in range(min(steps, last - index)):
        share, before = (k + 1) / steps, k / steps
        bend, moved = 0.0, 0.0
        for axis in range(3):
            p0, v0 = start.position[axis], start.velocity[axis] * duration
            p1, v1 = end.position[axis], end.velocity[axis] * duration
            d = p1 - p0
            first, rate = 6 * d - 4 * v0 - 2 * v1, 6 * (v0 + v1) - 12 * d
            point = p0 + share * (v0 + share * (first / 2 + share * rate / 6))
            if k + 1 == steps:
                point = p1
            moved += (point - plans.samples[plan, index + k, axis]) ** 2
            plans.samples[plan, index + k + 1, axis] = point
            bend += max(abs(first + before * rate), abs(first + share * rate)) ** 2
        # Accelerations in units of one leg; h^2 / 8 is 1 / (8 steps^2) of them.
        plans.bulges[plan, index + k] = math.sqrt(bend) / (8 * steps**2)
        length += math.sqrt(moved)
    return length


@kernel
def rest(plan: int, index: int, plans: Plans) -> None:
    """Let a plan stay for ever at its sample of an index."""
    last = plans.bulges.shape[1] - 1
    for k in range(index, last + 1):
        plans.bulges[plan, k] = 0.0
        for axis in range(3):
            plans.samples[plan, k, axis] = plans.samples[plan, index, axis]
