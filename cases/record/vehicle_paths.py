"""Paths of the vehicles in a record."""

import re
from collections.abc import Sequence

import numpy as np

from swarmstart.cases.format.document import shown
from swarmstart.cases.record.files import RecordError
from swarmstart.cases.record.results import Record
from swarmstart.export import AXES, VehiclePath

NAME = re.compile(r"[A-Za-z0-9_-]{1,80}")
"""Allowed names of vehicles; they come from a file that a stranger may have written."""
USUAL = (("x_m", "y_m", "z_m"), ("x_m", "y_m"), ("x", "y", "z"), ("x", "y"))
"""Names of coordinates that are looked for, if none are given."""


def paths_of(
    record: Record, names: Sequence[str] = (), *, height: float = 0.0
) -> list[VehiclePath]:
    """Return the paths of all vehicles along the simulated path.

    Args:
        record: The record of a run, or a saved result.
        names: Names of two or three states that are coordinates, without the end that
            names a vehicle; empty means x_m, y_m and z_m, or x, y and z.
        height: Third coordinate if only two are named [m].

    Raises:
        RecordError: If no vehicle has states with these names, if the name of a vehicle
            cannot be that of a file, or if the shape of the recorded states does not
            fit their names and times.
        ExportError: If a coordinate is not finite, or times do not rise.
    """
    states = [str(name) for name in record.arrays.get("state_names", ())]
    for wanted in (tuple(names),) if names else USUAL:
        vehicles = _vehicles(states, wanted)
        if vehicles:
            break
    else:
        looked = " or ".join(", ".join(one) for one in ([names] if names else USUAL))
        raise RecordError(
            f"{record.folder}: expected states {looked} of a vehicle, with or without "
            f"its name at the end; found {', '.join(states) or 'none'}"
        )
    times, path = (
        np.asarray(record.arrays.get(name, ()), dtype=np.float64)
        for name in ("dense_times", "dense_states")
    )
    if times.ndim != 1 or path.shape != (len(states), times.size):
        raise RecordError(
            f"{record.folder}: expected a state for each of {len(states)} names and "
            f"{times.size} times, found the shape {path.shape}"
        )
    # A jump has two states at its time; other times that do not rise are refused.
    kept = np.append(np.diff(times) != 0, True)
    found = []
    for name, rows in vehicles.items():
        if not NAME.fullmatch(name):
            raise RecordError(
                f"{record.folder}: expected names of vehicles of letters, digits, _ "
                f"and -, found {shown(name)}"
            )
        places = np.full((AXES, times.size), height)
        places[: len(rows)] = path[rows]
        found.append(VehiclePath(name, times[kept], places.T[kept]))
    return found


def _vehicles(states: Sequence[str], names: Sequence[str]) -> dict[str, list[int]]:
    """Return the rows of the coordinates of each vehicle that has all of them."""
    found = {}
    for state in states:
        end = state.removeprefix(names[0])
        if end == state or not (end == "" or end.startswith("_")):
            continue
        rows = [states.index(n + end) for n in names if n + end in states]
        if len(rows) == len(names):
            found[end.removeprefix("_") or "flight"] = rows
    return found
