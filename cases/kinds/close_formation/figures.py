"""Figures of a close formation flight, after the chapter's Figs. 5.15 and 5.16.

(a) x, (b) y, (c) speed, (d) heading, (e) the cost J of each plan. Beside them what the
chapter does not show: the drag saved in time, and the wingman's track over the map of
the drag saved, both aircraft to scale. With `reference: ipopt` the flight of the exact
minimum is drawn in (a) to (d), and the exact minimum at the flown states in (e).
"""

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.drawing.drawing import Figures, into_folder, new_figure
from swarmstart.cases.format.settings import search_part
from swarmstart.cases.kinds.close_formation.measures import (
    SETTLED_FT,
    reference_costs,
    savings,
    slot_of,
)
from swarmstart.cases.kinds.close_formation.pose import CloseFormationFlight, pose
from swarmstart.cases.kinds.close_formation.scenario import CloseFormationScenario
from swarmstart.cases.kinds.flight import flight_of
from swarmstart.cases.kinds.models.horseshoe_vortex import drag_saving
from swarmstart.cases.record.trajectory_arrays import plan_costs
from swarmstart.ocp import Trajectory, simulate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.contour import ContourSet
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

WINGMAN, LEADER, REFERENCE = "#0072B2", "#D55E00", "#000000"
SMALLEST_COST = 1e-9
"""Costs below it are drawn as this on the logarithmic axis."""
MAP_POINTS = (161, 121)
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
    """Return all figures of a flight by name, in the order of the chapter's panels."""
    exact = exact_flight(scenario) if scenario.reference == "ipopt" else None
    return [
        *_state_figures(scenario, flight, trajectory, exact),
        ("e_cost", _cost_figure(scenario, flight, trajectory)),
        ("f_drag_saving", _saving_figure(flight, trajectory, exact)),
        ("g_map", map_figure(flight, trajectory)),
    ]


def exact_flight(scenario: CloseFormationScenario) -> Trajectory:
    """Return the same flight with the exact minimum of J in every step (IPOPT)."""
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
    )


def _state_figures(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
    exact: Trajectory | None,
) -> "list[tuple[str, Figure]]":
    """Return (a) to (d): one state each, and what it is to be."""
    slot = scenario.slot
    speed, heading, _ = flight.posed.leader(trajectory.times)
    panels = (
        ("a_x", 0, slot.x_ft, "x, leader ahead [ft]", 1.0),
        ("b_y", 1, slot.y_ft, "y, leader to the right [ft]", 1.0),
        ("c_speed", 3, speed, "speed V [ft/s]", 1.0),
        ("d_heading", 2, np.degrees(heading), r"heading $\psi$ [deg]", np.degrees(1)),
    )
    figures = []
    for name, row, wanted, label, unit in panels:
        figure = new_figure()
        axes = figure.subplots()
        _target(axes, trajectory.times, wanted, held=scenario.leader.between == "hold")
        axes.plot(
            trajectory.times, unit * trajectory.states[row], color=WINGMAN,
            label="wingman",
        )  # fmt: skip
        _exact_line(axes, exact, None if exact is None else unit * exact.states[row])
        _label(axes, "time [s]", label)
        figures.append((name, figure))
    return figures


def _target(axes: "Axes", times: Array, wanted: Array | float, *, held: bool) -> None:
    """Draw the slot with its settling band, or what the leader does."""
    if isinstance(wanted, float):
        low, high = wanted - SETTLED_FT, wanted + SETTLED_FT
        axes.axhspan(
            low, high, color=LEADER, alpha=0.25, lw=0,
            label=f"settled: \N{PLUS-MINUS SIGN}{SETTLED_FT:g} ft",
        )  # fmt: skip
        axes.axhline(wanted, ls="--", color=LEADER, lw=1, label="slot")
        return
    style = "steps-post" if held else "default"
    axes.plot(times, wanted, "--", color=LEADER, drawstyle=style, label="leader")


def _exact_line(axes: "Axes", exact: Trajectory | None, values: Array | None) -> None:
    if exact is not None and values is not None:
        axes.plot(
            exact.times, values, ":", color=REFERENCE, label="exact minimum (IPOPT)"
        )


def _cost_figure(
    scenario: CloseFormationScenario,
    flight: CloseFormationFlight,
    trajectory: Trajectory,
) -> "Figure":
    """Return (e): J of each plan, and under it the exact minimum where it is asked."""
    figure = new_figure()
    axes = figure.subplots()
    times, costs = trajectory.times[:-1], plan_costs(trajectory)
    axes.semilogy(times, _at_least(costs), color=WINGMAN, label="plan")
    if scenario.reference == "ipopt":
        best = _at_least(reference_costs(flight, trajectory))
        axes.semilogy(times, best, "--", color=REFERENCE, label="exact minimum (IPOPT)")
    _label(axes, "time [s]", "J")
    return figure


def _at_least(costs: Array) -> Array:
    return np.maximum(costs, SMALLEST_COST)


def _saving_figure(
    flight: CloseFormationFlight, trajectory: Trajectory, exact: Trajectory | None
) -> "Figure":
    """Return the drag saved against time, and what the slot would save."""
    figure = new_figure()
    axes = figure.subplots()
    _, y, _ = slot_of(flight)
    ideal = 100 * drag_saving(flight.posed.aircraft, y, 0.0)
    axes.axhline(ideal, ls="--", color=LEADER, label=r"in the slot, y = $\pi$b/4")
    saved = 100 * savings(flight, trajectory.states)
    axes.plot(trajectory.times, saved, color=WINGMAN, label="wingman")
    _exact_line(
        axes, exact, None if exact is None else 100 * savings(flight, exact.states)
    )
    _label(axes, "time [s]", "drag saved [percent]")
    return figure


def map_figure(flight: CloseFormationFlight, trajectory: Trajectory) -> "Figure":
    """Return the wingman's track over the drag saved, from above and from behind."""
    figure = new_figure((10.0, 5.5))
    above, behind = figure.subplots(1, 2)
    x, y, _, _, z, _ = trajectory.dense_states
    # Seen from the leader: the wingman is x behind and y to the left.
    _map(above, flight, (-y, -x), np.zeros_like)
    _aircraft_from_above(above, flight, (-y[-1], -x[-1]))
    _track(above, -y, -x)
    above.set(title="from above", ylabel="ahead of the leader [ft]")
    image = _map(behind, flight, (-y, z), lambda height: height)
    _aircraft_from_behind(behind, flight, (-y[-1], z[-1]))
    _track(behind, -y, z)
    behind.set(title="from behind", ylabel="above the leader [ft]")
    for axes in (above, behind):
        axes.set_xlabel("right of the leader [ft]")
        axes.set_aspect("equal", adjustable="box")
    behind.legend(loc="upper left", bbox_to_anchor=(0.0, -0.2), ncols=2, frameon=False)
    figure.colorbar(image, ax=behind, label="drag saved [percent]", location="top")
    return figure


def _map(
    axes: "Axes",
    flight: CloseFormationFlight,
    track: tuple[Array, Array],
    height: Callable[[Array], Array],
) -> "ContourSet":
    """Draw the drag saved around a track: lateral place against the other axis."""
    span = flight.posed.aircraft.span_ft
    left, right = min(track[0].min(), 0) - span, max(track[0].max(), 0) + span
    across = np.linspace(left, right, MAP_POINTS[0])
    low, high = min(track[1].min(), 0) - span, max(track[1].max(), 0) + span
    along = np.linspace(low, high, MAP_POINTS[1])
    saved = [
        [100 * drag_saving(flight.posed.aircraft, float(-a), float(h)) for a in across]
        for h in height(along)
    ]
    return axes.contourf(
        across, along, saved, levels=np.linspace(-40, 40, 17), cmap="RdYlGn",
        extend="both",
    )  # fmt: skip


def _track(axes: "Axes", across: Array, along: Array) -> None:
    """Draw where the wingman was, readable on any colour."""
    axes.plot(across, along, color="white", lw=3.5)
    axes.plot(across, along, color=REFERENCE, lw=1.5, label="track of the wingman")
    axes.plot(across[0], along[0], "o", color="white", mec=REFERENCE, label="start")


def _aircraft_from_above(
    axes: "Axes", flight: CloseFormationFlight, wingman: tuple[float, float]
) -> None:
    """Draw both aircraft to scale, the wingman where it ended."""
    whole = (
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
    if axes.get_legend_handles_labels()[0]:
        axes.legend()
