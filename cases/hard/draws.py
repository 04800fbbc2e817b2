"""Functions that several families share: draws that are possible, and constraints.

Numbers are rounded to three decimals when they are drawn, so that a document states its
problem exactly.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from swarmstart.arrays import Array
from swarmstart.errors import SwarmstartError

MOST_DRAWS = 10_000
"""Number of draws after which a size counts as impossible."""
DECIMALS = 3
Mapped = dict[str, Any]
"""A document of `kind: problem`, or a part of one, as plain data."""
T = TypeVar("T")


class ImpossibleDrawError(SwarmstartError, ValueError):
    """No draw of a family at a size is possible."""


class Disc(NamedTuple):
    """A disc that a position must not enter.

    Attributes:
        x: Abscissa of the centre.
        y: Ordinate of the centre.
        radius: Radius of the disc.
    """

    x: float
    y: float
    radius: float


def first_possible(
    attempt: Callable[[np.random.Generator], T | None], seed: int
) -> tuple[T, str]:
    """Return the first possible draw, and which draw of the seed it is, in words.

    Args:
        attempt: Function that draws once. It returns None if the draw is impossible,
            such as one without a free path; the next draw then continues the same
            stream of numbers.
        seed: Seed of the stream.

    Raises:
        ImpossibleDrawError: If none of the first `MOST_DRAWS` is possible.
    """
    rng = np.random.default_rng(seed)
    for number in range(1, MOST_DRAWS + 1):
        found = attempt(rng)
        if found is not None:
            return found, f"draw {number} of seed {seed}"
    raise ImpossibleDrawError(
        f"expected a possible draw among {MOST_DRAWS} of seed {seed}, found none: "
        "choose a smaller size"
    )


def rounded(values: Any) -> Any:
    """Return a number, or an array as nested lists, with three decimals and no -0."""
    return (np.round(np.asarray(values, dtype=float), DECIMALS) + 0.0).tolist()


def apart(discs: Sequence[Disc], x: float, y: float, least: float) -> bool:
    """Return whether a point is at least `least` away from the edges of all discs."""
    return all(np.hypot(x - d.x, y - d.y) >= d.radius + least for d in discs)


def outside(disc: Disc, x: str = "x", y: str = "y") -> Mapped:
    """Return the path constraint that keeps a position outside of a disc."""
    relative = [minus(x, disc.x), minus(y, disc.y)]
    return {"distance": relative, "at_least": disc.radius}


def minus(name: str, value: float) -> str:
    """Return the expression `name - value`.

    Example:
        >>> minus("x", 2.0), minus("x", -1.5), minus("x", 0.0)
        ('x - 2', 'x + 1.5', 'x')
    """
    if value == 0.0:
        return name
    return f"{name} {'-' if value > 0 else '+'} {abs(value):.12g}"


def crossed(
    start: Sequence[float], goal: Sequence[float], *, half: float, fastest: float
) -> Mapped:
    """Return the problem of a point that crosses a room, as data of a YAML file.

    The cost is the integral of the squared speed.

    Args:
        start: Position at the start, (x, y).
        goal: Position after one second, (x, y).
        half: Bound of |y|. The bounds of x are -1 and 1 + x of the goal.
        fastest: Bound of each speed.

    Returns:
        States, controls, cost, an empty `path`, end and grid of the problem, in the
        order in which they are written.
    """
    bounds = {"x": [-1, goal[0] + 1.0], "y": [-half, half]}
    return {
        "states": {
            name: {"start": at, "rate": rate, "bounds": bounds[name]}
            for name, at, rate in zip("xy", start, "uv", strict=True)
        },
        "controls": {name: {"bounds": [-fastest, fastest]} for name in "uv"},
        "stage_cost": "u**2 + v**2",
        "path": [],
        "terminal": reached({"x": goal[0], "y": goal[1]}),
        "prediction": {"horizon_s": 1, "intervals": 60, "checks": 4, "substeps": 1},
    }


def reached(goal: Mapping[str, float]) -> list[Mapped]:
    """Return the constraints by which states have given values at the end."""
    return [{"expression": name, "equals": value} for name, value in goal.items()]


def least_distance(points: Array) -> float:
    """Return the least distance between any two of n points, shape (n, 2).

    It is infinite for a single point.
    """
    away = np.linalg.norm(points[:, None] - points[None], axis=2)
    return float(away[~np.eye(len(points), dtype=bool)].min(initial=np.inf))


def uniform(rng: np.random.Generator, low: float, high: float, size: int) -> Array:
    """Return uniform numbers with three decimals, shape (size,)."""
    return np.round(rng.uniform(low, high, size), DECIMALS) + 0.0
