"""Violation of hard constraints as one number, and of soft constraints at a cost.

The violation is the sum of all scaled excesses. Values that are not finite stay so in
the sums: the positive part of an excess e is (e + |e|) / 2, which keeps NaN, unlike
fmax(e, 0).

A soft constraint may be broken at a cost:

    cost of an interval   sum over the rows of dt (w e + q e^2)
    dt                    length of the interval
    w, q >= 0             prices of the row's excess and of its square
    e >= 0                the largest excess of a row over its limits, in its units: at
                          the start of the interval, at every check, and after the jump
                          at the interval's end, if there is one

In a rollout and along a finer path e is computed. In the NLP e is a variable of each
row and interval, so that all functions are smooth:

    value - e <= upper,    lower <= value + e    at each of these points

The variable e equals the computed e at an optimum, since no e is larger than necessary
there. If w exceeds the multiplier that a hard limit would have, the limit is kept
exactly, if that is possible.

Source: Kerrigan and Maciejowski (2000), Soft constraints and exact penalty functions in
model predictive control.
"""

from functools import cached_property
from typing import TypeVar

import casadi as ca
import numpy as np

from swarmstart.arrays import Array
from swarmstart.ocp.common.expressions import rows_that_depend
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.constraints import Constraint, Rows, row_excess

Symbolic = TypeVar("Symbolic", ca.SX, ca.MX)


def row_weights(problem: OptimalControlProblem, automatic: ca.SX) -> list[ca.SX]:
    """Return 1 / scale of the rows of each path constraint, then of each terminal one.

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

    With the measure "indicator" it is the number of broken rows. It is not finite if an
    excess is not finite.
    """
    if constraint.measure == "indicator":
        # A comparison with NaN is false, so NaN would count as kept.
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


class SoftRows:
    """Rows of all soft constraints of a problem, stacked.

    Attributes:
        problem: The problem.
        lower: Lower limits, shape (m,).
        upper: Upper limits, shape (m,).
        places: For each row: number of its constraint, which comes after those of the
            path and terminal constraints, and its row there.
    """

    def __init__(self, problem: OptimalControlProblem) -> None:
        """Collect the rows of a problem."""
        self.problem, soft = problem, problem.soft
        first = len(problem.path_constraints) + len(problem.terminal_constraints)
        empty = np.empty(0)
        self.lower = np.concatenate([empty, *[np.asarray(c.lower) for c in soft]])
        self.upper = np.concatenate([empty, *[np.asarray(c.upper) for c in soft]])
        self.places = [
            (first + number, row)
            for number, c in enumerate(soft)
            for row in range(c.expression.numel())
        ]

    @property
    def size(self) -> int:
        """Number of rows, m."""
        return len(self.places)

    @cached_property
    def values(self) -> ca.Function:
        """Function (x, u, p, s) -> the value of each row, (m, 1)."""
        return ca.Function(
            "soft", [*self.problem.symbols().values()], [self._expression]
        )

    @cached_property
    def price(self) -> ca.Function:
        """(x, p, s, e) -> cost per second of the excesses e, shape (m, 1).

        The cost is in the unit of the user.
        """
        symbols, e = self.problem.symbols(), ca.SX.sym("e", self.size)
        linear, quadratic = (
            ca.vertcat(ca.SX(0, 1), *[c.weights[i] for c in self.problem.soft])
            for i in (0, 1)
        )
        return ca.Function(
            "price",
            [symbols["states"], symbols["parameters"], symbols["signals"], e],
            [ca.dot(linear, e) + ca.dot(quadratic, e**2)],
        )

    @cached_property
    def that_jump(self) -> list[int]:
        """Rows that the end of an interval may change and that contain no control."""
        model, column = self.problem.model, self._expression
        controlled = rows_that_depend(column, model.controls)
        jump = rows_that_depend(column, model.jumping)
        return [row for row in jump if row not in controlled]

    def excess(self, values: ca.SX) -> ca.SX:
        """Return the excess of each value over its limits, at least 0, (m, 1).

        A value that is not finite stays so; fmax would lose it.
        """
        beyond = row_excess(Rows(values, self.lower, self.upper))
        return (beyond + ca.fabs(beyond)) / 2

    def grown(
        self, e: ca.SX, states: tuple[ca.SX, ca.SX], known: tuple[ca.SX, ca.SX, ca.SX]
    ) -> ca.SX:
        """Return the largest excesses so far, including the end of a check, (m, 1).

        Args:
            e: The largest excesses so far.
            states: States at the end of the check, and after the end of an interval.
            known: Controls, parameters and signals at the end of the check.
        """
        reached, left = states
        found = self.excess(self.values(reached, *known))
        e = (e + found + ca.fabs(e - found)) / 2  # Unlike fmax, it keeps NaN.
        rows = self.that_jump if left is not reached else []
        if rows:
            found, most = self.excess(self.values(left, *known))[rows], e[rows]
            e[rows] = (most + found + ca.fabs(most - found)) / 2
        return e

    def rate(self) -> ca.SX:
        """Return the cost per second at one point, in the problem's symbols."""
        symbols = self.problem.symbols()
        ends = symbols["states"], symbols["parameters"], symbols["signals"]
        return self.price(*ends, self.excess(self._expression))

    def excesses_along(
        self, begins: tuple[Array, ...], ends: tuple[Array, ...], left: Array
    ) -> Array:
        """Return the largest excess of each row in each interval, shape (m, N).

        Args:
            begins: States, controls, parameters and signals at the start of fine steps,
                the same number in each interval, one column each.
            ends: States, controls, parameters and signals at the ends of the intervals.
            left: States after the jumps at the intervals' ends, shape (nx, N).
        """
        N = self.problem.intervals
        e = self._beyond(*begins).reshape(self.size, N, -1).max(axis=2)
        e = np.maximum(e, self._beyond(*ends))
        if self.that_jump:
            jumped = self._beyond(left, *ends[1:])[self.that_jump]
            e[self.that_jump] = np.maximum(e[self.that_jump], jumped)
        return np.asarray(e)

    def _beyond(self, *at: Array) -> Array:
        """Return the excesses at many points, shape (m, n)."""
        values = np.array(self.values(*at))
        lower, upper = self.lower[:, None], self.upper[:, None]
        # NumPy's maximum keeps NaN, unlike CasADi's fmax.
        return np.asarray(np.maximum(np.maximum(lower - values, values - upper), 0.0))

    @property
    def _expression(self) -> ca.SX:
        return ca.vertcat(ca.SX(0, 1), *[c.expression for c in self.problem.soft])
