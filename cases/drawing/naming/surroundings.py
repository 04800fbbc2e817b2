"""Discs, slots, goals and leaders of recorded runs."""

import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.format.expressions import evaluate, parse
from swarmstart.cases.format.registry import words_of
from swarmstart.errors import SwarmstartError

_TWO = 2
_STRAIGHT = 1e-9
"""Relative error up to which a distance is one from a fixed place."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Disc:
    """A disc that vehicles keep out of, or within.

    Attributes:
        x: Centre.
        y: Centre.
        radius: Its radius, in the unit of the positions.
        name: What it is called; may be empty.
        is_limit: Whether vehicles stay within it.
    """

    x: float
    y: float
    radius: float
    name: str = ""
    is_limit: bool = False

    def __post_init__(self) -> None:
        """Refuse an invalid centre or radius; raises ValueError."""
        if not (math.isfinite(self.x + self.y) and 0 < self.radius < math.inf):
            raise ValueError(
                f"a disc with a centre and a radius expected, found ({self.x:g}, "
                f"{self.y:g}) and {self.radius:g}"
            )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Surroundings:
    """Surroundings that vehicles move among.

    Attributes:
        discs: Obstacles and limits.
        targets: Wanted place of each vehicle at the frames, shape (targets, 2, F).
        called: Name of a target.
        leader: The virtual leader at the frames, shape (2, F); None: there is none.
        leader_heading: Its direction [rad], shape (F,); None: not known.
    """

    discs: Sequence[Disc] = ()
    targets: Array | None = None
    called: str = ""
    leader: Array | None = None
    leader_heading: Array | None = None


def surroundings_of(
    scenario: Mapping[str, Any], times: Array, positions: Array, headings: Array
) -> Surroundings:
    """Return what is around the vehicles of a recorded run, as its kind says.

    Args:
        scenario: As recorded.
        times: Of the frames, shape (F,) [s].
        positions: Of the vehicles, shape (vehicles, 2, F).
        headings: Of the vehicles [rad], shape (vehicles, F).
    """
    place = words_of(scenario.get("kind")).surroundings
    if not place:
        return Surroundings()
    around: Surroundings = resolve_name(place)(scenario, times, positions, headings)
    return around


def points(given: Iterable[Mapping[str, Any]]) -> Array:
    """Return places with the keys x_m and y_m, shape (n, 2) [m]."""
    return np.array([[float(one["x_m"]), float(one["y_m"])] for one in given])


def standing(places: Array, times: Array) -> Array:
    """Return places (n, 2) that do not move, at all times, shape (n, 2, F)."""
    return np.repeat(places[:, :, None], times.size, axis=2)


def place_of(texts: Sequence[Any], states: Collection[str]) -> list[str]:
    """Return the one state that each coordinate of a distance names, or nothing.

    Args:
        texts: Expressions of the coordinates.
        states: Names of the states.
    """
    found = []
    for text in texts:
        try:
            used = [name for name in parse(str(text)).names if name in states]
        except SwarmstartError:
            return []
        if len(used) != 1:
            return []
        found.append(used[0])
    return found


def position_of(
    scenario: Mapping[str, Any], states: Collection[str], units: Mapping[str, str]
) -> tuple[str, str] | None:
    """Return the names of the states that are the position of a problem's vehicles.

    They are what the vehicles are kept apart by, or the coordinates of a distance, or
    are called x and y; None: there are no such states.

    Args:
        scenario: As recorded.
        states: Names of the states of one vehicle.
        units: By name, as far as they are known.
    """
    separation = (scenario.get("vehicles") or {}).get("separation") or {}
    candidates = [separation.get("of") or []]
    candidates += [
        list(place_of(part["distance"], states))
        for part in scenario.get("path") or []
        if isinstance(part, Mapping) and part.get("distance")
    ]
    candidates.append(["x", "y"])
    for found in candidates:
        if len(found) in {2, 3} and all(name in states for name in found[:2]):
            x, y = found[:2]
            if x != y and units.get(x, "") == units.get(y, ""):
                return x, y
    return None


def directions_of(positions: Array) -> Array:
    """Return the direction of the motion of each vehicle [rad], kept while it rests."""
    steps = np.gradient(positions, axis=2)
    angles = np.arctan2(steps[:, 1], steps[:, 0])
    moves = np.hypot(steps[:, 0], steps[:, 1]) > 0
    for angle, moving in zip(angles, moves, strict=True):
        if moving.any():
            kept = np.maximum.accumulate(np.where(moving, np.arange(moving.size), -1))
            kept[kept < 0] = int(np.argmax(moving))
            angle[:] = np.unwrap(angle[kept])
    return np.asarray(angles)


def discs_of_problem(
    scenario: Mapping[str, Any], axes: tuple[str, str]
) -> tuple[Disc, ...]:
    """Return the discs that a problem's distances from fixed places are.

    Args:
        scenario: As recorded.
        axes: Names of the states that are the position.
    """
    constants = _constants(scenario)
    found = []
    for part in scenario.get("path") or []:
        if not isinstance(part, Mapping) or len(part.get("distance") or ()) != _TWO:
            continue
        centre = _centre(part["distance"], axes, constants)
        limit = part.get("at_least")
        is_limit = limit is None
        try:
            radius = evaluate(str(part["at_most"] if is_limit else limit), constants)
        except (SwarmstartError, LookupError):
            continue
        if centre is not None and radius > 0:
            name = str(part.get("name") or "")
            found.append(
                Disc(
                    x=centre[0], y=centre[1], radius=radius, name=name,
                    is_limit=is_limit,
                )
            )  # fmt: skip
    return tuple(found)


def _centre(
    texts: Sequence[Any], axes: tuple[str, str], constants: Mapping[str, float]
) -> tuple[float, float] | None:
    """Return c of the coordinates x - c; None if they are others."""
    place = []
    for text, name in zip(texts, axes, strict=True):
        try:
            values = [evaluate(str(text), {**constants, name: v}) for v in (0, 1, -1)]
        except SwarmstartError:  # It needs more than the position: a moving place.
            return None
        size = max(map(abs, values)) + 1
        slopes = (values[1] - values[0], values[0] - values[2])
        is_straight = abs(slopes[0] - slopes[1]) <= _STRAIGHT * size
        if not is_straight or abs(abs(slopes[0]) - 1) > _STRAIGHT * size:
            return None
        place.append(-values[0] * np.sign(slopes[0]))
    return float(place[0]), float(place[1])


def _constants(scenario: Mapping[str, Any]) -> dict[str, float]:
    """Return the constants that are numbers, or made of those before them."""
    found: dict[str, float] = {}
    given = scenario.get("constants") or {}
    for _ in range(1 + len(given)):
        before = len(found)
        for name, text in itertools.islice(given.items(), 1000):
            if name in found:
                continue
            try:
                found[name] = evaluate(str(text), found)
            except SwarmstartError:
                continue
        if len(found) == before:
            break
    return found
