"""An answer that breaks a constraint between the checks, solved again with a margin.

The constraint is tightened by what was measured, and the problem solved again from the
answer. What counts as measured: the path's excess (path.py), and, of a separation along
segments, what its chords cut, since an NLP sees points only.
"""

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.ocp.checking import Excess
from swarmstart.ocp.constraints import Bounds, Constraint, PathConstraint
from swarmstart.ocp.fitness import Known, shared_arguments
from swarmstart.ocp.problem import OptimalControlProblem, label
from swarmstart.ocp.separation import Connection, Separation
from swarmstart.ocp.solution import Solution

Array = NDArray[np.float64]
ATTEMPTS = 3
_MORE = 1.05
"""Margins are this times what was measured: the next path is another one."""


def needed(
    problem: OptimalControlProblem, solution: Solution, x0: ArrayLike, known: Known
) -> list[Excess]:
    """Return the excesses of a solution that a margin could remove, the worst first.

    Args:
        problem: The problem as the user stated it.
        solution: An answer to it.
        x0: Initial state, shape (nx,).
        known: Parameters and signals.
    """
    on_path = [
        e
        for e in solution.path.broken
        if e.constraint < len(problem.path_constraints)
        and problem.path_tolerance < e.relative < np.inf
    ]
    measured = [*on_path, *_cut_by_chords(problem, solution, x0, known)]
    return sorted(measured, key=lambda e: -e.relative)


def tightened(
    problem: OptimalControlProblem, excesses: Sequence[Excess]
) -> OptimalControlProblem:
    """Return a problem whose constraints have margins for what was measured.

    Args:
        problem: The problem, margins of an earlier attempt included.
        excesses: What its answer breaks.
    """
    constraints = list(problem.constraints)
    lower, upper = (limits.copy() for limits in problem.state_limits)
    for excess in excesses:
        margin = _MORE * excess.amount + problem.path_tolerance * excess.scale / 2
        if excess.constraint < len(constraints):
            constraints[excess.constraint] = _with_margin(
                constraints[excess.constraint], excess, margin
            )
            continue
        bounded = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper))
        state = bounded[excess.row]
        _move_limit(lower, upper, state, excess.above, margin)
    bounds = Bounds(
        controls=problem.bounds.controls,
        states=(lower, upper),
        state_scale=problem.bounds.state_scale,
    )
    return replace(problem, constraints=constraints, bounds=bounds)


def at_points(problem: OptimalControlProblem) -> OptimalControlProblem:
    """Return a problem whose separations are measured at points, as in an NLP."""
    return replace(
        problem,
        constraints=[
            replace(c, along="points", margin=c.smooth_margin)
            if isinstance(c, Separation)
            else c
            for c in problem.constraints
        ],
    )


def has_segments(problem: OptimalControlProblem) -> bool:
    """Return whether a separation of the problem is measured along segments."""
    return any(
        isinstance(c, Separation) and c.along == "segments" for c in problem.constraints
    )


def _with_margin(constraint: Constraint, excess: Excess, margin: float) -> Constraint:
    """Return a constraint with a larger margin; unknown kinds stay as they are."""
    if isinstance(constraint, Separation):
        return replace(
            constraint,
            margin=constraint.margin + margin,
            smooth_margin=constraint.smooth_margin + margin,
        )
    if isinstance(constraint, Connection):
        most = constraint.distance - constraint.margin
        return replace(constraint, margin=constraint.margin + min(margin, 0.5 * most))
    if isinstance(constraint, PathConstraint):
        lower, upper = np.array(constraint.lower), np.array(constraint.upper)
        _move_limit(lower, upper, excess.row, excess.above, margin)
        return replace(constraint, lower=lower, upper=upper, name=label(constraint))
    return constraint


def _move_limit(
    lower: Array, upper: Array, row: int, above: bool, margin: float
) -> None:
    """Tighten one limit in place, at most to the middle of what it leaves."""
    width = upper[row] - lower[row]
    margin = min(margin, width / 2) if np.isfinite(width) else margin
    if above:
        upper[row] -= margin
    else:
        lower[row] += margin


def _cut_by_chords(
    problem: OptimalControlProblem, solution: Solution, x0: ArrayLike, known: Known
) -> list[Excess]:
    """Return what the chords of separations along segments cut, at the worst."""
    found = []
    _, p, flat = shared_arguments(problem, x0, known)
    x, s = solution.plan.states, flat.reshape((problem.ns, problem.nodes), order="F")
    columns = np.arange(problem.nodes - 1) // problem.checks
    u, many = solution.controls[:, columns], np.tile(p[:, None], (1, columns.size))
    start, end = (
        [ca.SX.sym(n, s.numel()) for n, s in problem.symbols().items()]
        for _ in range(2)
    )
    for number, c in enumerate(problem.constraints):
        if not isinstance(c, Separation) or c.along != "segments":
            continue
        value = ca.Function("value", [*problem.symbols().values()], [c.expression])
        excess = ca.Function(
            "excess", [*start, *end], [c.excess(value(*start), value(*end))]
        )
        ends = (x[:, :-1], u, many, s[:, :-1]), (x[:, 1:], u, many, s[:, 1:])
        cut = np.array(excess(*ends[0], *ends[1])).ravel()
        k = int(np.argmax(cut))
        if cut[k] > 0:
            found.append(
                Excess(
                    name=f"the chord of '{label(c)}'",
                    amount=float(cut[k]),
                    scale=float(np.asarray(c.scale)[0]),
                    time=float(problem.times[k + 1]),
                    constraint=number,
                    row=0,
                    above=False,
                )
            )
    return found
