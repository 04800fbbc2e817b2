"""The scenario of a reconfiguration: UAVs leave one formation for another.

Source: the chapter, section 5.4.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from swarmstart.cases.format.parts import (
    Checks,
    GridPart,
    NonNegative,
    Part,
    Positive,
    Range,
)
from swarmstart.cases.format.settings import LocatedFlaw, PlanningScenario
from swarmstart.cases.kinds.planar import (
    SAME_PLACE_M,
    PlanarState,
    Point,
    bank_flaws,
    distance,
    speed_limit_flaws,
    start_speed_flaws,
)

MOST_JOINT = 40
"""Largest number of UAVs for one problem of all pairs, which takes minutes to build."""


class Vehicle(Part):
    """The model of the UAVs, (5.30) of the chapter, and its bounds.

    Attributes:
        thrust_n: Bounds [lower, upper] of the thrust T [N].
        bank_rad: Bounds [lower, upper] of the bank angle phi [rad].
        drag_n: Drag D of the UAV [N].
        weight_n: Weight W of the UAV [N].
        thrust_equation: Acceleration by thrust: (T - D) / W as printed, or g (T - D) /
            W as Newton's law says.
        turn: Turn rate of a banked UAV: g sin(phi) / v as (5.30) prints it, or g
            tan(phi) / v, a coordinated turn.
        speed_m_s: Bounds [lower, upper] of the speed v [m/s], the lower one above 0;
            null means no bounds.
    """

    thrust_n: Range
    bank_rad: Range
    drag_n: NonNegative
    weight_n: Positive
    thrust_equation: Literal["printed", "newton"]
    turn: Literal["sin", "tan"] = "sin"
    speed_m_s: Range | None = None

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors of the bounds of bank and speed."""
        yield from bank_flaws(self.turn, self.bank_rad)
        if self.speed_m_s is not None:
            yield from speed_limit_flaws(self.speed_m_s)


class Distances(Part):
    """Distances that every two UAVs keep, (5.33) and (5.34) of the chapter.

    Attributes:
        safe_m: Smallest allowed distance between two UAVs [m].
        communication_m: Largest allowed distance between two UAVs [m].
        along: Places at which distances are checked: the check points, or also the
            straight segments between them.
        margin_m: Margin that plans keep from both limits [m].
    """

    safe_m: Positive
    communication_m: Positive
    along: Literal["points", "segments"] = "points"
    margin_m: NonNegative = 0.0

    @property
    def kept_m(self) -> tuple[float, float]:
        """Return the limits that plans keep, with the margin on both sides."""
        return self.safe_m + self.margin_m, self.communication_m - self.margin_m

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors of the limits."""
        near, far = self.kept_m
        if near >= far:
            yield (
                ("communication_m",),
                f"expected more than safe_m = {self.safe_m:g}, and the margin twice; "
                f"found {self.communication_m:g}",
            )


class Prediction(GridPart):
    """The horizon of a plan and its grid.

    Attributes:
        checks: Number of checks of the constraints in a control interval.
    """

    checks: Checks = 10


class Planning(Part):
    """Order of planning: all controls at once, or UAV after UAV, the leader first.

    Attributes:
        name: Method of planning: joint decides all controls at once for up to 40 UAVs,
            priority plans for one UAV after another.
        range_m: Distance beyond which the plans of other UAVs are not considered [m];
            required with priority, else null.
        links: Number of neighbours with which each UAV keeps the communication
            distance, used with priority.
    """

    name: Literal["joint", "priority"]
    range_m: Positive | None = None
    links: int = Field(default=1, ge=1, le=8)

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield an error if `range_m` is missing with priority."""
        if self.name == "priority" and self.range_m is None:
            yield (), "expected the key range_m with priority"


class PlantPart(Part):
    """The simulated aircraft: integrated finer than the prediction.

    Attributes:
        substeps: Number of Runge-Kutta steps of the simulated aircraft in a control
            interval.
    """

    substeps: int = Field(default=10, ge=1, le=1000)


class ReconfigurationScenario(PlanningScenario):
    """Scenario of a reconfiguration.

    Attributes:
        kind: Kind of the scenario, which decides its other keys.
        vehicle: Model of the UAVs and its bounds.
        uavs: Starts of the UAVs, 2 to 200.
        leader_uav: Number of the leader, from 1.
        leader: Motion of the leader: free means that its controls are decided too,
            straight that it keeps speed and heading.
        slots: Slots relative to the leader, one for each UAV, that of the leader at (0,
            0) [m].
        frame: Axes of the slots: fixed ones, or axes that turn with the leader's
            heading.
        assignment: Assignment of slots: UAV k to slot k, or the least sum of squared
            distances.
        distances: Distances that every two UAVs keep.
        prediction: Horizon of a plan and its grid.
        weights: Weights of the squared errors of v, psi, x and y, four numbers of at
            least 0.
        planning: Order of planning.
        reference: Solver that computes the lowest cost from every state, with which the
            measure gap_per_horizon compares the plans: ipopt, or none.
        plant: Simulated aircraft.
    """

    kind: Literal["reconfiguration"]
    vehicle: Vehicle
    uavs: list[PlanarState] = Field(min_length=2, max_length=200)
    leader_uav: int = Field(ge=1)
    leader: Literal["free", "straight"] = "free"
    slots: list[Point] = Field(min_length=2)
    frame: Literal["global", "leader"] = "global"
    assignment: Literal["given", "shortest"] = "given"
    distances: Distances
    prediction: Prediction
    weights: Annotated[list[NonNegative], Field(min_length=4, max_length=4)]
    planning: Planning = Planning(name="joint")
    reference: Literal["none", "ipopt"] = "none"
    plant: PlantPart = PlantPart()

    @property
    def leader_index(self) -> int:
        """The leader's number from 0."""
        return self.leader_uav - 1

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors between parts of the scenario."""
        yield from super().flaws()
        for key in ("vehicle", "distances", "planning"):
            for path, message in getattr(self, key).flaws():
                yield (key, *path), message
        if not any(self.weights):
            yield ("weights",), "expected a weight above 0, found zeros only"
        many = len(self.uavs) > MOST_JOINT
        if self.planning.name == "joint" and many:
            yield (
                ("planning", "name"),
                f"expected priority with more than {MOST_JOINT} UAVs, found joint with "
                f"{len(self.uavs)}",
            )
        elif not any(self.distances.flaws()):  # Else no slots can keep them.
            yield from self._slot_flaws()
        yield from self._speed_flaws()
        yield from self._leader_flaws()
        yield from self._range_flaws()

    def _slot_flaws(self) -> Iterator[LocatedFlaw]:
        slots, uavs = len(self.slots), len(self.uavs)
        if slots != uavs:
            word = "more" if slots > uavs else "fewer"
            yield (
                ("slots",),
                f"expected a slot for each of the {uavs} UAVs, found {slots}: {word} "
                "slots than UAVs",
            )
        near, far = self.distances.kept_m
        if self.planning.name == "priority":
            far = math.inf  # Only linked UAVs stay within it; see pose.flaws.
        for i, j in itertools.combinations(range(slots), 2):
            apart = distance(self.slots[i], self.slots[j])
            if apart < SAME_PLACE_M:
                what = "expected a place of its own"
                yield (("slots", j), f"{what}, found that of slot {i + 1}")
            else:
                for what in _out_of_range(apart, near=near, far=far):
                    yield ("slots", j), f"expected {what.format(f'slot {i + 1}')}"

    def _speed_flaws(self) -> Iterator[LocatedFlaw]:
        limits = self.vehicle.speed_m_s
        for i, uav in enumerate(self.uavs):
            place, speed = ("uavs", i, "speed_m_s"), uav.speed_m_s
            if speed <= 0:
                yield (
                    place,
                    "expected a speed above 0, since the heading rate divides by it; "
                    f"found {speed:g}",
                )
            elif limits is not None:
                yield from start_speed_flaws(place, speed, limits)

    def _leader_flaws(self) -> Iterator[LocatedFlaw]:
        if self.leader_uav > len(self.uavs):
            yield (
                ("leader_uav",),
                f"expected a UAV from 1 to {len(self.uavs)}, found {self.leader_uav}",
            )
            return
        yield from self._own_slot_flaws()
        for key, trim in (("thrust_n", self.vehicle.drag_n), ("bank_rad", 0.0)):
            limits: Range = getattr(self.vehicle, key)
            # Only a leader that flies straight needs these controls.
            if self.leader == "straight" and not limits.lower <= trim <= limits.upper:
                yield (
                    ("vehicle", key),
                    f"expected a range that includes {trim:g}, with which the leader "
                    f"flies straight; found [{limits.lower:g}, {limits.upper:g}]",
                )

    def _own_slot_flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors of the leader's slot: slots are relative to it."""
        expected = "expected the leader's own slot at (0, 0)"
        if self.assignment == "shortest":
            if all(math.hypot(s.x_m, s.y_m) > SAME_PLACE_M for s in self.slots):
                yield ("slots",), f"{expected}, found none there"
        elif self.leader_uav <= len(self.slots):
            slot = self.slots[self.leader_index]
            if math.hypot(slot.x_m, slot.y_m) > SAME_PLACE_M:
                yield (
                    ("slots", self.leader_index),
                    f"{expected}, found ({slot.x_m:g}, {slot.y_m:g})",
                )

    def _range_flaws(self) -> Iterator[LocatedFlaw]:
        if self.planning.name != "priority":
            return
        if self.leader != "straight":
            yield (
                ("leader",),
                "expected straight with planning priority: a leader that plans alone "
                "has no cost of its own; found free",
            )
        if self.reference != "none":
            yield (
                ("reference",),
                f"expected none with planning priority, found {self.reference}",
            )
        limits, seen = self.vehicle.speed_m_s, self.planning.range_m
        if limits is None:
            yield (
                ("vehicle",),
                "expected the key speed_m_s with planning priority, since the range "
                "that must be seen follows from it",
            )
        elif seen is not None:
            # Head on, both at the highest speed.
            closing = 2 * limits.upper * self.prediction.dt
            needed = self.distances.safe_m + closing
            if seen < needed:
                yield (
                    ("planning", "range_m"),
                    f"expected at least {needed:g} m: distances.safe_m, and what two "
                    f"UAVs can close in a control step; found {seen:g}",
                )


def start_flaws(
    scenario: ReconfigurationScenario, pair: tuple[int, int], *, linked: bool
) -> Iterator[LocatedFlaw]:
    """Yield errors of the distance of two starts.

    Args:
        scenario: The scenario.
        pair: Numbers of the two UAVs from 0.
        linked: Whether they keep the communication distance.
    """
    i, j = pair
    near, far = scenario.distances.kept_m
    apart = distance(scenario.uavs[i], scenario.uavs[j])
    for what in _out_of_range(apart, near=near, far=far if linked else math.inf):
        yield ("uavs", j), f"expected a start {what.format(f'that of UAV {i + 1}')}"


def _out_of_range(apart: float, *, near: float, far: float) -> Iterator[str]:
    """Yield the expectation for a distance that is out of its limits."""
    if apart < near:
        yield f"at least {near:g} m (distances.safe_m) from {{}}, found {apart:g} m"
    elif apart > far:
        limit = f"{far:g} m (distances.communication_m)"
        yield f"at most {limit} from {{}}, found {apart:g} m"
