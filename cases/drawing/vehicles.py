"""Vehicles of recorded runs: their rows, names and surroundings.

This module finds the rows of a flight's states and controls that belong to each
vehicle, the names of states in bands over seeds (UAV, quantity and unit), and discs,
slots, goals and leaders.
"""

import itertools
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.wording import label_of
from swarmstart.cases.format.expressions import evaluate, parse
from swarmstart.cases.format.registry import words_of
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Trajectory

_TWO = 2
_STRAIGHT = 1e-9
"""Relative error up to which a distance is one from a fixed place."""


@dataclass(frozen=True, kw_only=True, slots=True)
class VehicleRows:
    """Names of the states and the controls of one vehicle, and their rows in a flight.

    Attributes:
        vehicles: Name of each vehicle.
        states: Name of a state of one vehicle -> its row for each of the vehicles.
        controls: Name of a control of one vehicle -> its row for each of the vehicles;
            -1 for a vehicle without this control.
        units: Unit by name of a state or control.
    """

    vehicles: tuple[str, ...]
    states: dict[str, list[int]]
    controls: dict[str, list[int]]
    units: dict[str, str] = field(default_factory=dict)


def rows_of(flight: Trajectory, scenario: Mapping[str, Any]) -> VehicleRows:
    """Return the rows of a flight that belong to each vehicle of a recorded scenario.

    Raises:
        ValueError: If the flight has fewer rows.
    """
    words = words_of(scenario.get("kind"))
    if words.numbered_rows:
        numbers = _numbers(scenario, flight, words.first_number)
        states = _by_number(flight.state_names, len(numbers))
        controls = _by_number(flight.control_names, len(numbers))
        return VehicleRows(
            vehicles=tuple(f"{words.called} {number}" for number in numbers),
            states=states,
            controls=controls,
        )
    states = scenario.get("states") or {}
    members = (scenario.get("vehicles") or {}).get("members") or []
    vehicles = tuple(str(member["name"]) for member in members) or ("",)
    if not isinstance(states, Mapping) or not states:
        names, held = list(flight.state_names), list(flight.control_names)
        units: dict[str, str] = {}
    else:
        names, held = list(states), list(scenario.get("controls") or {})
        parts = {**states, **(scenario.get("controls") or {})}
        units = {name: str(part.get("unit") or "") for name, part in parts.items()}
    vehicles = words.vehicles or vehicles
    return VehicleRows(
        vehicles=vehicles,
        states=_one_after_another(names, len(vehicles), len(flight.states)),
        controls=_one_after_another(held, len(vehicles), len(flight.controls)),
        units=units,
    )


def _numbers(scenario: Mapping[str, Any], flight: Trajectory, first: int) -> list[int]:
    """Return the number of each vehicle."""
    count = len({name.rpartition("_")[2] for name in flight.state_names})
    uavs = scenario.get("uavs") or []
    given = [uav.get("number") if isinstance(uav, Mapping) else None for uav in uavs]
    given += [None] * (count - len(given))
    return [
        place if n is None else int(n) for place, n in enumerate(given[:count], first)
    ]


def _by_number(names: Sequence[str], count: int) -> dict[str, list[int]]:
    """Return the rows of each name that ends in the number of its vehicle."""
    found: dict[str, list[int]] = {}
    for row, name in enumerate(names):
        base, _, number = name.rpartition("_")
        if not (base and number.isdigit() and int(number) < count):
            base, number = name, "0"
        found.setdefault(base, [-1] * count)[int(number)] = row
    return found


def _one_after_another(
    names: Sequence[str], vehicles: int, rows: int
) -> dict[str, list[int]]:
    """Return the rows of each name where vehicles follow one another."""
    each = len(names)
    # More rows are no error: decided numbers and remembered values come last.
    if each * vehicles > rows:
        raise ValueError(f"{each * vehicles} rows expected, found {rows}")
    return {
        name: [vehicle * each + place for vehicle in range(vehicles)]
        for place, name in enumerate(names)
    }


def band_name(name: str, content: Mapping[str, Any]) -> tuple[str, str]:
    """Return the name of a state as a panel shows it, and its unit.

    Names of states of UAVs end in the number of the UAV, counted from 0; states of
    other kinds keep their names.

    Args:
        name: Name of the state, as in the bands of seeds.json.
        content: Content of seeds.json, of which "kind" and "vehicles", the names of the
            UAVs, are used; UAVs without names are numbered from 1 on.

    Example:
        >>> band_name("speed", {"kind": "problem"})
        ('speed', '')
    """
    base, _, place = name.rpartition("_")
    words = words_of(content.get("kind"))
    if not (words.numbered_rows and base and place.isdecimal()):
        return name, ""
    names = list(content.get("vehicles") or ())
    number = int(place)
    vehicle = f"{words.called} {number + words.first_number}"
    if number < len(names):
        vehicle = names[number]
    label, unit = label_of(base)
    return f"{vehicle}: {label}", unit


@dataclass(frozen=True, kw_only=True, slots=True)
class Disc:
    """A disc that vehicles keep out of, or within.

    Attributes:
        x: First coordinate of the centre.
        y: Second coordinate of the centre.
        radius: Radius of the disc, in the unit of the positions.
        name: Name of the disc; may be empty.
        is_limit: Whether vehicles must stay within the disc.
    """

    x: float
    y: float
    radius: float
    name: str = ""
    is_limit: bool = False

    def __post_init__(self) -> None:
        """Refuse an invalid centre or radius; raises ValueError."""
        # The sum is not finite if either is not.
        if not (math.isfinite(self.x + self.y) and 0 < self.radius < math.inf):
            raise ValueError(
                f"a disc with a centre and a radius expected, found ({self.x:g}, "
                f"{self.y:g}) and {self.radius:g}"
            )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Surroundings:
    """Things in the plane among which vehicles move.

    Attributes:
        discs: Obstacles and limits.
        targets: Wanted position of each vehicle at the frames, shape (targets, 2, F).
        called: Word for a target.
        leader: Position of the virtual leader at the frames, shape (2, F); None if
            there is none.
    """

    discs: Sequence[Disc] = ()
    targets: Array | None = None
    called: str = ""
    leader: Array | None = None


def surroundings_of(
    scenario: Mapping[str, Any], times: Array, positions: Array, headings: Array
) -> Surroundings:
    """Return the surroundings of the vehicles in a recorded run, from its kind.

    Args:
        scenario: Scenario as recorded.
        times: Times of the frames, shape (F,) [s].
        positions: Positions of the vehicles at the frames, shape (vehicles, 2, F).
        headings: Headings of the vehicles at the frames, shape (vehicles, F) [rad].
    """
    place = words_of(scenario.get("kind")).surroundings
    if not place:
        return Surroundings()
    # A kind names its function as text, so that a list of kinds need not import it.
    around: Surroundings = resolve_name(place)(scenario, times, positions, headings)
    return around


def points(given: Iterable[Mapping[str, Any]]) -> Array:
    """Return the places that mappings give as x_m and y_m, shape (n, 2) [m]."""
    return np.array([[float(one["x_m"]), float(one["y_m"])] for one in given])


def standing(places: Array, times: Array) -> Array:
    """Return places (n, 2) that do not move, at all times, shape (n, 2, F)."""
    return np.repeat(places[:, :, None], times.size, axis=2)


def _place_of(texts: Sequence[Any], states: Collection[str]) -> list[str]:
    """Return the one state that each coordinate of a distance names, or nothing."""
    found = []
    for text in texts:
        try:
            used = [name for name in parse(str(text)).names if name in states]
        except SwarmstartError:
            return []
        if len(used) != 1:  # A constant, or a difference of two vehicles' states.
            return []
        found.append(used[0])
    return found


def position_of(
    scenario: Mapping[str, Any], states: Collection[str], units: Mapping[str, str]
) -> tuple[str, str] | None:
    """Return the names of the states that are the position of a problem's vehicles.

    They are the states in the separation of the vehicles, or else the coordinates in a
    distance, or else states that are called x and y. None if there are no such states.

    Args:
        scenario: Scenario as recorded.
        states: Names of the states of one vehicle.
        units: Unit by name, if it is known.
    """
    separation = (scenario.get("vehicles") or {}).get("separation") or {}
    candidates = [separation.get("of") or []]
    candidates += [
        list(_place_of(part["distance"], states))
        for part in scenario.get("path") or []
        if isinstance(part, Mapping) and part.get("distance")
    ]
    candidates.append(["x", "y"])
    for found in candidates:
        if len(found) in {2, 3} and all(name in states for name in found[:2]):
            x, y = found[:2]  # A place in space is seen from above.
            # The plane is drawn to scale, which takes one unit.
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
            # The last step with a motion; before the first one, that one.
            kept = np.maximum.accumulate(np.where(moving, np.arange(moving.size), -1))
            kept[kept < 0] = int(np.argmax(moving))
            # The player interpolates: a jump by 2 pi would look like a turn.
            angle[:] = np.unwrap(angle[kept])
    return np.asarray(angles)


def discs_of_problem(
    scenario: Mapping[str, Any], axes: tuple[str, str]
) -> tuple[Disc, ...]:
    """Return the discs that belong to a problem's distances from fixed places.

    Args:
        scenario: Scenario as recorded.
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
            continue  # The radius is missing, or it is not constant.
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
        size = max(map(abs, values)) + 1  # The error is absolute near 0.
        slopes = (values[1] - values[0], values[0] - values[2])
        is_straight = abs(slopes[0] - slopes[1]) <= _STRAIGHT * size
        if not is_straight or abs(abs(slopes[0]) - 1) > _STRAIGHT * size:
            return None
        # slope (x - c) with a slope of 1 or -1 is -slope c at 0.
        place.append(-values[0] * np.sign(slopes[0]))
    return float(place[0]), float(place[1])


def _constants(scenario: Mapping[str, Any]) -> dict[str, float]:
    """Return the constants that are numbers, or made of those before them."""
    found: dict[str, float] = {}
    given = scenario.get("constants") or {}
    # Each round settles at least one constant, or is the last: any order is allowed.
    for _ in range(1 + len(given)):
        before = len(found)
        # A record is a user's file: it may be forged, and have any number of them.
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
