"""Currents: a boat of speed 1 crosses a field of vortices in the least time.

    p' = (cos(heading), sin(heading)) + w(p)
    w(p) = sum_k G_k perp(p - c_k) / (|p - c_k|^2 + core^2),   perp(x, y) = (-y, x)

with |w| < 1 everywhere, so that every point can be reached. Each vortex is passed on
one of two sides: with its stream by a detour, or against it.
"""

from typing import NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.hard.draws import (
    Mapped,
    first_possible,
    least_distance,
    minus,
    reached,
    rounded,
    uniform,
)

CORE, STRONGEST, AREA = 0.5, 0.9, 9.0
"""Radius of a core; largest |w|; area of the field for each vortex."""
APART = 1.2
"""Smallest distance between two vortices."""
GRID = 201
"""Number of points in each direction at which |w| is computed to scale it."""


class Currents(NamedTuple):
    """A drawn field of vortices.

    Attributes:
        start: Position at the start.
        goal: Position at the end.
        centres: Centres c_k, shape (n, 2).
        strengths: Strengths G_k, shape (n,); positive turns to the left.
        core: Radius of the core of each vortex.
        low: Smallest x and y that the boat may have.
        high: Largest x and y that the boat may have.
    """

    start: tuple[float, float]
    goal: tuple[float, float]
    centres: Array
    strengths: Array
    core: float
    low: tuple[float, float]
    high: tuple[float, float]


def current(field: Currents, points: Array) -> Array:
    """Return the current w at points, shape (2, n), like the points.

    Args:
        field: The field.
        points: Positions, shape (2, n).
    """
    away = points[:, :, None] - field.centres.T[:, None, :]
    weight = field.strengths / ((away**2).sum(axis=0) + field.core**2)
    found: Array = np.stack([-away[1], away[0]])
    return np.asarray((found * weight).sum(axis=2))


def drawn_currents(*, vortices: int, seed: int) -> tuple[Currents, str]:
    """Return the first possible draw, and which draw of the seed it is, in words.

    Args:
        vortices: Number of vortices.
        seed: Seed of the draw.

    Raises:
        ImpossibleDrawError: If no draw keeps vortices apart.
    """
    return first_possible(lambda rng: _attempt(rng, vortices), seed)


def currents(*, vortices: int, seed: int) -> Mapped:
    """Return the problem of a crossing, as the data of a YAML file.

    The arguments are those of `drawn_currents`.
    """
    field, draw = drawn_currents(vortices=vortices, seed=seed)
    far = field.goal[0]
    definitions: dict[str, str] = {}
    for k, (x, y) in enumerate(field.centres.tolist(), 1):
        dx, dy = minus("x", x), minus("y", y)
        strength = f"{field.strengths[k - 1]:.12g}"
        definitions[f"turn{k}"] = f"{strength}/(({dx})**2 + ({dy})**2 + core**2)"
        definitions[f"along{k}"] = f"-({dy})*turn{k}"
        definitions[f"across{k}"] = f"({dx})*turn{k}"
    numbers = range(1, len(field.centres) + 1)
    along, across = (
        " + ".join(f"{name}{k}" for k in numbers) for name in ("along", "across")
    )
    return {
        "kind": "problem",
        "title": f"Cross {vortices} vortices in the least time ({draw})",
        "constants": {"core": field.core},
        "definitions": definitions,
        "states": {
            "x": {
                "start": field.start[0],
                "rate": f"cos(heading) + {along}",
                "bounds": [field.low[0], field.high[0]],
            },
            "y": {
                "start": field.start[1],
                "rate": f"sin(heading) + {across}",
                "bounds": [field.low[1], field.high[1]],
            },
        },
        "controls": {"heading": {"bounds": [-6, 6], "unit": "rad"}},
        "stage_cost": "1",
        "terminal": reached({"x": far, "y": field.goal[1]}),
        "prediction": {
            "horizon_s": {"free": [rounded(far / 2), 4 * far], "guess": far},
            "intervals": 60,
        },
    }


def _attempt(rng: np.random.Generator, count: int) -> Currents | None:
    """Return a field; None if two vortices are too near each other."""
    side = rounded(np.sqrt(AREA * count))
    start, goal = uniform(rng, -side / 4, side / 4, 2).tolist()
    x, y = uniform(rng, 0.0, side, count), uniform(rng, -side / 2, side / 2, count)
    centres = np.stack([x, y], axis=1)
    if least_distance(centres) < APART:
        return None
    signs = np.where(rng.random(count) < 0.5, -1.0, 1.0)  # noqa: PLR2004
    field = Currents(
        start=(0.0, start),
        goal=(side, goal),
        centres=centres,
        strengths=signs * uniform(rng, 0.6, 1.0, count),
        core=CORE,
        low=(-2.0, rounded(-side / 2 - 2)),
        high=(side + 2.0, rounded(side / 2 + 2)),
    )
    xs = np.linspace(field.low[0], field.high[0], GRID)
    ys = np.linspace(field.low[1], field.high[1], GRID)
    speeds = np.linalg.norm(
        current(field, np.stack([g.ravel() for g in np.meshgrid(xs, ys)])), axis=0
    )
    strengths = field.strengths * (STRONGEST / speeds.max())
    return field._replace(strengths=np.asarray(rounded(strengths)))
