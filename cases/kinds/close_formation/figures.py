"""Figures of a close formation flight, after the chapter's Figs. 5.15 and 5.16.

(a) one sheet: place behind the leader, errors, commands with their bounds, and the time
that planning took; (b) speed, heading, cost J of each plan, and drag saved; (c) the
wingman's track over the map of the drag saved, both aircraft to scale. With
`reference: ipopt` (a) and (b) also show the flight with the exact minimum of J in every
step, and (b) the exact minimum at the flown states beside J.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import (
    COLOURS,
    Figures,
    into_folder,
    name_lines,
    new_figure,
)
from swarmstart.cases.drawing.panels import Labels, panels_of, stacked_limits, wrapped
from swarmstart.cases.drawing.planning import draw_planning
from swarmstart.cases.drawing.sheet import (
    Part,
    draw_band,
    draw_errors,
    panels_part,
    settled_at,
    sheet,
)
from swarmstart.cases.drawing.tracks import label_times, mark_times
from swarmstart.cases.format.settings import search_part
from swarmstart.cases.kinds.close_formation.measures import (
    SETTLED_FT,
    deviations,
    reference_costs,
    savings,
    slot_of,
)
from swarmstart.cases.kinds.close_formation.pose import (
    CloseFormationFlight,
    last_change_s,
    pose,
)
from swarmstart.cases.kinds.close_formation.scenario import CloseFormationScenario
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.kinds.models.horseshoe_vortex import drag_saving
from swarmstart.cases.record.trajectory_arrays import plan_costs
from swarmstart.ocp import Trajectory, simulate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.contour import ContourSet
    from matplotlib.figure import Figure, FigureBase


WINGMAN, LEADER, REFERENCE = COLOURS[0], COLOURS[1], "#000000"
COMMANDS = ("speed command", "heading command", "height command")
UNITS = {"speed command": "ft/s", "heading command": "deg", "height command": "ft"}
SMALLEST_COST = 1e-9
"""Costs below it are drawn as this on the logarithmic axis."""
MAP_POINTS = (161, 121)
MAP_COLOURS, MAP_LINES = "RdBu", (-30, -10, 10, 30)
"""Red and blue, which all colour vision tells apart, and labelled lines [percent]."""
# Outline of an aircraft, nose ahead, in spans: (ahead, right).
OUTLINE = np.array(
    [(0.8, 0), (0.25, 0.07), (0.0, 0.5), (-0.2, 0.5), (-0.25, 0.1), (-0.6, 0.25)]
)


@into_folder
def draw(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
) -> Figures:
    """Return all figures of a flight by name, in order."""
    exact = exact_flight(scenario) if scenario.reference == "ipopt" else None
    return [
        ("a_sheet", sheet_figure(scenario, flight, trajectory, exact)),
        ("b_motion", motion_figure(scenario, flight, trajectory, exact)),
        ("c_map", map_figure(flight, trajectory)),
    ]


def exact_flight(scenario: CloseFormationScenario) -> Trajectory:
    """Return the same flight with plans of exactly least cost, made by IPOPT."""
    # No search: IPOPT starts from the last plan.
    alone = search_part("none").model_validate(
        {"name": "none", "warm_start": "one", "sampling": None}
    )
    solved = scenario.model_copy(update={"search": alone, "polish": "ipopt"})
    flight = flight_of(pose(solved), solved)
    return simulate(
        flight.plant,
        flight.controller,
        flight.x0,
        steps=scenario.steps,
        rng=np.random.default_rng(0),  # Nothing is drawn.
        progress=False,
    )


def sheet_figure(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
    exact: Trajectory | None,
) -> "Figure":
    """Return figure (a): place, errors, commands, and planning."""
    labels = Labels(controls=COMMANDS, units=UNITS)
    scale = np.array([1.0, np.degrees(1.0), 1.0])  # The heading command in degrees.
    _, (lower, upper) = stacked_limits([flight.posed.agents[0].problem])
    commands = panels_of(
        COMMANDS,
        labels,
        trajectory.times,
        scale[:, None] * trajectory.controls,
        (scale * lower, scale * upper),
    )

    def draw_places(part: "FigureBase") -> None:
        _draw_places(part, scenario, trajectory, exact)

    def draw_off(part: "FigureBase") -> None:
        axes, off = part.subplots(), np.abs(deviations(scenario, trajectory.states))
        draw_errors(
            axes, trajectory.times, off, band=SETTLED_FT,
            settled=settled_s(scenario, trajectory), unit="ft",
            names=("x", "y", "height"),
        )  # fmt: skip
        axes.set(xlabel="time [s]", ylabel="distance from the slot [ft]")

    def draw_work(part: "FigureBase") -> None:
        draw_planning(part, trajectory, names=("wingman",))

    parts = [
        Part("Place behind the leader", draw_places),
        Part("Error of the place", draw_off),
        panels_part("Commands", commands, labels),
        Part("Planning: time of each step, source of each plan", draw_work),
    ]
    return sheet(scenario.title, parts)


def settled_s(scenario: CloseFormationScenario, trajectory: Trajectory) -> float | None:
    """Return the time from which x and y stay settled, after the leader's last change.

    Returns:
        Time since the start of the flight [s]; None if x and y do not settle, or if
        the leader's last change is after the end of the flight.
    """
    off = np.abs(deviations(scenario, trajectory.states)[:2])
    settled = settled_at(trajectory.times, off, SETTLED_FT)
    # Before the last change x and y may be near by chance.
    begin = last_change_s(scenario.leader)
    if settled is None or trajectory.times[-1] < begin:
        return None
    return max(settled, begin)


def _draw_places(
    part: "FigureBase",
    scenario: CloseFormationScenario,
    trajectory: Trajectory,
    exact: Trajectory | None,
) -> None:
    """Draw x and y with the slot, its band, and when both are settled."""
    wanted = (scenario.slot.x_ft, scenario.slot.y_ft)
    names = ("x, leader ahead [ft]", "y, leader to the right [ft]")
    settled = settled_s(scenario, trajectory)
    panels = part.subplots(2, 1, sharex=True)
    for row, (axes, slot, name) in enumerate(zip(panels, wanted, names, strict=True)):
        band = f"settled: at most {SETTLED_FT:g} ft off"
        draw_band(axes, slot - SETTLED_FT, slot + SETTLED_FT, name=band)
        axes.axhline(slot, ls="--", color=LEADER, lw=1, label="slot")
        axes.plot(
            trajectory.times, trajectory.states[row], color=WINGMAN, label="wingman"
        )
        _exact_line(axes, exact, None if exact is None else exact.states[row])
        if settled is not None:
            axes.axvline(settled, color="0.15", ls="-.", lw=1.2)
        axes.set_ylabel(wrapped(name))
        axes.grid(alpha=0.3)
        axes.margins(x=0)
    panels[-1].set_xlabel("time [s]")


def motion_figure(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
    exact: Trajectory | None,
) -> "Figure":
    """Return figure (b): speed, heading, cost J of each plan, and drag saved."""
    figure = new_figure((11.0, 7.0))
    fast, turned, costs, saved = figure.subplots(2, 2, sharex=True).ravel()
    speed, heading, _ = flight.posed.leader(trajectory.times)
    # A row that is held jumps to the next.
    style = "steps-post" if scenario.leader.between == "hold" else "default"
    panels = (
        (fast, 3, speed, "speed V [ft/s]", 1.0),
        (turned, 2, heading, r"heading $\psi$ [deg]", np.degrees(1.0)),
    )
    for axes, row, leader, label, unit in panels:
        axes.plot(
            trajectory.times, unit * leader, "--", color=LEADER, drawstyle=style,
            label="leader",
        )  # fmt: skip
        axes.plot(
            trajectory.times, unit * trajectory.states[row], color=WINGMAN,
            label="wingman",
        )  # fmt: skip
        _exact_line(axes, exact, None if exact is None else unit * exact.states[row])
        _label(axes, "", label)
    _draw_costs(costs, scenario, flight, trajectory)
    _draw_saving(saved, flight, trajectory, exact)
    figure.suptitle("Motion of the wingman, cost of its plans, drag saved")
    name_lines(figure)
    return figure


def _exact_line(axes: "Axes", exact: Trajectory | None, values: Array | None) -> None:
    if exact is not None and values is not None:
        axes.plot(
            exact.times, values, ":", color=REFERENCE, label="exact minimum (IPOPT)"
        )


def _draw_costs(
    axes: "Axes",
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
) -> None:
    """Draw J of each plan, and the exact minimum beside it if it is asked for."""
    times, costs = trajectory.times[:-1], plan_costs(trajectory)
    axes.semilogy(times, _at_least(costs), color=WINGMAN, label="wingman")
    if scenario.reference == "ipopt":
        best = _at_least(reference_costs(flight, trajectory))
        axes.semilogy(times, best, "--", color=REFERENCE, label="exact minimum (IPOPT)")
    _label(axes, "time [s]", "cost J of the plan")


def _at_least(costs: Array) -> Array:
    # J can be zero, which a logarithmic axis cannot show.
    return np.maximum(costs, SMALLEST_COST)


def _draw_saving(
    axes: "Axes",
    flight: CloseFormationFlight,
    trajectory: Trajectory,
    exact: Trajectory | None,
) -> None:
    """Draw the drag saved, and what the slot would save."""
    _, y, _ = slot_of(flight)
    ideal = 100 * drag_saving(flight.posed.aircraft, y, 0.0)
    axes.axhline(ideal, ls=":", color=LEADER, label=r"in the slot, y = $\pi$b/4")
    saved = 100 * savings(flight, trajectory.states)
    axes.plot(trajectory.times, saved, color=WINGMAN, label="wingman")
    _exact_line(
        axes, exact, None if exact is None else 100 * savings(flight, exact.states)
    )
    _label(axes, "time [s]", "drag saved [percent]")


def map_figure(flight: CloseFormationFlight, trajectory: Trajectory) -> "Figure":
    """Return the wingman's track over the drag saved, from above and from behind."""
    figure = new_figure((10.0, 5.6))
    above, behind = figure.subplots(1, 2, width_ratios=(2, 3))
    x, y, _, _, z, _ = trajectory.dense_states
    # Seen from the leader: the wingman is x behind and y to the left.
    # The wake is drawn at the leader's height, not at that of the track.
    _map(above, flight, (-y, -x), np.zeros_like)
    _aircraft_from_above(above, flight, (-y[-1], -x[-1]))
    _track(above, trajectory.dense_times, np.stack([-y, -x]))
    above.set(title="from above", ylabel="ahead of the leader [ft]")
    image = _map(behind, flight, (-y, z), lambda height: height)
    _aircraft_from_behind(behind, flight, (-y[-1], z[-1]))
    _track(behind, trajectory.dense_times, np.stack([-y, z]))
    behind.set(title="from behind", ylabel="above the leader [ft]")
    for axes in (above, behind):
        axes.set_xlabel("right of the leader [ft]")
        axes.set_aspect("equal", adjustable="box")
    figure.colorbar(image, ax=behind, label="drag saved [percent]", location="bottom")
    name_lines(figure)
    return figure


def _map(
    axes: "Axes",
    flight: CloseFormationFlight,
    track: tuple[Array, Array],
    height: Callable[[Array], Array],
) -> "ContourSet":
    """Draw the drag saved around a track: lateral place against the other axis."""
    span = flight.posed.aircraft.span_ft
    # The leader, at zero, is in the picture, with a span around both aircraft.
    left, right = min(track[0].min(), 0) - span, max(track[0].max(), 0) + span
    across = np.linspace(left, right, MAP_POINTS[0])
    low, high = min(track[1].min(), 0) - span, max(track[1].max(), 0) + span
    along = np.linspace(low, high, MAP_POINTS[1])
    saved = [
        # y counts to the right of the wingman, the axis to the right of the leader.
        [100 * drag_saving(flight.posed.aircraft, float(-a), float(h)) for a in across]
        for h in height(along)
    ]
    filled = axes.contourf(
        # Symmetric about zero: white is neither saved nor lost.
        across, along, saved, levels=np.linspace(-40, 40, 17), cmap=MAP_COLOURS,
        extend="both",
    )  # fmt: skip
    lines = axes.contour(
        across, along, saved, levels=MAP_LINES, colors="0.25", linewidths=0.6
    )  # Losses are dashed: the map can be read in grey print.
    axes.clabel(lines, fmt="%+g", fontsize="x-small")
    return filled


def _track(axes: "Axes", times: Array, track: Array) -> None:
    """Draw the wingman's track, shape (2, n), readable on any colour."""
    # A white line below the black one keeps it readable on dark colours.
    axes.plot(*track, color="white", lw=3.5)
    axes.plot(*track, color=REFERENCE, lw=1.5, label="track of the wingman")
    axes.plot(*track[:, 0], "o", color="white", mec=REFERENCE, label="start")
    marks = mark_times(times)
    at = [int(np.argmin(np.abs(times - mark))) for mark in marks]
    axes.plot(*track[:, at], ".", color=REFERENCE, ms=5, label="marks of time")
    label_times(axes, marks, track[:, at])


def _aircraft_from_above(
    axes: "Axes", flight: CloseFormationFlight, wingman: tuple[float, float]
) -> None:
    """Draw both aircraft to scale, the wingman at its last place."""
    whole = (
        # The right half, then its mirror image from tail to nose: a closed line.
        np.vstack([OUTLINE, OUTLINE[::-1] * [1, -1]]) * flight.posed.aircraft.span_ft
    )
    for (right, ahead), colour in (((0.0, 0.0), LEADER), (wingman, WINGMAN)):
        axes.fill(
            right + whole[:, 1], ahead + whole[:, 0], fc=colour, ec="white", lw=0.8
        )


def _aircraft_from_behind(
    axes: "Axes", flight: CloseFormationFlight, wingman: tuple[float, float]
) -> None:
    """Draw wings, fuselages and fins to scale."""
    span, fin = flight.posed.aircraft.span_ft, flight.posed.aircraft.fin_height_ft
    places = (((0.0, 0.0), LEADER, "leader"), (wingman, WINGMAN, "wingman"))
    for (right, up), colour, name in places:
        ends = [right - span / 2, right + span / 2]
        axes.plot(ends, [up, up], color=colour, lw=3, label=name)
        axes.plot([right, right], [up, up + fin], color=colour, lw=2)
        axes.plot(right, up, "o", color=colour, ms=7)


def _label(axes: "Axes", x: str, y: str) -> None:
    axes.set(xlabel=x, ylabel=y)
    axes.grid(alpha=0.3)
    axes.margins(x=0)
