"""All extremals of a boat of speed 1 in a current that pass through the goal.

    x' = cos(theta) + w_x,  y' = sin(theta) + w_y,
    theta' = sin^2 dw_y/dx + sin cos (dw_x/dx - dw_y/dy) - cos^2 dw_x/dy

The last is Zermelo's law: every path of least time inside the box follows it. A fan of
headings is integrated; each cell of headings and times whose image holds the goal is a
start for Newton's method on p(theta(0), t) = goal. An arrival is that of a path, so it
is an upper bound, as accurate as the integration. The grid of `fast_sweeping`, which
sees all paths, shows within its error that no path is faster than the earliest.

Source: Zermelo (1931), ZAMM 11(2); Bryson and Ho (1975), Applied Optimal Control,
section 2.7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from swarmstart.arrays import Array
from swarmstart.benchmarks.hard.blocks import Box, Point, in_box
from swarmstart.benchmarks.hard.currents import Current
from swarmstart.benchmarks.hard.fast_sweeping import MinimumTime, minimum_time

HEADINGS, STEPS = 2000, 300
"""Size of the fan."""
_ROUGH, _FINE = 1e-6, 1e-12
"""Tolerances of the integration of the fan, and of arrivals."""
_NEWTON, _DIFFERENCE, _MISS = 12, 1e-5, 1e-9


@dataclass(frozen=True, slots=True)
class Arrival:
    """An extremal that reaches the goal.

    Attributes:
        time: Time of arrival [s].
        heading: Heading at the start [rad].
    """

    time: float
    heading: float


@dataclass(frozen=True, slots=True)
class LeastTime:
    """The earliest arrival, and what confirms it.

    Attributes:
        arrivals: Extremals inside the box, the earliest first; empty if there is none.
        grid: The time on grids, which all paths inside the box have to themselves.
    """

    arrivals: tuple[Arrival, ...]
    grid: MinimumTime

    @property
    def confirmed(self) -> bool:
        """Agreement of the earliest arrival with the grids within twice their error."""
        bound = 2 * self.grid.error + 1e-8 * self.grid.time
        return bool(self.arrivals) and (
            abs(self.arrivals[0].time - self.grid.time) <= bound
        )


def least_time(
    start: Point, goal: Point, current: Current, box: Box, *, cells: int = 100
) -> LeastTime:
    """Return the least time from start to goal, with extremals up to a fifth longer.

    Args and errors are those of `minimum_time`.
    """
    grid = minimum_time(start, goal, current, box, cells=cells)
    latest = 1.2 * grid.time
    return LeastTime(arrivals(start, goal, current, box, latest=latest), grid)


def rates(state: Array, current: Current) -> Array:
    """Return the derivatives of (x, y, theta), shape (3, n), in their shape."""
    cos, sin = np.cos(state[2]), np.sin(state[2])
    w = current.velocity(state[:2])
    (x_x, x_y), (y_x, y_y) = current.jacobian(state[:2])
    turn = sin**2 * y_x + sin * cos * (x_x - y_y) - cos**2 * x_y
    return np.array([cos + w[0], sin + w[1], turn])


def extremals(
    start: Point, headings: Array, times: Array, current: Current, tolerance: float
) -> Array:
    """Return extremals by DOP853.

    Args:
        start: First point [m].
        headings: Headings at the start, shape (n,) [rad].
        times: Durations, shape (n,) [s].
        current: The current [m/s].
        tolerance: Relative and absolute tolerance of the integration.

    Returns:
        (x, y, theta) at STEPS + 1 equal times, shape (3, STEPS + 1, n).
    """
    first = np.array([np.full(headings.size, start[k]) for k in (0, 1)] + [headings])

    def scaled(_: float, state: Array) -> Array:
        return np.ravel(times * rates(state.reshape(3, -1), current))

    solution = solve_ivp(
        scaled, (0, 1), first.ravel(), "DOP853", np.linspace(0, 1, STEPS + 1),
        rtol=tolerance, atol=tolerance,
    )  # fmt: skip
    return np.asarray(solution.y.reshape(3, -1, STEPS + 1).swapaxes(1, 2))


def arrivals(
    start: Point, goal: Point, current: Current, box: Box, *, latest: float
) -> tuple[Arrival, ...]:
    """Return the extremals that reach the goal inside the box, the earliest first.

    Args:
        start: First point [m].
        goal: Last point [m].
        current: The current; its speed is below 1 [m/s].
        box: Lower left and upper right corner [m].
        latest: Latest time of arrival [s].
    """
    # One ray more than once round: rounding could leave a gap at -pi = pi.
    fan: Array = 2 * np.pi / HEADINGS * np.arange(HEADINGS + 2.0) - np.pi
    places = extremals(start, fan, np.full(fan.size, latest), current, _ROUGH)[:2]
    step, ray = np.nonzero(_holds(places, goal))
    if not step.size:
        return ()
    unknown = np.array([fan[ray], (step + 0.5) * latest / STEPS])
    for _ in range(_NEWTON):
        change = _newton_step(start, goal, unknown, current)
        unknown = unknown - change
        unknown[1] = np.clip(unknown[1], 0, latest)
        if np.abs(change).max() < _MISS / 100:
            break
    states = extremals(start, unknown[0], unknown[1], current, _FINE)
    reached = np.hypot(*(states[:2, -1].T - goal).T) < _MISS
    inside = np.array([in_box(path, box).all() for path in states[:2].T.swapaxes(1, 2)])
    found: list[Arrival] = []
    for k in np.argsort(unknown[1]):
        new = Arrival(float(unknown[1, k]), float(unknown[0, k]))
        # Neighbouring cells may both hold an extremal at their common edge.
        if reached[k] and inside[k] and not any(_same(new, old) for old in found):
            found.append(new)
    return tuple(found)


def _same(one: Arrival, other: Arrival) -> bool:
    turn = (one.heading - other.heading + np.pi) % (2 * np.pi) - np.pi
    return abs(turn) + abs(one.time - other.time) < 100 * _MISS


def _newton_step(start: Point, goal: Point, unknown: Array, current: Current) -> Array:
    """Return Newton's steps for (heading, time), at most a twentieth each, (2, n)."""
    heading, time = unknown
    near = np.concatenate([heading, heading + _DIFFERENCE, heading - _DIFFERENCE])
    ends = extremals(start, near, np.tile(time, 3), current, _FINE)[:, -1]
    end, plus, minus = ends.reshape(3, 3, -1).swapaxes(0, 1)
    miss = end[:2] - np.array(goal)[:, None]
    by_heading = (plus - minus)[:2] / (2 * _DIFFERENCE)
    by_time = rates(end, current)[:2]
    det = by_heading[0] * by_time[1] - by_heading[1] * by_time[0]
    det = np.where(det == 0, np.inf, det)  # No step from where extremals meet.
    step = np.array(
        [
            miss[0] * by_time[1] - miss[1] * by_time[0],
            by_heading[0] * miss[1] - by_heading[1] * miss[0],
        ]
    )
    return np.clip(step / det, -0.05, 0.05)


def _holds(fan: Array, goal: Point) -> NDArray[np.bool_]:
    """Return which cells of the fan hold the goal in one of their two triangles."""
    away = fan - np.array(goal)[:, None, None]
    a, b = away[:, :-1, :-1], away[:, 1:, :-1]
    c, d = away[:, 1:, 1:], away[:, :-1, 1:]
    return _surround(a, b, c) | _surround(a, c, d)


def _surround(a: Array, b: Array, c: Array) -> NDArray[np.bool_]:
    """Return whether triangles hold the origin: it is on one side of all edges."""
    sides = [p[0] * q[1] - p[1] * q[0] for p, q in ((a, b), (b, c), (c, a))]
    return np.asarray((np.min(sides, axis=0) >= 0) | (np.max(sides, axis=0) <= 0))
