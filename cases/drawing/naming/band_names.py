"""Names of the states in bands over seeds: UAV, quantity and unit."""

from collections.abc import Mapping
from typing import Any

from swarmstart.cases.drawing.naming.units import label_of
from swarmstart.cases.format.registry import words_of


def band_name(name: str, content: Mapping[str, Any]) -> tuple[str, str]:
    """Return the name of a state as a panel shows it, and its unit.

    States of UAVs end in the UAV's place, counted from 0; states of other kinds keep
    their names.

    Args:
        name: Of the state, as in the bands of seeds.json.
        content: Of seeds.json: its "kind", and the names of the UAVs as "vehicles";
            UAVs without names are numbered from 1 on.

    Example:
        >>> band_name("speed", {"kind": "problem"})
        ('speed', '')
    """
    base, _, place = name.rpartition("_")
    is_numbered = words_of(content.get("kind")).numbered_rows
    if not (is_numbered and base and place.isdecimal()):
        return name, ""
    names = list(content.get("vehicles") or ())
    number = int(place)
    vehicle = names[number] if number < len(names) else f"UAV {number + 1}"
    label, unit = label_of(base)
    return f"{vehicle}: {label}", unit
