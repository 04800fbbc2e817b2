"""The stirred tank of do-mpc's documentation: its model, and the problem of one tank.

Concentrations C_a, C_b [mol/l], temperatures of the reactor T_R and of its jacket T_K
[deg C], the feed F [1/h] and the heat Q_dot [kJ/h]; two factors alpha and beta of the
kinetics are uncertain. do-mpc counts hours, we seconds.

    minimise   sum of (C_b - 0.6)^2 + 0.1 (dF / 100)^2 + 1e-3 (dQ_dot / 2000)^2 at the
               begins of 20 intervals of 18 s, d the change from the interval before,
               + (C_b - 0.6)^2 at the end
    subject to T_R <= 140

Source: Klatt and Engell (1998), Gain-scheduling trajectory control of a continuous
stirred tank reactor, with the settings of do-mpc's documentation, "Continuous stirred
tank reactor (CSTR)".
"""

from collections.abc import Sequence
from itertools import product

import casadi as ca
import numpy as np

from swarmstart.ocp import Bounds, Model, OptimalControlProblem

HOUR = 3600.0
INTERVAL = 0.005
"""Length of a control interval [h]."""
INTERVALS = 20
HOTTEST = 140.0
"""Bound of T_R [deg C]."""
WANTED = 0.6
"""Desired C_b [mol/l]."""
UNITS = np.array([100.0, 2000.0])
"""Units of F and Q_dot in the cost of their changes."""
WEIGHTS = np.array([0.1, 1e-3])
"""Weights of these changes."""
START = np.array([0.8, 0.5, 134.14, 130.0])
BEFORE = np.array([5.0, 0.0])
"""Controls before the run: the allowed ones nearest to zero."""
STATE_LIMITS = ([0.1, 0.1, 50.0, 50.0], [2.0, 2.0, HOTTEST, 140.0])
CONTROL_LIMITS = ([5.0, -8500.0], [100.0, 0.0])
STATES, CONTROLS = ("C_a", "C_b", "T_R", "T_K"), ("F", "Q_dot")
NOMINAL = (1.0, 1.0)
PLANTS = tuple(product((1.0, 1.05, 0.95), (1.0, 1.1, 0.9)))
"""Values of (alpha, beta): the nominal ones, and all that a robust controller knows."""


def rates(
    x: Sequence[ca.SX], u: Sequence[ca.SX], p: Sequence[ca.SX | float]
) -> list[ca.SX]:
    """Return the rates of the states [1/h].

    Args:
        x: C_a, C_b, T_R, T_K.
        u: F, Q_dot.
        p: alpha, beta.
    """
    a, b, hot, jacket = x
    (feed, heat), (alpha, beta) = u, p
    kelvin = hot + 273.15
    to_b = beta * 1.287e12 * ca.exp(-9758.3 / kelvin) * a
    to_c = 1.287e12 * ca.exp(-9758.3 / kelvin) * b
    to_d = 9.043e9 * ca.exp(-8560.0 * alpha / kelvin) * a**2
    released = -4.2 * to_b + 11.0 * to_c + 41.85 * to_d  # [kJ/(l h)]
    through_wall = 4032.0 * 0.215 * (hot - jacket)  # [kJ/h]
    capacity = 0.9342 * 3.01  # Of a litre [kJ/K].
    return [
        feed * (5.1 - a) - to_b - to_d,
        -feed * b + to_b - to_c,
        released / capacity + feed * (130 - hot) - through_wall / (capacity * 10.01),
        (heat + through_wall) / (5.0 * 2.0),
    ]


def tank() -> Model:
    """Return the model, in seconds."""
    x, u, p = (
        [ca.SX.sym(name) for name in names]
        for names in (STATES, CONTROLS, ("alpha", "beta"))
    )
    return Model(
        states=ca.vertcat(*x),
        controls=ca.vertcat(*u),
        ode=ca.vertcat(*rates(x, u, p)) / HOUR,
        parameters=ca.vertcat(*p),
    )


def problem(model: Model) -> OptimalControlProblem:
    """Return the problem of one tank."""
    before = ca.vertcat(*[ca.SX.sym(f"{name}_before") for name in CONTROLS])
    off = (model.states[1] - WANTED) ** 2
    moves = (model.controls - before) / ca.DM(UNITS)
    return OptimalControlProblem(
        model,
        horizon=INTERVALS * INTERVAL * HOUR,
        intervals=INTERVALS,
        step_cost=off + ca.dot(ca.DM(WEIGHTS), moves**2),
        terminal_cost=off,
        previous=before,
        bounds=Bounds(controls=CONTROL_LIMITS, states=STATE_LIMITS),
        substeps=1,
    )
