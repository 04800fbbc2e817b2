"""Distances of several vehicles over time, with the limits they keep."""

import itertools
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import COLOURS, MOST_NAMED, new_figure
from swarmstart.cases.drawing.series import HALF, draw_series, name_lines

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def distances_figure(
    times: Array,
    pairs: Array,
    *,
    linked: Array | None = None,
    limits: Mapping[str, float],
) -> "Figure":
    """Return the distance of every pair of UAVs, or of many the extremes.

    Args:
        times: Shape (T,) [s].
        pairs: Distances of all pairs, (1, 2), (1, 3), ..., shape (pairs, T) [m].
        linked: Those that have an upper limit, shape (links, T) [m]; None: none has.
        limits: Name of each limit, and its distance [m].
    """
    figure = new_figure((7.0, 4.5))
    axes = figure.add_subplot()
    draw_distances(axes, times, pairs, linked=linked, limits=limits)
    name_lines(figure, room=HALF)
    return figure


def draw_distances(
    axes: "Axes",
    times: Array,
    pairs: Array,
    *,
    linked: Array | None = None,
    limits: Mapping[str, float],
) -> None:
    """Draw the distance of every pair of UAVs, or of many the extremes.

    Args:
        axes: The panel.
        times: Shape (T,) [s].
        pairs: Distances of all pairs, (1, 2), (1, 3), ..., shape (pairs, T) [m].
        linked: Those that have an upper limit, shape (links, T) [m]; None: none has.
        limits: Name of each limit, and its distance [m].
    """
    if len(pairs) <= MOST_NAMED:
        uavs = round((1 + np.sqrt(1 + 8 * len(pairs))) / 2)
        named = itertools.combinations(range(1, uavs + 1), 2)
        names = [f"UAVs {first}, {second}" for first, second in named]
        draw_series(axes, times, pairs, names=names)
    else:
        axes.plot(
            times, pairs.min(axis=0), color=COLOURS[0], lw=1.4,
            label=f"smallest of {len(pairs)} pairs",
        )  # fmt: skip
        if linked is not None:
            name = "largest" if len(linked) == len(pairs) else "largest of a link"
            axes.plot(
                times, linked.max(axis=0), color=COLOURS[1], ls="--", lw=1.4, label=name
            )
    styles = itertools.cycle((":", "-."))
    for (name, limit), style in zip(limits.items(), styles, strict=False):
        label = f"{name}, {limit:g} m"
        axes.axhline(limit, color="0.2", linestyle=style, linewidth=1.4, label=label)
    axes.set(xlabel="time [s]", ylabel="distance of two UAVs [m]")
    axes.grid(alpha=0.3)
    axes.margins(x=0)
