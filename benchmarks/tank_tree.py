"""A tree of scenarios of the stirred tank: an ensemble with a robust horizon of one.

Nine tanks have one control in the first interval, as they cannot be told apart before
it ends, and then controls of their own.

Source: Lucia, Finkler and Engell (2013), Multi-stage nonlinear model predictive control
applied to a semi-batch polymerization reactor under uncertainty.
"""

from dataclasses import replace

import numpy as np

from swarmstart.benchmarks.tank import PLANTS, STATE_LIMITS, STATES, problem, tank
from swarmstart.ocp import (
    IpoptOptions,
    OptimalControlProblem,
    Planner,
    RecedingHorizon,
    ensemble,
)

_MARGIN = 0.01
"""Margin of T_R [deg C], which may be higher between two checks."""


def tree() -> OptimalControlProblem:
    """Return the problem of nine tanks.

    T_R is also bounded in the middle of each interval, by a slightly lower bound.
    """
    one = problem(tank())
    lower, upper = (np.array(limits) for limits in STATE_LIMITS)
    upper[STATES.index("T_R")] -= _MARGIN
    bounds = replace(one.bounds, states=(lower, upper))
    alpha, beta = np.transpose(PLANTS)
    return ensemble(
        replace(one, bounds=bounds, checks=2),
        {"alpha": alpha, "beta": beta},
        robust_horizon=1,
    )


def branching() -> RecedingHorizon:
    """Return the controller, with IPOPT alone."""
    planner = Planner(tree(), search=None, polish=IpoptOptions())
    return RecedingHorizon(planner=planner, append="last")
