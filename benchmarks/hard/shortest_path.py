"""Shortest path from a point to a point among discs and rounded rectangles, exactly.

An obstacle is the open set {p : dist(p, core) < r}; its core is an axis-parallel
rectangle of half sizes a - r and b - r (a point for a disc). A shortest path consists
of segments that touch corner discs of radius r at both ends, and of arcs on these
discs. So Dijkstra's algorithm on a graph finds it: nodes are the points of contact of
the common tangents of all pairs of directed circles, edges are the tangents and the
arcs between neighbouring nodes that no obstacle blocks. Start and goal are circles of
radius 0. No boundary is sampled: chords between sampled points would cut the body, and
polygons around it are too long.

Tolerance. Tangents touch, so rounding would decide a test without tolerance. All radii
are therefore enlarged by delta = CLEARANCE * (diagonal of the box): tangents and arcs
are those of the enlarged circles, and an edge is kept if its distance to every core is
at least r + delta/2. Rounding errors are some 1e-16 of the diagonal, far less than
delta/2, so no tangent is lost, and no edge that is kept meets a block:

    L(r) <= length returned <= L(r + delta) = L(r) + delta Theta + O(delta^2)

with Theta the angle turned, the last if the shortest path uses no passage narrower than
2 delta. Blocks that touch each other or the box leave no way between them.

Optimal control. The minimum of the integral of u'u over one second for x' = u from
start to goal is L^2: by Cauchy and Schwarz it is at least L^2, and constant speed
attains it. N held controls make x a polygon, which costs N * sum |edge|^2, at least the
square of its length, in edges of length h = L/N if the speed is constant.
- Limits that hold along the whole path: the polygon is a path, so its cost is at least
  L^2. Edges that touch an arc (r, Theta) in their middle are Theta h^2/(12 r) longer:
  cost = L^2 (1 + sum of Theta L/(6 r N^2) + ...).
- Limits at the ends of intervals only: the polygon may be inscribed, and is Theta
  h^2/(24 r) shorter: cost = L^2 (1 - sum of Theta L/(12 r N^2) + ...), below L^2.
- Limits at several checks in each interval: in between.
- An arc shorter than h is passed by one corner, whatever N is: with limits along the
  whole path 2 r tan(Theta/2) - r Theta, about r Theta^3/12, longer. The order 1/N^2
  begins with N > L/(r Theta).
- A part of length l between two corners has a whole number of intervals, which changes
  speeds by shares of h/l, and the cost by their squares: again 1/N^2.

Source: Lozano-Perez and Wesley (1979), Comm. ACM 22(10), visibility graph; Chang, Choi,
Kwon, Park and Yap (2005), SoCG, Shortest path amidst disc obstacles is computable.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from swarmstart.arrays import Array
from swarmstart.benchmarks.hard.blocks import (
    Block,
    Box,
    Point,
    clearance,
    corners,
    enlarged,
    in_box,
    segment_clearance,
)
from swarmstart.benchmarks.hard.paths import Arc, Piece, Segment, ShortestPath

CLEARANCE = 1e-9
"""delta as a share of the box's diagonal: far above rounding, far below any gap."""
ROUND = 2 * np.pi


@dataclass(frozen=True, slots=True, eq=False)
class _Circles:
    """Circles that a path may follow, each in one direction; the last two are points.

    center has shape (2, m), radius (m,); turn is 1 for counter-clockwise, else -1.
    """

    center: Array
    radius: Array
    turn: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Nodes:
    """Points on circles: n that tangents leave, then n that they reach, in their order.

    Numbers of the circles, shape (2 n,), directions from their centres [rad], and the
    points, shape (2, 2 n).
    """

    circle: NDArray[np.intp]
    angle: Array
    points: Array


def shortest_path(
    start: Point, goal: Point, blocks: Sequence[Block], box: Box
) -> ShortestPath | None:
    """Return the shortest path that meets no block's inside and stays in the box.

    Args:
        start: First point [m].
        goal: Last point [m], another one.
        blocks: Obstacles; they may overlap, touch, and reach out of the box.
        box: Lower left and upper right corner [m].

    Returns:
        The path; None if there is no way.

    Raises:
        ValueError: If the box is empty, start and goal are one point, or one of them is
            outside the box or within delta of a block.

    Example:
        >>> path = shortest_path((-2, 0), (2, 0), [disc((0, 0), 1)], ((-3, -3), (3, 3)))
        >>> round(path.length, 6)  # 2 sqrt(3) + pi/3
        4.511299
    """
    lower, upper = np.array(box, dtype=float)
    if not (lower < upper).all():
        raise ValueError(f"box must have its lower left corner first, got {box}")
    if start == goal:
        raise ValueError(f"start and goal must be two points, got {start} twice")
    delta = CLEARANCE * float(np.hypot(*(upper - lower)))
    for name, point in (("start", start), ("goal", goal)):
        _validate(name, point, blocks, box, delta)
    circles = _circles(start, goal, [enlarged(block, delta) for block in blocks])
    grown = [enlarged(block, delta / 2) for block in blocks]
    return _shortest(_tangents(circles, grown), circles, grown, box)


def _validate(
    name: str, point: Point, blocks: Sequence[Block], box: Box, delta: float
) -> None:
    p = np.array(point, dtype=float)[:, None]
    if not in_box(p, box)[0]:
        raise ValueError(f"{name} must be in the box {box}, got {point}")
    for number, block in enumerate(blocks):
        if clearance(p, block)[0] < delta:
            raise ValueError(
                f"{name} must be outside all blocks, got {point}, which is in or on "
                f"block {number}: {block}"
            )


def _circles(start: Point, goal: Point, blocks: Sequence[Block]) -> _Circles:
    found = corners(blocks)
    circles = np.hstack([found, found, np.array([(*start, 0.0), (*goal, 0.0)]).T])
    turn = np.repeat([1.0, -1.0, 1.0], [found.shape[1], found.shape[1], 2])
    return _Circles(circles[:2], circles[2], turn)


def _tangents(circles: _Circles, blocks: Sequence[Block]) -> _Nodes:
    """Return the points of contact of every common tangent that no block meets.

    A path with turn s leaves a circle at c - s r n, if n is the left normal of its
    direction d. The points on both circles are on one line along d, so
    n'(c_j - c_i) = s_j r_j - s_i r_i. A path that leaves the box turns outside it to
    come back, so only arcs are compared with the box.
    """
    m = circles.radius.size
    i, j = np.divmod(np.arange(m * m), m)
    between = circles.center[:, j] - circles.center[:, i]
    distance = np.hypot(*between)
    signed = circles.turn * circles.radius
    gain = signed[j] - signed[i]
    # No path comes back to its start (m - 2), or goes on from its goal (m - 1).
    some = (distance >= abs(gain)) & (distance > 0) & (i != m - 1) & (j != m - 2)
    i, j = i[some], j[some]
    ahead, sine = between[:, some] / distance[some], gain[some] / distance[some]
    normal = sine * ahead + np.sqrt(1 - sine**2) * np.array([-ahead[1], ahead[0]])
    start, end = (circles.center[:, k] - signed[k] * normal for k in (i, j))
    free = np.ones(i.size, dtype=bool)
    for block in blocks:
        kept = np.flatnonzero(free)
        meets = segment_clearance(start[:, kept], end[:, kept], block) < 0
        free[kept[meets]] = False
    circle = np.concatenate([i[free], j[free]])
    outwards = -circles.turn[circle] * np.tile(normal[:, free], 2)
    angle = np.arctan2(outwards[1], outwards[0]) % ROUND
    return _Nodes(circle, angle, np.hstack([start[:, free], end[:, free]]))


def _cuts(center: Array, radius: float, blocks: Sequence[Block], box: Box) -> Array:
    """Return the angles at which a circle may enter or leave a block or the box.

    There it crosses the circle of a corner, or the line along a side.
    """
    x, y, r = corners(blocks)
    x, y = x - center[0], y - center[1]
    square = x**2 + y**2
    met = (abs(radius - r) ** 2 < square) & (square < (radius + r) ** 2)
    x, y, r, square = x[met], y[met], r[met], square[met]
    apart = np.arccos((square + radius**2 - r**2) / (2 * radius * np.sqrt(square)))
    towards = np.arctan2(y, x)
    half = np.array([(block.half_width, block.half_height) for block in blocks])
    middle = np.array([block.center for block in blocks])
    lines = np.vstack([np.array(box), middle - half, middle + half])
    x, y = ((lines - center) / radius).T
    beside = np.arccos(x[abs(x) <= 1])
    above = np.arcsin(y[abs(y) <= 1])
    parts = [towards - apart, towards + apart, beside, -beside, above, np.pi - above]
    return np.concatenate(parts) % ROUND


def _free_arcs(
    nodes: _Nodes, circles: _Circles, blocks: Sequence[Block], box: Box
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp], Array]]:
    """Yield for each circle its free arcs: nodes at both ends, and lengths [m].

    Between two neighbours among nodes and cuts all points are free or none is, so the
    middle decides.
    """
    for k in range(circles.radius.size - 2):
        own = np.flatnonzero(nodes.circle == k)
        if own.size < 2:
            continue
        own = own[np.argsort(nodes.angle[own])]
        angle, center, radius = (
            nodes.angle[own],
            circles.center[:, k],
            circles.radius[k],
        )
        every = np.sort(np.append(angle, _cuts(center, radius, blocks, box)))
        middle = every + np.diff(every, append=every[0] + ROUND) / 2
        points = center[:, None] + radius * np.array([np.cos(middle), np.sin(middle)])
        free = in_box(points, box)
        for block in blocks:
            free &= clearance(points, block) >= 0
        # Blocked parts before each node, and once round to the first again.
        blocked = np.append(0, np.cumsum(~free))
        before = blocked[np.searchsorted(every, angle)]
        kept = np.diff(before, append=before[0] + blocked[-1]) == 0
        lengths = radius * np.diff(angle, append=angle[0] + ROUND)[kept]
        tails, heads = own[kept], np.roll(own, -1)[kept]
        yield (
            (tails, heads, lengths) if circles.turn[k] > 0 else (heads, tails, lengths)
        )


def _shortest(
    nodes: _Nodes, circles: _Circles, blocks: Sequence[Block], box: Box
) -> ShortestPath | None:
    """Return the shortest path on the graph of tangents and free arcs."""
    n = nodes.circle.size // 2
    tangents = np.hypot(*(nodes.points[:, n:] - nodes.points[:, :n]))
    edges = [(np.arange(n), np.arange(n, 2 * n), tangents)]
    edges += _free_arcs(nodes, circles, blocks, box)
    tails, heads, lengths = (np.concatenate(part) for part in zip(*edges, strict=True))
    # All nodes at the start are node 2 n, all at the goal node 2 n + 1.
    ends = nodes.circle - (circles.radius.size - 2)
    name = np.where(ends >= 0, 2 * n + ends, np.arange(2 * n))
    graph = csr_array((lengths, (name[tails], name[heads])), shape=(2 * n + 2,) * 2)
    length, before = dijkstra(graph, indices=2 * n, return_predecessors=True)
    if not np.isfinite(length[-1]):
        return None
    way = [2 * n + 1]
    while way[-1] != 2 * n:
        way.append(int(before[way[-1]]))
    return ShortestPath(float(length[-1]), _pieces(way[::-1], nodes, circles))


def _pieces(way: Sequence[int], nodes: _Nodes, circles: _Circles) -> tuple[Piece, ...]:
    """Return segments and arcs; neighbouring arcs, which share a circle, become one."""
    circle = np.append(nodes.circle, circles.radius.size - np.array([2, 1]))
    points = [_point(p) for p in np.hstack([nodes.points, circles.center[:, -2:]]).T]
    pieces: list[Piece] = []
    for tail, head in pairwise(way):
        k = circle[tail]
        if k != circle[head]:
            pieces.append(Segment(points[tail], points[head]))
            continue
        turn, angle = float(circles.turn[k]), float(nodes.angle[tail])
        sweep = turn * float(turn * (nodes.angle[head] - angle) % ROUND)
        if pieces and isinstance(last := pieces[-1], Arc):
            pieces.pop()
            angle, sweep = last.angle, last.sweep + sweep
        center = _point(circles.center[:, k])
        pieces.append(Arc(center, float(circles.radius[k]), angle, sweep))
    return tuple(pieces)


def _point(p: Array) -> Point:
    return float(p[0]), float(p[1])
