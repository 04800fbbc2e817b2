"""Repair: a new solve with a margin, if an answer breaks a constraint between checks.

The constraint is tightened by the measured excess, and the problem is solved from the
answer. The excess is measured along the path (path.py). For a separation along
segments, a second excess is measured: how much the straight lines between the checks
come too near, since an NLP sees the checks only.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.ocp.answer.solution import Solution
from swarmstart.ocp.rollout.checking import Excess, Points
from swarmstart.ocp.rollout.fitness import Known, at_nodes, shared_arguments
from swarmstart.ocp.rollout.path import Tracer, signals_between
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.system.constraints import Constraint, PathConstraint
from swarmstart.ocp.system.separation import Connection, Separation, label

ATTEMPTS = 3
_MORE = 1.05
"""Factor of a margin over the measured excess, since the next path differs."""
_LEAST_EFFECT, _HASTE = 0.25, 0.25
"""Smallest effect of a margin that is trusted; extra factor for each later attempt."""


def needed(
    problem: OptimalControlProblem, solution: Solution, x0: ArrayLike, known: Known
) -> list[Excess]:
    """Return the excesses of a solution that a margin could remove, the worst first.

    Args:
        problem: The problem as the user stated it.
        solution: An answer to it.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
    """
    on_path = [
        e
        for e in solution.path.broken
        if e.constraint < len(problem.path_constraints)
        and problem.path_tolerance < e.relative < np.inf
    ]
    measured = [*on_path, *_cut_by_chords(problem, solution, x0, known)]
    return sorted(measured, key=lambda e: -e.relative)


Place = tuple[int, int, bool]
"""Number of the constraint, its row, and whether the upper limit is meant."""


def hurried(
    excesses: Sequence[Excess], last: Mapping[Place, float], attempt: int
) -> list[Excess]:
    """Return excesses enlarged by the part that the last margin did not remove.

    A margin moves the points that the NLP sees; the path between them follows only by a
    fraction c. The excesses of one constraint row in two answers give c, and thus the
    remaining margin (the secant method). It is multiplied by a factor that is 1 in the
    first attempt and grows with each further one.

    Args:
        excesses: Excesses of the last answer.
        last: Excess of each constraint row, by its `place_of`, in the answer before the
            last.
        attempt: Number of the attempt, from 0.
    """
    found = []
    for excess in excesses:
        before, part = last.get(place_of(excess)), 1.0
        if before is not None:
            part = min(max(1 - excess.amount / before, _LEAST_EFFECT), 1.0)
        amount = excess.amount * (1 + attempt * _HASTE) / part
        found.append(replace(excess, amount=amount))
    return found


def slack_at_checks(
    tracer: Tracer,
    solution: Solution,
    x0: ArrayLike,
    known: Known,
    times: int,
) -> dict[tuple[int, int], float]:
    """Return how far each path constraint stays within its limits at the checks.

    A margin below this distance would change nothing.

    Args:
        tracer: Tracer of the problem.
        solution: An answer to it.
        x0: Initial state, shape (nx,).
        known: Values of the parameters and signals.
        times: Factor for the number of checks of the solution.

    Returns:
        (Number of the constraint, row in it) -> smallest distance of this row.
    """
    problem = tracer.problem
    path, checks = solution.path, problem.intervals * problem.checks * times
    _, p, flat = shared_arguments(problem, x0, known)
    columns = np.linspace(0, path.times.size - 1, checks + 1).astype(int)[1:]
    at = np.linspace(0.0, problem.length, checks + 1)[1:]
    points = Points(
        path.times[columns],
        path.states[:, columns] - tracer.shooting.lowered.origin[:, None],
        path.controls[:, columns - 1],  # Held up to these times.
        signals_between(problem, at_nodes(problem, flat), at),
    )
    return tracer.checker.slack(points, p)


def added(
    margins: Mapping[Place, Excess],
    excesses: Sequence[Excess],
    slack: Mapping[tuple[int, int], float],
    coarser: float,
) -> dict[Place, Excess]:
    """Return the margins of each row: the earlier ones plus the measured excesses.

    If the slack of a row is larger than its earlier margin, it takes the place of this
    margin in the sum. With more checks than before all margins become smaller.

    Args:
        margins: Margins of the last attempt.
        excesses: Excesses of the answer that was found with these margins.
        slack: Smallest distance of each row to its limits at the checks, from
            `slack_at_checks`.
        coarser: Number of checks of the last attempt divided by that of the next one.
            Its square multiplies the margins, since an excess between checks falls
            with the square of their distance.
    """
    found = dict(margins)
    for excess in excesses:
        place = place_of(excess)
        before = found[place].amount if place in found else 0.0
        before = max(before, slack.get(place[:2], 0.0))
        found[place] = replace(excess, amount=before + excess.amount)
    return {
        place: replace(margin, amount=margin.amount * coarser**2)
        for place, margin in found.items()
    }


def place_of(excess: Excess) -> Place:
    """Return the limit and the row that an excess belongs to."""
    return excess.constraint, excess.row, excess.above


def tightened(
    problem: OptimalControlProblem,
    excesses: Sequence[Excess],
    *,
    for_all: float = 0.0,
) -> OptimalControlProblem:
    """Return a problem whose constraints have margins for the measured excesses.

    Args:
        problem: The problem.
        excesses: Excesses of an answer, or the margins wanted.
        for_all: Least margin that every constraint on distances gets, relative to its
            scale; 0: none. Without it one pair of vehicles may move into the room that
            another pair gives up.
    """
    constraints = list(problem.stated)
    if for_all:
        excesses = _shared_by_distances(constraints, excesses, for_all)
    lower, upper = (limits.copy() for limits in problem.state_limits)
    for excess in excesses:
        margin = _MORE * excess.amount + problem.path_tolerance * excess.scale / 2
        if excess.constraint < len(constraints):
            constraints[excess.constraint] = _with_margin(
                constraints[excess.constraint], excess, margin
            )
            continue
        state = problem.bounded_states[excess.row]
        _move_limit(lower, upper, state, excess.above, margin)
    bounds = replace(problem.bounds, states=(lower, upper))
    return replace(problem, constraints=[*constraints, *problem.soft], bounds=bounds)


def finer_checks(problem: OptimalControlProblem, attempt: int) -> int:
    """Return the factor for the number of checks: 1, 2, 4 in attempts 0, 1, 2.

    The integrator's steps stay the same if they can be divided evenly.
    """
    times = 2**attempt
    shared = math.gcd(problem.substeps, times)
    return shared if shared > 1 else times


def with_more_checks(
    problem: OptimalControlProblem, known: Known, times: int
) -> tuple[OptimalControlProblem, Known]:
    """Return a problem with more checks, whose integrator steps are not longer.

    Args:
        problem: The problem.
        known: Its parameters and signals; the signals are interpolated at the new
            nodes.
        times: Factor for the number of checks.
    """
    finer = replace(
        problem,
        checks=problem.checks * times,
        substeps=-(-problem.substeps // times),  # Rounded up.
    )
    shape = (problem.ns, problem.nodes)
    given = np.asarray(known.signals, dtype=np.float64).reshape(shape)
    return finer, Known(known.parameters, signals_between(problem, given, finer.times))


def at_points(problem: OptimalControlProblem) -> OptimalControlProblem:
    """Return a problem in which each `Separation` is measured at the checks only.

    The `margin` of the `Separation` is replaced by its `smooth_margin`, the one that
    the NLP uses, since the NLP sees these points only.
    """
    return replace(
        problem,
        constraints=[
            replace(c, along="points", margin=c.smooth_margin)
            if isinstance(c, Separation)
            else c
            for c in (*problem.stated, *problem.soft)
        ],
    )


def has_segments(problem: OptimalControlProblem) -> bool:
    """Return whether a `Separation` of the problem is measured along segments."""
    return any(
        isinstance(c, Separation) and c.along == "segments" for c in problem.stated
    )


def _shared_by_distances(
    constraints: Sequence[Constraint], excesses: Sequence[Excess], least: float
) -> list[Excess]:
    """Return margins, with those of distances at least a part of their scales."""
    own = {excess.constraint: excess for excess in excesses}
    distances = {}
    for number, c in enumerate(constraints):
        if isinstance(c, Separation):
            scale = float(np.asarray(c.scale)[0])
            amount = max(own[number].amount if number in own else 0.0, least * scale)
            distances[number] = replace(
                excesses[0], amount=amount, scale=scale, constraint=number, row=0
            )
    others = [e for e in excesses if e.constraint not in distances]
    return [*others, *distances.values()]


def _with_margin(constraint: Constraint, excess: Excess, margin: float) -> Constraint:
    """Return a constraint with a larger margin; unknown types stay unchanged."""
    if isinstance(constraint, Separation):
        return replace(
            constraint,
            margin=constraint.margin + margin,
            smooth_margin=constraint.smooth_margin + margin,
        )
    if isinstance(constraint, Connection):
        most = constraint.distance - constraint.margin
        # Some of the distance must be left.
        return replace(constraint, margin=constraint.margin + min(margin, 0.5 * most))
    if isinstance(constraint, PathConstraint):
        lower, upper = np.array(constraint.lower), np.array(constraint.upper)
        _move_limit(lower, upper, excess.row, excess.above, margin)
        return replace(constraint, lower=lower, upper=upper, name=label(constraint))
    return constraint


def _move_limit(
    lower: Array, upper: Array, row: int, above: bool, margin: float
) -> None:
    """Tighten one limit in place, at most to the middle of the allowed range."""
    width = upper[row] - lower[row]
    margin = min(margin, width / 2) if np.isfinite(width) else margin
    if above:
        upper[row] -= margin
    else:
        lower[row] += margin


def _cut_by_chords(
    problem: OptimalControlProblem, solution: Solution, x0: ArrayLike, known: Known
) -> list[Excess]:
    """Return the worst excess of the chords of separations along segments."""
    found = []
    _, p, flat = shared_arguments(problem, x0, known)
    x, s = solution.plan.states, at_nodes(problem, flat)
    columns = np.arange(problem.nodes - 1) // problem.checks
    u, many = solution.plan.controls[:, columns], np.tile(p[:, None], (1, columns.size))
    start, end = (
        [ca.SX.sym(n, s.numel()) for n, s in problem.symbols().items()]
        for _ in range(2)
    )
    for number, c in enumerate(problem.stated):
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
