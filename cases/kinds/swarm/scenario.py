"""The scenario of a swarm: many vehicles that go to goals by committed plans."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from swarmstart.arrays import Array
from swarmstart.cases.format.parts import NonNegative, Part, Positive
from swarmstart.cases.format.settings import LocatedFlaw, Scenario
from swarmstart.cases.kinds.links import LinksPart
from swarmstart.cases.kinds.planar import shortest_assignment
from swarmstart.cases.kinds.swarm.formations import (
    MOST_VEHICLES,
    Cube,
    Goals,
    Opposite,
    Place,
    Starts,
    random_places,
)
from swarmstart.errors import SwarmstartError
from swarmstart.ocp import Obstacle, Swarm, SwarmController
from swarmstart.ocp.swarm.tracking import tracking_of

INSTANTS = 101
"""Number of places of a moving obstacle from which random starts keep away."""
Speeds = Annotated[list[NonNegative], Field(min_length=3, max_length=3)]
"""A number for each axis."""
Sizes = Annotated[list[Positive], Field(min_length=3, max_length=3)]
"""A positive number for each axis."""
PLACES = {
    "starts": ("starts",),
    "goals": ("goals",),
    "silences": ("links", "silences"),
    "radio_range": ("links", "range_m"),
    "longest_s": ("planning", "longest_s"),
    "acceleration": ("vehicle", "acceleration_m_s2"),
    "speed": ("vehicle", "speed_m_s"),
    "vehicles": ("vehicle", "turn_rate_rad_s"),
    "drift": ("vehicle", "drift_m_s"),
    "times": ("obstacles",),
    "step_s": ("step_s",),
    "lead_s": ("planning", "lead_s"),
    "disturbance": ("plant", "disturbance_m_s2"),
}
"""First word of a message of the library -> the key that it concerns."""


def _count(part: Any) -> int:
    """Return the number of places of a formation."""
    points = getattr(part, "points_m", None)
    counts = getattr(part, "counts", None)
    if counts is not None:
        return int(np.prod(counts))
    return len(points) if points is not None else int(part.count)


class Vehicle(Part):
    """Every vehicle of the swarm: a point mass.

    Attributes:
        acceleration_m_s2: Largest acceleration along each axis [m/s^2].
        speed_m_s: Largest speed along each axis [m/s]; 0 means that plans keep the
            coordinate constant.
        turn_rate_rad_s: Largest turn rate of vehicles that move in the plane along
            their heading [rad/s]; the bounds along x are then those of the magnitudes
            of acceleration and velocity; null means no limit of the turn rate.
        drift_m_s: Velocity of the frame in which places are given, such as that of a
            formation's leader [m/s]; a place at rest in the frame moves with it.
    """

    acceleration_m_s2: Sizes = Field(default=[1.0, 1.0, 1.0])
    speed_m_s: Speeds = Field(default=[2.0, 2.0, 2.0])
    turn_rate_rad_s: Positive | None = None
    drift_m_s: Place = Field(default=[0.0, 0.0, 0.0])


class Waypoint(Part):
    """Place of an obstacle at a time.

    Attributes:
        time_s: The time [s].
        place_m: Centre of the obstacle: x, y, z [m].
    """

    time_s: NonNegative
    place_m: Place


class Ball(Part):
    """An obstacle: a ball that stands, or moves on a known path.

    Attributes:
        radius_m: Radius of the ball [m].
        place_m: Centre of a ball that stands: x, y, z [m]; null means that it moves.
        path: Places and times between which the ball moves at constant speed.
    """

    radius_m: Positive
    place_m: Place | None = None
    path: list[Waypoint] = Field(default_factory=list)

    @model_validator(mode="after")
    def _one_way(self) -> "Ball":
        if (self.place_m is None) == (not self.path):
            found = "neither" if self.place_m is None else "both"
            raise ValueError(f"expected place_m or path; found {found}")
        return self

    def obstacle(self) -> Obstacle:
        """Return the obstacle."""
        if self.place_m is not None:
            return Obstacle(radius=self.radius_m, path=[self.place_m])
        return Obstacle(
            radius=self.radius_m,
            path=[one.place_m for one in self.path],
            times=[one.time_s for one in self.path],
        )


class PlanningPart(Part):
    """The search of each vehicle for plans.

    Attributes:
        longest_s: Longest time of a plan [s].
        tries: Number of candidate flights to the goal that a search tries.
        lead_s: Time from the proposal of a plan to the instant at which this plan
            departs from the committed one [s]; null means the time of a round trip to
            all others over the links.
    """

    longest_s: Positive = 30.0
    tries: int = Field(default=600, ge=1, le=1_000_000)
    lead_s: NonNegative | None = None


class PlantPart(Part):
    """The simulated vehicles.

    Attributes:
        substeps: Number of integrator steps of the simulation in a step.
        disturbance_m_s2: Largest random acceleration along each axis, drawn anew for
            each integrator step; vehicles know this bound [m/s^2].
        seed: Seed of the disturbance.
    """

    substeps: int = Field(default=5, ge=1, le=1000)
    disturbance_m_s2: NonNegative = 0.0
    seed: int = Field(default=0, ge=0, lt=2**32)


class SwarmScenario(Scenario):
    """Scenario of a swarm. Vehicles are numbered from 0.

    Attributes:
        kind: Kind of the scenario, which decides its other keys.
        steps: Largest number of steps to simulate; a run ends when all have arrived.
        step_s: Length of a step [s].
        starts: Formation at the start, at rest, or a list of them; with `formation:
            file`, `file` names a CSV file with the columns x_m, y_m, z_m.
        goals: Formation of the goals, stated like that of the starts; opposite reflects
            each start through the middle of all starts.
        assignment: Assignment of goals: each vehicle has its own, or the least sum of
            squared distances.
        safe_distance_m: Least distance of two vehicles [m]; half of it is kept from
            obstacles.
        scale: Factors of the axes in distances: [1, 1, 0.5] keeps vehicles twice as far
            apart along z.
        vehicle: Bounds of each vehicle.
        obstacles: Balls that stand, or move on known paths.
        links: Links between the vehicles.
        rule: Rule by which a vehicle commits to a plan: when the plan is accepted by
            all others that may still change their own plans, after a wait in which
            nothing is heard, or at once.
        planning: Search of each vehicle for plans.
        plant: The simulated vehicles.
    """

    kind: Literal["swarm"]
    step_s: Positive = 0.1
    starts: Starts
    goals: Goals
    assignment: Literal["given", "shortest"] = "given"
    safe_distance_m: Positive
    scale: Sizes = Field(default=[1.0, 1.0, 1.0])
    vehicle: Vehicle = Vehicle()
    obstacles: list[Ball] = Field(default_factory=list, max_length=1000)
    links: LinksPart = LinksPart()
    rule: Literal["acknowledged", "waiting", "hearsay"] = "acknowledged"
    planning: PlanningPart = PlanningPart()
    plant: PlantPart = PlantPart()

    def way(self) -> str:
        """Return in words how plans are made."""
        return f"by committed plans: rule {self.rule}"

    def controller(self) -> SwarmController:
        """Return the controller of all vehicles.

        Raises:
            SwarmstartError: If starts, goals and bounds do not fit.
            ValueError: If a cube has no room for its vehicles.
        """
        for key, parts in (("starts", self.starts), ("goals", self.goals)):
            count = sum(map(_count, parts)) if isinstance(parts, list) else 0
            if count > MOST_VEHICLES:
                raise ValueError(
                    f"expected at most {MOST_VEHICLES} {key}, found {count}"
                )
        turn, scale = self.vehicle.turn_rate_rad_s, np.array(self.scale)
        obstacles = [one.obstacle() for one in self.obstacles]
        starts, goals = self._places(obstacles)
        if len(starts) != len(goals):
            raise ValueError(
                f"expected as many goals as starts, {len(starts)}; found {len(goals)}"
            )
        if self.assignment == "shortest":
            goals = goals[shortest_assignment(starts * scale, goals * scale)]
        return SwarmController(
            Swarm(
                starts=starts, goals=goals, distance=self.safe_distance_m, scale=scale,
                acceleration=self.vehicle.acceleration_m_s2,
                speed=self.vehicle.speed_m_s, obstacles=obstacles,
                turn_rate=np.inf if turn is None else turn,
                drift=self.vehicle.drift_m_s,
            ),
            links=self.links.links(), rule=self.rule, step_s=self.step_s,
            longest_s=self.planning.longest_s, tries=self.planning.tries,
            lead_s=self.planning.lead_s, disturbance=self.plant.disturbance_m_s2,
        )  # fmt: skip

    def _places(self, obstacles: list[Obstacle]) -> tuple[Array, Array]:
        """Return starts and goals, each of shape (n, 3) [m]."""
        scale = np.array(self.scale)
        law = tracking_of(self.plant.disturbance_m_s2, self.step_s)
        apart = self.safe_distance_m + 2.0 * law.distance(scale)

        def placed(part: Any, instants: int) -> Array:
            if isinstance(part, list):
                return np.concatenate([placed(one, instants) for one in part])
            if not isinstance(part, Cube):
                return np.asarray(part.places())
            balls = [
                (place, scale.max() * one.radius + apart)
                for one in obstacles
                for place in one.position(
                    np.linspace(one.times[-1], one.times[0], instants)
                )
            ]
            return random_places(part, scale, apart, balls)

        # Starts keep away from whole paths of obstacles, goals from their ends.
        starts = placed(self.starts, INSTANTS)
        if isinstance(self.goals, Opposite):
            return starts, 2.0 * starts.mean(axis=0) - starts
        return starts, placed(self.goals, 1)

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors between parts of the scenario."""
        yield from super().flaws()
        twice = list(self.links.flaws())
        yield from twice
        if twice:
            return
        try:
            self.controller()
        except (SwarmstartError, ValueError) as error:
            said = str(error)
            if said.startswith("expected "):
                yield ("goals",) if "goals" in said else ("starts",), said
                return
            # In the words of scenarios.
            words = said.replace(" must ", " to ", 1).replace(", got ", "; found ", 1)
            place = PLACES.get(said.partition(" ")[0], ())
            yield place, f"expected {words}"
