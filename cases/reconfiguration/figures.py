"""Figures of a reconfiguration, after the chapter's Figs. 5.18 to 5.28.

(a) tracks in the plane, "o" where they begin, an arrowhead where they end (5.18, 5.24);
(b) the search's best cost after each generation, a panel a horizon (5.19); (c) J of
each horizon (5.20, 5.25); (d) bank and (e) thrust of each UAV (5.21, 5.22, 5.26, 5.27);
(f) distances of all pairs, with both limits (5.23, 5.28).
"""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.drawing import (
    COLOURS,
    arrowhead,
    colour,
    new_figure,
    write_figures,
)
from swarmstart.cases.planar import POSITION, by_uav, pair_distances
from swarmstart.cases.reconfiguration.build import ReconfigurationFlight
from swarmstart.cases.reconfiguration.measures import (
    errors_of,
    link_distances,
    plan_costs,
)
from swarmstart.cases.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.cases.reconfiguration.target import slots_in_plane
from swarmstart.ocp import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MOST_NAMED = 10
"""UAVs, or pairs of them, up to which each has a line of its own in the legend."""
MOST_PANELS = 12
WIDE = 4


def draw(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
    folder: Path,
) -> list[Path]:
    """Draw all figures of a flight.

    Args:
        scenario: The scenario.
        flight: What was flown.
        trajectory: The flight.
        folder: Where the PNG files go; made where it is missing.

    Returns:
        The files, in the order of the chapter's figures.
    """
    figures = [
        ("a_trajectories", trajectories_figure(scenario, flight, trajectory)),
        ("b_evolution", evolution_figure(trajectory)),
        ("c_cost", cost_figure(scenario, flight, trajectory)),
        ("d_bank", controls_figure(flight, trajectory, 1, "bank [deg]", 180 / np.pi)),
        ("e_thrust", controls_figure(flight, trajectory, 0, "thrust [N]", 1.0)),
        ("f_distances", distances_figure(scenario, flight, trajectory)),
    ]
    return write_figures(figures, folder)


def trajectories_figure(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> "Figure":
    """Return (a): the tracks, and the slots around the leader at the end."""
    figure = new_figure((7.5, 6.0))
    axes = figure.add_subplot()
    tracks = by_uav(trajectory.dense_states, len(flight.slots))
    size = 6 if len(tracks) <= MOST_NAMED else 3
    for number, states in enumerate(tracks):
        x, y = states[list(POSITION)]
        label = f"UAV {number + 1}" if len(tracks) <= MOST_NAMED else None
        axes.plot(x, y, color=colour(number), linewidth=1.2, label=label)
        axes.plot(x[0], y[0], "o", color=colour(number), fillstyle="none", ms=size)
        axes.plot(
            x[-1], y[-1], marker=arrowhead(float(states[1, -1])), color=colour(number),
            ms=2 * size,
        )  # fmt: skip
    leader = tracks[scenario.leader_index]
    turned = scenario.frame == "leader"
    around = slots_in_plane(flight.slots, leader[1, -1:], turned=turned)[:, :, 0]
    wanted = around + leader[list(POSITION), -1]
    axes.plot(*wanted.T, "x", color="0.4", ms=size, label="slot", zorder=0)
    axes.set(xlabel="x [m]", ylabel="y [m]", title=scenario.title)
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize="small")
    return figure


def evolution_figure(trajectory: Trajectory) -> "Figure":
    """Return (b): the search's best cost against generations, a panel a horizon."""
    histories = [
        np.sum([plan.search_history for plan in decision.plans], axis=0)
        for decision in trajectory.decisions[:MOST_PANELS]
        if len({plan.search_history.size for plan in decision.plans}) == 1
    ]
    columns = min(len(histories), WIDE) or 1
    rows = math.ceil(len(histories) / columns) or 1
    figure = new_figure((3.0 * columns, 2.6 * rows))
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for number, axes in enumerate(panels):
        if number >= len(histories) or not histories[number].size:
            axes.set_axis_off()
            continue
        axes.plot(histories[number], color=COLOURS[0], linewidth=1.2)
        axes.set_title(f"horizon {number + 1}", fontsize="medium")
        axes.set_xlabel("generation")
    panels[0].set_ylabel("best J")
    if not any(history.size for history in histories):
        panels[0].text(
            0.5, 0.5, "no search", ha="center", transform=panels[0].transAxes
        )
    return figure


def cost_figure(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> "Figure":
    """Return (c): J of each horizon, and the position error at its end."""
    figure = new_figure((7.0, 5.5))
    above, below = figure.subplots(2, 1, sharex=True)
    horizons = np.arange(1, len(trajectory.decisions) + 1)
    above.plot(horizons, plan_costs(trajectory), "o-", color=COLOURS[0])
    above.set_ylabel("J")
    off = errors_of(scenario, flight, trajectory.states).max(axis=0)[1:]
    below.plot(horizons, off, "o-", color=COLOURS[1])
    below.set(xlabel="horizon", ylabel="largest position error [m]")
    for axes in (above, below):
        axes.set_ylim(bottom=0)
    below.xaxis.get_major_locator().set_params(integer=True)
    return figure


def controls_figure(
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
    row: int,
    label: str,
    unit: float,
) -> "Figure":
    """Return (d) or (e): one control of every UAV, held over each step.

    Args:
        flight: What was flown.
        trajectory: The flight.
        row: Of the control.
        label: Of the axis.
        unit: The control is multiplied by it.
    """
    figure = new_figure()
    axes = figure.add_subplot()
    controls = unit * flight.controls_by_uav(trajectory.controls)[:, row]
    for number, values in enumerate(controls):
        axes.stairs(
            values, trajectory.times, baseline=None, color=colour(number),
            linewidth=max(1.0, 3.4 - 0.5 * number),  # Lines that coincide stay visible.
            label=f"UAV {number + 1}",
        )  # fmt: skip
    axes.set(xlabel="time [s]", ylabel=label)
    if len(controls) <= MOST_NAMED:
        axes.legend(fontsize="small", ncols=2)
    return figure


def distances_figure(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> "Figure":
    """Return (f): the distance of every pair, or of many the smallest and largest."""
    figure = new_figure((7.0, 4.5))
    axes = figure.add_subplot()
    times, uavs = trajectory.dense_times, len(flight.slots)
    distances = pair_distances(trajectory.dense_states, uavs)
    if len(distances) <= MOST_NAMED:
        pairs = zip(*np.triu_indices(uavs, k=1), strict=True)
        for number, (pair, values) in enumerate(zip(pairs, distances, strict=True)):
            style = "-" if number < len(COLOURS) else "--"
            name = f"{pair[0] + 1}, {pair[1] + 1}"
            axes.plot(times, values, style, color=colour(number), lw=1.2, label=name)
    else:
        linked = link_distances(flight, distances).max(axis=0)
        name = "largest" if len(flight.links) == len(distances) else "largest of a link"
        axes.plot(times, distances.min(axis=0), lw=1.4, label="smallest")
        axes.plot(times, linked, lw=1.4, label=name)
    _limits(axes, scenario)
    axes.set(xlabel="time [s]", ylabel="distance of two UAVs [m]")
    axes.legend(fontsize="small", ncols=2, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _limits(axes: "Axes", scenario: ReconfigurationScenario) -> None:
    limits = scenario.distances
    for limit, name in (
        (limits.safe_m, "safe"), (limits.communication_m, "communication")
    ):  # fmt: skip
        label = f"{name}, {limit:g} m"
        axes.axhline(limit, color="0.2", linestyle=":", linewidth=1.2, label=label)
