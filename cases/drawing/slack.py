"""Figures of the distance from the limits of each constraint, along a run's fine path.

    slack   value - lower, upper - value, or the smaller of both: negative if broken
    off     value - limit of an equality: any value but 0 breaks it

Path constraints must hold at all times; in the figure the area below 0 is shaded.
Terminal constraints count at the end only: each is a point there, in multiples of its
tolerance. Bounds of states are left out, as they are drawn with the states.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import COLOURS, name_lines, new_figure
from swarmstart.cases.drawing.panels import (
    MOST_PANELS,
    MovingBound,
    columns_of,
    grid_in,
    grid_size,
    wrapped,
)
from swarmstart.cases.record.trajectory_arrays import (
    control_rows,
    held_controls,
    new_plans,
)
from swarmstart.ocp import (
    Constraint,
    Known,
    OptimalControlProblem,
    Plan,
    Solution,
    Trajectory,
)
from swarmstart.ocp.loop import ReferenceSignals, rows_before_jumps
from swarmstart.ocp.rollout import (
    Arguments,
    ConstraintRows,
    Shooting,
    at_nodes,
    core_known,
    shared_arguments,
    shooting_of,
    signals_between,
)
from swarmstart.ocp.statement import Lowered
from swarmstart.ocp.system import MOVING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase

_ROLES = {f"{MOVING}{role}": role for role in ("states", "controls")}
"""Name of the constraint of a moving bound -> what it bounds."""
KnownAt = Callable[[int], Known]
"""Number of a step -> parameters and signals of the plan made there."""

BROKEN = COLOURS[1]
_ROUNDING = 1e-2
"""Of the tolerance: an axis shows at least so much, so that rounding looks flat."""
_TITLE = 40
"""Characters of a line above a panel."""
_LINEAR = 2.0
"""Tolerances up to which the axis of end conditions is linear."""
_WIDE, _ROW_HIGH = 7.0, 0.35
"""Width of a figure of end conditions alone, height of a row there [inches]."""
_LIMIT = (
    "distance to the limit, in the constraint's own unit; broken below 0 "
    "(of an equality: off 0)"
)


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Slack:
    """One row of a constraint along a path.

    Attributes:
        name: Name of the row.
        times: Instants, shape (n,) [s]; a control instant occurs twice, before and
            after the change of controls. For a terminal constraint it is the end alone.
        values: Distance to the nearer limit, negative if it is broken; for an equality
            the deviation from its limit. Shape (n,).
        tolerance: Largest excess that does not count as broken, in the row's units.
        is_equality: Whether the row is an equality, which any value but 0 breaks.
        is_terminal: Whether the row must hold at the end only.
    """

    name: str
    times: Array
    values: Array
    tolerance: float
    is_equality: bool
    is_terminal: bool


def slacks(
    problem: OptimalControlProblem,
    trajectory: Trajectory,
    known: KnownAt,
    true: ReferenceSignals | None = None,
) -> list[Slack]:
    """Return the rows of all path constraints, then of all terminal constraints.

    Args:
        problem: The problem that is planned.
        trajectory: States and controls of this problem's model.
        known: Number of a step -> parameters and signals of the plan made then.
        true: Times -> the first signals of the problem (those before the plans of other
            vehicles), as the simulated system has them; None means that they are those
            of the plans.
    """
    shooting = shooting_of(problem)
    lowered, problem = shooting.lowered, shooting.problem
    stated, ends = problem.stated, problem.terminal_constraints
    if not (stated or ends):
        return []
    times, arguments = _along(lowered, trajectory, known, true)
    plan = trajectory.decisions[0].plans[0] if trajectory.decisions else None
    begin = arguments_of(lowered, plan, trajectory, 0, known)
    sizes = Arguments(shooting).sizes(*begin)
    groups: list[tuple[tuple[Constraint, ...], int]] = [
        (stated, 0),
        # Numbered through: after all path constraints, stated ones or not.
        (ends, len(problem.path_constraints)),
    ]
    found = []
    for is_terminal, (constraints, first) in enumerate(groups):
        rows = ConstraintRows(problem, constraints, first=first)
        counts = slice(-1, None) if is_terminal else slice(None)
        equal = rows.lower == rows.upper
        values = rows.values(*(part[:, counts] for part in arguments))
        inside = np.minimum(values - rows.lower, rows.upper - values)
        drawn = np.where(equal, values - rows.lower, inside)
        for i, (number, row) in enumerate(rows.places):
            found.append(
                Slack(
                    name=rows.names[i].replace("'", ""),
                    times=times.ravel()[counts],
                    values=drawn[i],
                    tolerance=problem.path_tolerance * float(sizes.rows[number][row]),
                    is_equality=bool(equal[i, 0]),
                    is_terminal=bool(is_terminal),
                )
            )
    return found


def moving_bounds(
    problem: OptimalControlProblem,
    trajectory: Trajectory,
    known: KnownAt,
    true: ReferenceSignals | None = None,
) -> list[tuple[str, int, MovingBound]]:
    """Return the bounds that change over time, with what each bounds.

    Each is a triple: "states" or "controls", the index of the bounded state or control,
    and the bound.

    Args:
        problem: The problem that is planned.
        trajectory: States and controls of this problem's model.
        known: Number of a step -> parameters and signals of the plan made then.
        true: Times -> the first signals of the problem (those before the plans of other
            vehicles), as the simulated system has them; None means that they are those
            of the plans.
    """
    shooting = shooting_of(problem)
    if not _moving(shooting.problem):
        return []
    return _bounds(shooting, *_along(shooting.lowered, trajectory, known, true))


def moving_bounds_of(solution: Solution) -> list[tuple[str, int, MovingBound]]:
    """Return the bounds of a solution that change over time, along its finer path.

    Args:
        solution: The solution.

    Returns:
        As `moving_bounds`.
    """
    shooting, path = shooting_of(solution.problem), solution.path
    core, lowered = shooting.problem, shooting.lowered
    if not _moving(core):
        return []
    start = np.asarray(solution.plan.x0, dtype=np.float64)
    _, p, flat = shared_arguments(core, start, core_known(lowered, solution.known))
    since = path.times * (core.length / lowered.end_time(start))
    signals = signals_between(core, at_nodes(core, flat), since)
    n = path.times.size
    controls = np.concatenate([path.controls, path.controls[:, -1:]], axis=1)
    return _bounds(
        shooting,
        path.times,
        (
            path.states - lowered.origin[:, None],
            controls,
            np.tile(p[:, None], (1, n)),
            signals,
        ),
    )


def _moving(core: OptimalControlProblem) -> list[Constraint]:
    """Return the bounds that change over time, as constraints."""
    return [c for c in core.stated if c.name in _ROLES]


def _bounds(
    shooting: Shooting, times: Array, arguments: tuple[Array, Array, Array, Array]
) -> list[tuple[str, int, MovingBound]]:
    """Return moving bounds from states, controls, parameters, signals of the core."""
    core, model = shooting.problem, shooting.stated.model
    symbols = core.symbols()
    # As they are stated: a number may be subtracted from states of the core.
    stated = arguments[0] + shooting.lowered.origin[:, None]
    paths = {"states": (stated, model.nx), "controls": (arguments[1], model.nu)}
    found = []
    for constraint in _moving(core):
        role, rows = _ROLES[constraint.name], constraint.rows(constraint.expression)
        values = ca.Function("rows", [*symbols.values()], [rows.values])(*arguments)
        path, count = paths[role]
        for i, upper in enumerate(rows.upper):
            # A row is a state or a control less its bound, in which other states of the
            # core may stand.
            own = ca.which_depends(rows.values[i], symbols[role][:count])
            for j in np.flatnonzero(own):
                bound = MovingBound(
                    times=times.ravel(),
                    values=path[j] - values[i, :].full().ravel(),
                    is_upper=bool(np.isfinite(upper)),
                )
                found.append((role, int(j), bound))
    return found


def arguments_of(
    lowered: Lowered,
    plan: Plan | None,
    trajectory: Trajectory,
    step: int,
    known: KnownAt,
) -> tuple[Array, Known]:
    """Return initial state, parameters and signals of a plan for the problem's core.

    Args:
        lowered: The problem with its core, that is, the problem after all rewrites.
        plan: The plan; None if there is no plan.
        trajectory: The run.
        step: Number of the step at which the plan was made.
        known: Number of a step -> parameters and signals of the plan made then.
    """
    given = known(step)
    start = lowered.start(trajectory.states[:, step], given.previous)
    if plan is not None and _is_recorded(plan):
        start = plan.x0
    return start, core_known(lowered, given)


def _is_recorded(plan: Plan | None) -> bool:
    """Return whether the initial state of a plan is known."""
    return plan is not None and bool(plan.states.size or plan.start is not None)


def _along(
    lowered: Lowered,
    trajectory: Trajectory,
    known: KnownAt,
    true: ReferenceSignals | None,
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
    begin, base = np.empty(0), 0
    for step, made in enumerate(made_at(trajectory)):
        decisions = trajectory.decisions
        plan = decisions[made].plans[0] if decisions else None
        start, given = arguments_of(lowered, plan, trajectory, int(made), known)
        if step == 0 or _is_recorded(plan):  # Else the controls before count.
            begin, base = start, int(made)
        _, p, flat = shared_arguments(core, start, given)
        since = times[step] - trajectory.times[made]
        # The core's horizon has a fixed length; that of the answer may be decided.
        since = since * (core.length / lowered.end_time(start))
        nodes = at_nodes(core, flat)
        rows = signals_between(core, nodes, since)
        signals.append(_with_true(lowered, rows, true, times[step]))
        parameters.append(np.tile(p[:, None], (1, m + 1)))
        at, there = (step - first + np.arange(m + 1) / m for first in (base, made))
        for one in (at, there):
            one[-1] = np.nextafter(one[-1], 0.0)  # Before what the end changes.
        added = lowered.along(begin, controls[:, base : step + 1, -1], at)
        own = trajectory.dense_states[:, columns[step]]
        whole = lowered.signalled(np.vstack([own, added]), nodes, there)
        states.append(whole - lowered.origin[:, None])
    return times, (
        np.hstack(states),
        controls.reshape(len(controls), -1),
        np.hstack(parameters),
        np.hstack(signals),
    )


def _with_true(
    lowered: Lowered, rows: Array, true: ReferenceSignals | None, times: Array
) -> Array:
    """Return signals of the core over an interval, the first ones as they really are.

    Args:
        lowered: The problem with its core.
        rows: Signals of the plan, shape (ns, m + 1).
        true: Times -> the first rows of the signals; None: those of the plan.
        times: Times of the columns, shape (m + 1,) [s].
    """
    if true is None:
        return rows
    values = rows_before_jumps(true, times[None])
    own = [row for row in range(len(rows)) if row != lowered.time_row]
    found = rows.copy()
    found[own[: len(values)]] = values
    return found


def _held(trajectory: Trajectory, m: int) -> Array:
    """Return held controls at both ends of the plant's m steps, (nu, T, m + 1)."""
    held, steps = held_controls(trajectory)[1], trajectory.controls.shape[1]
    every = held.shape[1] // steps  # 1, or m: each of the plant's steps its own.
    controls = np.repeat(held.reshape(len(held), steps, every), m // every, axis=2)
    return np.concatenate([controls, controls[:, :, -1:]], axis=2)


def made_at(trajectory: Trajectory) -> NDArray[np.intp]:
    """Return, for each step, the number of the step at which its plan was made."""
    if not trajectory.decisions:
        return np.zeros(trajectory.controls.shape[1], dtype=np.intp)
    fresh = new_plans(trajectory.decisions).any(axis=1)
    made: NDArray[np.intp] = np.where(fresh, np.arange(fresh.size), 0)
    return np.maximum.accumulate(made)


def slack_figure(rows: Sequence[Slack]) -> "Figure":
    """Return the slack of path constraints over time, and of terminal ones at the end.

    Args:
        rows: Rows of path and terminal constraints, at least one.
    """
    along = [row for row in rows if not row.is_terminal][:MOST_PANELS]
    ends = [row for row in rows if row.is_terminal][:MOST_PANELS]
    below = 0.9 + _ROW_HIGH * len(ends) if ends else 0.0
    wide, high = grid_size([len(along)]) if along else (_WIDE, 0.0)
    figure = new_figure((wide, high + below))
    # Only a figure of both sorts is cut in two.
    upper: FigureBase = figure
    lower: FigureBase = figure
    if along and ends:
        cells = figure.add_gridspec(2, 1, height_ratios=(high, below))
        upper, lower = (figure.add_subfigure(cells[k, 0]) for k in (0, 1))
    if along:
        (block,) = grid_in(upper, [len(along)], columns=columns_of(len(along)))
        for axes, row in zip(block, along, strict=True):
            _draw_slack(axes, row)
        upper.suptitle(_LIMIT, fontsize="medium")
    if ends:
        _draw_ends(lower.subplots(), ends)
    left = len(rows) - len(along) - len(ends)
    if left:
        figure.supxlabel(f"{left} more of {len(rows)} rows are not drawn")
    name_lines(figure)
    return figure


def _draw_slack(axes: "Axes", row: Slack) -> None:
    axes.axhline(0.0, color="0.25", ls=":", lw=1.4)
    axes.plot(row.times, row.values, color=COLOURS[0], lw=1.2)
    broken = (row.values != 0.0) if row.is_equality else row.values < 0.0
    axes.fill_between(
        row.times, row.values, 0.0, where=broken, interpolate=True, color=BROKEN,
        alpha=0.35, lw=0, label="broken" if broken.any() else None,
    )  # fmt: skip
    low, high = axes.get_ylim()
    rounding = _ROUNDING * row.tolerance
    axes.set_ylim(min(low, -rounding), max(high, rounding))
    name = wrapped(row.name, width=_TITLE)
    axes.set_title(f"{name}\n{_nearest(row)}", fontsize="small", loc="left")


def _nearest(row: Slack) -> str:
    """Return in words how near a path comes to the limit, and when."""
    sizes = np.abs(row.values) if row.is_equality else -row.values
    if not np.isfinite(sizes).any():
        return "no finite value"
    k = int(np.nanargmax(np.where(np.isfinite(sizes), sizes, np.nan)))
    word = "farthest off" if row.is_equality else "least"
    return f"{word} {row.values[k]:.3g}, at {row.times[k]:.4g} s"


def _draw_ends(axes: "Axes", rows: Sequence[Slack]) -> None:
    """Draw a point for each terminal row, the first on top."""
    axes.axvspan(-1.0, 1.0, color="0.9", lw=0, label="within the tolerance")
    axes.axvline(0.0, color="0.25", ls=":", lw=1.4)
    for place, row in enumerate(rows):
        value = row.values[-1] / row.tolerance
        broken = not (abs(value) <= 1.0 if row.is_equality else value >= -1.0)
        axes.plot(
            value, place, "X" if broken else "o", ms=6,
            color=BROKEN if broken else COLOURS[2],
            label="broken at the end" if broken else "kept at the end",
        )  # fmt: skip
    names = [wrapped(row.name, width=_TITLE) for row in rows]
    axes.set_yticks(range(len(rows)), names, fontsize="small")
    axes.set(
        ylim=(len(rows) - 0.4, -0.6), xlabel="distance from the limit [tolerances]"
    )
    # Some room around the points, and around what is within the tolerance.
    off = [_LINEAR * row.values[-1] / row.tolerance for row in rows]
    low, high = min(*off, -_LINEAR), max(*off, _LINEAR)
    if max(-low, high) > _LINEAR:  # A large slack must not hide what is near 0.
        axes.set_xscale("symlog", linthresh=_LINEAR)
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    if np.isfinite([low, high]).all():
        axes.set_xlim(low, high)
    axes.grid(alpha=0.3)
    title = f"end conditions, at {rows[0].times[-1]:.4g} s"
    axes.set_title(title, fontsize="medium")
