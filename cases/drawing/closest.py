"""Tracks of vehicles with a zoom at each place of a close approach.

    to an obstacle      |p - c| - r      of two vehicles      |p - q|, at the same time

with positions p and q of vehicles, and centre c and radius r of the obstacle.

A distance of less than 2 % of the picture's larger side can hardly be seen. Each
nearest approach with such a distance has a panel of its own beside the tracks.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import escaped
from swarmstart.cases.drawing.tracks import Scene, draw_tracks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import FigureBase

SMALL = 0.02
"""Part of the picture's larger side below which a distance has a zoom."""
_AROUND, _LEAST = 2.5, 5e-4
"""Half the side of a zoom, in distances, and at least in parts of the picture."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Approach:
    """The nearest approach of a vehicle to an obstacle, or of two vehicles.

    Attributes:
        names: Names of the vehicles, or of vehicle and obstacle; empty names are left
            out.
        distance: Least distance, in the unit of the positions, negative inside an
            obstacle.
        time: Time of the least distance [s].
        ends: Positions of both ends of the distance, each in a row, shape (2, 2).
    """

    names: Sequence[str]
    distance: float
    time: float
    ends: Array

    def words(self, unit: str) -> str:
        """Return two lines of text: the distance with its time, then the names."""
        # About: a measure may follow a finer path than the figure.
        shown = f"about {self.distance:.2g} {unit}".strip()
        who = ", ".join(name for name in self.names if name)
        return f"{shown} at {self.time:.4g} s\n{who}"


def draw_scene(part: "FigureBase", scene: Scene) -> None:
    """Draw tracks, and beside them a zoom at each approach that is hardly seen.

    Args:
        part: A figure, or a part of one, that is empty.
        scene: The vehicles with their surroundings.
    """
    side = _side(scene)
    zooms = [one for one in approaches(scene) if one.distance < SMALL * side]
    if not zooms:
        draw_tracks(part.subplots(), scene)
        return
    cells = part.add_gridspec(len(zooms), 2, width_ratios=(2.0, 1.0))
    whole = part.add_subplot(cells[:, 0])
    draw_tracks(whole, scene)
    for row, zoom in enumerate(zooms):
        half = max(_AROUND * abs(zoom.distance), _LEAST * side)
        x, y = zoom.ends.mean(axis=0)
        whole.plot(x, y, "s", ms=9, mfc="none", mec="0.1", label="enlarged beside")
        # Two places may be near each other: their numbers are not.
        whole.annotate(
            f"{row + 1}", (x, y), textcoords="offset points",
            xytext=((6, -12), (-13, 5))[row], fontsize="small",
        )  # fmt: skip
        axes = part.add_subplot(cells[row, 1])
        _draw_zoom(axes, scene, zoom)
        # auto: one of them gives way to the shape of the panel, to stay to scale.
        axes.set_xlim(x - half, x + half, auto=True)
        axes.set_ylim(y - half, y + half, auto=True)
        axes.set_title(f"{row + 1}: {_title(zoom, scene)}", fontsize="small")


def _draw_zoom(axes: "Axes", scene: Scene, zoom: Approach) -> None:
    draw_tracks(axes, scene)
    for text in [*axes.texts]:  # Times, which would stand beside the panel, too.
        text.remove()
    axes.plot(*zoom.ends.T, color="0.1", lw=1.2, marker=".", zorder=4)
    axes.tick_params(labelsize="small")
    axes.locator_params(nbins=3)
    axes.ticklabel_format(useOffset=False)


def _title(zoom: Approach, scene: Scene) -> str:
    _, _, unit = scene.axes[0].partition(" [")
    return escaped(zoom.words(unit.rstrip("]")))


def approaches(scene: Scene) -> Iterator[Approach]:
    """Yield the nearest approach to an obstacle, and that of two vehicles, if any."""
    yield from _nearest(_to_obstacles(scene))
    yield from _nearest(_of_two(scene))


Candidate = tuple[float, float, Sequence[str], Array]
"""Distance, time, names, ends."""


def _nearest(candidates: Iterator[Candidate]) -> Iterator[Approach]:
    best = min(candidates, key=lambda one: one[0], default=None)
    if best is not None and np.isfinite(best[0]):
        distance, time, names, ends = best
        yield Approach(names=names, distance=distance, time=time, ends=ends)


def _to_obstacles(scene: Scene) -> Iterator[Candidate]:
    for x, y, radius in scene.discs:
        centre = np.array([x, y])
        for name, places in zip(scene.names, scene.positions, strict=True):
            away, time = _least(scene.times, places - centre[:, None])
            place = _at(scene, places, time)
            # 1e-300: at the centre itself there is no direction.
            edge = centre + radius * (place - centre) / max(away, 1e-300)
            ends = np.stack([place, edge])
            yield away - radius, time, (name, "obstacle"), ends


def _of_two(scene: Scene) -> Iterator[Candidate]:
    for first, second in itertools.combinations(range(len(scene.names)), 2):
        pair = scene.positions[[first, second]]
        apart, time = _least(scene.times, pair[1] - pair[0])
        ends = np.stack([_at(scene, places, time) for places in pair])
        yield apart, time, (scene.names[first], scene.names[second]), ends


def _least(times: Array, way: Array) -> tuple[float, float]:
    """Return the least length of a vector (2, T), straight between instants; its time.

    Infinite if no length is finite.
    """
    begin, step = way[:, :-1], np.diff(way)
    # 1e-300: a vector that rests is as short at the begin.
    part = np.clip(
        -(begin * step).sum(axis=0) / (step**2).sum(axis=0).clip(1e-300), 0, 1
    )
    lengths = np.hypot(*(begin + part * step))
    lengths = np.where(np.isfinite(lengths), lengths, np.inf)
    k = int(np.argmin(lengths))
    return float(lengths[k]), float(times[k] + part[k] * (times[k + 1] - times[k]))


def _at(scene: Scene, places: Array, time: float) -> Array:
    """Return a place (2,) at a time, straight between instants."""
    return np.array([np.interp(time, scene.times, row) for row in places])


def _side(scene: Scene) -> float:
    """Return the larger side of the picture of tracks and obstacles."""
    low = np.nanmin(scene.positions, axis=(0, 2))
    high = np.nanmax(scene.positions, axis=(0, 2))
    for x, y, radius in scene.discs:
        low = np.minimum(low, [x - radius, y - radius])
        high = np.maximum(high, [x + radius, y + radius])
    return float((high - low).max())
