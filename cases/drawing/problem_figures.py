"""Figures of any problem: states, controls, slack, cost, phase plane, plans, time.

Each is drawn where it applies: the slack where there are constraints, the phase plane
where a vehicle has two states, plans and time where there is more than one plan.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.drawing.drawing import COLOURS, colour, new_figure, write_figures
from swarmstart.cases.drawing.panels import (
    MOST_PANELS,
    Labels,
    Panel,
    bounds_of,
    escaped,
    grid,
    name_lines,
    panels_figure,
    panels_of,
    stacked_limits,
    wrapped,
)
from swarmstart.cases.drawing.plan_figures import (
    Flown,
    KnownOf,
    PlanPath,
    cost_figure,
    nothing_known,
    plan_paths,
    plans_figure,
    step_time_figure,
)
from swarmstart.cases.drawing.slack import Slack, slacks
from swarmstart.cases.record.trajectory_arrays import held_controls
from swarmstart.ocp import OptimalControlProblem, Solution, Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

BROKEN = "#D55E00"
_ROUNDING = 1e-2
"""Of the tolerance: an axis shows at least so much, so that rounding looks flat."""
_TITLE = 40
"""Characters of a line above a panel."""
_PLANE = 2
"""States of a phase plane."""


def draw_problem(
    problem: OptimalControlProblem | Sequence[OptimalControlProblem],
    trajectory: Trajectory,
    folder: Path,
    *,
    labels: Labels | None = None,
    known: KnownOf = nothing_known,
) -> list[Path]:
    """Write all figures that apply to a flight as PNG files; return them, in order.

    Args:
        problem: What is planned; of vehicles that plan one after another the problem of
            each, in the order of their states.
        trajectory: The flight.
        folder: Where the files go; made where it is missing.
        labels: The words on the axes; None: the names of the (first) model, no units.
        known: (number of a step, of a problem) -> parameters and signals of the plan
            made there; by default no parameters and signals.

    Raises:
        InvalidProblemError: If what is known does not fit a problem.
    """
    problems = (
        (problem,) if isinstance(problem, OptimalControlProblem) else tuple(problem)
    )
    vehicles = [f"vehicle {number}" for number in range(1, len(problems) + 1)]
    flown = Flown(
        problems=problems,
        trajectory=trajectory,
        labels=labels or labels_of(problems[0], vehicles=vehicles),
        known=known,
    )
    return write_figures(_figures(flown), folder)


def _figures(flown: Flown) -> "Iterator[tuple[str, Figure]]":
    """Yield the figures that apply, with their names."""
    trajectory, labels = flown.trajectory, flown.labels
    on_states, on_controls = stacked_limits(flown.problems)
    shown = len(labels.states) * len(labels.vehicles)
    lower, upper = on_states
    states = panels_of(
        labels.states,
        labels,
        trajectory.dense_times,
        trajectory.dense_states[:shown],  # Others are what phases remember.
        (lower[:shown], upper[:shown]),
    )
    yield "a_states", panels_figure({"states": states}, labels)
    controls = panels_of(
        labels.controls, labels, *held_controls(trajectory), on_controls
    )
    if controls:
        yield "b_controls", panels_figure({"controls": controls}, labels)
    rows = [
        replace(row, name=f"{labels.vehicles[number]}: {row.name}")
        if len(flown.problems) > 1
        else row
        for number, part in enumerate(flown.parts())
        for row in slacks(*part)
    ]
    if rows:
        steps = trajectory.controls.shape[1]
        yield "c_slack", slack_figure([_within(row, labels, steps) for row in rows])
    costs = cost_figure(flown)
    if costs is not None:
        yield "d_cost", costs
    plans = plan_paths(flown) if flown.fresh.size > 1 else []
    if len(labels.states) == _PLANE:
        yield "e_phase_plane", phase_plane_figure(states[0], states[1], plans, labels)
    if plans:
        yield "f_plans", plans_figure(states, plans, labels)
        yield "g_step_time", step_time_figure(trajectory)


def _within(row: Slack, labels: Labels, steps: int) -> Slack:
    """Return a row that is drawn only while its phase lasts."""
    for name, (begin, end) in labels.spans.items():
        if row.name.endswith(name) and not row.is_terminal:
            interval = np.arange(row.times.size) // (row.times.size // steps)
            inside = (interval >= begin) & (interval < end)
            return replace(row, values=np.where(inside, row.values, np.nan))
    return row


def draw_solution(
    solution: Solution, *, units: Mapping[str, str] | None = None
) -> "Figure":
    """Return states along the verified path, and controls, with their bounds.

    Args:
        solution: The solution.
        units: Unit by name of a state or control; None: none is known.
    """
    problem, path = solution.problem, solution.path
    labels = labels_of(problem, units=units)
    instants = np.linspace(0.0, solution.times[-1], problem.intervals + 1)
    on_states, on_controls = stacked_limits([problem])
    blocks = {
        "states": panels_of(labels.states, labels, path.times, path.states, on_states),
        "controls": panels_of(
            labels.controls, labels, instants, solution.controls, on_controls
        ),
    }
    return panels_figure(blocks, labels)


def draw_trajectory(
    trajectory: Trajectory, *, labels: Labels | None = None
) -> "Figure":
    """Return states and held controls of a flight.

    Args:
        trajectory: The flight.
        labels: The words on the axes; None: the trajectory's own names.
    """
    if labels is None:
        labels = Labels(
            states=trajectory.state_names, controls=trajectory.control_names
        )
    times = trajectory.dense_times
    blocks = {
        "states": panels_of(labels.states, labels, times, trajectory.dense_states),
        "controls": panels_of(labels.controls, labels, *held_controls(trajectory)),
    }
    return panels_figure(blocks, labels)


def labels_of(
    problem: OptimalControlProblem,
    *,
    units: Mapping[str, str] | None = None,
    vehicles: Sequence[str] = ("",),
) -> Labels:
    """Return the names of a problem's model, as those of one vehicle."""
    return Labels(
        states=problem.model.state_names,
        controls=problem.model.control_names,
        units=units or {},
        vehicles=vehicles,
        maximize=problem.maximize,
    )


def slack_figure(rows: Sequence[Slack]) -> "Figure":
    """Return the slack of each row, below 0 shaded, and where it counts.

    Args:
        rows: Of path and terminal constraints, at least one.
    """
    shown = rows[:MOST_PANELS]
    figure, (block,) = grid([len(shown)])
    for axes, row in zip(block, shown, strict=True):
        _draw_slack(axes, row)
    title = "distance to the limit, broken below 0 (of an equality: off 0)"
    if len(rows) > len(shown):
        title = f"the first {len(shown)} of {len(rows)} rows: {title}"
    figure.suptitle(title, fontsize="medium")
    name_lines(figure)
    return figure


def _draw_slack(axes: "Axes", row: Slack) -> None:
    axes.axhline(0.0, color="0.25", ls="--", lw=1.0)
    axes.plot(row.times, row.values, color=COLOURS[0], lw=1.2)
    if row.is_terminal:
        end = row.values[-1]
        broken = abs(end) > row.tolerance if row.is_equality else end < -row.tolerance
        axes.plot(
            row.times[-1], end, "o", ms=5, clip_on=False,
            color=BROKEN if broken else COLOURS[2],
            label="broken at the end" if broken else "kept at the end",
        )  # fmt: skip
    else:
        broken = (row.values != 0.0) if row.is_equality else row.values < 0.0
        axes.fill_between(
            row.times, row.values, 0.0, where=broken, interpolate=True, color=BROKEN,
            alpha=0.35, lw=0, label="broken" if broken.any() else None,
        )  # fmt: skip
    low, high = axes.get_ylim()
    rounding = _ROUNDING * row.tolerance
    axes.set_ylim(min(low, -rounding), max(high, rounding))
    axes.set_title(wrapped(row.name, width=_TITLE), fontsize="small", loc="left")


def phase_plane_figure(
    first: Panel, second: Panel, plans: Sequence[PlanPath], labels: Labels
) -> "Figure":
    """Return the second state of each vehicle against its first.

    Args:
        first: The first state.
        second: The second state.
        plans: Drawn thin beneath.
        labels: The words.
    """
    figure = new_figure((6.5, 5.0))
    axes = figure.add_subplot()
    for plan in plans:
        for x, y in zip(plan.states[::2], plan.states[1::2], strict=True):
            axes.plot(x, y, color="0.6", lw=0.6, zorder=1, label="plans")
    for number, (x, y) in enumerate(zip(first.values, second.values, strict=True)):
        own = colour(number)
        name = escaped(labels.vehicles[number]) if labels.are_named else None
        axes.plot(x, y, color=own, lw=1.4, label=name)
        axes.plot(x[0], y[0], "o", color=own, fillstyle="none", label="start")
        axes.plot(x[-1], y[-1], "s", color=own, ms=5, label="end")
    for panel, line in ((first, axes.axvline), (second, axes.axhline)):
        for bound, own in bounds_of(panel)[0]:
            line(bound, color=own, ls="--", lw=1.0, label="bound")
    axes.set(xlabel=escaped(first.label), ylabel=escaped(second.label))
    axes.grid(alpha=0.3)
    name_lines(figure)
    return figure
