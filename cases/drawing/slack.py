"""Distance of a run from the limits of each constraint, along its fine path.

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

from swarmstart.arrays import Array
from swarmstart.cases.record.trajectory_arrays import (
    control_rows,
    held_controls,
    new_plans,
)
from swarmstart.ocp import Constraint, Known, OptimalControlProblem, Plan, Trajectory
from swarmstart.ocp.rollout import (
    Arguments,
    ConstraintRows,
    Shooting,
    at_nodes,
    core_known,
    shared_arguments,
    signals_between,
)
from swarmstart.ocp.statement import Lowered

KnownAt = Callable[[int], Known]
"""Number of a step -> parameters and signals of the plan made there."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Slack:
    """One row of a constraint along a path.

    Attributes:
        name: Of the row.
        times: Shape (n,) [s]; a control instant occurs twice, before and after.
        values: Slack, or deviation from the limit of an equality, shape (n,).
        tolerance: Largest excess that counts as none, in the row's units.
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
        problem: The problem that is planned.
        trajectory: States and controls of this problem's model.
        known: Parameters and signals of each plan.
    """
    shooting = Shooting(problem)
    lowered, problem = shooting.lowered, shooting.problem
    stated, ends = problem.stated, problem.terminal_constraints
    if not (stated or ends):
        return []
    times, arguments = _along(lowered, trajectory, known)
    plan = trajectory.decisions[0].plans[0] if trajectory.decisions else None
    begin = arguments_of(lowered, plan, trajectory, 0, known)
    sizes = Arguments(shooting).sizes(*begin)
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


def arguments_of(
    lowered: Lowered,
    plan: Plan | None,
    trajectory: Trajectory,
    step: int,
    known: KnownAt,
) -> tuple[Array, Known]:
    """Return initial state, parameters and signals of a plan, as the core has them.

    Args:
        lowered: The problem with its core.
        plan: The plan; None: there is none.
        trajectory: The run.
        step: Number of the step at which it was made.
        known: Parameters and signals of each plan.
    """
    given = known(step)
    start = lowered.start(trajectory.states[:, step], given.previous)
    if plan is not None and (plan.states.size or plan.start is not None):
        start = plan.x0
    return start, core_known(lowered, given)


def _along(
    lowered: Lowered, trajectory: Trajectory, known: KnownAt
) -> tuple[Array, tuple[Array, Array, Array, Array]]:
    """Return times, and states, controls, parameters and signals of the core there."""
    core, linear = lowered.core, control_rows(trajectory)
    steps = trajectory.controls.shape[1]
    m = (trajectory.dense_times.size - 1) // steps
    columns = np.arange(steps)[:, None] * m + np.arange(m + 1)
    times, parameters, signals, states = trajectory.dense_times[columns], [], [], []
    if lowered.stated.model.jumps and m > 1:
        columns[:-1, -1] -= 1  # What the end changes begins the next interval.
    controls = _held(trajectory, m) if linear is None else linear
    before, knots = lowered.places["previous"], lowered.places["knots"]
    for step, made in enumerate(made_at(trajectory)):
        decisions = trajectory.decisions
        plan = decisions[made].plans[0] if decisions else None
        start, given = arguments_of(lowered, plan, trajectory, int(made), known)
        _, p, flat = shared_arguments(core, start, given)
        since = times[step] - trajectory.times[made]
        since = since * (core.length / lowered.end_time(start))
        signals.append(signals_between(core, at_nodes(core, flat), since))
        parameters.append(np.tile(p[:, None], (1, m + 1)))
        states.append(lowered.states(trajectory.dense_states[:, columns[step]], start))
        if before and step > 0:
            states[-1][before] = controls[:, step - 1, -1:]
        if knots:
            first = np.repeat(controls[:, step, :1], m + 1, axis=1)
            states[-1][knots] = np.vstack([controls[:, step], first])
    return times.ravel(), (
        np.hstack(states),
        controls.reshape(len(controls), -1),
        np.hstack(parameters),
        np.hstack(signals),
    )


def _held(trajectory: Trajectory, m: int) -> Array:
    """Return held controls at both ends of the plant's m steps, (nu, T, m + 1)."""
    held, steps = held_controls(trajectory)[1], trajectory.controls.shape[1]
    every = held.shape[1] // steps  # 1, or m: each of the plant's steps its own.
    controls = np.repeat(held.reshape(len(held), steps, every), m // every, axis=2)
    return np.concatenate([controls, controls[:, :, -1:]], axis=2)


def made_at(trajectory: Trajectory) -> NDArray[np.intp]:
    """Return the step at which the plan that is used in each step was made."""
    if not trajectory.decisions:
        return np.zeros(trajectory.controls.shape[1], dtype=np.intp)
    fresh = new_plans(trajectory.decisions).any(axis=1)
    made: NDArray[np.intp] = np.where(fresh, np.arange(fresh.size), 0)
    return np.maximum.accumulate(made)
