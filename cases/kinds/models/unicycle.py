"""A vehicle in the plane that steers by its turn rate (5.1).

    v' = u,  psi' = omega,  x' = v cos psi,  y' = v sin psi

States (v, psi, x, y) in the order of (5.3): speed [m/s], heading [rad], position [m].
Controls (u, omega): acceleration [m/s^2], turn rate [rad/s].
"""

import casadi as ca

from swarmstart.cases.kinds.planar import STATES
from swarmstart.ocp import Model

CONTROLS = ("acceleration_m_s2", "turn_rate_rad_s")


def unicycle() -> Model:
    """Return the model (5.1), nx = 4, nu = 2."""
    v, psi, x, y = (ca.SX.sym(name) for name in ("v", "psi", "x", "y"))
    u, omega = ca.SX.sym("u"), ca.SX.sym("omega")
    return Model(
        states=ca.vertcat(v, psi, x, y),
        controls=ca.vertcat(u, omega),
        ode=ca.vertcat(u, omega, v * ca.cos(psi), v * ca.sin(psi)),
        state_names=STATES,
        control_names=CONTROLS,
    )
