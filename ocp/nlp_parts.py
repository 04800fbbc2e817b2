"""One control interval, and the end, as functions of an NLP's own variables.

Everything is divided by its size (scaling.py): states, controls, cost, rows. So these
functions see and give numbers near one. The sizes are arguments; the cost's is in its
unit (`OptimalControlProblem.costs`).
"""

from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.ocp.constraints import Rows
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.shooting import Shooting

Array = NDArray[np.float64]


class LimitedRows(NamedTuple):
    """Rows with limits and where they come from.

    Attributes:
        values: Shape (m, 1).
        lower: Shape (m,).
        upper: Shape (m,).
        places: Of each row: number of its constraint among path and terminal
            constraints, and its row there.
    """

    values: ca.SX
    lower: Array
    upper: Array
    places: list[tuple[int, int]]


class Part(NamedTuple):
    """A part of the NLP with its derivatives by its own variables z.

    Attributes:
        cost: (z, shared, s) -> cost.
        value: (z, shared, s) -> g.
        cost_slope: (z, shared, s) -> (cost, its gradient).
        slopes: (z, shared, s) -> (g, its Jacobian).
        curvature: (z, shared, s, lam_f, lam_g) -> upper triangle of the Hessian of
            lam_f cost + lam_g' g.
        rows: The rows with limits among g, the last ones.
    """

    cost: ca.Function
    value: ca.Function
    cost_slope: ca.Function
    slopes: ca.Function
    curvature: ca.Function
    rows: LimitedRows


class Shared(NamedTuple):
    """Arguments that all parts share, one column: see `shared_symbols`."""

    parameters: ca.SX
    states: ca.SX
    controls: ca.SX
    cost: ca.SX

    def column(self) -> ca.SX:
        """Return all in one column."""
        return ca.vertcat(*self)


def shared_symbols(problem: OptimalControlProblem) -> Shared:
    """Return symbols of the parameters and of the sizes."""
    model = problem.model
    return Shared(
        ca.SX.sym("p", model.np),
        ca.SX.sym("size_x", model.nx),
        ca.SX.sym("size_u", model.nu),
        ca.SX.sym("size_f"),
    )


def interval_part(shooting: Shooting) -> Part:
    """Return an interval: z = (x, u), g = (x after, constraint rows).

    Args:
        shooting: The problem's functions.
    """
    problem = shooting.problem
    model, shared = problem.model, shared_symbols(problem)
    x_, u_ = ca.SX.sym("x", model.nx), ca.SX.sym("u", model.nu)
    s = ca.SX.sym("s", problem.ns, problem.checks + 1)
    state, u, p = x_ * shared.states, u_ * shared.controls, shared.parameters
    constraints = [
        *enumerate(zip(problem.path_constraints, shooting.path_values, strict=True))
    ]
    on_states = len(problem.constraints)  # Bounds, the last one if there are any.
    cost, parts = ca.SX(0), []
    if problem.quadrature == "left":
        cost = problem.dt * shooting.stage_cost(state, u, p, s[:, 0])
    for number, (constraint, value) in constraints:
        rows = constraint.smooth(value(state, u, p, s[:, 0]))
        parts.append(_limited(rows, number, shooting.rows_with_controls[number]))
    for k in range(problem.checks):
        state, spent = shooting.check_step(state, u, p, (s[:, k], s[:, k + 1]))
        cost += spent
        for number, (constraint, value) in constraints:
            if number == on_states and k == problem.checks - 1:
                continue  # The states after an interval are variables, with bounds.
            rows = constraint.smooth(value(state, u, p, s[:, k + 1]))
            parts.append(_limited(rows, number, None))
    if problem.quadrature == "right":
        cost = problem.dt * shooting.stage_cost(state, u, p, s[:, -1])
    limited = _joined(parts)
    g = ca.vertcat(state / shared.states, limited.values)
    return _part(ca.vertcat(x_, u_), shared, s, cost, g, limited)


def end_part(shooting: Shooting) -> Part:
    """Return the end of the horizon: z = x, g = terminal rows.

    Args:
        shooting: The problem's functions.
    """
    problem = shooting.problem
    symbols, shared = problem.symbols(), shared_symbols(problem)
    first = len(problem.path_constraints)
    x_ = ca.SX.sym("x", problem.model.nx)
    rows = _joined(
        [
            _limited(constraint.smooth(constraint.expression), first + number, None)
            for number, constraint in enumerate(problem.terminal_constraints)
        ]
    )
    at_end = ca.Function(
        "end",
        [symbols["states"], symbols["parameters"], symbols["signals"]],
        [shooting.costs[2], rows.values],
    )
    s = ca.SX.sym("s", problem.ns)
    cost, values = at_end(x_ * shared.states, shared.parameters, s)
    return _part(x_, shared, s, cost, values, rows)


def _part(
    z: ca.SX, shared: Shared, s: ca.SX, cost: ca.SX, g: ca.SX, rows: LimitedRows
) -> Part:
    """Return a part with its derivatives; the last rows of g get a weight each."""
    weights = ca.SX.sym("weights", len(rows.places))
    free = g.numel() - weights.numel()
    first, limited = ca.vertsplit(g, [0, free, g.numel()])
    g = ca.vertcat(first, limited * weights)
    cost = cost / shared.cost
    arguments = [z, ca.vertcat(shared.column(), weights), s]
    lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", g.numel())
    lagrangian = lam_f * cost + ca.dot(lam_g, g)
    return Part(
        ca.Function("cost", arguments, ca.cse([cost])),
        ca.Function("value", arguments, ca.cse([g])),
        ca.Function("cost_slope", arguments, ca.cse([cost, ca.gradient(cost, z)])),
        ca.Function("slopes", arguments, ca.cse([g, ca.jacobian(g, z)])),
        ca.Function(
            "curvature",
            [*arguments, lam_f, lam_g],
            ca.cse([ca.triu(ca.hessian(lagrangian, z)[0])]),
        ),
        rows,
    )


def _limited(rows: Rows, number: int, chosen: list[int] | None) -> LimitedRows:
    """Return the chosen rows that have a limit."""
    limited = np.isfinite(rows.lower) | np.isfinite(rows.upper)
    kept = [
        int(i) for i in np.flatnonzero(limited) if chosen is None or int(i) in chosen
    ]
    return LimitedRows(
        rows.values[kept] if kept else ca.SX(0, 1),
        rows.lower[kept],
        rows.upper[kept],
        [(number, row) for row in kept],
    )


def _joined(parts: list[LimitedRows]) -> LimitedRows:
    empty = np.empty(0)
    return LimitedRows(
        ca.vertcat(ca.SX(0, 1), *[part.values for part in parts]),
        np.concatenate([empty, *[part.lower for part in parts]]),
        np.concatenate([empty, *[part.upper for part in parts]]),
        [place for part in parts for place in part.places],
    )
