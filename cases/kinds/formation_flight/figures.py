"""Figures of a formation flight, after the chapter's Figs. 5.9-5.12, and its animation.

(a) one sheet: tracks with the leader, errors of the places, controls with their bounds,
and the time that planning took; (b) relative speed, heading, x and y against time; (c)
distances and obstacle clearance between the samples; (d) the terminal set. If a flight
has one planned step, all figures show the plan over its whole horizon. The animation
shows the formation from above, and its leader.
"""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.drawing.animation import animate_scene, check_writer
from swarmstart.cases.drawing.closest import draw_scene
from swarmstart.cases.drawing.drawing import (
    COLOURS,
    HALF,
    Figures,
    colour,
    draw_series,
    into_folder,
    line_style,
    name_lines,
    name_powers,
    new_figure,
)
from swarmstart.cases.drawing.panels import Labels, panels_of, stacked_limits, wrapped
from swarmstart.cases.drawing.planning import draw_planning
from swarmstart.cases.drawing.sheet import (
    Part,
    draw_band,
    draw_errors,
    panels_part,
    sheet,
)
from swarmstart.cases.drawing.tails import tail_from, tail_in_words
from swarmstart.cases.drawing.tracks import Scene
from swarmstart.cases.kinds.formation_flight.measures import (
    SETTLED_M,
    clearances,
)
from swarmstart.cases.kinds.formation_flight.pose import (
    FormationFlight,
    leader_positions,
)
from swarmstart.cases.kinds.formation_flight.scenario import FormationScenario
from swarmstart.cases.kinds.formation_flight.shown_path import Shown, shown_of
from swarmstart.cases.kinds.planar import POSITION, pair_distances
from swarmstart.ocp import Trajectory
from swarmstart.ocp.common import ProgressCallback, tell_nothing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase


LONGER = 1.25
"""Part of a flight that is shown, in times of settling; the rest is straight."""
SHORTEST_S = 20.0  # Of what is shown, however soon all settle.
# Pairs of states that the terminal set's matrix couples, behind a leader along x.
PLANES = ((2, 3), (0, 2), (1, 3))
SETS_SHOWN = 2.5  # Half-width of a panel, in half-widths of the set.
# A clearance far above the limit says nothing: the panel ends here, in metres.
FAR_M = 40.0
SMALLEST_VALUE = 1e-14
"""Values of e'Pe below it are drawn as this on the logarithmic axis."""

RELATIVE = (
    ("speed", "speed - leader's [m/s]"),
    ("heading", "heading - leader's [rad]"),
    ("x", "x - slot [m]"),
    ("y", "y - slot [m]"),
)
CONTROLS = ("acceleration", "turn rate")
UNITS = {"acceleration": "m/s\N{SUPERSCRIPT TWO}", "turn rate": "rad/s"}

# `check_writer` is looked up here by its name; see `animated_by` of Kind.
__all__ = ["animate", "check_writer", "draw"]


@into_folder
def draw(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
) -> Figures:
    """Return all figures of a flight by name, in order."""
    shown = shown_of(scenario, flight, trajectory)
    figures = [
        ("a_sheet", sheet_figure(scenario, flight, trajectory)),
        ("b_relative", relative_figure(scenario, flight, shown)),
    ]
    if not shown.is_plan:
        distances = distances_figure(scenario, flight, shown)
        if distances is not None:
            figures.append(("c_distances", distances))
    if flight.posed.designed_set is not None:
        figures.append(("d_terminal_set", terminal_set_figure(scenario, flight, shown)))
    return figures


def sheet_figure(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> "Figure":
    """Return figure (a): tracks, errors, controls, and the time of planning.

    If the flight is a single plan, distances take the place of the time of planning.
    """
    whole, labels = shown_of(scenario, flight, trajectory), _labels(scenario, flight)
    settled, shown = whole.settled(flight), eventful(whole, flight)
    errors = shown.errors(flight)
    _, limits = stacked_limits([agent.problem for agent in flight.posed.agents])
    first = _first_words(shown, whole)
    controls = [
        replace(panel, rest=first)
        for panel in panels_of(CONTROLS, labels, shown.times, shown.controls, limits)
    ]
    scene = scene_of(scenario, flight, shown)

    def draw_places(part: "FigureBase") -> None:
        draw_scene(part, scene)

    def draw_off(part: "FigureBase") -> None:
        axes = part.subplots()
        draw_errors(
            axes, shown.dense_times, errors, band=SETTLED_M,
            settled=settled, unit="m", names=labels.vehicles,
            numbers=labels.numbers,
        )  # fmt: skip
        _shade_linear(axes, shown)
        axes.set(xlabel="time [s]", ylabel="largest of |dx|, |dy| to the slot [m]")

    tracks = "Planned tracks" if shown.is_plan else "Tracks"
    title, last = scenario.title, _planning_part(scenario, flight, trajectory)
    if shown.is_plan:
        title = f"{title}\n{_cost_in_words(scenario, flight, trajectory)}"
        last = _distances_part(scenario, flight, shown)
    parts = [
        Part(", ".join(filter(None, [tracks, first])), draw_places),
        Part(", ".join(filter(None, ["Error of the place", first])), draw_off),
        panels_part("Controls", controls, labels),
        last,
    ]
    return sheet(title, parts)


def eventful(shown: Shown, flight: FormationFlight) -> Shown:
    """Return the part of a flight until soon after all UAVs are settled.

    A path that is a plan, or on which they do not settle, is returned whole.
    """
    settled = None if shown.is_plan else shown.settled(flight)
    return shown if settled is None else shown.until(max(LONGER * settled, SHORTEST_S))


def _first_words(shown: Shown, whole: Shown) -> str:
    """Return words on the part that is shown; empty if it is the whole."""
    end, last = float(shown.times[-1]), float(whole.times[-1])
    return f"the first {end:g} s of {last:g} s" if end < last else ""


def _planning_part(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> Part:
    given = [n for n, uav in enumerate(scenario.uavs) if uav.plan is not None]

    def draw_work(part: "FigureBase") -> None:
        draw_planning(part, trajectory, names=flight.posed.names, given=given)

    return Part("Planning: time of each step, source of each plan", draw_work)


def _distances_part(
    scenario: FormationScenario, flight: FormationFlight, shown: Shown
) -> Part:
    series = _distances(scenario, flight, shown)

    def draw_room(part: "FigureBase") -> None:
        panels = part.subplots(max(len(series), 1), 1, squeeze=False)[:, 0]
        _draw_distances(panels, shown, series)

    return Part("Distances along the plan", draw_room)


def _cost_in_words(
    scenario: FormationScenario, flight: FormationFlight, trajectory: Trajectory
) -> str:
    """Return what each plan that was made costs."""
    plans = trajectory.decisions[0].plans
    costs = [
        f"{flight.posed.names[number]}: J = {plans[number].cost:.6g}"
        for number in scenario.planning
    ]
    return f"the plan over {_horizon(scenario):g} s, cost of {', '.join(costs)}"


def _horizon(scenario: FormationScenario) -> float:
    return scenario.prediction.dt * scenario.prediction.intervals


def _labels(scenario: FormationScenario, flight: FormationFlight) -> Labels:
    return Labels(
        controls=CONTROLS,
        units=UNITS,
        vehicles=flight.posed.names,
        numbers=colour_numbers(scenario),
    )


def colour_numbers(scenario: FormationScenario) -> list[int]:
    """Return the number of each UAV's colour, which is the same in every figure."""
    return [number - 1 for number in scenario.numbers]


def scene_of(
    scenario: FormationScenario, flight: FormationFlight, shown: Shown
) -> Scene:
    """Return the tracks with leader and obstacles."""
    return Scene(
        times=shown.dense_times,
        positions=shown.dense[:, list(POSITION)],
        headings=shown.dense[:, 1],
        names=flight.posed.names,
        numbers=colour_numbers(scenario),
        discs=[(disc.x_m, disc.y_m, disc.radius_m) for disc in scenario.obstacles],
        leader=leader_positions(scenario, shown.dense_times),
    )


def relative_figure(
    scenario: FormationScenario, flight: FormationFlight, shown: Shown
) -> "Figure":
    """Return figure (b): each relative state of every UAV against time, four panels."""
    whole, settled = shown, shown.settled(flight)
    shown = eventful(whole, flight)
    off = shown.dense - flight.posed.slots(shown.dense_times)
    figure = new_figure((11.0, 6.4))
    panels = figure.subplots(2, 2, sharex=True).ravel()
    for row, axes in enumerate(panels):
        if row in POSITION:
            name = f"settled: at most {SETTLED_M:g} m off"
            draw_band(axes, -SETTLED_M, SETTLED_M, name=name)
        axes.axhline(0.0, color="0.6", linewidth=0.8)
        draw_series(
            axes, shown.dense_times, off[:, row], names=flight.posed.names,
            numbers=colour_numbers(scenario),
        )  # fmt: skip
        _shade_linear(axes, shown)
        if settled is not None and row in POSITION:
            axes.axvline(
                settled, color="0.15", ls="-.", lw=1.2,
                label=f"settled from {settled:g} s on",
            )  # fmt: skip
        axes.set_ylabel(RELATIVE[row][1])
        axes.grid(alpha=0.3)
        axes.margins(x=0)
    for axes in panels[2:]:
        axes.set_xlabel("time [s]")
    what = "plan" if shown.is_plan else "flight"
    words = ["States relative to the leader and the slots", what]
    words += filter(None, [_first_words(shown, whole)])
    figure.suptitle(", ".join(words))
    name_lines(figure)
    return figure


def _shade_linear(axes: "Axes", shown: Shown) -> None:
    """Shade the steps flown under the linear law."""
    if not shown.linear.any():
        return
    # One area: a span for each step would be drawn, and measured, one by one.
    axes.fill_between(
        np.repeat(shown.times, 2)[1:-1], 0.0, 1.0, where=np.repeat(shown.linear, 2),
        transform=axes.get_xaxis_transform(), color="0.93", lw=0, zorder=-1,
        label="linear law",
    )  # fmt: skip


Distances = tuple[str, float, Array, Array]
"""Label, limit, values along the path, values at the control instants."""


def _distances(
    scenario: FormationScenario, flight: FormationFlight, shown: Shown
) -> list[Distances]:
    """Return the smallest distance of two UAVs, and of the obstacles, if there are."""
    stacked = [
        states.reshape(-1, states.shape[2]) for states in (shown.dense, shown.states)
    ]
    series: list[Distances] = []
    if flight.agents > 1:
        apart = [pair_distances(x, flight.agents).min(axis=0) for x in stacked]
        safe = scenario.avoidance.safe_distance_m
        series.append(("smallest distance of two UAVs [m]", safe, apart[0], apart[1]))
    if scenario.obstacles:
        room = [clearances(scenario, flight, x).min(axis=0) for x in stacked]
        label = "smallest clearance of the obstacles [m]"
        series.append((label, 0.0, room[0], room[1]))
    return series


def distances_figure(
    scenario: FormationScenario, flight: FormationFlight, shown: Shown
) -> "Figure | None":
    """Return figure (c): smallest distance of UAVs, and smallest clearance, over time.

    Lines show the whole path, dots the control instants. Returns None if there is one
    UAV and no obstacle.
    """
    series = _distances(scenario, flight, shown)
    if not series:
        return None
    figure = new_figure((7.5, 1.0 + 2.8 * len(series)))
    panels = figure.subplots(len(series), 1, squeeze=False)[:, 0]
    _draw_distances(panels, shown, series)
    title = "Smallest distances along the flight"
    begin = tail_from((shown.dense_times, dense[None]) for _, _, dense, _ in series)
    if begin is not None:
        title += f", {tail_in_words(begin, float(shown.times[-1]))}"
        for axes in panels:
            axes.set_xlim(right=begin)
    figure.suptitle(title, fontsize="medium")
    name_lines(figure, room=HALF)
    return figure


def _draw_distances(
    panels: "NDArray[np.object_]", shown: Shown, series: list[Distances]
) -> None:
    for axes, (label, limit, dense, sampled) in zip(panels, series, strict=False):
        name = "planned" if shown.is_plan else "flown"
        axes.plot(shown.dense_times, dense, color=COLOURS[0], lw=1.3, label=name)
        axes.plot(
            shown.times, sampled, ".", color=COLOURS[1], label="at the control instants"
        )
        axes.axhline(limit, color="0.25", ls=":", lw=1.4, label=f"limit, {limit:g} m")
        axes.fill_between(
            shown.dense_times, limit, dense, where=dense < limit, color=COLOURS[1],
            alpha=0.4,
        )  # fmt: skip
        axes.set_ylabel(wrapped(label))
        k = int(np.argmin(dense))
        least = f"least {dense[k]:.4g} m, at {shown.dense_times[k]:.4g} s"
        axes.set_title(least, fontsize="small", loc="right")
        low, high = min(float(dense.min()), limit), axes.get_ylim()[1]
        high = min(high, limit + FAR_M)
        # Some room, so that the limit is not on the frame.
        axes.set_ylim(low - 0.08 * (high - low), high)
        axes.grid(alpha=0.3)
        axes.margins(x=0)
    panels[-1].set_xlabel("time [s]")


def terminal_set_figure(
    scenario: FormationScenario, flight: FormationFlight, shown: Shown
) -> "Figure":
    """Return figure (d): e'Pe, the terminal set's level, and the paths into the set."""
    terminal_set = flight.posed.terminal_set
    figure = new_figure((11.0, 8.0))
    first, *planes = figure.subplots(2, 2).ravel()
    _draw_level(first, scenario, flight, shown)
    draw_entering(planes, scenario, flight, shown)
    certificate = terminal_set.certificate
    grounds = "of its bounds"
    dots = "; dots: steps under the linear law" if shown.linear.any() else ""
    if certificate is not None and certificate.dt is not None:
        grounds = f"certified for inputs held {certificate.dt:g} s"
    figure.suptitle(
        f"Terminal set, {terminal_set.design} design, alpha = {terminal_set.alpha:.4g} "
        f"{grounds}{dots}"
    )
    name_lines(figure)
    return figure


def _draw_level(
    axes: "Axes", scenario: FormationScenario, flight: FormationFlight, shown: Shown
) -> None:
    """Draw e'Pe of every UAV at the control instants, and the level of the set."""
    terminal_set = flight.posed.terminal_set
    off = shown.states - flight.posed.slots(shown.times)
    values = np.stack([terminal_set.value(one) for one in off])
    draw_series(
        # Below the axis, so that rounded zeros leave the picture downwards.
        axes, shown.times, np.maximum(values, SMALLEST_VALUE / 10),
        names=flight.posed.names, numbers=colour_numbers(scenario),
    )  # fmt: skip
    level = terminal_set.alpha
    axes.axhline(level, color="0.25", ls=":", lw=1.4, label=f"alpha = {level:.3g}")
    name_powers(axes, has_minor_ticks=False)
    axes.set_ylim(bottom=max(SMALLEST_VALUE, axes.get_ylim()[0]))
    _shade_linear(axes, shown)
    axes.set(xlabel="time [s]", ylabel="e'Pe")
    axes.margins(x=0)
    axes.grid(alpha=0.3)


def draw_entering(
    panels: "list[Axes]",
    scenario: FormationScenario,
    flight: FormationFlight,
    shown: Shown,
) -> None:
    """Draw the terminal set's projections, and the UAVs on their way into it."""
    terminal_set, of = flight.posed.terminal_set, flight.posed.slots
    deviations = shown.dense - of(shown.dense_times)
    at_instants = shown.states - of(shown.times)
    extent = terminal_set.ellipsoid.extent()
    numbers = colour_numbers(scenario)
    for axes, (i, j) in zip(panels, PLANES, strict=True):
        outline = terminal_set.ellipsoid.shadow(i, j)
        axes.fill(*outline, color="0.9")
        axes.plot(*outline, color="0.25", ls=":", lw=1.4, label="terminal set")
        for number, dense, instants in zip(
            numbers, deviations, at_instants, strict=True
        ):
            own = colour(number)
            axes.plot(dense[i], dense[j], color=own, ls=line_style(number), lw=1.0)
            # The state at the beginning of each step under the linear law.
            flown = instants[:, :-1][:, shown.linear]
            axes.plot(flown[i], flown[j], "o", color=own, markersize=3)
        axes.set(xlabel=RELATIVE[i][1], ylabel=RELATIVE[j][1])
        axes.set_xlim(-SETS_SHOWN * extent[i], SETS_SHOWN * extent[i])
        axes.set_ylim(-SETS_SHOWN * extent[j], SETS_SHOWN * extent[j])


def animate(
    scenario: FormationScenario,
    flight: FormationFlight,
    trajectory: Trajectory,
    file: Path,
    *,
    progress: ProgressCallback = tell_nothing,
) -> None:
    """Write an animation of a flight, or of the plan of a flight of one step.

    The arguments are those of `Kind.animate`.

    Raises:
        MissingWriterError: If the program that writes such a file is not installed.
        RecordError: If the file cannot be written.
    """
    shown = shown_of(scenario, flight, trajectory)
    scene = scene_of(scenario, flight, shown)
    slots = flight.posed.slots(shown.dense_times)[:, list(POSITION)]
    # A frame at a control instant belongs to the step that begins; 1e-9 is rounding.
    steps = np.searchsorted(shown.times, shown.dense_times + 1e-9, side="right") - 1
    steps = np.clip(steps, 0, shown.linear.size - 1)  # The end of the last step.
    law = "plan" if shown.is_plan else "planning"
    notes = ["terminal law" if shown.linear[step] else law for step in steps]
    animate_scene(
        replace(scene, slots=slots),
        file,
        title=scenario.title,
        notes=notes,
        progress=progress,
    )
