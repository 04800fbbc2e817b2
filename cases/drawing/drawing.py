"""Figures that several kinds share: colours, tracks, controls, distances, files."""

import functools
import itertools
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmstart.cases.record.files import write_atomically
from swarmstart.ocp import Trajectory

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]
S = TypeVar("S")
F = TypeVar("F")
Figures = Iterable[tuple[str, "Figure"]]
"""Names without a suffix, and figures."""

# Colours that people with colour-blindness can tell apart (Okabe and Ito, 2008).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MOST_NAMED = 10
"""Vehicles, or pairs of them, up to which each is named in the legend."""


def new_figure(size: tuple[float, float] = (7.0, 4.0)) -> "Figure":
    """Return an empty figure that no global state knows of; its size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=size, dpi=110, layout="constrained")


def into_folder(
    figures: Callable[[S, F, Trajectory], Figures],
) -> Callable[[S, F, Trajectory, Path], list[Path]]:
    """Return a function that writes figures into a folder and returns the files.

    Args:
        figures: Scenario, flight and trajectory -> figures by name, in order.
    """

    @functools.wraps(figures)
    def draw(
        scenario: S, flight: F, trajectory: Trajectory, folder: Path
    ) -> list[Path]:
        return write_figures(figures(scenario, flight, trajectory), folder)

    return draw


def write_figures(figures: Figures, folder: Path) -> list[Path]:
    """Write figures as PNG files by name; return the files, in order.

    Args:
        figures: Names without a suffix, and figures.
        folder: Where they go; made where it is missing.
    """
    files = []
    for name, figure in figures:
        file = folder / f"{name}.png"
        write_atomically(file, functools.partial(figure.savefig, format="png"))
        files.append(file)
    return files


def colour(number: int) -> str:
    """Return the colour of a UAV; seven, then round again."""
    return COLOURS[number % len(COLOURS)]


def arrowhead(heading: float) -> Array:
    """Return a triangle that points along a heading [rad], shape (4, 2)."""
    along = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-along[1], along[0]])
    tip, left = along, -0.7 * along + 0.55 * across
    right = -0.7 * along - 0.55 * across
    return np.array([tip, left, right, tip])


def tracks_figure(title: str, tracks: Array, targets: Array, called: str) -> "Figure":
    """Return tracks, "o" where they begin and an arrowhead where they end.

    Args:
        title: Of the figure.
        tracks: Speed, heading [rad], x and y [m] of each UAV, shape (uavs, 4, T).
        targets: Where each ought to end, shape (uavs, 2) [m].
        called: What a target is called.
    """
    figure = new_figure((7.5, 6.0))
    axes = figure.add_subplot()
    few = len(tracks) <= MOST_NAMED
    size = 6 if few else 3
    for number, states in enumerate(tracks):
        (_, heading, x, y), own = states, colour(number)
        label = f"UAV {number + 1}" if few else None
        axes.plot(x, y, color=own, linewidth=1.2, label=label)
        axes.plot(x[0], y[0], "o", color=own, fillstyle="none", ms=size)
        axes.plot(
            x[-1], y[-1], marker=arrowhead(float(heading[-1])), color=own, ms=2 * size
        )
    axes.plot(*targets.T, "x", color="0.4", ms=size, label=called, zorder=0)
    axes.set(xlabel="x [m]", ylabel="y [m]", title=title)
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize="small")
    return figure


def held_controls_figure(times: Array, controls: Array, label: str) -> "Figure":
    """Return one control of every UAV, held over each step.

    Args:
        times: Ends of the steps, shape (T + 1,) [s].
        controls: Of each UAV, shape (uavs, T).
        label: Of the axis.
    """
    figure = new_figure()
    axes = figure.add_subplot()
    for number, values in enumerate(controls):
        width = max(1.0, 3.4 - 0.5 * number)  # Lines that coincide stay visible.
        axes.stairs(
            values, times, baseline=None, color=colour(number), linewidth=width,
            label=f"UAV {number + 1}",
        )  # fmt: skip
    axes.set(xlabel="time [s]", ylabel=label)
    if len(controls) <= MOST_NAMED:
        axes.legend(fontsize="small", ncols=2)
    return figure


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
        limits: What a limit is called, and its distance [m].
    """
    figure = new_figure((7.0, 4.5))
    axes = figure.add_subplot()
    if len(pairs) <= MOST_NAMED:
        uavs = round((1 + np.sqrt(1 + 8 * len(pairs))) / 2)
        named = itertools.combinations(range(1, uavs + 1), 2)
        for number, (pair, values) in enumerate(zip(named, pairs, strict=True)):
            style = "-" if number < len(COLOURS) else "--"
            name = f"{pair[0]}, {pair[1]}"
            axes.plot(times, values, style, color=colour(number), lw=1.2, label=name)
    else:
        axes.plot(times, pairs.min(axis=0), color=COLOURS[0], lw=1.4, label="smallest")
        if linked is not None:
            name = "largest" if len(linked) == len(pairs) else "largest of a link"
            axes.plot(times, linked.max(axis=0), color=COLOURS[1], lw=1.4, label=name)
    for name, limit in limits.items():
        label = f"{name}, {limit:g} m"
        axes.axhline(limit, color="0.2", linestyle=":", linewidth=1.2, label=label)
    axes.set(xlabel="time [s]", ylabel="distance of two UAVs [m]")
    axes.legend(fontsize="small", ncols=2, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
