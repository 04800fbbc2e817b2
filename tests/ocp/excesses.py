"""Violation that a search adds up for a constraint, from two of its values."""

from collections.abc import Callable

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp import Constraint
from swarmstart.ocp.rollout.violation import path_violation

A, B = ca.SX.sym("a", 2), ca.SX.sym("b", 2)


def excess_of(constraint: Constraint) -> Callable[[Array, Array], float]:
    """Return the sum of a search, with scales that are given."""
    excess = constraint.excess(A, B)
    scale = np.asarray(1.0 if constraint.scale is None else constraint.scale)
    broken = path_violation(
        constraint, excess, ca.SX(1 / np.broadcast_to(scale, (excess.numel(),)))
    )
    function = ca.Function("excess", [A, B], [broken])
    return lambda a, b: float(function(a, b))
