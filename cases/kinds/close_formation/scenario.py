"""The scenario of a close formation: a wingman keeps a slot behind its leader.

Source: the chapter, section 5.3. Lengths are in ft, as there.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from swarmstart.cases.format.parts import (
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


class AircraftPart(Part):
    """Both aircraft: F-16 class; see `models.horseshoe_vortex.Aircraft`.

    Attributes:
        span_ft: Span of the wing [ft].
        wing_area_ft2: Area of the wing [ft^2].
        weight_lb: Weight of the aircraft [lb].
        air_density_slug_ft3: Density of the air [slug/ft^3].
        speed_ft_s: Airspeed for which the vortex is computed [ft/s].
        lift_slope_per_rad: Lift slope of the wing and of the fin [1/rad].
        core_fraction: Squared radius of the vortex core divided by the squared span.
        fin_efficiency: Dynamic pressure at the fin divided by that of the free stream.
        fin_area_ft2: Area of the fin [ft^2].
        fin_height_ft: Height of the fin [ft].
        parasitic_drag: Coefficient of parasitic drag, used for the measures of saved
            drag only.
    """

    span_ft: Positive = 30.0
    wing_area_ft2: Positive = 300.0
    weight_lb: Positive = 25_000.0
    air_density_slug_ft3: Positive = 4.62e-4
    speed_ft_s: Positive = 825.0
    lift_slope_per_rad: Positive = 5.3
    core_fraction: Positive = 0.01
    fin_efficiency: Positive = 0.95
    fin_area_ft2: Positive = 54.75
    fin_height_ft: Positive = 8.0
    parasitic_drag: NonNegative = 0.02


class Autopilot(Part):
    """Lags of the wingman's autopilot, and the limit of its turn rate.

    Attributes:
        speed_lag_s: Time constant of the speed [s].
        heading_lag_s: Time constant of the heading [s].
        height_lag_a_s: First time constant of the height [s].
        height_lag_b_s: Second time constant of the height [s].
        turn_rate_rad_s: Largest turn rate [rad/s]; null means no limit.
    """

    speed_lag_s: Positive = 5.0
    heading_lag_s: Positive = 0.75
    height_lag_a_s: Positive = 0.3075
    height_lag_b_s: Positive = 3.85
    turn_rate_rad_s: Positive | None = None


class Slot(Part):
    """Position at which the leader is to be held, seen from the wingman.

    Attributes:
        x_ft: Distance ahead of the wingman [ft].
        y_ft: Distance to the right of the wingman [ft].
        z_ft: Height of the wingman above the leader [ft].
    """

    x_ft: Positive
    y_ft: Number
    z_ft: Number = 0.0


class Start(Part):
    """State of the wingman at the start.

    Attributes:
        x_ft: Distance of the leader ahead of the wingman [ft].
        y_ft: Distance of the leader to the right of the wingman [ft].
        heading_rad: Heading of the wingman [rad].
        speed_ft_s: Speed of the wingman [ft/s].
        z_ft: Height of the wingman above the leader [ft].
        climb_ft_s: Rate of change of that height [ft/s].
    """

    x_ft: Number
    y_ft: Number
    heading_rad: Number = 0.0
    speed_ft_s: Positive
    z_ft: Number = 0.0
    climb_ft_s: Number = 0.0

    def vector(self) -> list[float]:
        """Return (x, y, psi, V, z, zeta), the order of (5.20)."""
        flown = [self.x_ft, self.y_ft, self.heading_rad, self.speed_ft_s]
        return [*flown, self.z_ft, self.climb_ft_s]


class LeaderRow(Part):
    """Speed, heading and height of the leader from an instant on.

    Attributes:
        time_s: Time from which the row is valid [s].
        speed_ft_s: Speed of the leader [ft/s].
        heading_rad: Heading of the leader, not wrapped [rad].
        height_ft: Height of the leader [ft].
    """

    time_s: NonNegative
    speed_ft_s: Positive
    heading_rad: Number
    height_ft: Number = 0.0


class Leader(Part):
    """Manoeuvre of the leader, which the controller does not know ahead.

    Attributes:
        between: Motion between two rows: hold keeps a row until the next, linear
            changes evenly.
        manoeuvre: Rows of the manoeuvre in order of time, the first at 0 s.
    """

    between: Literal["hold", "linear"] = "hold"
    manoeuvre: list[LeaderRow] = Field(min_length=1)


class Commands(Part):
    """Bounds of the commands to the autopilot.

    Attributes:
        speed_ft_s: Bounds [lower, upper] of the speed command [ft/s], with the leader's
            speeds inside.
        heading_rad: Bounds [lower, upper] of the heading command [rad].
        heading_from: Direction from which the heading command counts: north, or the
            heading of the leader.
        height_ft: Bounds [lower, upper] of the height command [ft].
    """

    speed_ft_s: Range
    heading_rad: Range
    heading_from: Literal["north", "leader"] = "north"
    height_ft: Range


class Prediction(GridPart):
    """Model that the controller predicts with, and its horizon.

    Attributes:
        integrator: Integrator of the prediction: fourth-order Runge-Kutta, Euler, or
            one for stiff models.
        model: Equations of motion: corrected, or literal as the chapter prints them.
        kinematics: Position in the rotation terms: fixed takes that of the slot as
            (5.20) does, exact takes the true one.
        aerodynamics: Effect of the leader's vortex: linear in the position, or none.
    """

    integrator: IntegratorName = "rk4"
    model: Literal["corrected", "literal"] = "corrected"
    kinematics: Literal["fixed", "exact"] = "fixed"
    aerodynamics: Literal["linear", "none"] = "linear"


class Gusts(Part):
    """Dryden turbulence on the relative position, unknown to the controller.

    Attributes:
        sigma_ft_s: Standard deviation of each component [ft/s]; 0 means no gusts.
        length_ft: Scale length of the turbulence [ft].
        seed: Seed of the random numbers of the gusts.
    """

    sigma_ft_s: NonNegative = 0.0
    length_ft: Positive = 1750.0
    seed: int = Field(default=0, ge=0)


class PlantPart(Part):
    """The simulated aircraft.

    Attributes:
        substep_s: Length of an integrator step of the simulation [s].
        model: Equations of motion: corrected, or literal as the chapter prints them.
        kinematics: Position in the rotation terms: fixed takes that of the slot as
            (5.20) does, exact takes the true one.
        aerodynamics: Effect of the leader's vortex: linear in the position, the vortex
            itself, or none.
        gusts: Turbulence on the relative position.
    """

    substep_s: Positive = 0.01
    model: Literal["corrected", "literal"] = "corrected"
    kinematics: Literal["fixed", "exact"] = "fixed"
    aerodynamics: Literal["linear", "vortex", "none"] = "linear"
    gusts: Gusts = Gusts()


class CloseFormationScenario(PlanningScenario):
    """Scenario of a close formation flight.

    Attributes:
        kind: Kind of the scenario, which decides its other keys.
        aircraft: Geometry and flight condition of both aircraft.
        autopilot: Lags of the wingman's autopilot.
        slot: Position at which the leader is to be held, seen from the wingman.
        start: State of the wingman at the start.
        leader: Manoeuvre of the leader.
        commands: Bounds of the commands to the autopilot.
        prediction: Model that the controller predicts with, and its horizon.
        weights: Weights of the squared deviations of x, y, z, V and psi, five numbers
            of at least 0.
        leader_as_candidate: Option to put the state of the leader, as a command, into
            the first population.
        reference: Solver of the reference for the gap measures: ipopt, or none.
        plant: Simulated aircraft.
    """

    kind: Literal["close_formation"]
    aircraft: AircraftPart = AircraftPart()
    autopilot: Autopilot = Autopilot()
    slot: Slot
    start: Start
    leader: Leader
    commands: Commands
    prediction: Prediction
    weights: Annotated[list[NonNegative], Field(min_length=5, max_length=5)]
    leader_as_candidate: bool = True
    reference: Literal["none", "ipopt"] = "none"
    plant: PlantPart = PlantPart()

    def flaws(self) -> Iterator[LocatedFlaw]:
        """Yield errors between parts of the scenario."""
        yield from super().flaws()
        yield from self._manoeuvre_flaws()
        if not self.prediction.dt >= self.plant.substep_s:
            yield (
                ("plant", "substep_s"),
                f"expected at most prediction.horizon_s / intervals = "
                f"{self.prediction.dt:g}, "
                f"found {self.plant.substep_s:g}",
            )
        for key in ("prediction", "plant"):
            part = getattr(self, key)
            # (5.20) as printed is linear in the position; no vortex fits into it.
            if part.model == "literal" and part.aerodynamics == "vortex":
                yield (
                    (key, "aerodynamics"),
                    "expected linear or none with model literal, found vortex",
                )
        yield from self._bounds_flaws()

    def _bounds_flaws(self) -> Iterator[LocatedFlaw]:
        limits = self.commands.speed_ft_s
        # Else the wingman cannot follow, whatever it plans.
        speeds = [row.speed_ft_s for row in self.leader.manoeuvre]
        if min(speeds) < limits.lower or max(speeds) > limits.upper:
            yield (
                ("commands", "speed_ft_s"),
                f"expected bounds that include the leader's speeds, {min(speeds):g} to "
                f"{max(speeds):g}; found [{limits.lower:g}, {limits.upper:g}]",
            )

    def _manoeuvre_flaws(self) -> Iterator[LocatedFlaw]:
        rows = self.leader.manoeuvre
        end, dt = rows[-1].time_s, self.prediction.dt
        if 0 < end < dt:
            yield (
                ("prediction", "horizon_s"),
                f"expected control intervals of at most {end:g} s, when the leader's "
                f"manoeuvre is over; found {dt:g} s",
            )
        if rows[0].time_s > 0:
            yield (
                ("leader", "manoeuvre", 0, "time_s"),
                f"expected a manoeuvre that begins at 0 s, found {rows[0].time_s:g}",
            )
        for number in range(1, len(rows)):
            before, time = rows[number - 1].time_s, rows[number].time_s
            if not time > before:
                yield (
                    ("leader", "manoeuvre", number, "time_s"),
                    f"expected a time after {before:g} s, that of the row before; "
                    f"found {time:g}",
                )
