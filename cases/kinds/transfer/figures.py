"""Figures of a transfer: tracks, the search's evolution, controls, distances."""

from typing import TYPE_CHECKING

import numpy as np

from swarmstart.cases.drawing.drawing import (
    COLOURS,
    Figures,
    distances_figure,
    held_controls_figure,
    into_folder,
    new_figure,
    tracks_figure,
)
from swarmstart.cases.kinds.planar import by_uav, pair_distances
from swarmstart.cases.kinds.transfer.pose import NU, TransferFlight
from swarmstart.cases.kinds.transfer.scenario import TransferScenario
from swarmstart.ocp import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@into_folder
def draw(
    scenario: TransferScenario,
    flight: TransferFlight,
    trajectory: Trajectory,
) -> Figures:
    """Return all figures of a flight by name, in order."""
    uavs, times = len(flight.posed.goals), trajectory.times
    tracks = by_uav(trajectory.dense_states, uavs)
    steps = trajectory.controls.shape[1]
    acceleration, bank = np.moveaxis(trajectory.controls.reshape(uavs, NU, steps), 1, 0)
    figures = [
        (
            "a_trajectories",
            tracks_figure(scenario.title, tracks, flight.posed.goals, "goal"),
        ),
        ("b_evolution", evolution_figure(trajectory)),
        (
            "c_acceleration",
            held_controls_figure(times, acceleration, "acceleration [m/s$^2$]"),
        ),
        ("d_bank", held_controls_figure(times, np.degrees(bank), "bank [deg]")),
    ]
    if uavs > 1:
        pairs = pair_distances(trajectory.dense_states, uavs)
        limits = {"safe": scenario.safe_distance_m}
        distances = distances_figure(trajectory.dense_times, pairs, limits=limits)
        figures.append(("e_distances", distances))
    return figures


def evolution_figure(trajectory: Trajectory) -> "Figure":
    """Return the search's best cost against generations, and the plan's cost."""
    figure = new_figure()
    axes = figure.add_subplot()
    plan = trajectory.decisions[0].plans[0]
    if plan.search.history.size:
        axes.plot(
            plan.search.history, color=COLOURS[0], label="best point of the search"
        )
    label = f"plan, {plan.cost:.4g}"
    axes.axhline(plan.cost, ls="--", color=COLOURS[1], label=label)
    axes.set(xlabel="generation", ylabel="cost", ylim=(0, None))
    axes.legend(fontsize="small")
    return figure
