"""Violation: one number for all broken constraints, the sum of scaled excesses.

Values that are not finite stay so in the sums: the positive part of an excess e is
(e + |e|) / 2, which keeps NaN, unlike fmax(e, 0).
"""

from typing import TypeVar

import casadi as ca
import numpy as np

from swarmstart.ocp.common.expressions import rows_that_depend
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.constraints import Constraint

Symbolic = TypeVar("Symbolic", ca.SX, ca.MX)


def row_weights(problem: OptimalControlProblem, automatic: ca.SX) -> list[ca.SX]:
    """Return 1 / scale of the rows of each path, then each terminal constraint.

    Args:
        problem: The problem.
        automatic: 1 / scale of the rows whose scale the problem leaves open.
    """
    weights, used = [], 0
    for scales in problem.row_scales():
        column = []
        for scale in scales:
            known = not np.isnan(scale)
            column.append(ca.SX(1 / scale) if known else automatic[used])
            used += not known
        weights.append(ca.vertcat(ca.SX(0, 1), *column))
    return weights


def path_violation(constraint: Constraint, excess: ca.SX, weight: ca.SX) -> ca.SX:
    """Return the violation of a constraint: the sum of its scaled positive excesses.

    It is not finite if an excess is not finite.
    """
    if constraint.measure == "indicator":
        finite = ca.fabs(excess) < ca.inf
        return ca.sum1(ca.if_else(finite, constraint.indicated(excess), ca.inf))
    return ca.sum1((excess + ca.fabs(excess)) * (weight / 2))


def rows_depending(constraint: Constraint, symbols: ca.SX) -> list[int]:
    """Return the rows of a constraint that depend on any of some symbols."""
    return rows_that_depend(constraint.rows(constraint.expression).values, symbols)


def unless_finite(cost: Symbolic, violation: Symbolic) -> Symbolic:
    """Return the violation; infinity unless it and the cost are finite numbers."""
    return ca.if_else(ca.fabs(cost) + violation < ca.inf, violation, ca.inf)


def infinite_unless_finite(value: ca.SX) -> ca.SX:
    """Return infinity if a number is NaN or infinite, else 0."""
    return ca.if_else(ca.fabs(value) < ca.inf, 0, ca.inf)
