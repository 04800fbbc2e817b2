"""Search of a clear plan to a goal, by random flights past a via point.

A flight has a wait (if it begins at rest), a leg to a via point with a velocity there,
and a leg to the goal, at which it rests for ever. Its cost is

    J = arrival time + w * length of the path,

and only a flight that would be cheaper than the best so far is compared with the plans
of others, first with those that were in the way before.
"""

import math
from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.machine_code import Count, kernel
from swarmstart.ocp.swarm.legs import (
    LONGEST,
    PointMass,
    State,
    accelerations,
    least_steps,
    rest,
    write_leg,
)
from swarmstart.ocp.swarm.plans import Plans, may_meet

PARTS = 6
"""Parts of a flight: wait, via point (3), speed there, its place along the way."""
WAIT, SPEED, PLACE = 0, 4, 5
"""Indices of parts; the via point has 1 to 3."""
WEIGHT = 1.0
"""Weight w of the length [s/m]."""
WAIT_S = 3.0
"""Wait for a normal number of 1.5 [s]; below 0.5 there is none."""
ASIDE = 2.0
"""Spread of via points, in least distances."""
SHARE = 0.3
"""Spread of its place along the way, around the middle."""
SLOWER = 0.5
"""Spread of speeds at a via point, below the largest."""
SLOWEST = 0.05
"""Least speed at a via point of a vehicle with a turn rate, in the largest."""
SHORT = 1e-9
"""Length of a way that has no direction [m]."""
AT_LARGE = 0.5
"""Share of the tries at large; the others are near the best one, if there is one."""
NEAR = 0.6
"""Spread of draws near the best one, in draws at large; it falls to zero."""


class Task(NamedTuple):
    """Task of one search.

    Attributes:
        step: Number of the present time.
        parting: Index of the sample at which the plan parts from the committed one; all
            samples up to it are written already.
        state: State at that sample.
        goal: Scaled position [m], shape (3,).
        others: Rows of plans to keep clear of, shape (k,); their order changes.
        radius: Least distance [m], scaled.
        heading: Heading at rest of a vehicle with a turn rate [rad].
    """

    step: int
    parting: int
    state: State
    goal: Array
    others: Count
    radius: float
    heading: float = 0.0


@kernel
def seek(plan: int, task: Task, draws: Array, body: PointMass, plans: Plans) -> float:
    """Write the cheapest clear flight that is found into a plan; return its cost.

    Args:
        plan: Row of the plan; it may be overwritten even if no flight is found.
        task: Task of the search.
        draws: Normal numbers, shape (tries, PARTS); the first row is not used, as the
            first flight is the direct one, without a wait.
        body: Bounds of the point mass, and the grid of its plans.
        plans: All plans of the vehicles, each a row.

    Returns:
        The cost; infinite if no flight is found.
    """
    best = math.inf
    known, trial = np.zeros(PARTS), np.zeros(PARTS)
    found = False
    for number in range(len(draws)):
        # First farther and farther from the straight way, then nearer to the best.
        share = number / len(draws)
        if found and share > AT_LARGE:
            trial[:] = known + NEAR * (1.0 - share) * draws[number]
        elif number:
            trial[:] = share / AT_LARGE * draws[number]
            trial[WAIT] = draws[number, WAIT]
        cost = fly(plan, trial, task, best, body, plans)
        if cost < best and _is_clear(plan, task, plans):
            best = cost
            known[:] = trial
            found = True
    if not found:
        return math.inf
    fly(plan, known, task, math.inf, body, plans)
    return best


@kernel
def fly(
    plan: int, parts: Array, task: Task, most: float, body: PointMass, plans: Plans
) -> float:
    """Write a flight into a plan, and return its cost.

    The cost is infinite, and the flight is not written, if it is not feasible or cannot
    be cheaper than `most`.

    Args:
        plan: Row of the plan.
        parts: Normal numbers for the wait, the three axes of the via point, the speed
            there, and its place along the way, shape (PARTS,).
        task: Task of the search.
        most: Cost of the best flight so far.
        body: Bounds of the point mass, and the grid of its plans.
        plans: All plans of the vehicles, each a row.
    """
    start, end = task.state, State(task.goal, np.zeros(3))
    room = plans.bulges.shape[1] - 1 - task.parting
    shortest = WEIGHT * _way(start, end)
    via = _via(parts, task, body)
    first, second = least_steps(start, via, room, body), LONGEST
    if first < LONGEST:
        second = least_steps(via, end, room - first, body)
    if second == LONGEST:
        return math.inf
    wait = _wait(parts[WAIT], (start, via), (first, task.heading), body)
    arrival = (wait + first + second) * body.step_s
    if wait + first + second > room or arrival + shortest >= most:
        return math.inf
    index = task.parting + wait
    for k in range(task.parting, index):
        plans.bulges[plan, k] = 0.0
        plans.samples[plan, k + 1] = start.position
    length = write_leg(plan, index, (start, via), first, body, plans)
    length += write_leg(plan, index + first, (via, end), second, body, plans)
    rest(plan, index + first + second, plans)
    return arrival + WEIGHT * length


@kernel
def _wait(
    part: float, ends: tuple[State, State], leg: tuple[int, float], body: PointMass
) -> int:
    """Return for how many steps a flight waits: 0 for most, and for all in motion.

    A vehicle with a turn rate turns on the spot at least.

    Args:
        part: A normal number.
        ends: States at the ends of the first leg.
        leg: Its number of steps, and the heading before it [rad].
        body: Bounds of the point mass, and the grid of its plans.
    """
    start, via = ends
    if start.velocity.any():
        return 0
    wait = int(max(0.0, part - 0.5) * WAIT_S / body.step_s)
    if body.turn_rate == math.inf or body.drift_x or body.drift_y:
        return wait
    steps, heading = leg
    push, _ = accelerations(start, via, (0, steps), body)
    aside, _ = accelerations(start, via, (1, steps), body)
    turn = abs((math.atan2(aside, push) - heading + math.pi) % (2 * math.pi) - math.pi)
    return max(wait, math.ceil(turn / body.turn_rate / body.step_s))


@kernel
def _way(start: State, end: State) -> float:
    """Return the distance of two states."""
    return math.sqrt(((end.position - start.position) ** 2).sum())


@kernel
def _via(parts: Array, task: Task, body: PointMass) -> State:
    """Return the via point of a flight: off the straight way, with a speed along it.

    Without parts it is half-way, at the speed of a constant acceleration so far: the
    fastest flight from rest to rest in whole steps, if the bound of the speed allows.
    """
    way = task.goal - task.state.position
    length = math.sqrt((way**2).sum())
    along = way / max(length, SHORT)
    in_plane = body.turn_rate < math.inf
    drift = math.hypot(body.drift_x, body.drift_y)
    push = body.acceleration[0] if in_plane else math.inf
    if drift:
        across = abs(along[0] * body.drift_y - along[1] * body.drift_x) / drift
        push = min(push, body.turn_rate * drift / max(across, SHORT))
    fastest = body.speed[0] if in_plane else math.inf
    for axis in range(3):
        if along[axis] != 0.0 and not in_plane:
            push = min(push, body.acceleration[axis] / abs(along[axis]))
            fastest = min(fastest, body.speed[axis] / abs(along[axis]))
    half = math.ceil(math.sqrt(length / push) / body.step_s) * body.step_s
    speed = min(length / max(half, SHORT), fastest)
    share = min(1.0, max(0.0, 0.5 + SHARE * parts[PLACE]))
    place = task.state.position + share * way
    for axis in range(2 if in_plane else 3):
        if body.speed[axis] > 0.0:
            place[axis] += ASIDE * task.radius * parts[1 + axis]
    # At rest a vehicle could turn at once, and its path would not show it.
    least = SLOWEST if in_plane and not drift else 0.0
    return State(place, max(least, 1.0 - SLOWER * abs(parts[SPEED])) * speed * along)


@kernel
def _is_clear(plan: int, task: Task, plans: Plans) -> bool:
    """Return whether a plan is clear of all others; who is in the way comes first."""
    for place in range(task.others.size):
        other = task.others[place]
        if may_meet(plan, other, task.step, task.radius, plans):
            for before in range(place, 0, -1):
                task.others[before] = task.others[before - 1]
            task.others[0] = other
            return False
    return True
