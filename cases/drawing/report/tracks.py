"""A recorded run as tracks in the plane and lines over time, for the player.

Which states are positions is read from the record: UAVs of the planar kinds have (v,
psi, x, y); in a close formation x and y say how far the leader is ahead of its wingman
and to its right; in a problem positions are the states that its `separation` or its
distances name, else `x` and `y`. For a record without positions only lines over time
are drawn.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.drawing.report.outlook import Outlook, outlook_of
from swarmstart.cases.drawing.vehicles import (
    Surroundings,
    VehicleRows,
    directions_of,
    discs_of_problem,
    position_of,
    rows_of,
    surroundings_of,
)
from swarmstart.cases.drawing.wording import label_of
from swarmstart.cases.format.registry import KindWords, words_of
from swarmstart.cases.record.files import RecordError
from swarmstart.cases.record.results import Record
from swarmstart.cases.record.trajectory_arrays import held_controls
from swarmstart.ocp import Decision, Source, Trajectory

MOST_FRAMES = 600
MOST_COORDINATES = 90_000
"""Number of coordinates of all vehicles and frames; many vehicles have fewer frames."""
MOST_NAMED = 10
"""Largest number of vehicles whose states and controls are drawn over time."""
MOST_SERIES = 24
_FEWEST_TIMES = 2
_HEADINGS = ("heading", "psi", "theta", "yaw", "course")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Plane:
    """Vehicles that move in the plane.

    Attributes:
        unit: Unit of the positions.
        positions: Position of each vehicle at the frames, shape (vehicles, 2, F).
        headings: Heading of each vehicle at the frames, shape (vehicles, F) [rad].
        surroundings: Discs, targets and leader around the vehicles.
        plans: For each instant at which plans were made: its time [s], and for each
            vehicle the planned path, shape (2, n), or None if it did not plan then.
        words: A sentence on the axes if they are not those of the ground.
    """

    unit: str
    positions: Array
    headings: Array
    surroundings: Surroundings
    plans: Sequence[tuple[float, Sequence[Array | None]]] = ()
    words: str = ""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Series:
    """One quantity of all vehicles over time.

    Attributes:
        name: Name of the quantity in words.
        unit: Unit of the quantity; may be empty.
        times: Instants, shape (n,) [s], or (n + 1,) if values are held from each to the
            next.
        values: Values of each vehicle, shape (vehicles, n).
        lower: Lower bound for all vehicles; -inf for no bound.
        upper: Upper bound for all vehicles; inf for no bound.
    """

    name: str
    unit: str
    times: Array
    values: Array
    lower: float = -np.inf
    upper: float = np.inf

    @property
    def is_held(self) -> bool:
        """Return whether values are held from each time to the next."""
        return bool(self.times.size == self.values.shape[1] + 1)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Tracks:
    """The parts of a run that are drawn.

    Attributes:
        title: Title of the scenario.
        times: Times of the frames, evenly spaced, shape (F,) [s].
        vehicles: Name of each vehicle; one empty name if the problem has no vehicles.
        plane: The positions; None if the problem has none.
        series: States and controls over time.
        step_times: Control instants, shape (T + 1,) [s].
        step_seconds: Wall time of each decision, shape (T,) [s].
        without_plan: Whether a vehicle planned at a step and found no feasible plan,
            shape (T,).
        linear_breaks: Whether at a step the further path of a vehicle under the linear
            law breaks a constraint, shape (T,).
        is_one_plan: Whether one plan is carried out to its end.
        notes: Sentences on what is not drawn.
    """

    title: str
    times: Array
    vehicles: tuple[str, ...]
    plane: Plane | None
    series: tuple[Series, ...]
    step_times: Array
    step_seconds: Array
    without_plan: NDArray[np.bool_]
    linear_breaks: NDArray[np.bool_] = field(
        default_factory=lambda: np.zeros(0, dtype=bool)
    )
    is_one_plan: bool = False
    notes: tuple[str, ...] = ()


def tracks_of(record: Record) -> Tracks:
    """Return the parts of a record of `swarmstart run` that the player shows.

    Raises:
        RecordError: If the record has no flight, or parts of it do not fit together.
    """
    flight, scenario = record.trajectory, record.scenario
    if flight is None or scenario is None:
        raise RecordError(
            f"{record.folder}: expected the record of a run with a flight, found "
            f"{'no flight' if flight is None else 'no scenario.yaml'}"
        )
    try:
        return _tracks(record, _checked(flight), scenario)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise RecordError(
            f"{record.folder}: expected a flight and a scenario that fit together, "
            f"found: {type(error).__name__}: {error}"
        ) from error


def _tracks(record: Record, flight: Trajectory, scenario: Mapping[str, Any]) -> Tracks:
    rows = rows_of(flight, scenario)
    outlook = outlook_of(record, flight)
    notes = list(outlook.notes)
    count = len(rows.vehicles)
    # 3: x, y and heading of each vehicle.
    frames = max(2, min(MOST_FRAMES, MOST_COORDINATES // (3 * count)))
    end = float(flight.dense_times[-1])
    times = np.linspace(0.0, end, min(frames, max(flight.dense_times.size, 2)))
    plane = _plane(flight, scenario, rows, times, outlook)
    series: list[Series] = []
    if count <= MOST_NAMED:
        series = _series(flight, rows, outlook, plane)
        if len(series) > MOST_SERIES:
            notes.append(
                f"The first {MOST_SERIES} of {len(series)} states and controls are "
                "drawn over time."
            )
    else:
        notes.append(
            f"States and controls over time are drawn of at most {MOST_NAMED} "
            f"vehicles; there are {count}."
        )
    if not np.isfinite(flight.dense_states).all():
        notes.append("The flight leaves the finite numbers; what follows is not drawn.")
    decisions = flight.decisions
    return Tracks(
        title=str(scenario.get("title") or scenario.get("name", "")),
        times=times,
        vehicles=rows.vehicles,
        plane=plane,
        series=tuple(series[:MOST_SERIES]),
        step_times=flight.times,
        step_seconds=flight.step_seconds,
        without_plan=np.array([_is_without(d) for d in decisions], dtype=bool),
        linear_breaks=np.array([_linear_breaks(d) for d in decisions], dtype=bool),
        is_one_plan=len(decisions) > 1
        and bool(decisions[0].plans)
        and all(d.plans == decisions[0].plans for d in decisions),
        notes=tuple(notes),
    )


def _checked(flight: Trajectory) -> Trajectory:
    """Return a flight whose states are finite, or NaN.

    Raises:
        ValueError: If times do not increase, or arrays are of other shapes or types.
    """
    states, steps = flight.dense_states, flight.controls.shape[1]
    for name, times, count in (
        ("times", flight.times, steps + 1),
        ("dense_times", flight.dense_times, states.shape[1]),
    ):
        if times.shape != (count,) or count < _FEWEST_TIMES:
            raise ValueError(f"{name}: {count} times expected, shape {times.shape}")
        if not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
            raise ValueError(f"{name}: increasing times expected")
    for name, values in (
        ("dense_states", states),
        ("controls", flight.controls),
        ("step_seconds", flight.step_seconds),
    ):
        if values.dtype.kind not in "fi":
            raise ValueError(f"{name}: real numbers expected, found {values.dtype}")
    return replace(flight, dense_states=np.where(np.isfinite(states), states, np.nan))


def _is_without(decision: Decision) -> bool:
    """Return whether a vehicle planned and found no feasible plan."""
    planned = [p for p in decision.plans if p.source is not Source.LINEAR]
    return any(p.source is Source.SHIFTED or not p.feasible for p in planned)


def _linear_breaks(decision: Decision) -> bool:
    linear = [p for p in decision.plans if p.source is Source.LINEAR]
    return not all(p.feasible for p in linear)


def _plane(
    flight: Trajectory,
    scenario: Mapping[str, Any],
    rows: VehicleRows,
    times: Array,
    outlook: Outlook,
) -> Plane | None:
    """Return the vehicles in the plane; None if no states are positions."""
    axes = _axes_of(scenario, rows)
    if axes is None:
        return None
    words = words_of(scenario.get("kind"))
    x, y = (_at(flight, rows.states[name], times) for name in axes)
    named = next((name for name in rows.states if _is_heading(name)), None)
    turned = None if named is None else _at(flight, rows.states[named], times)
    paths = [
        (time, [_path(path, rows, axes, words) for path in each])
        for time, each in outlook.paths
    ]
    if words.relative:  # The leader is x ahead and y to the right of its wingman.
        positions = np.stack([-y, -x], axis=1)
        turned = np.full_like(x, np.pi / 2)
        told = "Seen from above; the leader is at (0, 0) and heads up the page."
        return Plane(
            unit="ft", positions=positions, headings=turned, plans=paths, words=told,
            surroundings=surroundings_of(scenario, times, positions, turned),
        )  # fmt: skip
    positions = np.stack([x, y], axis=1)
    if turned is None:
        turned = directions_of(positions)
    around = (
        surroundings_of(scenario, times, positions, turned)
        if words.numbered_rows
        else Surroundings(discs=discs_of_problem(scenario, axes))
    )
    unit = "m" if words.numbered_rows else rows.units.get(axes[0], "")
    return Plane(
        unit=unit, positions=positions, headings=turned, surroundings=around,
        plans=paths,
    )  # fmt: skip


def _axes_of(scenario: Mapping[str, Any], rows: VehicleRows) -> tuple[str, str] | None:
    """Return the names of the states that are the position of a vehicle."""
    words, names = words_of(scenario.get("kind")), rows.states
    if words.numbered_rows:
        return ("x_m", "y_m") if {"x_m", "y_m"} <= names.keys() else None
    if words.relative:
        return ("x_ft", "y_ft") if {"x_ft", "y_ft"} <= names.keys() else None
    return position_of(scenario, names, rows.units)


def _is_heading(name: str) -> bool:
    return name.casefold().removesuffix("_rad") in _HEADINGS


def _at(flight: Trajectory, rows: Sequence[int], times: Array) -> Array:
    """Return rows of the states at some times, shape (rows, n)."""
    return np.stack(
        [np.interp(times, flight.dense_times, flight.dense_states[r]) for r in rows]
    )


def _path(
    path: Array | None, rows: VehicleRows, axes: tuple[str, str], words: KindWords
) -> Array | None:
    """Return the places of a vehicle's path from its own states (nx, n)."""
    if path is None:
        return None
    place = list(rows.states)
    x, y = (path[place.index(name)] for name in axes)
    return np.stack([-y, -x] if words.relative else [x, y])


def _series(
    flight: Trajectory, rows: VehicleRows, outlook: Outlook, plane: Plane | None
) -> list[Series]:
    """Return controls and states over time; positions in the plane are left out."""
    found = []
    held_times, held = held_controls(flight)
    for name, own in rows.controls.items():
        found.append(_one(name, own, rows, held_times, held, outlook.controls))
    for name, own in rows.states.items():
        if plane is not None and re.fullmatch(r"[xy](_m|_ft)?", name):
            # The wingman's place, relative to its leader, is what is controlled.
            if rows.vehicles != ("wingman",):
                continue
        times, values = flight.dense_times, flight.dense_states
        found.append(_one(name, own, rows, times, values, outlook.states))
    return found


def _one(
    name: str,
    own: Sequence[int],
    rows: VehicleRows,
    times: Array,
    values: Array,
    limits: tuple[Array, Array] | None,
) -> Series:
    """Return one quantity of all vehicles."""
    known = [row for row in own if row >= 0]
    lower, upper = -np.inf, np.inf
    if limits is not None and known and max(known) < limits[0].size:
        lower, upper = (float(side[known[0]]) for side in limits)
        if any((side[known] != side[known[0]]).any() for side in limits):
            lower, upper = -np.inf, np.inf  # Vehicles have bounds of their own.
    label, unit = label_of(name, rows.units.get(name))
    picked = np.stack(
        [values[row] if row >= 0 else np.full(values.shape[1], np.nan) for row in own]
    )
    return Series(
        name=label, unit=unit, times=times, values=picked, lower=lower, upper=upper
    )
