"""Figures of a reconfiguration, after the chapter's Figs. 5.18 to 5.28.

(a) tracks in the plane, "o" where they begin, an arrowhead where they end (5.18, 5.24);
(b) J of the search's best point after each generation, a panel a horizon (5.19); (c) J
of each horizon (5.20, 5.25); (d) bank and (e) thrust of each UAV (5.21, 5.22, 5.26,
5.27); (f) distances of all pairs, with both limits (5.23, 5.28).
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.drawing.drawing import (
    COLOURS,
    Figures,
    distances_figure,
    held_controls_figure,
    into_folder,
    new_figure,
    tracks_figure,
)
from swarmstart.cases.kinds.planar import POSITION, by_uav, pair_distances
from swarmstart.cases.kinds.reconfiguration.measures import (
    errors_of,
    link_distances,
)
from swarmstart.cases.kinds.reconfiguration.pose import ReconfigurationFlight
from swarmstart.cases.kinds.reconfiguration.scenario import ReconfigurationScenario
from swarmstart.cases.kinds.reconfiguration.target import slots_in_plane
from swarmstart.cases.record.trajectory_arrays import plan_costs
from swarmstart.ocp import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MOST_PANELS = 12
WIDE = 4


@into_folder
def draw(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> Figures:
    """Return all figures of a flight by name, in the order of the chapter's figures."""
    times = trajectory.times
    thrust, bank = np.moveaxis(flight.posed.controls_by_uav(trajectory.controls), 1, 0)
    return [
        ("a_trajectories", trajectories_figure(scenario, flight, trajectory)),
        ("b_evolution", evolution_figure(trajectory)),
        ("c_cost", cost_figure(scenario, flight, trajectory)),
        ("d_bank", held_controls_figure(times, np.degrees(bank), "bank [deg]")),
        ("e_thrust", held_controls_figure(times, thrust, "thrust [N]")),
        ("f_distances", pairs_figure(scenario, flight, trajectory)),
    ]


def trajectories_figure(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> "Figure":
    """Return (a): the tracks, and the slots around the leader at the end."""
    tracks = by_uav(trajectory.dense_states, len(flight.posed.slots))
    leader = tracks[scenario.leader_index]
    turned = scenario.frame == "leader"
    around = slots_in_plane(flight.posed.slots, leader[1, -1:], turned=turned)[:, :, 0]
    slots = around + leader[list(POSITION), -1]
    return tracks_figure(scenario.title, tracks, slots, "slot")


def evolution_figure(trajectory: Trajectory) -> "Figure":
    """Return (b): J of the search's best point, a panel a horizon.

    It may rise where the point comes to break less.

    Where each UAV plans alone it is the sum of their costs; a search that ended early
    counts on with its last.
    """
    histories = [
        _summed([plan.search.history for plan in decision.plans])
        for decision in trajectory.decisions[:MOST_PANELS]
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
    panels[0].set_ylabel("J of the best point")
    if len(trajectory.decisions) > len(histories):
        figure.suptitle(f"the first {len(histories)} horizons")
    if not any(history.size for history in histories):
        panels[0].text(
            0.5, 0.5, "no search", ha="center", transform=panels[0].transAxes
        )
    return figure


def _summed(histories: Sequence[Array]) -> Array:
    """Return the sum of histories, the shorter ones held at their last value."""
    longest = max(history.size for history in histories)
    searched = [history for history in histories if history.size]
    padded = [np.pad(h, (0, longest - h.size), mode="edge") for h in searched]
    return np.sum(padded, axis=0) if padded else np.empty(0)


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


def pairs_figure(
    scenario: ReconfigurationScenario,
    flight: ReconfigurationFlight,
    trajectory: Trajectory,
) -> "Figure":
    """Return (f): the distance of every pair, or of many the extremes."""
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
