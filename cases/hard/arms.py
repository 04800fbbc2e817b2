"""Arms: a planar arm of n links moves its tip to a point, between discs.

Joints are kinematic, angle' = rate. The cost is the integral of the squared rates over
one second; its least value is the square of the length of the shortest path in the
space of angles. The tip can reach its goal with each elbow up or down, and after turns
on either side.

The arm's joints and `POINTS` points of each link stay outside of the discs.
"""

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.hard.draws import (
    Disc,
    Mapped,
    apart,
    first_possible,
    outside,
    reached,
    uniform,
)

POINTS = 4
"""Points of each link that are checked; the last is its end."""
RADII, CLEARANCE = (0.2, 0.35), 0.15
"""Smallest and largest radius of discs for a reach of 2; gap at start and goal."""


def arms(*, links: int, discs: int, seed: int) -> Mapped:
    """Return the problem of an arm among discs, as the data of a YAML file.

    Args:
        links: Number of links; their lengths add to 2.
        discs: Number of discs.
        seed: Seed of the draw.

    Raises:
        ImpossibleDrawError: If so many discs do not fit.
    """
    (start, goal, found), draw = first_possible(
        lambda rng: _attempt(rng, links, discs), seed
    )
    points = [(f"x{k}_{n}", f"y{k}_{n}") for k in range(1, links + 1)
              for n in range(1, POINTS + 1)]  # fmt: skip
    return {
        "kind": "problem",
        "title": f"Move an arm of {links} links among {discs} discs ({draw})",
        "constants": {"link": 2 / links},
        "definitions": _positions(links),
        "states": {
            f"q{k}": {"start": angle, "rate": f"w{k}", "unit": "rad"}
            for k, angle in enumerate(start, 1)
        },
        "controls": {f"w{k}": {"bounds": [-8, 8]} for k in range(1, links + 1)},
        "stage_cost": " + ".join(f"w{k}**2" for k in range(1, links + 1)),
        "path": [outside(disc, x, y) for disc in found for x, y in points],
        "terminal": reached(
            {f"x{links}_{POINTS}": goal[0], f"y{links}_{POINTS}": goal[1]}
        ),
        "prediction": {"horizon_s": 1, "intervals": 40, "checks": 2, "substeps": 1},
    }


def _positions(links: int) -> dict[str, str]:
    """Return the expressions of all points: x2_4 is the end of the second link."""
    found: dict[str, str] = {}
    before, angle = ("0", "0"), ""
    for k in range(1, links + 1):
        angle = f"{angle} + q{k}" if angle else f"q{k}"
        found |= {f"cos{k}": f"link*cos({angle})", f"sin{k}": f"link*sin({angle})"}
        for n in range(1, POINTS + 1):
            part = n / POINTS
            found[f"x{k}_{n}"] = f"{before[0]} + {part:g}*cos{k}"
            found[f"y{k}_{n}"] = f"{before[1]} + {part:g}*sin{k}"
        before = (f"x{k}_{POINTS}", f"y{k}_{POINTS}")
    return found


def _attempt(
    rng: np.random.Generator, links: int, count: int
) -> tuple[list[float], list[float], list[Disc]] | None:
    """Return start, goal and discs; None if the arm does not fit at both ends."""
    start, end = (uniform(rng, -np.pi, np.pi, links) for _ in range(2))
    start[1:], end[1:] = start[1:] / 2, end[1:] / 2
    start = np.round(start, 3)
    goal = np.round(_arm(end, links)[-1], 3)
    discs = [
        Disc(*_polar(rng), *uniform(rng, *RADII, 1).tolist()) for _ in range(count)
    ]
    ends = [*_arm(start, links), *_arm(end, links)]
    # Not through the shoulder, which no motion avoids.
    free = all(apart(discs, x, y, CLEARANCE) for x, y in [(0.0, 0.0), *ends])
    far = np.linalg.norm(goal - _arm(start, links)[-1]) > 1.5  # noqa: PLR2004
    apart_discs = all(
        apart(discs[:k], one.x, one.y, one.radius) for k, one in enumerate(discs)
    )
    if not (free and far and apart_discs):
        return None
    return start.tolist(), goal.tolist(), discs


def _polar(rng: np.random.Generator) -> list[float]:
    """Return a point of the ring that the outer half of the arm sweeps."""
    distance, angle = rng.uniform(0.9, 1.8), rng.uniform(-np.pi, np.pi)
    point = [distance * np.cos(angle), distance * np.sin(angle)]
    return [float(value) for value in np.round(point, 3)]


def _arm(angles: Array, links: int) -> Array:
    """Return the points of an arm that are checked, shape (links * POINTS, 2)."""
    headings = np.cumsum(angles)
    ways = np.stack([np.cos(headings), np.sin(headings)], axis=1) * 2 / links
    joints = np.vstack([np.zeros(2), np.cumsum(ways, axis=0)])
    parts = np.arange(1, POINTS + 1) / POINTS
    return np.vstack(
        [a + part * way for a, way in zip(joints, ways, strict=False) for part in parts]
    )
