"""Walls with gaps: a point crosses K walls, through one of G gaps in each.

The least integral of u'u over one second is the square of the length of the shortest
path, since speed is constant along an optimum. Each choice of gaps has a path of its
own: G^K of them.

A block is a stadium: the points within a radius r of a vertical segment of half length
c, thus a rectangle with rounded corners whose half width is r. Its constraint is
log(g) >= 0, with the gauge g: the factor by which the block is enlarged until the
point is on its boundary. With (x, y) relative to the centre, and d^2 = x^2 + h^2,

    h = max(|y|, c |x| / r),   g = d^2 / (c h + sqrt(r^2 d^2 - c^2 x^2))

The gauge leads points within a wall along the wall to a gap; the distance from the
boundary would lead them across it. On one draw 39 of 66 random starts find a feasible
path with the gauge, and 5 with the distance. A path passes the kinks of max and | |,
which cancel in g. They are rounded,

    max(a, b) -> (a + b + sqrt((a - b)^2 + e^2)) / 2,   |a| -> sqrt(a^2 + e^2)

with e = EDGE, which moves the boundary by less than e / 4 where an arc meets a side,
and by e^2 / r elsewhere.
"""

from typing import NamedTuple

import numpy as np

from swarmstart.cases.hard.draws import (
    Mapped,
    crossed,
    first_possible,
    minus,
    rounded,
    uniform,
)

SPACING, HALF_HEIGHT = 2.5, 4.0
"""Distance of walls; half the height of the room."""
RADIUS, EDGE, GAP = 0.25, 1e-3, 0.7
"""Half the width of a wall; width of the rounded kinks e; height of a gap."""
LEAST_HEIGHT = 0.6
"""Smallest height of a block between two gaps."""


class Block(NamedTuple):
    """A rectangle with rounded corners and sides along the axes.

    Attributes:
        x: Abscissa of its centre.
        y: Ordinate of its centre.
        half_width: Half the extent of the block in x, corners included.
        half_height: Half the extent of the block in y, corners included.
        radius: Radius of its corners.
    """

    x: float
    y: float
    half_width: float
    half_height: float
    radius: float


class Walls(NamedTuple):
    """A drawn room with walls.

    Attributes:
        start: Position at the start.
        goal: Position at the end.
        blocks: Blocks of all walls; the outermost reach beyond the room.
        half_height: Bound of |y|.
        fastest: Bound of each speed: more than the length of some path to the goal.
    """

    start: tuple[float, float]
    goal: tuple[float, float]
    blocks: tuple[Block, ...]
    half_height: float
    fastest: float


def drawn_walls(*, walls: int, gaps: int, seed: int) -> tuple[Walls, str]:
    """Return the first draw that is possible, and words such as "draw 2 of seed 0".

    Args:
        walls: Number of walls K.
        gaps: Number of gaps in each wall, G.
        seed: Seed of the draw.

    Raises:
        ImpossibleDrawError: If so many gaps do not fit into a wall.
    """
    return first_possible(lambda rng: _attempt(rng, walls, gaps), seed)


def walls(*, walls: int, gaps: int, seed: int) -> Mapped:
    """Return the document of K walls with G gaps each; arguments as `drawn_walls`."""
    room, draw = drawn_walls(walls=walls, gaps=gaps, seed=seed)
    definitions: dict[str, str] = {}
    for number, block in enumerate(room.blocks, 1):
        definitions |= _definitions(block, number)
    return {
        "kind": "problem",
        "title": f"Cross {walls} walls with {gaps} gaps each ({draw})",
        "constants": {"e": EDGE},
        "definitions": definitions,
        **crossed(room.start, room.goal, half=room.half_height, fastest=room.fastest),
        "path": [
            {"expression": f"log(gauge{number})", "lower": 0, "scale": 1}
            for number, _ in enumerate(room.blocks, 1)
        ],
    }


def _attempt(rng: np.random.Generator, walls: int, gaps: int) -> Walls | None:
    """Return a room; None if two gaps of a wall are too near each other."""
    far = SPACING * (walls + 1)
    start, goal = uniform(rng, 0.7 - HALF_HEIGHT, HALF_HEIGHT - 0.7, 2).tolist()
    blocks: list[Block] = []
    height, climbed = start, 0.0
    for wall in range(walls):
        reach = HALF_HEIGHT - GAP / 2 - LEAST_HEIGHT
        centres = np.sort(uniform(rng, -reach, reach, gaps))
        if (np.diff(centres) < GAP + LEAST_HEIGHT).any():
            return None
        nearest = float(centres[np.argmin(abs(centres - height))])
        climbed, height = climbed + abs(nearest - height), nearest
        edges = [c + side * GAP / 2 for c in centres for side in (-1, 1)]
        # The outermost blocks end a corner beyond the room: no way leads around.
        beyond = HALF_HEIGHT + RADIUS
        ends = rounded([-beyond, *edges, beyond])
        for low, high in zip(ends[::2], ends[1::2], strict=True):
            middle, half = rounded([(low + high) / 2, (high - low) / 2])
            blocks.append(Block(SPACING * (wall + 1), middle, RADIUS, half, RADIUS))
    # The way through the nearest gaps, along the axes, is longer than the shortest.
    fastest = float(np.ceil(far + climbed + abs(goal - height)))
    return Walls((0.0, start), (far, goal), tuple(blocks), HALF_HEIGHT, fastest)


def _definitions(block: Block, number: int) -> dict[str, str]:
    """Return the expressions of a block's gauge, with the names d, h, ... and number.

    Args:
        block: The block, a stadium: its radius is its half width.
        number: Number of the block, for the names.
    """
    x, y = f"({minus('x', block.x)})", f"({minus('y', block.y)})"
    r, c = f"{block.radius:.12g}", f"{block.half_height - block.radius:.12g}"
    w, v, h, d = (f"{name}{number}" for name in "wvhd")
    return {
        w: f"sqrt({x}**2 + e**2)*{c}/{r}",
        v: f"sqrt({y}**2 + e**2)",
        h: f"({w} + {v} + sqrt(({w} - {v})**2 + e**2))/2",
        d: f"{x}**2 + {h}**2",
        f"gauge{number}": f"{d}/({c}*{h} + sqrt({r}**2*{d} - {c}**2*{x}**2))",
    }
