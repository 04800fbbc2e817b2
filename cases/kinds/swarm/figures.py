"""Sheet of a swarm's flight: tracks, least distance, arrivals, agreements."""

from typing import TYPE_CHECKING

import numpy as np

from swarmstart.cases.drawing.drawing import COLOURS, Figures, into_folder
from swarmstart.cases.drawing.sheet import Part, sheet
from swarmstart.cases.drawing.swarm_figures import (
    draw_arrivals,
    draw_distance,
    draw_swarm_tracks,
)
from swarmstart.cases.drawing.wording import quantity
from swarmstart.cases.kinds.swarm.kind import flight_of
from swarmstart.cases.kinds.swarm.pose import SwarmRun
from swarmstart.cases.kinds.swarm.scenario import SwarmScenario
from swarmstart.ocp import SwarmFlight, Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase


@into_folder
def draw(scenario: SwarmScenario, flight: SwarmRun, trajectory: Trajectory) -> Figures:
    """Return the figure of a flight with its name."""
    del flight
    return [("a_sheet", sheet_figure(scenario, flight_of(trajectory)))]


def sheet_figure(scenario: SwarmScenario, flight: SwarmFlight) -> "Figure":
    """Return tracks from above, least distance, arrivals and agreements."""

    def tracks(part: "FigureBase") -> None:
        draw_swarm_tracks(part.subplots(), flight)

    def distance(part: "FigureBase") -> None:
        draw_distance(part.subplots(), flight)

    def arrivals(part: "FigureBase") -> None:
        draw_arrivals(part.subplots(), flight)

    def agreements(part: "FigureBase") -> None:
        draw_agreements(part.subplots(), flight)

    near = quantity(flight.min_distance_m, 3)
    said = f"{flight.swarm.size} vehicles, rule {flight.rule}, at least {near} m apart"
    return sheet(
        f"{scenario.title}\n{said}",
        [
            Part("Tracks from above", tracks),
            Part("Nearest two plans", distance),
            Part("Arrivals", arrivals),
            Part("Plans a second", agreements),
        ],
    )


def draw_agreements(axes: "Axes", flight: SwarmFlight) -> None:
    """Draw how many plans were proposed, and committed to, in each second."""
    log = flight.log
    tick_s = log.step_s / log.ticks
    edges = np.arange(0.0, np.ceil(max(flight.times[-1], 1.0)) + 1.0)
    flown = log.proposed >= 0
    proposed, _ = np.histogram(log.proposed[flown] * tick_s, edges)
    agreed, _ = np.histogram(log.ended[flown & log.committed] * tick_s, edges)
    axes.stairs(proposed, edges, color=COLOURS[1], label="proposed")
    axes.stairs(agreed, edges, color=COLOURS[0], fill=True, label="committed to")
    axes.set(xlabel="time [s]", ylabel="plans a second")
