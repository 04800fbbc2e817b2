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
    model, N, checks = problem.model, problem.intervals, problem.checks
    u, x = ca.SX.sym("u", model.nu, N), ca.SX.sym("x", model.nx, N)
    x0, p = ca.SX.sym("x0", model.nx), ca.SX.sym("p", model.np)
    signals = ca.SX.sym("s", problem.ns, problem.nodes)

    interval = stage(problem)
    smooth = ca.Function(
        "smooth",
        [*problem.symbols().values()],
        [
            ca.vertcat(
                ca.SX(0, 1),
                *[c.inequalities(c.expression) for c in problem.constraints],
            )
        ],
    )
    cost, before = ca.SX(0), x0
    defects, inside, limited = [], [], []
    for k in range(N):
        known = signals[:, k * checks : (k + 1) * checks + 1]
        after, spent, _ = interval(before, u[:, k], p, known)
        cost += spent
        defects.append(after[:, -1] - x[:, k])
        for c in range(checks):
            # The last check's state is a variable: its bounds are bounds on w.
            state = x[:, k] if c == checks - 1 else after[:, c]
            inside.append(smooth(state, u[:, k], p, known[:, c + 1]))
            if c < checks - 1:
                limited.append(state)
        before = x[:, k]
    end_cost, _ = terminal(problem)(before, p, signals[:, -1])
    ends, end_lower, end_upper = _terminal_rows(problem, before, p, signals[:, -1])

    # State bounds between the intervals' ends, only where there are any.
    lower_x, upper_x = problem.state_limits
    bounded = np.flatnonzero(np.isfinite(lower_x) | np.isfinite(upper_x))
    between = [state[int(i)] for state in limited for i in bounded]

    g_defect = ca.vertcat(*defects)
    g_inside = ca.vertcat(ca.SX(0, 1), *inside)
    zeros = np.zeros(g_defect.numel())
    lower_u, upper_u = problem.control_limits
    return NonlinearProgram(
        nlp={
            "x": ca.vertcat(ca.vec(u), ca.vec(x)),
            "p": ca.vertcat(x0, p, ca.vec(signals)),
            "f": cost + end_cost,
            "g": ca.vertcat(g_defect, g_inside, ca.SX(0, 1), *between, ends),
        },
        lower=np.concatenate([np.tile(lower_u, N), np.tile(lower_x, N)]),
        upper=np.concatenate([np.tile(upper_u, N), np.tile(upper_x, N)]),
        lower_g=np.concatenate(
            [
                zeros,
                np.full(g_inside.numel(), -np.inf),
                np.tile(lower_x[bounded], len(limited)),
                end_lower,
            ]
        ),
        upper_g=np.concatenate(
            [
                zeros,
                np.zeros(g_inside.numel()),
                np.tile(upper_x[bounded], len(limited)),
                end_upper,
            ]
        ),
    )


def _terminal_rows(
    problem: OptimalControlProblem, x: ca.SX, p: ca.SX, s: ca.SX
) -> tuple[ca.SX, Array, Array]:
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
