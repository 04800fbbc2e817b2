"""Statements of a certificate of a swarm's flight, and their reader.

Times are steps of a grid; a step has a fixed number of ticks, equal parts in each of
which vehicles exchange messages. A plan has samples, which are positions at successive
steps, and bulges, which are distances. Between two samples the distance of the vehicle
from a point that moves along the straight line between them (the chord) at constant
speed is at most the bulge there. After the last sample the vehicle stays for ever
within the last bulge of this sample. Positions are scaled such that the least distance
of two vehicles is the same in all directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarmstart.terminal_set.checker.file_content import (
    CertificateFileError,
    Entries,
    integer,
    mapping,
    one_of,
    optional,
    unusable,
)

Array = NDArray[np.float64]
VERSION = 1
MOST_VEHICLES, MOST_PLANS, MOST_STEPS = 1_000, 20_000, 100_000
MOST_OBSTACLES = 10_000  # Beside a thousand vehicles they need a part of a gigabyte.
MOST_TICKS = 100
OPEN = MOST_STEPS * MOST_TICKS + 1
_READ = Entries(largest=1e9, longest=200_000, longest_tape=1)
_KEYS = "format version sha256 vehicles steps ticks distance plans obstacles statements"
_PLAN = "vehicle first parting proposed ended committed accepted samples bulges"
STATEMENTS = (
    "each plan begins as the one that it replaces, until they part",
    "no two vehicles come nearer than the distance, at any time from the start on",
    "no vehicle comes nearer to an obstacle than its clearance",
    "each plan was accepted by all others before it was committed to, or they had "
    "committed to their last plan, and was clear then of what they had committed to "
    "and proposed",
)


@dataclass(frozen=True, kw_only=True, slots=True)
class Tube:
    """A path, and how far the vehicle may be away from it.

    Attributes:
        first: Step of the first sample.
        samples: Positions, shape (k, 3).
        bulges: Largest distance of the vehicle from the moving point on the straight
            line between two samples, for each pair of successive samples; the last
            entry is the largest distance from the last sample, after it; shape (k,).
    """

    first: int
    samples: Array
    bulges: Array

    @property
    def last(self) -> int:
        """Step of the last sample, near which the vehicle stays from then on."""
        return self.first + len(self.samples) - 1

    def at(self, steps: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return samples and bulges at steps not before the first one."""
        index = np.minimum(steps - self.first, len(self.samples) - 1)
        return self.samples[index], self.bulges[index]


@dataclass(frozen=True, kw_only=True, slots=True)
class Plan:
    """A plan of a vehicle.

    Attributes:
        vehicle: Number of the vehicle.
        tube: Path of the plan, and how far the vehicle may be away from it.
        parting: Last step at which the plan is equal to the one that it replaces.
        proposed: Tick at which the plan was proposed; -1 at the start.
        ended: Tick at which the plan was committed to or withdrawn; -1 at the start;
            OPEN if neither has happened.
        committed: Whether the plan was committed to.
        accepted: For each vehicle the tick at which it accepted the plan; None if it
            did not.
    """

    vehicle: int
    tube: Tube
    parting: int
    proposed: int
    ended: int
    committed: bool
    accepted: tuple[int | None, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Certificate:
    """The statements of a certificate.

    Attributes:
        vehicles: Number of vehicles.
        steps: Number of steps of the flight.
        ticks: Number of ticks in a step.
        distance: Least distance of two vehicles.
        plans: All plans that were proposed, those of the start first.
        obstacles: (clearance, path) of each obstacle.
    """

    vehicles: int
    steps: int
    ticks: int
    distance: float
    plans: tuple[Plan, ...]
    obstacles: tuple[tuple[float, Tube], ...]


def certificate_of(content: dict[str, object]) -> Certificate:
    """Return the statements of a file of `SWARM_FLIGHT`, with its entries validated.

    Raises:
        CertificateFileError: If it is not a valid certificate.
    """
    mapping(content, "the file", _KEYS)
    integer(content["version"], "version", VERSION, VERSION)
    vehicles = integer(content["vehicles"], "vehicles", 1, MOST_VEHICLES)
    ticks = integer(content["ticks"], "ticks", 1, MOST_TICKS)
    _read_statements(content["statements"])
    plans = _READ.list_of(
        content["plans"], "plans", None, lambda one, at: _plan(one, at, vehicles)
    )
    if not vehicles <= len(plans) <= MOST_PLANS:
        raise unusable("plans", f"{vehicles} to {MOST_PLANS} plans", len(plans))
    obstacles = _READ.list_of(content["obstacles"], "obstacles", None, _obstacle)
    if len(obstacles) > MOST_OBSTACLES:
        raise unusable("obstacles", f"at most {MOST_OBSTACLES}", len(obstacles))
    for number, plan in enumerate(plans):
        is_start = number < vehicles
        if is_start != (plan.proposed < 0) or (is_start and plan.vehicle != number):
            raise CertificateFileError(
                f"plans[{number}]: expected the plans of the start first, one of each "
                "vehicle in their order"
            )
    return Certificate(
        vehicles=vehicles,
        steps=integer(content["steps"], "steps", 0, MOST_STEPS),
        ticks=ticks,
        distance=_READ.positive(content["distance"], "distance"),
        plans=plans,
        obstacles=obstacles,
    )


def _read_statements(value: object) -> None:
    stated = _READ.list_of(value, "statements", len(STATEMENTS), lambda one, _: one)
    for number, (one, words) in enumerate(zip(stated, STATEMENTS, strict=True)):
        at = f"statements[{number}]"
        entry = mapping(one, at, "statement grounds")
        one_of(entry["statement"], f"{at}.statement", (words,))
        one_of(entry["grounds"], f"{at}.grounds", ("proven",))


def _plan(value: object, where: str, vehicles: int) -> Plan:
    entry = mapping(value, where, _PLAN)

    def tick(name: str, least: int) -> int:
        return integer(entry[name], f"{where}.{name}", least, MOST_STEPS * MOST_TICKS)

    committed = entry["committed"]
    if not isinstance(committed, bool):
        raise unusable(f"{where}.committed", "true or false", committed)
    proposed = tick("proposed", -1)
    ended = OPEN if entry["ended"] is None else tick("ended", -1)
    if ended < proposed or (ended == OPEN and committed):
        raise unusable(f"{where}.ended", "a tick after the proposal", ended)
    if proposed < 0 and (ended != -1 or not committed):
        raise unusable(where, "a plan of the start that is committed to", value)
    return Plan(
        vehicle=integer(entry["vehicle"], f"{where}.vehicle", 0, vehicles - 1),
        tube=_tube(entry, where),
        parting=tick("parting", 0),
        proposed=proposed,
        ended=ended,
        committed=committed,
        accepted=_READ.list_of(
            entry["accepted"],
            f"{where}.accepted",
            vehicles,
            lambda one, at: optional(
                one, at, lambda t, a: integer(t, a, 0, MOST_STEPS * MOST_TICKS)
            ),
        ),
    )


def _obstacle(value: object, where: str) -> tuple[float, Tube]:
    entry = mapping(value, where, "clearance first samples bulges")
    clearance = _READ.positive(entry["clearance"], f"{where}.clearance")
    return clearance, _tube(entry, where)


def _tube(entry: dict[str, Any], where: str) -> Tube:
    samples = _READ.matrix(entry["samples"], f"{where}.samples", None, 3)
    bulges = _READ.list_of(
        entry["bulges"], f"{where}.bulges", len(samples), _READ.at_least_zero
    )
    if not samples:
        raise unusable(f"{where}.samples", "at least one", samples)
    return Tube(
        first=integer(entry["first"], f"{where}.first", 0, MOST_STEPS),
        samples=np.array(samples),
        bulges=np.array(bulges),
    )
