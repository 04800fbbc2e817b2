"""A wingman close behind its leader, in the leader's wake: (5.20) of the chapter.

States (x, y, psi_W, V_W, z, zeta): position of the leader seen from the wingman, x
ahead and y to the right in the frame of the wingman's velocity [ft]; heading, positive
to the right [rad]; speed [ft/s]; height above the leader [ft] and its rate [ft/s].
Controls (V_Wc, psi_Wc, h_Wc): commands to the autopilot. Parameters (V_L, psi_L, h_L):
speed, heading and height command of the leader. dC_L, dC_D and dC_Y are what the wake
adds to the wingman's coefficients of lift, drag and side force (`horseshoe_vortex.py`),
q is the dynamic pressure, S the wing area, m the mass, tau_psi, tau_V, t_a and t_b are
the lags of the autopilot, and w the gusts, if there are any.

    psi_E  = psi_L - psi_W
    r      = (psi_Wc - psi_W)/tau_psi + qS/(m V_W) dC_Y
    x'     = V_L cos psi_E - V_W + Y r  [+ w_x]
    y'     = V_L sin psi_E - X r        [+ w_y]
    psi_W' = r
    V_W'   = (V_Wc - V_W)/tau_V - qS/m dC_D
    z'     = zeta                       [+ w_z]
    zeta'  = -(1/t_a + 1/t_b) zeta - z/(t_a t_b) + (h_Wc - h_L)/(t_a t_b) + qS/m dC_L

kinematics "fixed": (X, Y) = (xbar, ybar), the slot, as printed in (5.20)
           "exact": (X, Y) = (x, y)
aerodynamics "linear": dC = C_y (y - ybar) + C_z z, derivatives at the slot
             "vortex": dC = C(y, z) - C(ybar, 0), the increments themselves
             "none": dC = 0, no wake
heading_from "leader": the control is psi_Wc - psi_L in place of psi_Wc

A limit of the turn rate is that of the autopilot, and limits (psi_Wc - psi_W)/tau_psi
only.

The variant "corrected" is the above. "literal" is (5.20) as printed, linear: y in place
of y - ybar, a constant lift that h_Wc has to hold down, and + qS/m C_Dz z, which is
zero, in place of - qS/m dC_D. In both variants the last row is zeta' (printed xi'), and
psi_E, which the chapter leaves undefined, is as above.

The wake is derived anew for the F-16 class; its numbers are not those of the thesis
that the chapter cites. The speed for which the wake is computed is that of the flight
condition (`Aircraft.speed_ft_s`), not the chapter's 200 ft/s, at which such an aircraft
cannot fly level; V_W in qS/(m V_W) is the state.
"""

import math
from dataclasses import dataclass, field
from typing import Literal, get_args

import casadi as ca

from swarmstart.cases.kinds.models.horseshoe_vortex import (
    Aircraft,
    Increments,
    derivatives,
    increments,
    require_positive,
)
from swarmstart.ocp import InvalidProblemError, Model

STATES = ("x_ft", "y_ft", "heading_rad", "speed_ft_s", "z_ft", "climb_rate_ft_s")
CONTROLS = ("speed_command_ft_s", "heading_command_rad", "height_command_ft")
POSITION = (0, 1, 4)
"""Rows of the states that are the relative position (x, y, z)."""

Variant = Literal["corrected", "literal"]
Kinematics = Literal["fixed", "exact"]
Aerodynamics = Literal["linear", "vortex", "none"]
HeadingFrom = Literal["north", "leader"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Wingman:
    """An aircraft with its autopilot, and the slot that its span gives.

    Attributes:
        aircraft: Geometry and flight condition, of the leader too.
        speed_lag_s: Lag tau_V of the speed [s].
        heading_lag_s: Lag tau_psi of the heading [s].
        height_lag_a_s: t_a, the shorter lag of the height [s].
        height_lag_b_s: t_b, the longer lag of the height [s].
        turn_rate_rad_s: Largest turn rate of the autopilot [rad/s]; None means no
            limit.

    Raises:
        InvalidAircraftError: If a lag or the limit is not positive and finite.

    Source: the lags are chosen here, typical of an autopilot of the F-16's class.
    """

    aircraft: Aircraft = field(default_factory=Aircraft)
    speed_lag_s: float = 5.0
    heading_lag_s: float = 0.75
    height_lag_a_s: float = 0.3075
    height_lag_b_s: float = 3.85
    turn_rate_rad_s: float | None = None

    def __post_init__(self) -> None:
        """Check the range of the lags."""
        for name in (
            "speed_lag_s", "heading_lag_s", "height_lag_a_s", "height_lag_b_s"
        ):  # fmt: skip
            require_positive(name, getattr(self, name))
        if self.turn_rate_rad_s is not None:
            require_positive("turn_rate_rad_s", self.turn_rate_rad_s)

    @property
    def slot_ft(self) -> tuple[float, float, float]:
        """(xbar, ybar, zbar) = (2 b, pi b/4, 0) [ft]."""
        return 2 * self.aircraft.span_ft, math.pi * self.aircraft.span_ft / 4, 0.0


def close_formation(
    wingman: Wingman,
    *,
    variant: Variant = "corrected",
    kinematics: Kinematics = "fixed",
    aerodynamics: Aerodynamics = "linear",
    heading_from: HeadingFrom = "north",
    gusts: bool = False,
) -> Model:
    """Return the model, the chapter's (5.20): nx = 6, nu = 3, np = 3 or, with gusts, 6.

    Args:
        wingman: The aircraft, its lags and its slot.
        variant: "corrected", or "literal": as printed.
        kinematics: Position in the rotation terms: "fixed" takes that of the slot,
            "exact" that of the state.
        aerodynamics: Effect of the wake: "linear" about the slot, "vortex" for the
            vortex itself, which needs the variant "corrected", or "none".
        heading_from: Direction from which the heading command is counted.
        gusts: Whether the model has three more parameters, the gusts w_x, w_y and w_z
            [ft/s], which are added to the rate of the relative position; for a plant.

    Raises:
        InvalidProblemError: If a choice is unknown, or literal is combined with vortex.
    """
    _require_choices(variant, kinematics, aerodynamics, heading_from)
    x, y, psi, V, z, zeta = (ca.SX.sym(n) for n in ("x", "y", "psi", "V", "z", "zeta"))
    V_c, psi_c, h_c = (ca.SX.sym(name) for name in ("V_c", "psi_c", "h_c"))
    V_L, psi_L, h_L = (ca.SX.sym(name) for name in ("V_L", "psi_L", "h_L"))
    w = ca.SX.sym("w", 3) if gusts else ca.SX(0, 1)
    # Without gusts the parameters stay three, as the planning problem has them.
    w_x, w_y, w_z = ca.vertsplit(w) if gusts else (0, 0, 0)

    if aerodynamics == "vortex":
        dC = _vortex(wingman, y, z)
    elif aerodynamics == "linear":
        dC = _linear(wingman, y, z, as_printed=variant == "literal")
    else:
        dC = Increments(ca.SX(0), ca.SX(0), ca.SX(0))
    qSm = wingman.aircraft.acceleration_ft_s2
    X, Y = (x, y) if kinematics == "exact" else wingman.slot_ft[:2]
    t_a, t_b = wingman.height_lag_a_s, wingman.height_lag_b_s
    told = psi_c + psi_L if heading_from == "leader" else psi_c
    commanded = (told - psi) / wingman.heading_lag_s
    limit = wingman.turn_rate_rad_s
    if limit is not None:
        # Of the command alone: the side force of the wake still turns the aircraft.
        commanded = ca.fmin(ca.fmax(commanded, -limit), limit)
    r = commanded + qSm / V * dC.C_Y
    return Model(
        states=ca.vertcat(x, y, psi, V, z, zeta),
        controls=ca.vertcat(V_c, psi_c, h_c),
        parameters=ca.vertcat(V_L, psi_L, h_L, w),
        ode=ca.vertcat(
            V_L * ca.cos(psi_L - psi) - V + Y * r + w_x,
            V_L * ca.sin(psi_L - psi) - X * r + w_y,
            r,
            (V_c - V) / wingman.speed_lag_s - qSm * dC.C_D,
            zeta + w_z,
            -(1 / t_a + 1 / t_b) * zeta + (h_c - h_L - z) / (t_a * t_b) + qSm * dC.C_L,
        ),
        state_names=STATES,
        control_names=CONTROLS,
    )


def _require_choices(
    variant: str, kinematics: str, aerodynamics: str, heading_from: str
) -> None:
    """Raise if a choice is unknown or contradicts another one."""
    for role, given, known in (
        ("variant", variant, get_args(Variant)),
        ("kinematics", kinematics, get_args(Kinematics)),
        ("aerodynamics", aerodynamics, get_args(Aerodynamics)),
        ("heading_from", heading_from, get_args(HeadingFrom)),
    ):
        if given not in known:
            raise InvalidProblemError(
                f"{role} must be one of {', '.join(known)}, got {given!r}"
            )
    if variant == "literal" and aerodynamics == "vortex":
        raise InvalidProblemError(
            "aerodynamics of variant 'literal' must be linear or none, got 'vortex'"
        )


def _linear(
    wingman: Wingman, y: ca.SX, z: ca.SX, *, as_printed: bool
) -> Increments[ca.SX]:
    """Return dC = C_y (y - ybar) + C_z z, or dC as (5.20) prints it."""
    _, ybar, zbar = wingman.slot_ft
    C = derivatives(wingman.aircraft, ybar, zbar)
    dy = y if as_printed else y - ybar  # Printed without the slot: a constant lift.
    return Increments(
        C_L=C.C_Ly * dy + C.C_Lz * z,
        # (5.20) prints + qS/m C_Dz z; the rate of V_W subtracts dC_D.
        C_D=-C.C_Dz * z if as_printed else C.C_Dy * dy + C.C_Dz * z,
        C_Y=C.C_Yy * dy + C.C_Yz * z,
    )


def _vortex(wingman: Wingman, y: ca.SX, z: ca.SX) -> Increments[ca.SX]:
    """Return dC = C(y, z) - C(ybar, 0), the nonlinear increments about the slot."""
    _, ybar, zbar = wingman.slot_ft
    here = increments(wingman.aircraft, y, z)
    in_slot = increments(wingman.aircraft, ybar, zbar)
    return Increments(*(a - b for a, b in zip(here, in_slot, strict=True)))
