"""Tracks of vehicles in the plane, to scale, with marks of time, and their distances.

For a problem without a position the phase plane takes the place of tracks: the second
state over the first one, also with marks of time. Distances of several vehicles are
drawn over time, with their limits.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import (
    COLOURS,
    HALF,
    MOST_NAMED,
    arrowhead,
    colour,
    draw_series,
    escaped,
    line_style,
    name_lines,
    new_figure,
)
from swarmstart.cases.drawing.panels import BOUND, Labels, Panel, bounds_of
from swarmstart.cases.drawing.plan_figures import PlanPath

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_MARKS = 8
"""Marks of time on a track."""
_NICE = (1.0, 2.0, 5.0, 10.0)
"""Steps between marks, times a power of ten [s]."""
_APART = 0.06
"""Least distance of two labels, in parts of the axes."""
_TOUCH = 1e-3
"""Part of an obstacle's radius that a path may enter it by rounding."""
_PAPER = {"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.7}


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Scene:
    """Vehicles in the plane over time, with their surroundings.

    Attributes:
        times: Instants, shape (T,) [s].
        positions: Positions of the vehicles, shape (vehicles, 2, T).
        headings: Headings of the vehicles, shape (vehicles, T) [rad].
        names: Names of the vehicles.
        numbers: Number of each vehicle's colour; None means from 0 on.
        discs: x, y and radius of each obstacle.
        leader: Position of a virtual leader, shape (2, T); None without one.
        slots: Wanted position of each vehicle at each time, shape (vehicles, 2, T),
            shown in animations only; None if not known.
        targets: Wanted positions at the end, shape (targets, 2); None if not known.
        called: Word for a target.
        plans: Paths that were planned, each of shape (2, n); drawn as thin lines
            beneath.
        axes: Labels of the two axes.
    """

    times: Array
    positions: Array
    headings: Array
    names: Sequence[str]
    numbers: Sequence[int] | None = None
    discs: Sequence[tuple[float, float, float]] = ()
    leader: Array | None = None
    slots: Array | None = None
    targets: Array | None = None
    called: str = "target"
    plans: Sequence[Array] = ()
    axes: tuple[str, str] = ("x [m]", "y [m]")

    def until(self, end: float) -> "Scene":
        """Return the part of the scene up to a time [s]."""
        kept = self.times <= end + 1e-9  # An end that is off by rounding.
        return replace(
            self,
            times=self.times[kept],
            positions=self.positions[:, :, kept],
            headings=self.headings[:, kept],
            leader=None if self.leader is None else self.leader[:, kept],
        )

    @property
    def is_few(self) -> bool:
        """Return whether each vehicle has its own line and name."""
        return len(self.names) <= MOST_NAMED


def draw_tracks(axes: "Axes", scene: Scene) -> None:
    """Draw tracks to scale: a ring at the start, a dot each few seconds, an arrowhead.

    Args:
        axes: The panel.
        scene: The vehicles with their surroundings.
    """
    _draw_discs(axes, scene)
    for path in scene.plans:
        axes.plot(*path, color="0.6", lw=0.6, zorder=1, label="plans")
    if scene.leader is not None:
        axes.plot(*scene.leader, color="0.35", ls=":", lw=1.2, label="virtual leader")
        axes.plot(*scene.leader[:, -1], "o", color="0.2", fillstyle="none", ms=6)
    marks = mark_times(scene.times)
    at = [int(np.argmin(np.abs(scene.times - mark))) for mark in marks]
    numbers = scene.numbers or range(len(scene.names))
    for number, places, headings, name in zip(
        numbers, scene.positions, scene.headings, scene.names, strict=True
    ):
        _draw_track(axes, scene, number, (places, headings, name), at)
    if not scene.is_few:
        # A line without points: only its name is wanted, in the legend.
        axes.plot(
            [], [], color=COLOURS[0], lw=0.8, label=f"{len(scene.names)} vehicles"
        )
    if scene.targets is not None:
        size = 7 if scene.is_few else 3
        axes.plot(
            *scene.targets.T, "x", color="0.35", ms=size, ls="none",
            label=scene.called, zorder=0,
        )  # fmt: skip
    if scene.is_few:
        name = f"each {_step(marks):g} s"
        axes.plot([], [], ".", color="0.2", ls="none", label=name)
    axes.set(xlabel=scene.axes[0], ylabel=scene.axes[1])
    axes.margins(0.08)
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)
    if scene.is_few:
        _label_marks(axes, scene, marks, at)


def inside_discs(scene: Scene) -> NDArray[np.bool_]:
    """Return whether a vehicle is inside an obstacle, shape (vehicles, T).

    A vehicle counts as inside if it is farther inside the edge than 0.1 % of the
    radius.
    """
    inside = np.zeros((len(scene.positions), scene.times.size), dtype=bool)
    for x, y, radius in scene.discs:
        away = np.hypot(scene.positions[:, 0] - x, scene.positions[:, 1] - y)
        inside |= away < (1 - _TOUCH) * radius
    return inside


def mark_times(times: Array) -> Array:
    """Return round times for marks: after the first instant, and up to the last.

    Args:
        times: Instants, shape (T,) [s].

    Example:
        >>> mark_times(np.linspace(0.0, 35.0, 71)).tolist()
        [5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0]
    """
    begin, end = float(times[0]), float(times[-1])
    least = max(end - begin, 1e-9) / MOST_MARKS  # A single instant has no length.
    power = 10.0 ** np.floor(np.log10(least))
    # 1e-9: a step or a mark that fits exactly must not be lost to rounding.
    step = power * next(nice for nice in _NICE if nice * power >= least * (1 - 1e-9))
    first, last = np.floor(begin / step + 1e-9) + 1, np.floor(end / step + 1e-9)
    marks: Array = np.round(step * np.arange(first, last + 1), 9)
    return marks


def _step(marks: Array) -> float:
    return float(marks[1] - marks[0]) if marks.size > 1 else float(marks.sum())


def _draw_discs(axes: "Axes", scene: Scene) -> None:
    from matplotlib.patches import Circle

    for number, (x, y, radius) in enumerate(scene.discs):
        axes.add_patch(
            Circle(
                (x, y), radius, facecolor="0.85", edgecolor="0.4", hatch="///",
                label="obstacle" if number == 0 else None,
            )
        )  # fmt: skip


def _draw_track(
    axes: "Axes",
    scene: Scene,
    number: int,
    track: tuple[Array, Array, str],
    at: Sequence[int],
) -> None:
    """Draw one vehicle's track with its marks."""
    (x, y), headings, name = track
    few = scene.is_few
    own = colour(number) if few else COLOURS[0]
    axes.plot(
        x, y, color=own, ls=line_style(number) if few else "-",
        lw=1.3 if few else 0.5, alpha=1.0 if few else 0.6,
        label=escaped(name) if few and name else None,
    )  # fmt: skip
    axes.plot(x[0], y[0], "o", color=own, fillstyle="none", ms=6 if few else 2)
    if few:
        axes.plot(x[at], y[at], ".", color=own, ms=6, ls="none")
    if np.isfinite(headings[-1]):
        axes.plot(
            x[-1], y[-1], marker=arrowhead(float(headings[-1])), color=own,
            ms=11 if few else 5, ls="none",
        )  # fmt: skip


def _label_marks(axes: "Axes", scene: Scene, marks: Array, at: Sequence[int]) -> None:
    """Write the time beside the marks of the vehicle that comes farthest."""
    moved = np.abs(np.diff(scene.positions, axis=2)).sum(axis=(1, 2))
    track = scene.positions[int(np.nanargmax(moved))]
    label_times(axes, marks, track[:, at])


def label_times(axes: "Axes", marks: Array, places: Array) -> None:
    """Write times beside places; a time too near to the one before is left out.

    Args:
        axes: The panel; all lines are drawn already.
        marks: Times to write, shape (n,) [s].
        places: Positions at these times, shape (2, n).
    """
    spans = np.abs([np.diff(axes.get_xlim())[0], np.diff(axes.get_ylim())[0]])
    # To scale, matplotlib widens the shorter axis only while it draws.
    if axes.get_aspect() != "auto":
        spans[:] = spans.max()
    last = np.full(2, np.inf)
    for mark, place in zip(marks, places.T, strict=True):
        if not np.isfinite(place).all():
            continue
        if np.isfinite(last).all() and (np.abs(place - last) < _APART * spans).all():
            continue
        last = place
        axes.annotate(
            f"{mark:g} s", tuple(place), textcoords="offset points", xytext=(4, 5),
            fontsize="x-small", color="0.2", bbox=_PAPER,
        )  # fmt: skip


def distances_figure(
    times: Array,
    pairs: Array,
    *,
    linked: Array | None = None,
    limits: Mapping[str, float],
) -> "Figure":
    """Return a figure of the distances of all pairs of UAVs.

    Of many pairs only the extremes are drawn.

    Args:
        times: Instants, shape (T,) [s].
        pairs: Distances of all pairs, (1, 2), (1, 3), ..., shape (pairs, T) [m].
        linked: Distances of pairs that have an upper limit, shape (links, T) [m]; None
            if no pair has one.
        limits: Name of each limit, and its distance [m].
    """
    figure = new_figure((7.0, 4.5))
    axes = figure.add_subplot()
    draw_distances(axes, times, pairs, linked=linked, limits=limits)
    axes.set_title("Distances between UAVs", fontsize="medium")
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
    """Draw the distance of every pair of UAVs; of many pairs only the extremes.

    Args:
        axes: The panel.
        times: Instants, shape (T,) [s].
        pairs: Distances of all pairs, (1, 2), (1, 3), ..., shape (pairs, T) [m].
        linked: Distances of pairs that have an upper limit, shape (links, T) [m]; None
            if no pair has one.
        limits: Name of each limit, and its distance [m].
    """
    if len(pairs) <= MOST_NAMED:
        # n vehicles have n (n - 1) / 2 pairs.
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


def draw_phase_plane(
    axes: "Axes",
    first: Panel,
    second: Panel,
    plans: Sequence[PlanPath],
    labels: Labels,
) -> None:
    """Draw the second state of each vehicle over its first, with plans thin."""
    for plan in plans:
        # Vehicle after vehicle, two states each.
        for x, y in zip(plan.states[::2], plan.states[1::2], strict=True):
            axes.plot(x, y, color="0.6", lw=0.6, zorder=1, label="plans")
    marks = mark_times(first.times)
    at = [int(np.argmin(np.abs(first.times - mark))) for mark in marks]
    for number, (x, y) in enumerate(zip(first.values, second.values, strict=True)):
        own = colour(number)
        name = escaped(labels.vehicles[number]) if labels.are_named else None
        axes.plot(x, y, color=own, ls=line_style(number), lw=1.4, label=name)
        axes.plot(x[0], y[0], "o", color=own, fillstyle="none", label="start")
        axes.plot(x[-1], y[-1], "s", color=own, ms=5, label="end")
        axes.plot(x[at], y[at], ".", color=own, ms=5)
    for panel, line in ((first, axes.axvline), (second, axes.axhline)):
        for bound, own in bounds_of(panel)[0]:
            line(bound, color=own, ls=":", lw=1.4, label=BOUND)
    places = np.stack([first.values[0, at], second.values[0, at]])
    label_times(axes, marks, places)
    axes.set(xlabel=escaped(first.label), ylabel=escaped(second.label))
    axes.grid(alpha=0.3)
