"""Discs: a point crosses a field of discs that stand close together.

The least integral of u'u over one second is the square of the length of the shortest
path, since speed is constant along an optimum. Each disc is passed on one of two sides.
"""

from typing import NamedTuple

import numpy as np

from swarmstart.cases.hard.draws import (
    Disc,
    Mapped,
    apart,
    crossed,
    first_possible,
    outside,
    rounded,
    uniform,
)

SHARE, CLEARANCE = 0.4, 0.25
"""Part of the field that discs cover; smallest gap between two of them."""
RADII = (0.5, 0.9)
"""Smallest and largest radius."""
TRIALS = 400
"""Number of places that are tried for the discs of one draw, for each of them."""


class Field(NamedTuple):
    """A drawn field of discs.

    Attributes:
        start: Position at the start.
        goal: Position at the end.
        discs: The discs.
        half: Bound of |y|. The bounds of x are -1 and 1 + x of the goal.
    """

    start: tuple[float, float]
    goal: tuple[float, float]
    discs: tuple[Disc, ...]
    half: float


def drawn_discs(*, discs: int, seed: int) -> tuple[Field, str]:
    """Return the first possible draw, and which draw of the seed it is, in words.

    Args:
        discs: Number of discs.
        seed: Seed of the draw.

    Raises:
        ImpossibleDrawError: If the discs do not fit.
    """
    return first_possible(lambda rng: _attempt(rng, discs), seed)


def discs(*, discs: int, seed: int) -> Mapped:
    """Return the problem of a point among discs, as the data of a YAML file.

    The arguments are those of `drawn_discs`.
    """
    field, draw = drawn_discs(discs=discs, seed=seed)
    fastest = float(np.ceil(2 * field.goal[0]))
    return {
        "kind": "problem",
        "title": f"Cross a field of {discs} discs ({draw})",
        **crossed(field.start, field.goal, half=field.half, fastest=fastest),
        "path": [outside(disc) for disc in field.discs],
    }


def _attempt(rng: np.random.Generator, count: int) -> Field | None:
    """Return a field; None if the discs do not fit or touch start or goal."""
    radii = uniform(rng, *RADII, count)
    side = rounded(np.sqrt(np.pi * np.sum(radii**2) / SHARE))
    start, goal = uniform(rng, -side / 4, side / 4, 2).tolist()
    found: list[Disc] = []
    tried = 0
    while len(found) < count and tried < TRIALS * count:
        tried += 1
        x, y = uniform(rng, 0.0, 1.0, 2)
        x, y = rounded(side * x), rounded(side * (y - 0.5))
        radius = float(radii[len(found)])
        if apart(found, x, y, radius + CLEARANCE):
            found.append(Disc(x, y, radius))
    ends = (0.0, start), (rounded(side), goal)
    free = all(apart(found, x, y, CLEARANCE) for x, y in ends)
    if len(found) < count or not free:
        return None
    return Field(*ends, tuple(found), rounded(side / 2))
