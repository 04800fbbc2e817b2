"""Minimum time of a boat of speed 1 in a current, by fast sweeping on a grid.

The earliest arrival T(p) from the start satisfies, for |w| < 1,

    |grad T| + w . grad T = 1,   T(start) = 0.

The boat's velocity v = grad T/|grad T| + w is not along grad T, so isotropic fast
marching is wrong here: it updates a node from neighbours on the side against grad T,
and accepts nodes in the order of T, but the value comes from the side against v, and
may come from a neighbour that is not accepted yet. Here the time of a node x is the
least over the eight triangles with two neighbours,

    T(x) = min over y between the neighbours of T(y) + F(x - y),

with F(d) = t the time of a way d in the current at x, |d - w t| = t. It is right for
any direction of v. Nodes are visited in four orders until no time falls, so no order of
acceptance is needed.

T between two neighbours is T0 plus linear interpolation of T - T0, with T0 the time in
the uniform current of the start: T is a cone there, which linear interpolation alone
follows with an error of h log h. The scheme is monotone and of first order, exact in a
uniform current; Richardson's extrapolation removes the first order.

Source: Tsai, Cheng, Osher and Zhao (2003), SIAM Journal on Numerical Analysis 41(2),
sweeping for Hamilton-Jacobi equations; Sethian and Vladimirsky (2003), the same journal
41(1), the update by minimisation; Luo and Qian (2012), J. Sci. Comput. 52, factoring.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.benchmarks.hard.blocks import Box, Point
from swarmstart.benchmarks.hard.currents import Current
from swarmstart.machine_code.numba_kernels import kernel

RING = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
"""The eight neighbours of a node, counter-clockwise."""
Numbers = tuple[float, float, float, float]
_NEAR = 2.0
"""Cells around the start in which T0 itself is the time, with an error of h^2."""
_HALVINGS = 20
"""Halvings of the place y between neighbours: 1e-6, which changes T by its square."""


@dataclass(frozen=True, slots=True)
class MinimumTime:
    """A time by extrapolation.

    Attributes:
        time: Extrapolated from the two finest grids [s].
        error: Difference to the extrapolation from the two grids before [s].
        grids: Times on the grids, coarse to fine [s].
    """

    time: float
    error: float
    grids: tuple[float, ...]


def minimum_time(
    start: Point, goal: Point, current: Current, box: Box, *, cells: int = 100
) -> MinimumTime:
    """Return the least time from start to goal inside a box.

    Args:
        start: First point [m].
        goal: Last point [m].
        current: The current; its speed is below 1 in the box [m/s].
        box: Lower left and upper right corner [m].
        cells: Cells along the longer side of the coarsest grid, at least 8; the next
            two grids have two and four times as many.

    Raises:
        ValueError: If start or goal is outside the box, there are too few cells, or the
            current is too fast at a node.

    Example:
        >>> box = ((0, 0), (1, 1))  # against a current of half the boat's speed
        >>> time = minimum_time((0.9, 0.5), (0.1, 0.5), Current(uniform=(0.5, 0)), box)
        >>> round(time.time, 9)
        1.6
    """
    grids = tuple(
        time_on_grid(start, goal, current, box, cells=cells * times)
        for times in (1, 2, 4)
    )
    before, last = (2 * grids[k + 1] - grids[k] for k in (0, 1))
    return MinimumTime(last, abs(last - before), grids)


def time_on_grid(
    start: Point, goal: Point, current: Current, box: Box, *, cells: int
) -> float:
    """Return the time on one grid [s]; see `minimum_time`."""
    lower, upper = np.array(box, dtype=float)
    for name, point in (("start", start), ("goal", goal)):
        if not ((lower <= point) & (point <= upper)).all():
            raise ValueError(f"{name} must be in the box {box}, got {point}")
    if cells < 8:
        raise ValueError(f"cells must be at least 8, got {cells}")
    side = float((upper - lower).max())
    counts = np.maximum(np.rint((upper - lower) * cells / side).astype(int), 2)
    axes = [np.linspace(lower[k], upper[k], counts[k] + 1) for k in (0, 1)]
    grid = np.array(np.meshgrid(*axes, indexing="ij"))
    w = current.velocity(grid)
    if not (fastest := float(np.hypot(*w).max())) < 1:
        raise ValueError(f"the current must be slower than 1 m/s, got {fastest:.6g}")
    u, v = (float(speed) for speed in current.velocity(np.array(start, dtype=float)))
    away = grid - np.array(start, dtype=float)[:, None, None]
    near = np.hypot(*away) <= _NEAR * side / cells
    excess = np.where(near, 0.0, np.inf)
    steps = np.array([axis[1] - axis[0] for axis in axes])
    while sweep(excess, np.vstack([away, w]), (u, v), steps) > 1e-13 * side:
        pass
    at = (np.array(goal) - lower) / steps
    i, j = np.minimum(at.astype(int), counts - 1)
    a, b = at - (i, j)
    between = np.array([1 - a, a]) @ excess[i : i + 2, j : j + 2] @ np.array([1 - b, b])
    return float(between) + _time((goal[0] - start[0], goal[1] - start[1], u, v))


@kernel
def sweep(
    excess: Array, places: Array, uniform: tuple[float, float], steps: Array
) -> float:
    """Update all nodes in four orders, in place, and return the greatest change [s].

    Args:
        excess: T - T0, shape (m, n), infinite if not reached yet [s].
        places: Displacements of the nodes from the start, and the current there, shape
            (4, m, n) [m, m/s].
        uniform: The current of T0 [m/s].
        steps: Distances of neighbours along x and y, shape (2,) [m].
    """
    m, n = excess.shape
    change = 0.0
    for order in range(4):
        for row in range(m):
            i = row if order % 2 == 0 else m - 1 - row
            for column in range(n):
                j = column if order < 2 else n - 1 - column
                new = _updated(i, j, excess, places, uniform, steps)
                if new < excess[i, j]:
                    change = max(change, excess[i, j] - new)
                    excess[i, j] = new
    return change


@kernel
def _updated(
    i: int,
    j: int,
    excess: Array,
    places: Array,
    uniform: tuple[float, float],
    steps: Array,
) -> float:
    """Return the least T - T0 of a node by the triangles with its neighbours."""
    m, n = excess.shape
    x, y, u, v = places[0, i, j], places[1, i, j], places[2, i, j], places[3, i, j]
    least = np.inf
    # The neighbour before: its displacement from the node, and its excess.
    last_x, last_y, last = 0.0, 0.0, np.inf
    for k in range(9):
        right, up = RING[k % 8]
        to_x, to_y, new = right * steps[0], up * steps[1], np.inf
        if 0 <= i + right < m and 0 <= j + up < n:
            new = excess[i + right, j + up]
        if min(last, new) < np.inf:
            ends = (last_x, last_y, to_x - last_x, to_y - last_y)
            time = _by_triangle((x, y, u, v), ends, (last, new), uniform)
            least = min(least, time)
        last_x, last_y, last = to_x, to_y, new
    return least - _time((x, y, uniform[0], uniform[1]))


@kernel
def _by_triangle(
    node: Numbers,
    ends: Numbers,
    excess: tuple[float, float],
    uniform: tuple[float, float],
) -> float:
    """Return the least time of a node by two neighbours, one of which may be unknown.

    T(y) + F(x - y) is convex in the place y, so the sign of its slope brackets it. The
    slope is infinite, away from the unknown neighbour, if there is one.
    """
    low, high = 0.0, 1.0
    if _slope(low, node, ends, excess, uniform) >= 0:
        high = low
    elif _slope(high, node, ends, excess, uniform) <= 0:
        low = high
    for _ in range(_HALVINGS if low < high else 0):
        share = (low + high) / 2
        if _slope(share, node, ends, excess, uniform) < 0:
            low = share
        else:
            high = share
    share = (low + high) / 2
    x, y = ends[0] + share * ends[2], ends[1] + share * ends[3]
    known = excess[0] if share == 0 else excess[1]
    if 0 < share < 1:
        known = excess[0] + share * (excess[1] - excess[0])
    cone = _time((node[0] + x, node[1] + y, uniform[0], uniform[1]))
    return known + cone + _time((-x, -y, node[2], node[3]))


@kernel
def _slope(
    share: float,
    node: Numbers,
    ends: Numbers,
    excess: tuple[float, float],
    uniform: tuple[float, float],
) -> float:
    """Return the derivative of T(y) + F(x - y) by the place y between neighbours."""
    x, y = ends[0] + share * ends[2], ends[1] + share * ends[3]
    cone = (node[0] + x, node[1] + y, uniform[0], uniform[1])
    return (
        excess[1]
        - excess[0]
        + _time_rate(cone, ends[2], ends[3])
        - _time_rate((-x, -y, node[2], node[3]), ends[2], ends[3])
    )


@kernel
def _time(way: Numbers) -> float:
    """Return the time t of a way d in a current w, (d, w): |d - w t| = t."""
    x, y, u, v = way
    along, slack = u * x + v * y, 1 - u**2 - v**2
    return (math.sqrt(along**2 + slack * (x**2 + y**2)) - along) / slack


@kernel
def _time_rate(way: Numbers, by_x: float, by_y: float) -> float:
    """Return the derivative of `_time` by d in a direction; 0 for no way."""
    x, y, u, v = way
    along, slack, turn = u * x + v * y, 1 - u**2 - v**2, u * by_x + v * by_y
    root = math.sqrt(along**2 + slack * (x**2 + y**2))
    if root == 0:
        return 0.0
    return ((along * turn + slack * (x * by_x + y * by_y)) / root - turn) / slack
