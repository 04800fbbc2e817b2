"""Cost and violation of a path that is known at the nodes only.

    cost       sum over the checks of dt (L(x_k, u) + L(x_k+1, u)) / 2, or by Simpson's
               rule, + initial, step and terminal costs; L is the stage cost, dt the
               time between two checks, and x_k the state at node k
    violation  path constraints and bounds of the states at every check, terminal
               constraints, bounds of the controls at every node, relative to their
               ranges

The weights of all rows are those of a roll-out of the problem (violation.py).
"""

import math
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.common.errors import InvalidProblemError
from swarmstart.ocp.rollout.fitness import Arguments, Known, at_nodes, core_known
from swarmstart.ocp.rollout.shooting import Shooting, shooting_of
from swarmstart.ocp.rollout.violation import SoftRows, path_violation, row_weights
from swarmstart.ocp.statement.problem import OptimalControlProblem


class Value(NamedTuple):
    """Cost and violation of a path.

    Attributes:
        cost: The minimised cost.
        violation: The violation, 0 if all constraints hold; infinite unless it and the
            cost are finite.
    """

    cost: float
    violation: float


class SampledValue:
    """Evaluates paths at the nodes of one problem; compiled once.

    Attributes:
        problem: The problem after all rewrites (core).
    """

    def __init__(self, stated: OptimalControlProblem) -> None:
        """Compile the terms of a problem.

        Raises:
            InvalidProblemError: If it decides more than held controls.
        """
        self._shooting = shooting = shooting_of(stated)
        self.problem = problem = shooting.problem
        kept = (problem.model.nx, problem.model.nu) == (
            stated.model.nx,
            stated.model.nu,
        )
        if problem.free_starts or problem.model.jumps or not kept or problem.clock:
            raise InvalidProblemError(
                "a path that is simulated from its start can have held controls as "
                "decisions: expected a problem without an end time, parameters or a "
                "start that are decided, linear controls, delays, held signals, "
                "previous controls and states that jump"
            )

    @cached_property
    def _terms(self) -> tuple[ca.Function, ca.Function]:
        """Functions of a node, and of a check."""
        return node_terms(self.problem), check_violation(self._shooting)

    @cached_property
    def _single(self) -> ca.Function:
        """Function (x, u, p, s) -> step cost and initial cost."""
        problem = self.problem
        names = [*problem.symbols().values()]
        return ca.Function("single", names, [problem.step_cost, problem.initial_cost])

    def __call__(
        self, states: Array, controls: Array, x0: ArrayLike, known: Known
    ) -> Value:
        """Return cost and violation of a path.

        Args:
            states: States at the nodes, shape (nx, nodes).
            controls: Controls held over the intervals, shape (nu, N).
            x0: Initial state, from which the scales follow, shape (nx,).
            known: Known data of the stated problem.
        """
        problem, m = self.problem, self.problem.checks
        known = core_known(self._shooting.lowered, known)
        _, p, flat = Arguments(self._shooting)(x0, known)
        s, parameters = at_nodes(problem, flat), p[: problem.model.np]
        u = np.repeat(controls, m, axis=1)
        at_node, at_check = self._terms
        (begins, broken), (ends, _) = (
            at_node(states[:, side], u, parameters, s[:, side])
            for side in (slice(0, -1), slice(1, None))
        )
        rates = [np.array(part).reshape(-1, m) for part in (begins, ends)]
        cost = (
            problem.dt * (_weights(m) * np.hstack([rates[0], rates[1][:, -1:]])).sum()
        )
        over = at_check(states[:, :-1], u, p, s[:, :-1], states[:, 1:], u, p, s[:, 1:])
        first = states[:, :-1:m], controls, parameters, s[:, :-1:m]
        step, initial = (np.array(part).ravel() for part in self._single(*first))
        end, missed = self._shooting.terminal(states[:, -1], p, s[:, -1])
        value = Value(
            cost=float(cost + step.sum() + initial[0] + float(end)),
            violation=float(np.array(broken).sum() + np.array(over).sum() + missed),
        )
        return value if math.isfinite(sum(value)) else value._replace(violation=np.inf)


def _weights(parts: int) -> Array:
    """Return weights of the values at both ends and between the parts of 1.

    By Simpson's rule if the number of parts is even, else by the trapezoidal rule.
    """
    weights = np.ones(parts + 1)
    if parts % 2:
        weights[[0, -1]] = 0.5
    else:
        weights[1::2], weights[2:-1:2] = 4.0, 2.0
        weights /= 3.0
    return weights / parts


def node_terms(problem: OptimalControlProblem) -> ca.Function:
    """Return a function (x, u, p, s) -> (stage cost, scaled excess of bounds of u)."""
    symbols = problem.symbols()
    u = symbols["controls"]
    lower, upper = problem.control_limits
    width = np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    over = ca.fmax(ca.fmax(ca.DM(lower) - u, u - ca.DM(upper)), 0)
    broken = ca.sum1(over / ca.DM(width))
    cost = problem.stage_cost
    if problem.soft:
        cost += SoftRows(problem).rate()
    return ca.Function("node", [*symbols.values()], [cost, broken])


def check_violation(shooting: Shooting) -> ca.Function:
    """Return the function (x, u, p, s at two successive checks) -> path violation.

    It is the sum of the violations of all path constraints.
    """
    problem = shooting.problem
    before, after = (
        [ca.SX.sym(n, s.numel()) for n, s in problem.symbols().items()]
        for _ in range(2)
    )
    automatic = ca.SX.sym("w", problem.automatic)
    weights = row_weights(problem, automatic)
    broken = ca.SX(0)
    for constraint, value, weight in zip(
        problem.path_constraints, shooting.path_values, weights, strict=False
    ):
        excess = constraint.excess(value(*before), value(*after))
        broken += path_violation(constraint, excess, weight)
    before[2], after[2] = (
        # Both ends have an argument for the weights; only that of the start is used.
        ca.vertcat(side[2], w)
        for side, w in ((before, automatic), (after, ca.SX.sym("w", automatic.numel())))
    )
    return ca.Function("check", [*before, *after], [broken])
