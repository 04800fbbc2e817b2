"""Direct multiple shooting: an optimal-control problem as a sparse NLP.

    minimise  f(w, q)   subject to  lbg <= g(w, q) <= ubg,  lbw <= w <= ubw
    w = (ca.vec of controls (nu, N), ca.vec of the states (nx, N) after each interval)
    q = (x0, parameters, ca.vec of signals)

The states after each interval are variables, tied by continuity (defects = 0); path
constraints in their smooth form hold at every check, terminal constraints at the end.

Source: Bock and Plitt (1984), A multiple shooting algorithm for direct solution of
optimal control problems.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.shooting import stage, terminal

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class NonlinearProgram:
    """An NLP in the form CasADi's `nlpsol` takes, with its bounds.

    Attributes:
        nlp: The expressions "x", "p", "f", "g".
        lower: Bounds of the variables, shape (nw,).
        upper: Bounds of the variables, shape (nw,).
        lower_g: Bounds of the constraints, shape (ng,).
        upper_g: Bounds of the constraints, shape (ng,).
    """

    nlp: dict[str, ca.SX]
    lower: Array
    upper: Array
    lower_g: Array
    upper_g: Array


def multiple_shooting(problem: OptimalControlProblem) -> NonlinearProgram:
    """Return the multiple-shooting NLP of a problem.

    Args:
        problem: The problem.
    """
    model, N = problem.model, problem.intervals
    u, x = ca.SX.sym("u", model.nu, N), ca.SX.sym("x", model.nx, N)
    x0, p = ca.SX.sym("x0", model.nx), ca.SX.sym("p", model.np)
    signals = ca.SX.sym("s", problem.ns, problem.nodes)

    cost, defects, checked = _intervals(problem, ca.horzcat(x0, x), u, p, signals)
    last = x[:, -1]
    end_cost, _ = terminal(problem)(last, p, signals[:, -1])
    rows = [
        (defects, np.zeros(defects.numel()), np.zeros(defects.numel())),
        checked,
        _terminal_rows(problem, last, p, signals[:, -1]),
    ]
    lower_u, upper_u = problem.control_limits
    lower_x, upper_x = problem.state_limits
    return NonlinearProgram(
        nlp={
            "x": ca.vertcat(ca.vec(u), ca.vec(x)),
            "p": ca.vertcat(x0, p, ca.vec(signals)),
            "f": cost + end_cost,
            "g": ca.vertcat(*[values for values, _, _ in rows]),
        },
        lower=np.concatenate([np.tile(lower_u, N), np.tile(lower_x, N)]),
        upper=np.concatenate([np.tile(upper_u, N), np.tile(upper_x, N)]),
        lower_g=np.concatenate([lower for _, lower, _ in rows]),
        upper_g=np.concatenate([upper for _, _, upper in rows]),
    )


Rows = tuple[ca.SX, Array, Array]
"""Constraints: their values, lower and upper limits."""


def _intervals(
    problem: OptimalControlProblem, x: ca.SX, u: ca.SX, p: ca.SX, signals: ca.SX
) -> tuple[ca.SX, ca.SX, Rows]:
    """Return cost and defects of all intervals, and what holds at their checks.

    Args:
        problem: The problem.
        x: States at the ends of the intervals, the initial state first, (nx, N + 1).
        u: Controls, shape (nu, N).
        p: Parameters.
        signals: Signals at the nodes, shape (ns, nodes).
    """
    interval, smooth, checks = stage(problem), _smooth(problem), problem.checks
    cost, defects, inside, between = ca.SX(0), [], [], []
    for k in range(problem.intervals):
        known = signals[:, k * checks : (k + 1) * checks + 1]
        after, spent, _ = interval(x[:, k], u[:, k], p, known)
        cost += spent
        defects.append(after[:, -1] - x[:, k + 1])
        # The state after the last check is a variable, with bounds of its own.
        states = ca.horzcat(after[:, :-1], x[:, k + 1])
        between.append(after[:, :-1])
        inside += [
            smooth(states[:, c], u[:, k], p, known[:, c + 1]) for c in range(checks)
        ]
    held = ca.vertcat(ca.SX(0, 1), *inside)
    values, lower, upper = _state_rows(problem, ca.horzcat(*between))
    rows = (
        ca.vertcat(held, values),
        np.concatenate([np.full(held.numel(), -np.inf), lower]),
        np.concatenate([np.zeros(held.numel()), upper]),
    )
    return cost, ca.vertcat(*defects), rows


def _smooth(problem: OptimalControlProblem) -> ca.Function:
    """Return (x, u, p, s) -> g of all path constraints, g <= 0."""
    rows = [c.inequalities(c.expression) for c in problem.constraints]
    symbols = [*problem.symbols().values()]
    return ca.Function("smooth", symbols, [ca.vertcat(ca.SX(0, 1), *rows)])


def _state_rows(problem: OptimalControlProblem, states: ca.SX) -> Rows:
    """Return bounded states, shape (nx, m), and their limits, state after state."""
    lower, upper = problem.state_limits
    bounded = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
    count = states.shape[1]
    rows = [states[int(i), k] for k in range(count) for i in bounded]
    return (
        ca.vertcat(ca.SX(0, 1), *rows),
        np.tile(lower[bounded], count),
        np.tile(upper[bounded], count),
    )


def _terminal_rows(
    problem: OptimalControlProblem, x: ca.SX, p: ca.SX, s: ca.SX
) -> Rows:
    """Return the terminal constraints' values and limits."""
    symbols = problem.symbols()
    at_end = [symbols["states"], symbols["parameters"], symbols["signals"]]
    constraints = problem.terminal_constraints
    rows = ca.vertcat(ca.SX(0, 1), *[c.expression for c in constraints])
    values = ca.Function("ends", at_end, [rows])(x, p, s)
    empty = np.empty(0)
    return (
        values,
        np.concatenate([empty, *[np.asarray(c.lower) for c in constraints]]),
        np.concatenate([empty, *[np.asarray(c.upper) for c in constraints]]),
    )
