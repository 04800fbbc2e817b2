"""Distance of a flight from the limits of each constraint, along its fine path.

    slack   value - lower, upper - value, or the smaller of both: negative if broken
    off     value - limit of an equality: any value but 0 breaks it

Path constraints hold all along; terminal constraints only at the end of a horizon, but
their rows are followed on the way there. Bounds of states are not among them: they are
drawn with the states.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.record.trajectory_arrays import new_plans
from swarmstart.ocp import Constraint, Known, OptimalControlProblem, Trajectory
from swarmstart.ocp.checking import ConstraintRows
from swarmstart.ocp.fitness import Arguments, at_nodes, shared_arguments
from swarmstart.ocp.path import signals_between
from swarmstart.ocp.shooting import Shooting

Array = NDArray[np.float64]
KnownAt = Callable[[int], Known]
"""Number of a step -> parameters and signals of the plan made there."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Slack:
    """One row of a constraint along a path.

    Attributes:
        name: Of the row.
        times: Shape (n,) [s]; a control instant occurs twice, before and after.
        values: Slack, or what an equality is off by, shape (n,).
        tolerance: What a path may break it by, in the row's units.
        is_equality: Whether any value but 0 breaks it.
        is_terminal: Whether it must hold at the end only.
    """

    name: str
    times: Array
    values: Array
    tolerance: float
    is_equality: bool
    is_terminal: bool


def slacks(
    problem: OptimalControlProblem, trajectory: Trajectory, known: KnownAt
) -> list[Slack]:
    """Return the rows of all path constraints, then of all terminal constraints.

    Args:
        problem: What is planned.
        trajectory: States and controls of this problem's model.
        known: Parameters and signals of each plan.
    """
    stated, ends = problem.stated, problem.terminal_constraints
    if not (stated or ends):
        return []
    times, arguments = _along(problem, trajectory, known)
    sizes = Arguments(Shooting(problem)).sizes(trajectory.states[:, 0], known(0))
    groups: list[tuple[tuple[Constraint, ...], int]] = [
        (stated, 0),
        (ends, len(problem.path_constraints)),
    ]
    found = []
    for is_terminal, (constraints, first) in enumerate(groups):
        rows = ConstraintRows(problem, constraints, first=first)
        equal, values = rows.lower == rows.upper, rows.values(*arguments)
        inside = np.minimum(values - rows.lower, rows.upper - values)
        drawn = np.where(equal, values - rows.lower, inside)
        for i, (number, row) in enumerate(rows.places):
            found.append(
                Slack(
                    name=rows.names[i].replace("'", ""),
                    times=times,
                    values=drawn[i],
                    tolerance=problem.path_tolerance * float(sizes.rows[number][row]),
                    is_equality=bool(equal[i, 0]),
                    is_terminal=bool(is_terminal),
                )
            )
    return found


def _along(
    problem: OptimalControlProblem, trajectory: Trajectory, known: KnownAt
) -> tuple[Array, tuple[Array, Array, Array, Array]]:
    """Return times, and states, controls, parameters and signals at each."""
    steps = trajectory.controls.shape[1]
    m = (trajectory.dense_times.size - 1) // steps
    columns = np.arange(steps)[:, None] * m + np.arange(m + 1)
    times, parameters, signals = trajectory.dense_times[columns], [], []
    for step, made in enumerate(made_at(trajectory)):
        _, p, flat = shared_arguments(
            problem, trajectory.states[:, 0], known(int(made))
        )
        since = times[step] - trajectory.times[made]
        signals.append(signals_between(problem, at_nodes(problem, flat), since))
        parameters.append(np.tile(p[:, None], (1, m + 1)))
    return times.ravel(), (
        trajectory.dense_states[:, columns.ravel()],
        np.repeat(trajectory.controls, m + 1, axis=1),
        np.hstack(parameters),
        np.hstack(signals),
    )


def made_at(trajectory: Trajectory) -> NDArray[np.intp]:
    """Return at which step the plan that is flown in each step was made."""
    if not trajectory.decisions:
        return np.zeros(trajectory.controls.shape[1], dtype=np.intp)
    fresh = new_plans(trajectory.decisions).any(axis=1)
    made: NDArray[np.intp] = np.where(fresh, np.arange(fresh.size), 0)
    return np.maximum.accumulate(made)
