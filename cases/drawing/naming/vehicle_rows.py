"""Rows of a flight's states and controls that belong to each vehicle."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from swarmstart.cases.format.registry import words_of
from swarmstart.ocp import Trajectory

_PLANAR_STATES = ("speed_m_s", "heading_rad", "x_m", "y_m")


@dataclass(frozen=True, kw_only=True, slots=True)
class VehicleRows:
    """Names of the states and the controls of one vehicle, and their rows.

    Attributes:
        vehicles: Name of each vehicle.
        states: Names of the states of one vehicle, and the row of each of all vehicles.
        controls: The same of the controls; a vehicle without it has row -1.
        units: By name.
    """

    vehicles: tuple[str, ...]
    states: dict[str, list[int]]
    controls: dict[str, list[int]]
    units: dict[str, str] = field(default_factory=dict)


def rows_of(flight: Trajectory, scenario: Mapping[str, Any]) -> VehicleRows:
    """Return which rows belong to which vehicle.

    Args:
        flight: The flight.
        scenario: As recorded.

    Raises:
        ValueError: If the flight has fewer rows.
    """
    words = words_of(scenario.get("kind"))
    if words.numbered_rows:
        numbers = _numbers(scenario, flight)
        states = _by_number(flight.state_names, len(numbers))
        controls = _by_number(flight.control_names, len(numbers))
        return VehicleRows(
            vehicles=tuple(f"UAV {number}" for number in numbers),
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


def _numbers(scenario: Mapping[str, Any], flight: Trajectory) -> list[int]:
    """Return the number of each UAV."""
    count = len(flight.states) // len(_PLANAR_STATES)
    uavs = scenario.get("uavs") or []
    given = [uav.get("number") if isinstance(uav, Mapping) else None for uav in uavs]
    given += [None] * (count - len(given))
    return [place if n is None else int(n) for place, n in enumerate(given[:count], 1)]


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
    if each * vehicles > rows:
        raise ValueError(f"{each * vehicles} rows expected, found {rows}")
    return {
        name: [vehicle * each + place for vehicle in range(vehicles)]
        for place, name in enumerate(names)
    }
