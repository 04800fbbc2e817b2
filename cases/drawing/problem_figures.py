"""Figures of any problem: one sheet, and figures of what does not fit into it.

The sheet of a closed-loop run shows states with the plans beneath them, the cost of
each plan, controls with their bounds, and time of planning. The sheet of a problem
that was solved once shows states, convergence of the search, controls, and the local
optima that were found. Without a search, or with one optimum only, tracks or the phase
plane of two states take the place of the missing part. The slack of constraints is
drawn if there are any.

For a single result, `plot()` draws states, controls and outputs, as notebooks show
them.
"""

import base64
import html
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from swarmstart.cases.drawing.closest import draw_scene
from swarmstart.cases.drawing.drawing import (
    HALF,
    escaped,
    name_lines,
    new_figure,
)
from swarmstart.cases.drawing.panels import (
    Labels,
    MovingBound,
    Panel,
    panels_figure,
    panels_of,
    stacked_limits,
    without_tails,
)
from swarmstart.cases.drawing.plan_figures import (
    Flown,
    KnownOf,
    PlanPath,
    draw_convergence,
    draw_costs,
    draw_optima,
    nothing_known,
    optima_of,
    plan_paths,
    searches_figure,
    with_plans,
)
from swarmstart.cases.drawing.planning import draw_planning
from swarmstart.cases.drawing.sheet import MOST_IN_PART, Part, panels_part, sheet
from swarmstart.cases.drawing.signal_panels import signals_of_run, signals_of_solution
from swarmstart.cases.drawing.slack import (
    Slack,
    moving_bounds,
    moving_bounds_of,
    slack_figure,
    slacks,
)
from swarmstart.cases.drawing.tracks import Scene, draw_phase_plane
from swarmstart.cases.drawing.vehicles import directions_of
from swarmstart.cases.record.trajectory_arrays import held_controls
from swarmstart.ocp import OptimalControlProblem, Solution, Trajectory
from swarmstart.ocp.loop import ReferenceSignals

if TYPE_CHECKING:
    from matplotlib.figure import Figure, FigureBase

_PLANE = 2
"""States of a phase plane."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Place:
    """The states that are a position in the plane, and the discs in the plane.

    Attributes:
        rows: Indices of the two states of a vehicle that are its position.
        discs: x, y and radius of each disc that vehicles keep out of.
    """

    rows: tuple[int, int]
    discs: Sequence[tuple[float, float, float]] = ()


def figures_of(  # noqa: PLR0913 - a run, what is known of it, and words
    problem: OptimalControlProblem | Sequence[OptimalControlProblem],
    trajectory: Trajectory,
    *,
    labels: Labels | None = None,
    known: KnownOf = nothing_known,
    true: Sequence[ReferenceSignals | None] = (),
    title: str = "",
    place: Place | None = None,
) -> "Iterator[tuple[str, Figure]]":
    """Return all figures that apply to a run, with their names, in order.

    Args:
        problem: The problem that is planned; if vehicles plan one after another, the
            problem of each, in the order of their states.
        trajectory: The run.
        labels: Words on the axes; None means names and units of the (first) model.
        known: Function from the number of a step, and of a problem, to parameters and
            signals of the plan made there; by default there are none.
        true: For each problem a function from times to its first signals (those before
            the plans of other vehicles), as the simulated system has them. None in its
            place, or an empty sequence, means that they are those of the plans.
        title: Title of the sheet.
        place: States that are a position; None if there are none.

    Raises:
        InvalidProblemError: If parameters or signals do not fit a problem.
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
        true=true,
    )
    return _figures(flown, title, place)


def _figures(
    flown: Flown, title: str, place: Place | None
) -> "Iterator[tuple[str, Figure]]":
    """Yield the figures that apply, with their names."""
    paths = plan_paths(flown) if flown.fresh.size > 1 else []
    moving = [
        one
        for number, part in enumerate(flown.parts())
        for one in moving_bounds(*part, flown.signals_of(number))
    ]
    whole = with_plans(_with_moving(_states(flown), moving, "states"), paths)
    held = _with_moving(_controls(flown), moving, "controls")
    states, controls = without_tails(whole, held)
    parts = [panels_part("States", states, flown.labels)]
    if controls:
        name = "Controls"
        parts.append(panels_part(name, controls, flown.labels))
    plane = _plane_part(flown, whole, paths, place)
    if flown.fresh.size > 1:  # A closed loop plans more than once.
        parts.insert(1, Part("Cost of the plans", lambda part: _costs(part, flown)))
        parts.append(_planning_part(flown))
    else:
        parts, plane = _solved_once(parts, flown, plane)
    # Letters keep the files of a folder in this order.
    yield "a_sheet", sheet(title, parts)
    yield from _whole(states, controls, flown.labels)
    rows = _slack_rows(flown)
    if rows:
        yield "d_slack", slack_figure(rows)
    if plane is not None:
        name = "e_phase_plane" if place is None else "e_tracks"
        yield name, _alone(plane, flown, place)
    searches = searches_figure(flown) if flown.fresh.size > 1 else None
    if searches is not None:
        yield "f_searches", searches
    outputs = _outputs(flown.trajectory, flown.labels)
    if outputs:
        yield "h_outputs", panels_figure({"outputs": outputs}, flown.labels)
    signals = signals_of_run(flown)
    if signals:
        yield "i_signals", panels_figure({"signals": signals}, flown.labels)


def _whole(
    states: Sequence[Panel], controls: Sequence[Panel], labels: Labels
) -> "Iterator[tuple[str, Figure]]":
    """Yield states and controls that the sheet has no room for."""
    if len(states) > MOST_IN_PART:
        yield "b_states", panels_figure({"states": states}, labels)
    if len(controls) > MOST_IN_PART:
        yield "c_controls", panels_figure({"controls": controls}, labels)


def _states(flown: Flown) -> list[Panel]:
    labels, trajectory = flown.labels, flown.trajectory
    (lower, upper), _ = stacked_limits(flown.problems)
    shown = len(labels.states) * len(labels.vehicles)
    return panels_of(
        labels.states,
        labels,
        trajectory.dense_times,
        trajectory.dense_states[:shown],  # Others are what phases remember.
        (lower[:shown], upper[:shown]),
    )


def _with_moving(
    panels: list[Panel], moving: Sequence[tuple[str, int, MovingBound]], role: str
) -> list[Panel]:
    """Return panels of states or controls with the bounds that change over time."""
    bounds = [(row % len(panels), one) for own, row, one in moving if own == role]
    return [
        replace(panel, moving=[one for row, one in bounds if row == number])
        for number, panel in enumerate(panels)
    ]


def _controls(flown: Flown) -> list[Panel]:
    _, limits = stacked_limits(flown.problems)
    held = held_controls(flown.trajectory)
    return panels_of(flown.labels.controls, flown.labels, *held, limits)


def _outputs(trajectory: Trajectory, labels: Labels) -> list[Panel]:
    """Return the panels of outputs of the plant, named for all vehicles together."""
    return panels_of(
        trajectory.output_names,
        replace(labels, vehicles=("",)),
        trajectory.dense_times,
        trajectory.outputs,
    )


def _plane_part(
    flown: Flown,
    states: Sequence[Panel],
    paths: Sequence[PlanPath],
    place: Place | None,
) -> Part | None:
    """Return tracks of vehicles with a position, or the phase plane of two states."""
    labels = flown.labels
    if place is not None:
        scene = _scene(states, paths, place, labels)
        return Part("Tracks", lambda part: draw_scene(part, scene))
    if len(labels.states) != _PLANE:
        return None
    first, second = states
    return Part(
        "Phase plane",
        lambda part: draw_phase_plane(part.subplots(), first, second, paths, labels),
    )


def _scene(
    states: Sequence[Panel], paths: Sequence[PlanPath], place: Place, labels: Labels
) -> Scene:
    x, y = (states[row] for row in place.rows)
    positions = np.stack([x.values, y.values], axis=1)
    count = len(states)
    # One plan of several vehicles has their states one after another.
    plans = [
        path.states[[begin + row for row in place.rows]]
        for path in paths
        for begin in range(0, len(path.states) - count + 1, count)
    ]
    return Scene(
        times=x.times,
        positions=positions,
        headings=directions_of(positions),
        names=labels.vehicles,
        discs=place.discs,
        plans=plans,
        axes=(escaped(x.label), escaped(y.label)),
    )


def _alone(part: Part, flown: Flown, place: Place | None) -> "Figure":
    """Return a figure of one part; one of tracks is about as high as these need."""
    height = 5.5
    if place is not None:
        rows = [_states(flown)[row].values for row in place.rows]
        wide, high = (float(np.ptp(one[np.isfinite(one)])) for one in rows)
        # 1e-300: all may move along y alone.
        height = 1.6 + 6.4 * float(np.clip(high / max(wide, 1e-300), 0.25, 1.0))
    figure = new_figure((8.0, height))
    part.draw(figure)
    name_lines(figure, room=HALF)
    return figure


def _solved_once(
    parts: list[Part], flown: Flown, plane: Part | None
) -> tuple[list[Part], Part | None]:
    """Return the parts of a problem solved once, and a plane that has no room there."""
    labels, decisions = flown.labels, flown.trajectory.decisions
    plan = decisions[0].plans[0] if decisions else None
    more: list[Part] = []
    if plan is not None and len(flown.problems) == 1:
        if plan.search.history.size:
            more.append(
                Part(
                    "Convergence of the search",
                    lambda part: draw_convergence(part, plan, labels),
                )
            )
        if optima_of(plan)[0].size > 1:
            more.append(
                Part(
                    "Local optima found",
                    lambda part: draw_optima(part.subplots(), plan, labels),
                )
            )
    if len(more) < len(parts) and plane is not None:
        more.append(plane)
        plane = None
    # States and controls on the left, one above the other, if there are four parts.
    ordered = [*parts[:1], *more[:1], *parts[1:], *more[1:]]
    return ordered, plane


def _costs(part: "FigureBase", flown: Flown) -> None:
    axes = part.subplots()
    draw_costs(axes, flown)
    axes.set_xlim(*flown.trajectory.times[[0, -1]])


def _planning_part(flown: Flown) -> Part:
    several = len(flown.problems) > 1
    names = list(flown.labels.vehicles) if several else [""]

    def draw_work(part: "FigureBase") -> None:
        draw_planning(part, flown.trajectory, names=names)

    return Part("Planning: time of each step, source of each plan", draw_work)


def _slack_rows(flown: Flown) -> list[Slack]:
    labels, steps = flown.labels, flown.trajectory.controls.shape[1]
    several = len(flown.problems) > 1
    return [
        _within(
            replace(row, name=f"{labels.vehicles[number]}: {row.name}")
            if several
            else row,
            labels,
            steps,
        )
        for number, part in enumerate(flown.parts())
        for row in slacks(*part, flown.signals_of(number))
    ]


def _within(row: Slack, labels: Labels, steps: int) -> Slack:
    """Return a row that is drawn only while its phase lasts."""
    for name, (begin, end) in labels.spans.items():
        if row.name.endswith(name) and not row.is_terminal:
            # Each interval has as many instants as any other.
            interval = np.arange(row.times.size) // (row.times.size // steps)
            inside = (interval >= begin) & (interval < end)
            return replace(row, values=np.where(inside, row.values, np.nan))
    return row


def draw_solution(
    solution: Solution, *, units: Mapping[str, str] | None = None
) -> "Figure":
    """Return a figure of the verified states, controls, outputs and signals.

    States and controls have their bounds.

    Args:
        solution: The solution.
        units: Unit of a state or control, by name; None means the units of the model.
    """
    problem, path = solution.problem, solution.path
    labels = labels_of(problem, units=units)
    instants = np.linspace(0.0, solution.times[-1], problem.intervals + 1)
    (lower, upper), on_controls = stacked_limits([problem])
    shown = len(labels.states)  # Others are decided numbers and remembered values.
    moving = moving_bounds_of(solution)
    states = panels_of(
        labels.states,
        labels,
        path.times,
        path.states[:shown],
        (lower[:shown], upper[:shown]),
    )
    controls = panels_of(
        labels.controls, labels, instants, solution.controls, on_controls
    )
    blocks = {
        "states": _with_moving(states, moving, "states"),
        "controls": _with_moving(controls, moving, "controls"),
        "outputs": panels_of(solution.output_names, labels, path.times, path.outputs),
        "signals": signals_of_solution(solution, labels),
    }
    return panels_figure(blocks, labels)


def draw_trajectory(
    trajectory: Trajectory, *, labels: Labels | None = None
) -> "Figure":
    """Return a figure of the states, the held controls and the outputs of a run.

    Args:
        trajectory: The run.
        labels: Words on the axes; None means the trajectory's own names.
    """
    if labels is None:
        labels = Labels(
            states=trajectory.state_names, controls=trajectory.control_names,
            units=trajectory.units,
        )  # fmt: skip
    times, count = trajectory.dense_times, len(labels.states)
    # Rows beyond whole vehicles are decided numbers and remembered values.
    shown = count * min(
        len(labels.vehicles), len(trajectory.dense_states) // max(count, 1)
    )
    states = trajectory.dense_states[:shown]
    blocks = {
        "states": panels_of(labels.states, labels, times, states),
        "controls": panels_of(labels.controls, labels, *held_controls(trajectory)),
        "outputs": _outputs(trajectory, labels),
    }
    return panels_figure(blocks, labels)


def labels_of(
    problem: OptimalControlProblem,
    *,
    units: Mapping[str, str] | None = None,
    vehicles: Sequence[str] = ("",),
) -> Labels:
    """Return labels for figures of a problem.

    Args:
        problem: The problem of one vehicle; its model has the names of the states and
            controls.
        units: Unit by name; None means the model's units.
        vehicles: Name of each vehicle in the figures.
    """
    return Labels(
        states=problem.model.state_names,
        controls=problem.model.control_names,
        units=problem.model.units if units is None else units,
        vehicles=vehicles,
        maximize=problem.maximize,
    )


def html_of(result: Solution | Trajectory) -> str:
    """Return HTML with the summary of a result, and its figure beneath."""
    image = io.BytesIO()
    result.plot().savefig(image, format="png")
    encoded = base64.b64encode(image.getvalue()).decode("ascii")
    return (
        f"<pre>{html.escape(repr(result))}</pre>"
        '<img alt="states and controls over time" '
        f'src="data:image/png;base64,{encoded}">'
    )
