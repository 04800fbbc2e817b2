"""Figure of a swarm's flight: tracks from above, least distance, arrivals."""

from typing import TYPE_CHECKING, Any

import numpy as np

from swarmstart.cases.drawing.drawing import COLOURS, colour, name_lines, new_figure
from swarmstart.ocp import SwarmFlight

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARGIN = 0.1
"""Room above the curve, in parts of its height."""


def draw_swarm(flight: SwarmFlight) -> "Figure":
    """Return a figure of the tracks from above, the least distance and the arrivals.

    Args:
        flight: The flight.
    """
    figure = new_figure((9.0, 4.5))
    grid = figure.add_gridspec(2, 2, width_ratios=(3, 2))
    above = figure.add_subplot(grid[:, 0])
    draw_swarm_tracks(above, flight)
    above.set_title("from above")
    near = figure.add_subplot(grid[0, 1])
    draw_distance(near, flight)
    draw_arrivals(figure.add_subplot(grid[1, 1], sharex=near), flight)
    near.set_xlabel("")
    near.tick_params(labelbottom=False)
    name_lines(figure)
    return figure


def draw_swarm_tracks(axes: "Axes", flight: SwarmFlight) -> None:
    """Draw the tracks with starts, goals, and the last places of obstacles."""
    from matplotlib.patches import Circle

    swarm = flight.swarm
    for number, obstacle in enumerate(swarm.obstacles):
        x, y, _ = obstacle.path[-1]
        axes.add_patch(
            Circle(
                (x, y), obstacle.radius, color="0.8",
                label="obstacle" if number == 0 else None,
            )
        )  # fmt: skip
        if len(obstacle.path) > 1:
            axes.plot(*obstacle.path[:, :2].T, color="0.8", linestyle="--")
    for number, path in enumerate(flight.positions):
        axes.plot(path[0], path[1], color=colour(number), linewidth=1.0)
    style: dict[str, Any] = {"linestyle": "", "color": "0.3", "markersize": 4}
    axes.plot(*swarm.starts[:, :2].T, marker="o", label="start", **style)
    axes.plot(*swarm.goals[:, :2].T, marker="x", label="goal", **style)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")


def draw_distance(axes: "Axes", flight: SwarmFlight) -> None:
    """Draw the distance of the nearest two vehicles, and the least allowed distance."""
    if np.isfinite(flight.apart).all() and len(flight.apart):
        axes.stairs(
            flight.apart, flight.times, baseline=None, color=COLOURS[0],
            label="nearest two",
        )  # fmt: skip
    axes.axhline(
        flight.swarm.plan_distance,
        color=COLOURS[1],
        linestyle="--",
        label="least distance",
    )
    axes.set(xlabel="time [s]", ylabel="distance [m]")
    axes.margins(y=MARGIN)
    axes.set_ylim(bottom=0.0)


def draw_arrivals(axes: "Axes", flight: SwarmFlight) -> None:
    """Draw the share of the vehicles that have arrived."""
    arrived = (flight.arrival_s[:, None] <= flight.times).mean(axis=0)
    axes.step(flight.times, arrived, where="post", color=COLOURS[0])
    axes.set(xlabel="time [s]", ylabel="share arrived", ylim=(0.0, 1.05))
