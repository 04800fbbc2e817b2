"""The scenario of a formation flight: UAVs that follow slots of a virtual leader.

Source: the chapter, section 5.2.
"""

import itertools
from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from swarmstart.cases.format.parts import (
    Checks,
    GridPart,
    NonNegative,
    Number,
    Part,
    Positive,
    Range,
)
from swarmstart.cases.format.settings import (
    IntegratorName,
    LocatedFlaw,
    PlanningScenario,
)
from swarmstart.cases.kinds.planar import (
    PlanarState,
    PlantPart,
    Point,
    distance,
    near_place_flaws,
    start_speed_flaws,
)


class Disc(Point):
    """A circular obstacle that does not move.

    Attributes:
        radius_m: Radius of the obstacle [m].
    """

    radius_m: Positive


class Vehicle(Part):
    """The model of the UAVs and its bounds.

    Attributes:
        name: Name of the model; unicycle is v' = u, psi' = omega, x' = v cos psi, y' =
            v sin psi.
        acceleration_m_s2: Bounds [lower, upper] of the acceleration u [m/s^2], with 0
            inside.
        turn_rate_rad_s: Bounds [lower, upper] of the turn rate omega [rad/s], with 0
            inside.
        speed_m_s: Bounds [lower, upper] of the speed v [m/s], kept at every check of a
            plan; null means no bounds.
    """

    name: Literal["unicycle"]
    acceleration_m_s2: Range
    turn_rate_rad_s: Range
    speed_m_s: Range | None = None


Controls = Annotated[list[Number], Field(min_length=2, max_length=2)]
"""An acceleration [m/s^2] and a turn rate [rad/s]."""


class Uav(Part):
    """One UAV: its start, and its slot relative to the leader.

    Attributes:
        number: Number of the UAV in figures, messages and `planning_order`; null means
            its place in the list, from 1.
        start: Speed, heading and position at the start.
        slot: Position of the slot relative to the leader, in axes that do not turn with
            it [m].
        plan: Given plan, [acceleration, turn rate] [m/s^2, rad/s] for each interval of
            the horizon; the UAV then flies it and does not plan, and null means that it
            plans.
    """

    number: int | None = Field(default=None, ge=1, le=9999)
    start: PlanarState
    slot: Point
    plan: list[Controls] | None = None


class Prediction(GridPart):
    """The horizon and its grid.

    Attributes:
        intervals: Number of control intervals in the horizon.
        checks: Number of checks of the constraints in a control interval.
        integrator: Integrator of the prediction: fourth-order Runge-Kutta, Euler, or
            one for stiff models.
    """

    intervals: int = Field(ge=1, le=1000)
    checks: Checks = 1
    integrator: IntegratorName = "rk4"


class Weights(Part):
    """Diagonals of the weights Q and R of the stage cost, (5.6) of the chapter.

    Attributes:
        Q: Weights of the squared error of v, psi, x and y, four numbers of at least 0.
        R: Weights of the squared controls u and omega, two numbers above 0.
    """

    Q: list[NonNegative] = Field(min_length=4, max_length=4)
    R: list[Positive] = Field(min_length=2, max_length=2)


Matrix = list[list[Number]]


class TerminalCost(Part):
    """Matrix P of the terminal cost, (5.7) of the chapter.

    Attributes:
        design: Origin of P: the Riccati equation of the sampled system with Q and R, or
            the key `P`.
        P: Symmetric, positive definite matrix of 4 x 4 numbers, required if `design` is
            `given`, else ignored.
    """

    design: Literal["riccati", "given"]
    P: Matrix | None = None

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield an error if `design` needs P, and P is missing or invalid."""
        yield from _matrix_flaws(self.design == "given", self.P)


class Avoidance(Part):
    """Rules that keep distances to other UAVs and to obstacles.

    They are (5.15) and (5.16) of the chapter.

    Attributes:
        safe_distance_m: Smallest allowed distance between two UAVs [m].
        along: Places at which distances are checked: the check points, or also the
            straight segments between them.
        measure: Measure of a violation: excess counts the metres that are missing,
            indicator counts 1 for each check that is too near.
        distance_margin_m: Margin added to the safe distance in the search [m].
        obstacle_margin_m: Margin added to the radius of an obstacle in the search [m].
        polish_distance_margin_m: Margin added to the safe distance in the polish, which
            checks points only [m].
        polish_obstacle_margin_m: Margin added to the radius of an obstacle in the
            polish, which checks points only [m].
    """

    safe_distance_m: Positive
    along: Literal["points", "segments"]
    measure: Literal["excess", "indicator"]
    distance_margin_m: NonNegative = 0.0
    obstacle_margin_m: NonNegative = 0.0
    polish_distance_margin_m: NonNegative = 0.0
    polish_obstacle_margin_m: NonNegative = 0.0


class DualModePart(Part):
    """The linear law that takes over when every UAV is inside its terminal set.

    Attributes:
        enabled: Switch of the linear law.
        design: Design of the gain and of P: sampled is for a control held over an
            interval, literal is as the chapter prints it.
        Q: Weights of the squared error of v, psi, x and y in this design, four numbers
            of at least 0.
        R: Weights of the squared controls in this design, two numbers above 0.
        P: Symmetric, positive definite matrix of 4 x 4 numbers, required if `design` is
            `literal`, else ignored.
        certify: Proof of the terminal set: true takes the largest level that is proven,
            and refuses a law for which no level is proven; false takes the level that
            the bounds give.
    """

    enabled: bool
    design: Literal["sampled", "literal"]
    Q: list[NonNegative] = Field(min_length=4, max_length=4)
    R: list[Positive] = Field(min_length=2, max_length=2)
    P: Matrix | None = None
    certify: bool = True

    @property
    def is_certified(self) -> bool:
        """Return whether the set is certified; with a literal design it never is."""
        return self.enabled and self.certify and self.design == "sampled"

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield an error if `design` needs P, and P is missing or invalid."""
        yield from _matrix_flaws(self.design == "literal", self.P)


class FormationScenario(PlanningScenario):
    """Scenario of a formation flight.

    Attributes:
        kind: Kind of the scenario, which decides its other keys.
        vehicle: Model of the UAVs and its bounds.
        leader: Speed, heading and position of the virtual leader at the start, which
            then keeps speed and heading.
        uavs: UAVs of the formation, 1 to 100.
        obstacles: Circular obstacles that do not move.
        planning_order: Order in which the UAVs plan: by their numbers, or a list of all
            numbers, the first planner first.
        last_plan: Starting point of searches and polishes: the last plan shifted by one
            interval with zero controls appended, or as it is.
        prediction: Horizon of a plan and its grid.
        weights: Weights of the stage cost.
        terminal_cost: Matrix of the terminal cost.
        avoidance: Distances to other UAVs and to obstacles.
        dual_mode: Linear law inside the terminal sets.
        plant: Simulated aircraft.
    """

    kind: Literal["formation_flight"]
    vehicle: Vehicle
    leader: PlanarState
    uavs: list[Uav] = Field(min_length=1, max_length=100)
    obstacles: list[Disc] = Field(default_factory=list)
    planning_order: Literal["highest_first", "lowest_first"] | list[int] = (
        "highest_first"
    )
    last_plan: Literal["shifted", "unshifted"] = "shifted"
    prediction: Prediction
    weights: Weights
    terminal_cost: TerminalCost
    avoidance: Avoidance
    dual_mode: DualModePart
    plant: PlantPart = PlantPart()

    @property
    def numbers(self) -> list[int]:
        """Return the number of each UAV."""
        return [
            place if uav.number is None else uav.number
            for place, uav in enumerate(self.uavs, start=1)
        ]

    @property
    def planning(self) -> list[int]:
        """Indices from 0 of the UAVs that plan: those without a given plan."""
        return [place for place, uav in enumerate(self.uavs) if uav.plan is None]

    def order_of_planning(self) -> list[int]:
        """Return the UAVs' indices from 0 in the order in which they plan."""
        numbers = self.numbers
        if isinstance(self.planning_order, list):
            return [numbers.index(number) for number in self.planning_order]
        places = sorted(range(len(numbers)), key=numbers.__getitem__)
        return places if self.planning_order == "lowest_first" else places[::-1]

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors between parts of the scenario."""
        yield from super().flaws()
        for key in ("terminal_cost", "dual_mode"):
            for path, message in getattr(self, key).flaws():
                yield (key, *path), message
        yield from self._order_flaws()
        yield from self._place_flaws()
        yield from self._control_flaws()
        yield from self._plan_flaws()
        if self.vehicle.speed_m_s is not None:
            yield from self._speed_flaws(self.vehicle.speed_m_s)

    def _order_flaws(self) -> Iterator[LocatedFlaw]:
        numbers = self.numbers
        for place, number in enumerate(numbers):
            if number in numbers[:place]:
                yield (
                    ("uavs", place),
                    f"expected a number of its own, found {number} again",
                )
        order = self.planning_order
        if isinstance(order, list) and sorted(order) != sorted(numbers):
            yield (
                ("planning_order",),
                f"expected the number of each of the {len(numbers)} UAVs once, "
                f"found {order}",
            )

    def _place_flaws(self) -> Iterator[LocatedFlaw]:
        safe = self.avoidance.safe_distance_m
        places = ("start", "slot")
        yield from near_place_flaws(self.uavs, places, safe, self.numbers)
        for (i, uav), disc in itertools.product(enumerate(self.uavs), self.obstacles):
            apart = distance(uav.start, disc)
            if apart < disc.radius_m:
                yield (
                    ("uavs", i, "start"),
                    f"expected a start outside the obstacle of radius "
                    f"{disc.radius_m:g} m, found {apart:g} m from its centre",
                )

    def _control_flaws(self) -> Iterator[LocatedFlaw]:
        for key in ("acceleration_m_s2", "turn_rate_rad_s"):
            limits: Range = getattr(self.vehicle, key)
            # Strictly: the terminal set needs room on both sides of its reference.
            if not limits.lower < 0 < limits.upper:
                yield (
                    ("vehicle", key),
                    "expected 0, the leader's own, strictly within the range; found "
                    f"[{limits.lower:g}, {limits.upper:g}]",
                )
        each = getattr(self.search, "velocity_max", None)
        # A search chooses the two controls of each interval.
        variables = 2 * self.prediction.intervals
        if isinstance(each, list) and len(each) != variables:
            yield (
                ("search", "velocity_max"),
                f"expected a number, or one for each of the {variables} controls of "
                f"a horizon; found {len(each)}",
            )

    def _plan_flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors of plans that are given."""
        given = {i: uav.plan for i, uav in enumerate(self.uavs) if uav.plan is not None}
        if given and self.steps != 1:
            first = self.numbers[min(given)]
            yield (
                ("steps",),
                f"expected 1, since the plan of UAV {first} is given, for the first "
                f"step only; found {self.steps}",
            )
        if len(given) == len(self.uavs):
            yield (
                ("uavs",),
                f"expected a UAV without the key 'plan', which plans; found a plan for "
                f"each of {len(given)}",
            )
        for i, plan in given.items():
            if len(plan) != self.prediction.intervals:
                yield (
                    ("uavs", i, "plan"),
                    f"expected controls for each of the {self.prediction.intervals} "
                    f"intervals of the horizon, found {len(plan)}",
                )
            for k, controls in enumerate(plan):
                yield from self._bound_flaws(("uavs", i, "plan", k), controls)

    def _bound_flaws(
        self, place: tuple[str | int, ...], controls: list[float]
    ) -> Iterator[LocatedFlaw]:
        """Yield the controls of one interval that are out of the vehicle's bounds."""
        keys = ("acceleration_m_s2", "turn_rate_rad_s")
        for row, (key, value) in enumerate(zip(keys, controls, strict=True)):
            limits: Range = getattr(self.vehicle, key)
            if not limits.lower <= value <= limits.upper:
                yield (
                    (*place, row),
                    f"expected a value within vehicle.{key} [{limits.lower:g}, "
                    f"{limits.upper:g}], found {value:g}",
                )

    def _speed_flaws(self, limits: Range) -> Iterator[LocatedFlaw]:
        # Strictly, for the same reason as in `_control_flaws`.
        if not limits.lower < self.leader.speed_m_s < limits.upper:
            yield (
                ("leader", "speed_m_s"),
                "expected a speed strictly within vehicle.speed_m_s "
                f"[{limits.lower:g}, {limits.upper:g}], "
                f"found {self.leader.speed_m_s:g}",
            )
        for i, uav in enumerate(self.uavs):
            place = ("uavs", i, "start", "speed_m_s")
            yield from start_speed_flaws(place, uav.start.speed_m_s, limits)


def _matrix_flaws(needed: bool, P: Matrix | None) -> Iterator[LocatedFlaw]:
    """Yield errors of a 4 x 4 matrix, if the design needs it."""
    if not needed:
        return
    if P is None:
        yield (), "expected the key P, a 4 x 4 matrix, with this design"
    elif [len(row) for row in P] != [4, 4, 4, 4]:
        yield ("P",), f"expected a 4 x 4 matrix, found rows of {[len(r) for r in P]}"
    elif not np.allclose(P, np.transpose(P)):
        yield ("P",), "expected a symmetric matrix"
    elif (smallest := np.linalg.eigvalsh(P).min()) <= 0:
        yield (
            ("P",),
            f"expected a positive definite matrix, found the eigenvalue {smallest:.4g}",
        )
