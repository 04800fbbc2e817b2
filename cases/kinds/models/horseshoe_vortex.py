"""Effect of the leader's wake on a wingman: a horseshoe vortex with a core.

The chapter prints the model (5.20) without coefficients. They are computed here from
geometry and flight condition of an aircraft of the F-16's class, by the equations
below; they are not the coefficients of the thesis that the chapter cites.

Two trailing vortices of circulation Gamma, bp = pi b/4 apart, leave the leader in level
flight. The aircraft have the span b, the weight W, the wing area S, the lift slope a,
and a fin of the height h, the area S_fin and the efficiency eta; V is the speed, qbar
the dynamic pressure. The wingman is y beside and z above the leader; with M the squared
core radius,

    C_L = W / (qbar S),    G = Gamma / V = C_L S / (2 bp),    s(d, h) = d^2 + h^2 + M

In the quotients W/V and S/V, and only there, W is the upwash and S the sidewash, as is
usual; elsewhere W is the weight and S the wing area.

    upwash W/V, the mean over a span bp of the wingman, positive up:
        W/V = G / (4 pi bp) ln[ s(y, z)^2 / (s(y - bp, z) s(y + bp, z)) ]
    sidewash S/V, the mean over the fin from z to z + h, positive towards the leader:
        S/V = G / (4 pi h) ln[ s(y - bp/2, z + h) s(y + bp/2, z)
                               / (s(y - bp/2, z) s(y + bp/2, z + h)) ]

    dC_L = a W/V,    dC_D = -C_L W/V,    dC_Y = k_Y S/V,    k_Y = a eta S_fin / S

dC_D is the lift vector, tilted forward by the upwash. W/V is even in y and S/V odd, so
neither needs |y| and "the sign of y": both are smooth without them.

The functions take floats and CasADi expressions; CasADi converts an array to a DM.
Units: ft, slug, s, lb (of force), rad.
"""

import math
from dataclasses import dataclass, fields
from typing import Generic, NamedTuple, TypeVar

import casadi as ca

from swarmstart.errors import SwarmstartError

Scalar = TypeVar("Scalar", float, ca.SX)
"""A number or an expression."""


class InvalidAircraftError(SwarmstartError, ValueError):
    """A number that describes an aircraft is out of range.

    Attributes:
        name: Name of the number.
        value: The given value.
        allowed: Allowed values, in words.
    """

    def __init__(self, name: str, value: float, allowed: str) -> None:
        """Keep the parts."""
        super().__init__(name, value, allowed)
        self.name = name
        self.value = value
        self.allowed = allowed

    def __str__(self) -> str:
        """Return the given and the allowed values."""
        return f"{self.name} must be {self.allowed}, got {self.value}"


def require_positive(name: str, value: float) -> None:
    """Validate a positive finite number.

    Raises:
        InvalidAircraftError: If it is not one, with its name and value.
    """
    if not (math.isfinite(value) and value > 0):
        raise InvalidAircraftError(name, value, "positive and finite")


@dataclass(frozen=True, kw_only=True, slots=True)
class Aircraft:
    """Geometry and flight condition that leader and wingman share: F-16 class.

    Attributes:
        span_ft: Wing span b [ft].
        wing_area_ft2: Wing area S [ft^2].
        weight_lb: Weight W [lb].
        air_density_slug_ft3: Density rho of the air [slug/ft^3]; the default is that at
            45,000 ft.
        speed_ft_s: Speed V0 of the flight condition [ft/s].
        lift_slope_per_rad: a = dC_L/dalpha, of the wing and of the fin [1/rad].
        core_fraction: mu^2/b^2, the squared core radius over the squared span.
        fin_efficiency: eta, dynamic pressure at the fin over that of the free stream.
        fin_area_ft2: Area of the fin [ft^2].
        fin_height_ft: Height h of the fin [ft].
        parasitic_drag: C_D0, which only `drag_saving` uses; zero is allowed.
        gravity_ft_s2: g [ft/s^2].

    Raises:
        InvalidAircraftError: If a number is not positive and finite.
    """

    span_ft: float = 30.0
    wing_area_ft2: float = 300.0
    weight_lb: float = 25_000.0
    air_density_slug_ft3: float = 4.62e-4
    speed_ft_s: float = 825.0
    lift_slope_per_rad: float = 5.3
    core_fraction: float = 0.01
    fin_efficiency: float = 0.95
    fin_area_ft2: float = 54.75
    fin_height_ft: float = 8.0
    parasitic_drag: float = 0.02
    gravity_ft_s2: float = 32.174

    def __post_init__(self) -> None:
        """Check the range of every number."""
        for name in (field.name for field in fields(self)):
            # It may be zero: then savings are those of the induced drag.
            if name != "parasitic_drag":
                require_positive(name, getattr(self, name))
        if not (math.isfinite(self.parasitic_drag) and self.parasitic_drag >= 0):
            raise InvalidAircraftError(
                "parasitic_drag", self.parasitic_drag, "zero or positive, and finite"
            )

    @property
    def mass_slug(self) -> float:
        """Mass m = W/g [slug]."""
        return self.weight_lb / self.gravity_ft_s2

    @property
    def dynamic_pressure_lb_ft2(self) -> float:
        """Dynamic pressure qbar = rho V0^2 / 2 [lb/ft^2]."""
        return 0.5 * self.air_density_slug_ft3 * self.speed_ft_s**2

    @property
    def acceleration_ft_s2(self) -> float:
        """Acceleration qbar S/m that a force coefficient of one gives [ft/s^2]."""
        return self.dynamic_pressure_lb_ft2 * self.wing_area_ft2 / self.mass_slug

    @property
    def lift_coefficient(self) -> float:
        """C_L = W / (qbar S) of level flight."""
        return self.weight_lb / (self.dynamic_pressure_lb_ft2 * self.wing_area_ft2)

    @property
    def aspect_ratio(self) -> float:
        """AR = b^2/S."""
        return self.span_ft**2 / self.wing_area_ft2

    @property
    def induced_drag(self) -> float:
        """C_Di = C_L^2 / (pi AR) of an aircraft that flies alone."""
        return self.lift_coefficient**2 / (math.pi * self.aspect_ratio)

    @property
    def vortex_separation_ft(self) -> float:
        """Distance of the trailing vortices, bp = pi b/4 [ft]."""
        return math.pi * self.span_ft / 4

    @property
    def circulation_ft(self) -> float:
        """G = Gamma/V0 = C_L S / (2 bp) [ft]."""
        return (
            self.lift_coefficient * self.wing_area_ft2 / (2 * self.vortex_separation_ft)
        )

    @property
    def squared_core_ft2(self) -> float:
        """M = (mu^2/b^2) b^2, the squared radius of the vortex core [ft^2]."""
        return self.core_fraction * self.span_ft**2

    @property
    def side_force_slope(self) -> float:
        """k_Y = a eta S_fin / S, side-force coefficient per radian of sidewash."""
        return (
            self.lift_slope_per_rad
            * self.fin_efficiency
            * self.fin_area_ft2
            / self.wing_area_ft2
        )


class Increments(NamedTuple, Generic[Scalar]):
    """Additions of the wake to the wingman's coefficients: floats or expressions."""

    C_L: Scalar
    C_D: Scalar
    C_Y: Scalar


class Derivatives(NamedTuple, Generic[Scalar]):
    """Derivatives of what the wake adds to the wingman's coefficients [1/ft].

    C_Ly is the derivative of dC_L, the addition to the lift coefficient, with respect
    to the lateral distance y, and so on; z is the height.
    """

    C_Ly: Scalar
    C_Lz: Scalar
    C_Dy: Scalar
    C_Dz: Scalar
    C_Yy: Scalar
    C_Yz: Scalar


def upwash(aircraft: Aircraft, y_ft: Scalar, z_ft: Scalar) -> Scalar:
    """Return W/V, the mean upwash over the wingman's span, positive up.

    Args:
        aircraft: Geometry and flight condition of leader and wingman.
        y_ft: Lateral distance [ft], float or expression; W/V is even in it.
        z_ft: Height of the wingman above the leader [ft], float or expression; W/V is
            even in it, too.
    """
    bp, M = aircraft.vortex_separation_ft, aircraft.squared_core_ft2
    # M keeps the logarithm finite in the vortices themselves.
    centre, near, far = (d**2 + z_ft**2 + M for d in (y_ft, y_ft - bp, y_ft + bp))
    strength = aircraft.circulation_ft / (4 * math.pi * bp)
    return strength * ca.log(centre**2 / (near * far))


def sidewash(aircraft: Aircraft, y_ft: Scalar, z_ft: Scalar) -> Scalar:
    """Return S/V, the mean sidewash over the wingman's fin.

    Args:
        aircraft: Geometry and flight condition of leader and wingman.
        y_ft: Lateral distance [ft], float or expression; S/V is odd in it, and
            positive, towards the leader, for y and z positive.
        z_ft: Height of the wingman above the leader [ft], likewise.
    """
    bp, M = aircraft.vortex_separation_ft, aircraft.squared_core_ft2
    h = aircraft.fin_height_ft
    (near_foot, far_foot), (near_tip, far_tip) = (
        tuple(d**2 + height**2 + M for d in (y_ft - bp / 2, y_ft + bp / 2))
        for height in (z_ft, z_ft + h)
    )
    strength = aircraft.circulation_ft / (4 * math.pi * h)
    return strength * ca.log(near_tip * far_foot / (near_foot * far_tip))


def increments(aircraft: Aircraft, y_ft: Scalar, z_ft: Scalar) -> Increments[Scalar]:
    """Return what the wake adds to the coefficients of the wingman's air forces.

    dC_L = a W/V, dC_D = -C_L W/V, dC_Y = k_Y S/V, with the upwash W/V, the sidewash
    S/V, the slopes a of the lift and k_Y of the side force, and the lift coefficient
    C_L.

    Args:
        aircraft: Geometry and flight condition of leader and wingman.
        y_ft: Lateral distance of the leader, positive to the right of the wingman [ft],
            float or expression. dC_Y has the sign of this distance.
        z_ft: Height of the wingman above the leader [ft], likewise.
    """
    W = upwash(aircraft, y_ft, z_ft)
    return Increments(
        C_L=aircraft.lift_slope_per_rad * W,
        C_D=-aircraft.lift_coefficient * W,
        C_Y=aircraft.side_force_slope * sidewash(aircraft, y_ft, z_ft),
    )


def derivatives(aircraft: Aircraft, y_ft: Scalar, z_ft: Scalar) -> Derivatives[Scalar]:
    """Return the derivatives of the increments at a position, in closed form.

    They are multiples (see `increments`) of the derivatives of the upwash W/V and of
    the sidewash S/V, here written W and S. Let G be the circulation divided by the
    speed, bp the distance of the trailing vortices, h the height of the fin, M the
    squared core radius, s(d, e) = d^2 + e^2 + M, A = y - bp/2 and B = y + bp/2. Then

        dW/dy = G/(2 pi bp) [2 y/s(y, z) - (y - bp)/s(y - bp, z)
                             - (y + bp)/s(y + bp, z)]
        dW/dz = G/(2 pi bp) z [2/s(y, z) - 1/s(y - bp, z) - 1/s(y + bp, z)]
        dS/dy = G/(2 pi h) { A [1/s(A, z + h) - 1/s(A, z)]
                             - B [1/s(B, z + h) - 1/s(B, z)] }
        dS/dz = G/(2 pi h) { (z + h) [1/s(A, z + h) - 1/s(B, z + h)]
                             - z [1/s(A, z) - 1/s(B, z)] }

    Args:
        aircraft: Geometry and flight condition of leader and wingman.
        y_ft: Lateral distance y [ft]. The chapter's linear model (5.20) takes the
            derivatives at the slot, y = pi b/4 with the span b.
        z_ft: Height of the wingman above the leader [ft]. At zero C_Lz = C_Dz = 0.
    """
    G, M = aircraft.circulation_ft, aircraft.squared_core_ft2
    bp, h = aircraft.vortex_separation_ft, aircraft.fin_height_ft
    A, B, top = y_ft - bp / 2, y_ft + bp / 2, z_ft + h

    def inverse(d: Scalar, height: Scalar) -> Scalar:
        return 1 / (d**2 + height**2 + M)

    centre, near, far = (inverse(d, z_ft) for d in (y_ft, y_ft - bp, y_ft + bp))
    foot, tip = [(inverse(A, e), inverse(B, e)) for e in (z_ft, top)]
    # d ln s(d, h) / dd = 2 d / s(d, h): the 4 of W/V and S/V becomes a 2.
    wing, fin = G / (2 * math.pi * bp), G / (2 * math.pi * h)
    W_y = wing * (2 * y_ft * centre - (y_ft - bp) * near - (y_ft + bp) * far)
    W_z = wing * z_ft * (2 * centre - near - far)
    S_y = fin * (A * (tip[0] - foot[0]) - B * (tip[1] - foot[1]))
    S_z = fin * (top * (tip[0] - tip[1]) - z_ft * (foot[0] - foot[1]))
    a, C_L, k_Y = (
        aircraft.lift_slope_per_rad,
        aircraft.lift_coefficient,
        aircraft.side_force_slope,
    )
    return Derivatives(a * W_y, a * W_z, -C_L * W_y, -C_L * W_z, k_Y * S_y, k_Y * S_z)


def drag_saving(aircraft: Aircraft, y_ft: Scalar, z_ft: Scalar) -> Scalar:
    """Return the share of the total drag that the upwash saves.

        saving = C_L W/V / (C_D0 + C_L^2 / (pi AR))

    W/V is the upwash divided by the speed, C_D0 the parasitic drag and AR the aspect
    ratio. The lift coefficient C_L and the circulation of the vortices are those of
    level flight without a wake; a change by the wake is neglected.

    Args:
        aircraft: Geometry and flight condition of leader and wingman. If its C_D0 is 0,
            the share is that of the induced drag, not of the total.
        y_ft: Lateral distance in the wingman's frame [ft], float or expression.
        z_ft: Height of the wingman above the leader [ft], likewise.
    """
    total = aircraft.parasitic_drag + aircraft.induced_drag
    return aircraft.lift_coefficient * upwash(aircraft, y_ft, z_ft) / total
