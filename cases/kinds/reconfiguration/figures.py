"""Figures of a reconfiguration, after the chapter's Figs. 5.17-5.22.

(a) one sheet: tracks with the slots, distances from the slots, controls with their
bounds, and the time that planning took; (b) cost of each horizon's plan and the
search's best point in each horizon; (c) distances of the UAVs.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.closest import draw_scene
from swarmstart.cases.drawing.drawing import (
    COLOURS,
    Figures,
    into_folder,
    name_lines,
    new_figure,
)
from swarmstart.cases.drawing.panels import Labels, Panel, panels_of, stacked_limits
from swarmstart.cases.drawing.plan_figures import BREAKING, KEEPING, by_violation
from swarmstart.cases.drawing.planning import draw_planning
from swarmstart.cases.drawing.sheet import Part, draw_errors, panels_part, sheet
from swarmstart.cases.drawing.tracks import Scene, distances_figure
from swarmstart.cases.kinds.planar import POSITION, by_uav, pair_distances
from swarmstart.cases.kinds.reconfiguration.measures import (
    errors_of,
    link_distances,
)
from swarmstart.cases.kinds.reconfiguration.pose import ReconfigurationFlight
from swarmstart.cases.kinds.reconfiguration.problem import slots_in_plane
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.cases.record.trajectory_arrays import plan_costs
from swarmstart.ocp import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure, FigureBase


MOST_HORIZONS = 11
"""Horizons whose searches have a panel."""
WIDE = (4, 3)
"""Possible numbers of panels in a row; the one with fewer empty places is taken."""
CONTROLS = ("thrust", "bank")
UNITS = {"thrust": "N", "bank": "deg"}


@into_folder
def draw(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> Figures:
    """Return all figures of a flight by name, in order."""
    figures = [
        ("a_sheet", sheet_figure(scenario, flight, trajectory)),
        ("b_evolution", evolution_figure(trajectory)),
    ]
    if len(flight.posed.slots) > 1:
        figures.append(("c_distances", pairs_figure(scenario, flight, trajectory)))
    return figures


def sheet_figure(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> "Figure":
    """Return figure (a): tracks, distances from the slots, controls, and planning."""
    labels = _labels(flight)
    leader = scenario.leader_index
    off = errors_of(scenario, flight, trajectory.dense_states)
    # The leader is always in its slot: slots are relative to it.
    followers = [number for number in range(len(off)) if number != leader]
    scene = scene_of(scenario, flight, trajectory)

    def draw_places(part: "FigureBase") -> None:
        draw_scene(part, scene)

    def draw_off(part: "FigureBase") -> None:
        axes = part.subplots()
        draw_errors(
            axes, trajectory.dense_times, off[followers], unit="m",
            names=[labels.vehicles[number] for number in followers], numbers=followers,
        )  # fmt: skip
        axes.set(xlabel="time [s]", ylabel="distance from the slot [m]")
        last = f"largest at the end {off[:, -1].max():.3g} m"
        axes.set_title(last, fontsize="small", loc="right")

    def draw_work(part: "FigureBase") -> None:
        joint = len(flight.posed.agents) == 1
        names = ("all UAVs",) if joint else labels.vehicles
        draw_planning(part, trajectory, names=names)

    controls = _controls(flight, trajectory, labels)
    parts = [
        Part("Tracks", draw_places),
        Part("Distance from the slot, seen from the leader", draw_off),
        panels_part("Controls", controls, labels),
        Part("Planning: time of each step, source of each plan", draw_work),
    ]
    return sheet(scenario.title, parts)


def scene_of(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> Scene:
    """Return the tracks, and the slots around the leader at the end."""
    tracks = by_uav(trajectory.dense_states, len(flight.posed.slots))
    leader = tracks[scenario.leader_index]
    turned = scenario.frame == "leader"
    around = slots_in_plane(flight.posed.slots, leader[1, -1:], turned=turned)[:, :, 0]
    return Scene(
        times=trajectory.dense_times,
        positions=tracks[:, list(POSITION)],
        headings=tracks[:, 1],
        names=_labels(flight).vehicles,
        targets=around + leader[list(POSITION), -1],
        called="slot at the end",
    )


def _labels(flight: ReconfigurationFlight) -> Labels:
    uavs = len(flight.posed.slots)
    return Labels(
        controls=CONTROLS,
        units=UNITS,
        vehicles=tuple(f"UAV {number}" for number in range(1, uavs + 1)),
    )


def _controls(
    flight: ReconfigurationFlight, trajectory: Trajectory, labels: Labels
) -> list[Panel]:
    """Return thrust and bank, the latter in degrees; all UAVs have the same bounds."""
    held = flight.posed.controls_by_uav(trajectory.controls)
    uavs, count, steps = held.shape
    scale = np.array([1.0, np.degrees(1.0)])
    _, limits = stacked_limits([agent.problem for agent in flight.posed.agents])
    # The first UAV's bounds for every row: also for a leader without decisions.
    lower, upper = (np.tile(scale * side[:count], uavs) for side in limits)
    values = (scale[:, None] * held).reshape(uavs * count, steps)
    return panels_of(CONTROLS, labels, trajectory.times, values, (lower, upper))


def evolution_figure(trajectory: Trajectory) -> "Figure":
    """Return figure (b): cost J of each plan, and of each search's best point so far.

    The line of the best point is dashed as long as this point breaks limits. If each
    UAV plans alone, the costs of all UAVs are added; a search that has ended counts
    with its last cost.
    """
    histories = [
        by_violation(
            _summed([plan.search.history for plan in decision.plans]),
            _summed([plan.search.violations for plan in decision.plans]),
        )
        for decision in trajectory.decisions[:MOST_HORIZONS]
    ]
    searched = [(k, h) for k, h in enumerate(histories, 1) if h[0].size]
    count = len(searched) + 1
    # -count % wide is the number of empty places in the last row; then the wider.
    columns = min(WIDE, key=lambda wide: (-count % min(wide, count), -wide))
    columns = min(columns, count)
    rows = math.ceil(count / columns)
    figure = new_figure((max(3.0 * columns, 5.0), 2.7 * rows))
    costs, *panels = figure.subplots(rows, columns, squeeze=False).ravel()
    every = plan_costs(trajectory)
    costs.plot(np.arange(1, every.size + 1), every, "o-", color=COLOURS[0], ms=4)
    costs.set(xlabel="horizon", ylabel="J of the plan", title="plans")
    costs.xaxis.get_major_locator().set_params(integer=True)
    costs.set_ylim(bottom=0)
    costs.grid(alpha=0.3)
    for axes, (number, history) in zip(panels, searched, strict=False):
        for values, style in zip(history, (KEEPING, BREAKING), strict=True):
            if np.isfinite(values).any():
                axes.plot(values, **style)
        none = "" if np.isfinite(history).any() else ", no finite cost"
        axes.set(title=f"horizon {number}{none}", xlabel="generation")
        axes.set_ylabel("J of the best point")
        axes.grid(alpha=0.3)
    for axes in panels[len(searched) :]:
        axes.set_axis_off()
    if not searched:
        costs.set_title("plans, made without a search")
    elif len(trajectory.decisions) > len(histories):
        figure.suptitle(f"searches of the first {len(histories)} horizons")
    name_lines(figure)
    return figure


def _summed(histories: Sequence[Array]) -> Array:
    """Return the sum of histories, the shorter ones held at their last value."""
    longest = max(history.size for history in histories)
    searched = [history for history in histories if history.size]
    padded = [np.pad(h, (0, longest - h.size), mode="edge") for h in searched]
    return np.sum(padded, axis=0) if padded else np.empty(0)


def pairs_figure(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> "Figure":
    """Return figure (c): the distance of every pair, or the extremes of many pairs."""
    pairs = pair_distances(trajectory.dense_states, len(flight.posed.slots))
    limits = {
        "safe": scenario.distances.safe_m,
        "communication": scenario.distances.communication_m,
    }
    return distances_figure(
        trajectory.dense_times,
        pairs,
        linked=link_distances(flight, pairs),
        limits=limits,
    )
