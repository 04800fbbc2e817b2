"""The best distinct basins that a search has met.

Two points a and b belong to one basin if they are near each other in the box. With the
widths w of the box, and the mean over the variables d that are not fixed, this means

    sqrt(mean_d ((a_d - b_d) / w_d)^2) < radius

An archive keeps a limited number of points, the best of each basin. If a new point is
better than each member near it, it is added and these members are removed; otherwise
the point is dropped. These basins are not the basins of attraction of a local solver:
two points of the archive may lead a solver to the same optimum.
"""

from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.heuristics.laws.algorithm import copy_column, fill_column
from swarmstart.heuristics.laws.box import Box
from swarmstart.heuristics.laws.order import RunningOrder, better_at, is_finite
from swarmstart.machine_code import Count, kernel


class Archive(NamedTuple):
    """Points with their costs and violations; only the first `members` are in use.

    Attributes:
        points: The points as columns, shape (dim, room).
        cost: Costs of the points, shape (room,).
        violation: Violations of the points, shape (room,).
        members: Number of points in use, int64, shape (1,).
        free: Indices of the variables that are not fixed, int64 (`Box.free`).
        width: Widths of the box, shape (dim,); 1 for variables that are fixed.
        radius: Least distance of two members, as `distance` measures it, shape (1,).
    """

    points: Array
    cost: Array
    violation: Array
    members: Count
    free: Count
    width: Array
    radius: Array


def new_archive(box: Box, *, room: int, radius: float) -> Archive:
    """Return an empty archive.

    Args:
        box: The box.
        room: Largest number of members; with 0 nothing is kept.
        radius: Least distance of two members, as `distance` measures it.
    """
    return Archive(
        points=np.zeros((box.dim, room)),
        cost=np.full(room, np.inf),
        violation=np.full(room, np.inf),
        members=np.zeros(1, dtype=np.int64),
        free=box.free,
        width=np.where(box.width > 0.0, box.width, 1.0),
        radius=np.full(1, radius),
    )


@kernel
def collect(
    order: RunningOrder, archive: Archive, asked: Array, cost: Array, violation: Array
) -> None:
    """Offer a generation to the archive.

    Args:
        order: The order of points; they are compared at its final tolerance.
        archive: The archive, changed in place.
        asked: Individuals of the generation as columns, shape (dim, size).
        cost: Costs, shape (size,).
        violation: Violations, shape (size,).
    """
    room = archive.cost.size
    if room == 0:
        return
    for i in range(cost.size):
        if not is_finite(cost[i], violation[i]):
            continue
        worst = room - 1  # Members stand in order, the best first.
        if archive.members[0] == room and not _beats(
            order, cost[i], violation[i], archive, worst
        ):
            continue
        offer(order, archive, asked[:, i], cost[i], violation[i])


@kernel
def offer(
    order: RunningOrder, archive: Archive, point: Array, cost: float, violation: float
) -> None:
    """Add one point if it is the best of its basin."""
    for k in range(archive.members[0]):
        near = distance(archive, point, k) < archive.radius[0]
        if near and not _beats(order, cost, violation, archive, k):
            return
    kept = 0  # The members near the point are worse and make way.
    for k in range(archive.members[0]):
        if distance(archive, point, k) >= archive.radius[0]:
            _move(archive, k, kept)
            kept += 1
    place = min(kept, archive.cost.size - 1)  # A full archive loses its worst.
    archive.members[0] = place + 1
    while place > 0 and _beats(order, cost, violation, archive, place - 1):
        _move(archive, place - 1, place)
        place -= 1
    fill_column(point, archive.points, place)
    archive.cost[place] = cost
    archive.violation[place] = violation


@kernel
def distance(archive: Archive, point: Array, k: int) -> float:
    """Distance of a point from member k.

    It is the root mean square, over the variables that are not fixed, of the
    differences divided by the widths of the box.
    """
    total = 0.0
    for d in archive.free:
        part = (point[d] - archive.points[d, k]) / archive.width[d]
        total += part * part
    return float(np.sqrt(total / archive.free.size))


@kernel
def _beats(
    order: RunningOrder, cost: float, violation: float, archive: Archive, k: int
) -> bool:
    return better_at(
        order,
        order.tolerance,
        cost,
        violation,
        archive.cost[k],
        archive.violation[k],
    )


@kernel
def _move(archive: Archive, source: int, target: int) -> None:
    if source != target:
        copy_column(archive.points, source, archive.points, target)
        archive.cost[target] = archive.cost[source]
        archive.violation[target] = archive.violation[source]
