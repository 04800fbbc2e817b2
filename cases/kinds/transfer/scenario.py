"""The scenario of a transfer: UAVs that fly from starts to goals in a given time.

The chapter has no transfers. UAVs that change places across a circle (`swap_5`) are a
common test of collision avoidance.
"""

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
    PlantPart,
    Point,
    bank_flaws,
    near_place_flaws,
    speed_limit_flaws,
    start_speed_flaws,
)


class Vehicle(Part):
    """A UAV that accelerates and turns by banking, and its bounds.

    Attributes:
        acceleration_m_s2: Bounds [lower, upper] of the acceleration [m/s^2].
        bank_rad: Bounds [lower, upper] of the bank angle phi [rad].
        speed_m_s: Bounds [lower, upper] of the speed v [m/s].
        turn: Turn rate of a banked UAV: g sin(phi) / v as (5.30) prints it, or g
            tan(phi) / v, a coordinated turn.
    """

    acceleration_m_s2: Range
    bank_rad: Range
    speed_m_s: Range
    turn: Literal["sin", "tan"] = "tan"

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors of the bounds of bank and speed."""
        yield from bank_flaws(self.turn, self.bank_rad)
        yield from speed_limit_flaws(self.speed_m_s)


class Uav(Part):
    """One UAV: its start and its goal.

    Attributes:
        start: Speed, heading and position at the start.
        goal: Position at the end of the horizon.
    """

    start: PlanarState
    goal: Point


class Prediction(GridPart):
    """The time of the transfer and its grid.

    Attributes:
        intervals: Number of control intervals in the horizon.
        checks: Number of checks of the constraints in a control interval.
    """

    intervals: int = Field(ge=2, le=1000)
    checks: Checks = 2


class Paths(Part):
    """The family of paths in which the search looks.

    Attributes:
        lateral: Largest bump to the side, divided by the straight distance to the goal.
        along: Largest bump forwards or backwards, divided by the same distance.
    """

    lateral: Positive = 0.24
    along: Positive = 0.1


class TransferScenario(PlanningScenario):
    """Scenario of a transfer.

    Attributes:
        kind: Kind of the scenario, which decides its other keys.
        vehicle: Model of the UAVs and its bounds.
        uavs: UAVs with their starts and goals, 1 to 50.
        assignment: Assignment of goals: each UAV has its own, or the least sum of
            squared distances.
        safe_distance_m: Smallest allowed distance between two UAVs [m].
        along: Places at which distances are checked: the check points, or (in the
            search) also the straight segments between them.
        margin_m: Margin that plans keep from the safe distance [m].
        prediction: Time of the transfer and its grid.
        weights: Weights of the squared acceleration and of the squared bank angle, two
            numbers of at least 0.
        paths: Family of paths in which the search looks.
        path_tolerance_m: Largest excess of a constraint along the finely integrated
            path of a confirmed plan [m; m/s for speeds].
        repair: Option to solve a plan again with a margin, at most three times, if it
            breaks a constraint between checks.
        plant: Simulated aircraft.
    """

    kind: Literal["transfer"]
    vehicle: Vehicle
    uavs: list[Uav] = Field(min_length=1, max_length=50)
    assignment: Literal["given", "shortest"] = "given"
    safe_distance_m: Positive
    along: Literal["points", "segments"] = "points"
    margin_m: NonNegative = 0.0
    prediction: Prediction
    weights: Annotated[list[NonNegative], Field(min_length=2, max_length=2)]
    paths: Paths = Paths()
    path_tolerance_m: Positive = 5e-4
    repair: bool = True
    plant: PlantPart = PlantPart()

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors between parts of the scenario."""
        yield from super().flaws()
        if self.steps > self.prediction.intervals:
            yield (
                ("steps",),
                f"expected at most prediction.intervals = {self.prediction.intervals}, "
                f"found {self.steps}",
            )
        for path, message in self.vehicle.flaws():
            yield ("vehicle", *path), message
        for i, uav in enumerate(self.uavs):
            place = ("uavs", i, "start", "speed_m_s")
            speed, limits = uav.start.speed_m_s, self.vehicle.speed_m_s
            yield from start_speed_flaws(place, speed, limits)
        safe = self.safe_distance_m + self.margin_m
        numbers = range(1, len(self.uavs) + 1)
        yield from near_place_flaws(self.uavs, ("start", "goal"), safe, numbers)


def goal_flaws(
    scenario: TransferScenario, number: int, goal: tuple[float, float]
) -> Iterator[LocatedFlaw]:
    """Yield errors of a UAV's goal, its own or an assigned one.

    Args:
        scenario: The scenario.
        number: Number of the UAV, from 0.
        goal: Position at the end [m].
    """
    start, place = scenario.uavs[number].start, ("uavs", number, "goal")
    reach = scenario.vehicle.speed_m_s.upper * scenario.prediction.horizon_s
    way = math.hypot(goal[0] - start.x_m, goal[1] - start.y_m)
    if way < SAME_PLACE_M:
        yield place, "expected a goal away from the start"
    elif way > reach:
        yield (
            place,
            f"expected a goal within {reach:g} m of the start, as far as the highest "
            f"speed comes in prediction.horizon_s; found {way:g} m",
        )
