"""An aircraft in the plane that turns by banking (5.30).

    v' = a,  psi' = g sin(phi) / v,  x' = v cos psi,  y' = v sin psi

States (v, psi, x, y): speed [m/s], heading [rad], position [m]. Controls (a, phi):
acceleration [m/s^2] and bank [rad]; or (T, phi), thrust and bank, with

    a = g (T - D) / W          thrust_equation "newton": W is the weight [N]
    a = (T - D) / W            "printed", as in (5.30): W stands for the mass

A coordinated turn has g tan(phi) / v, turn "tan"; (5.30) prints sin, turn "sin". The
heading rate divides by the speed, so that v = 0 is not allowed.
"""

from dataclasses import dataclass
from typing import Literal

import casadi as ca

from swarmstart.cases.kinds.planar import STATES
from swarmstart.ocp import InvalidProblemError, Model

GRAVITY_M_S2 = 9.8
"""Value of the chapter, after (5.30)."""

Turn = Literal["sin", "tan"]
ThrustEquation = Literal["printed", "newton"]
TURNS = {"sin": ca.sin, "tan": ca.tan}


@dataclass(frozen=True, kw_only=True, slots=True)
class Thrust:
    """Aircraft that accelerates by thrust against drag.

    Attributes:
        drag: D, constant [N].
        weight: W [N], positive.
        equation: "printed" or "newton"; see above.
    """

    drag: float
    weight: float
    equation: ThrustEquation

    def acceleration(self, thrust: ca.SX | float) -> ca.SX | float:
        """Return a [m/s^2] for a thrust [N]."""
        factor = GRAVITY_M_S2 if self.equation == "newton" else 1.0
        return factor * (thrust - self.drag) / self.weight


def bank_to_turn(*, turn: Turn, thrust: Thrust | None = None) -> Model:
    """Return the model, nx = 4, nu = 2.

    Args:
        turn: Whether the heading rate has the sine or the tangent of the bank.
        thrust: Conversion of the first control to an acceleration; None means that it
            is an acceleration.

    Raises:
        InvalidProblemError: If the turn is neither "sin" nor "tan".
    """
    if turn not in TURNS:
        raise InvalidProblemError(f"turn must be sin or tan, got {turn!r}")
    v, psi, x, y = (ca.SX.sym(name) for name in ("v", "psi", "x", "y"))
    push, phi = ca.SX.sym("push"), ca.SX.sym("phi")
    return Model(
        states=ca.vertcat(v, psi, x, y),
        controls=ca.vertcat(push, phi),
        ode=ca.vertcat(
            push if thrust is None else thrust.acceleration(push),
            GRAVITY_M_S2 * TURNS[turn](phi) / v,
            v * ca.cos(psi),
            v * ca.sin(psi),
        ),
        state_names=STATES,
        control_names=(
            "acceleration_m_s2" if thrust is None else "thrust_n",
            "bank_rad",
        ),
    )
