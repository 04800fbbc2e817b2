"""Animations of vehicles in the plane: a camera that follows, a clock, headings.

The camera keeps all vehicles in the picture, and the scales of both axes equal. It
looks at a moving average of the middle of the vehicles, a little behind them, so that
their trails are seen; its view is as wide as the farthest vehicle needs, and gets
narrower as they gather. An obstacle within two widths of the formation is in the view
too. A vehicle inside an obstacle is red, and the clock says so.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import arrowhead, colour, escaped
from swarmstart.cases.drawing.tracks import Scene, inside_discs
from swarmstart.cases.record.files import replacing
from swarmstart.errors import SwarmstartError
from swarmstart.ocp.common import ProgressCallback, tell_nothing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D
    from PIL.Image import Image


WRITERS = {".gif": ("pillow", "Pillow"), ".mp4": ("ffmpeg", "the program ffmpeg")}
FRAMES_PER_S = 12.5
"""Frame rate of animations [1/s]; a GIF counts in hundredths of a second."""
SHORTEST_S, LONGEST_S = 4.0, 12.0
"""Length of an animation; a longer flight is shown faster."""
SIZE, DPI = (8.0, 4.5), 100
"""Of the picture [inches], and its dots per inch."""
FRAME = (0.075, 0.115, 0.91, 0.79)
"""Left, bottom, width and height of the axes, in parts of the picture."""
MARGIN, NEAREST_M = 0.18, 12.0
"""Room around the vehicles in parts of their extent, and the least half width [m]."""
SMOOTH_S, BEHIND_S, TRAIL_S = 2.0, 2.0, 8.0
"""Of the flight: time that the camera averages over each way, time by which it is
behind the vehicles, and length of a trail."""
REACH = 2.0
"""Distance within which an obstacle is in the view, in widths of the formation."""
INSIDE, ALARM = "inside an obstacle", "#d00000"
"""Words beside the clock, and the colour of a vehicle inside an obstacle."""
_SHADES = 7
"""Steps of a colour to white: what smooth edges need."""


class MissingWriterError(SwarmstartError):
    """The program that writes this kind of animation is not installed."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Camera:
    """View of each frame.

    Attributes:
        centres: Middle of the view, shape (2, frames).
        halves: Half of the width and half of the height of the view, shape (2, frames).
    """

    centres: Array
    halves: Array

    def limits(self, frame: int) -> tuple[Array, Array]:
        """Return the limits of x and of y in a frame, each of shape (2,)."""
        low = self.centres[:, frame] - self.halves[:, frame]
        high = self.centres[:, frame] + self.halves[:, frame]
        return np.array([low[0], high[0]]), np.array([low[1], high[1]])


def check_writer(ending: str) -> None:
    """Refuse a kind of animation that cannot be written here.

    Args:
        ending: "gif" or "mp4".

    Raises:
        MissingWriterError: If the program that writes such a file is not installed.
    """
    from matplotlib import animation

    name, needed = WRITERS[f".{ending}"]
    if not animation.writers.is_available(name):
        raise MissingWriterError(
            f"an animation as {ending} needs {needed}, which is not installed; "
            "try --animation gif"
        )


def animate_scene(
    scene: Scene,
    file: Path,
    *,
    title: str,
    notes: Sequence[str] = (),
    progress: ProgressCallback = tell_nothing,
) -> None:
    """Write an animation of vehicles in the plane.

    Args:
        scene: The vehicles over time, their leader and slots, and obstacles.
        file: A name that ends in .gif or .mp4.
        title: Title above the picture.
        notes: A few words for each instant of the scene, shown beside the clock; empty
            means no notes.
        progress: Callback with (frames finished, all frames, "animating").

    Raises:
        MissingWriterError: If the program that writes such a file is not installed.
        RecordError: If the file cannot be written.
    """
    check_writer(file.suffix.removeprefix("."))
    times = frame_times(scene.times)
    words = noted(scene.times, times, notes)
    write_film(Film(at_times(scene, times), title=title), file, words, progress)


class Filmed(ABC):
    """A picture whose frames are drawn one after another.

    Attributes:
        figure: The picture.
        axes: Axes of the plane in which everything moves.
        frames: Number of frames.
        colours: Colour of each moving thing.
    """

    def __init__(self, frames: int, colours: list[str]) -> None:
        """Make an empty picture."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        # No pyplot: it would keep the figure, and might open a window.
        self.figure: Figure = Figure(figsize=SIZE, dpi=DPI)
        self._canvas: FigureCanvasAgg = FigureCanvasAgg(self.figure)
        self.axes: Axes = self.figure.add_axes(FRAME)
        self.frames, self.colours = frames, colours

    @abstractmethod
    def show(self, frame: int, note: str = "") -> None:
        """Move everything to its place in a frame, with a note beside the clock."""

    def draw(self, frame: int, note: str = "") -> "Image":
        """Return a frame as an image."""
        from PIL import Image

        self.show(frame, note)
        self._canvas.draw()  # type: ignore[no-untyped-call]
        width, height = self._canvas.get_width_height()
        pixels = bytes(self._canvas.buffer_rgba())  # type: ignore[no-untyped-call]
        return Image.frombuffer("RGBA", (width, height), pixels).convert("RGB")


def write_film(
    film: Filmed, file: Path, words: Sequence[str], progress: ProgressCallback
) -> None:
    """Write a film.

    Args:
        film: The film.
        file: A name that ends in .gif or .mp4.
        words: A note for each frame.
        progress: Callback with (frames finished, all frames, "animating").

    Raises:
        RecordError: If the file cannot be written.
    """
    with replacing(file, suffix=file.suffix) as temporary:
        save = _save_gif if file.suffix == ".gif" else _save_mp4
        save(film, temporary, words, progress)


def frame_times(times: Array) -> Array:
    """Return the instants of the frames [s], evenly spaced, the last one included."""
    begin, end = float(times[0]), float(times[-1])
    length = min(max(end - begin, SHORTEST_S), LONGEST_S)
    return np.linspace(begin, end, round(length * FRAMES_PER_S) + 1)


def at_times(scene: Scene, times: Array) -> Scene:
    """Return a scene interpolated at other instants."""

    def moved(rows: Array) -> Array:
        flat = rows.reshape(-1, scene.times.size)
        new = np.stack([np.interp(times, scene.times, row) for row in flat])
        return new.reshape(*rows.shape[:-1], times.size)

    return replace(
        scene,
        times=times,
        positions=moved(scene.positions),
        # Interpolated between 3.1 and -3.1 rad, a heading would turn all the way round.
        headings=moved(np.unwrap(scene.headings, axis=1)),
        leader=None if scene.leader is None else moved(scene.leader),
        slots=None if scene.slots is None else moved(scene.slots),
    )


def noted(times: Array, frames: Array, notes: Sequence[str]) -> list[str]:
    """Return the note of each frame: the one of the last instant before the frame."""
    if not notes:
        return [""] * frames.size
    # 1e-9: an instant of the scene and its frame may differ by rounding.
    places = np.searchsorted(times, frames + 1e-9, side="right") - 1
    return [notes[min(max(place, 0), len(notes) - 1)] for place in places]


def camera_of(scene: Scene, *, ratio: float) -> Camera:
    """Return a view for each instant of a scene, with all vehicles in it.

    Args:
        scene: The vehicles, their leader, and the obstacles.
        ratio: Height of a view divided by its width.
    """
    every = scene.positions
    if scene.leader is not None:
        every = np.concatenate([every, scene.leader[None]])
    low, high = with_near_discs(scene, every.min(axis=0), every.max(axis=0))
    step = float(np.diff(scene.times).mean()) if scene.times.size > 1 else 1.0
    around = max(1, round(SMOOTH_S / step))
    before = scene.times - BEHIND_S
    centres = np.stack(
        [
            averaged(np.interp(before, scene.times, row), around)
            for row in (low + high) / 2
        ]
    )
    # The centre lags behind, so that the farther side decides.
    reach = np.maximum(high - centres, centres - low)
    wanted = np.maximum(reach[0], reach[1] / ratio) * (1 + MARGIN)
    wanted = np.maximum(wanted, NEAREST_M)
    # The average of the largest values nearby is nowhere below the value itself.
    largest = np.array([
        wanted[max(0, k - around) : k + around + 1].max() for k in range(wanted.size)
    ])  # fmt: skip
    wide = averaged(largest, around)
    return Camera(centres=centres, halves=np.stack([wide, ratio * wide]))


def with_near_discs(scene: Scene, low: Array, high: Array) -> tuple[Array, Array]:
    """Return the box around the vehicles, enlarged by the obstacles near to it.

    Args:
        scene: Scene with the obstacles.
        low: Lower left corner at each instant, shape (2, frames).
        high: Upper right corner at each instant, shape (2, frames).
    """
    least, most = low.copy(), high.copy()
    reach = REACH * np.maximum((high - low).max(axis=0), NEAREST_M)
    for x, y, radius in scene.discs:
        centre = np.array([[x], [y]])
        apart = centre - np.clip(centre, low, high)
        near = np.hypot(*apart) - radius <= reach
        # Of a huge one only the part that is near: the vehicles must stay visible.
        begin = np.maximum(centre - radius, low - reach)
        end = np.minimum(centre + radius, high + reach)
        least[:, near] = np.minimum(least, begin)[:, near]
        most[:, near] = np.maximum(most, end)[:, near]
    return least, most


def averaged(values: Array, around: int) -> Array:
    """Return moving averages over `around` values on each side, fewer at the ends.

    At the ends as many values are left out on one side as on the other.

    Example:
        >>> averaged(np.array([0.0, 3.0, 6.0, 6.0]), 1).tolist()
        [0.0, 3.0, 5.0, 6.0]
    """
    sums = np.concatenate([[0.0], np.cumsum(values)])
    place = np.arange(values.size)
    reach = np.minimum(np.minimum(place, values.size - 1 - place), around)
    means: Array = (sums[place + reach + 1] - sums[place - reach]) / (2 * reach + 1)
    return means


class Film(Filmed):
    """Vehicles in the plane, frame by frame, with a camera that follows them.

    Attributes:
        clock: The text of the time.
        camera: View of the picture in each frame.
    """

    def __init__(self, scene: Scene, *, title: str) -> None:
        """Draw what stays, and prepare what moves.

        Args:
            scene: Scene at the instants of the frames.
            title: Title above the picture.
        """
        numbers = scene.numbers or range(len(scene.names))
        super().__init__(scene.times.size, [colour(number) for number in numbers])
        self._scene = scene
        ratio = (FRAME[3] * SIZE[1]) / (FRAME[2] * SIZE[0])
        self.camera = camera_of(scene, ratio=ratio)
        self._still(title)
        self._trails = [
            self.axes.plot([], [], color=c, lw=1.6)[0] for c in self.colours
        ]
        self._heads = [
            self.axes.plot([], [], color=c, ms=16, mec="white", mew=0.6, ls="none")[0]
            for c in self.colours
        ]
        few = scene.is_few
        self._names = [
            self.axes.text(0, 0, _short(name) if few else "", fontsize=9, color=c)
            for name, c in zip(scene.names, self.colours, strict=True)
        ]
        (self._leader,) = self.axes.plot(
            [], [], "o", color="0.2", mfc="none", ms=9, label="leader"
        )
        (self._slots,) = self.axes.plot(
            [], [], "x", color="0.45", ms=7, zorder=1, label="slot"
        )
        self._inside = inside_discs(scene)
        self._name_marks()
        self.clock = self.axes.set_title(
            "", loc="left", fontsize=12, family="monospace", fontweight="bold"
        )

    def _still(self, title: str) -> None:
        from matplotlib.patches import Circle

        axes, scene = self.axes, self._scene
        for number, (x, y, radius) in enumerate(scene.discs):
            axes.add_patch(
                Circle(
                    (x, y), radius, facecolor="0.85", edgecolor="0.4", hatch="//",
                    label="obstacle" if number == 0 else None,
                )
            )  # fmt: skip
        if scene.targets is not None:
            axes.plot(
                *scene.targets.T, "x", color="0.45", ms=7, zorder=1, label=scene.called
            )
        axes.set(xlabel=scene.axes[0], ylabel=scene.axes[1])
        axes.set_title(escaped(title), fontsize=10, loc="right")
        axes.set_aspect("equal", adjustable="box")
        axes.grid(alpha=0.35)

    def _name_marks(self) -> None:
        """Put a legend of the marks that are drawn below; nothing if there are none."""
        scene = self._scene
        marks = {
            "leader": scene.leader is not None,
            "slot": scene.slots is not None,
            scene.called: scene.targets is not None,
            "obstacle": bool(scene.discs),
        }
        handles, names = self.axes.get_legend_handles_labels()
        shown = [
            (handle, name)
            for handle, name in zip(handles, names, strict=True)
            if marks.get(name)
        ]
        if shown:
            self.axes.legend(
                *zip(*shown, strict=True), loc="upper right",
                # Right of the axis's name, below its numbers.
                bbox_to_anchor=(1.0, -0.07), borderaxespad=0.0, frameon=False,
                fontsize=9, ncols=len(shown),
            )  # fmt: skip

    def show(self, frame: int, note: str = "") -> None:
        """Move everything to its place in a frame."""
        scene = self._scene
        begin = int(np.searchsorted(scene.times, scene.times[frame] - TRAIL_S))
        x, y = self.camera.limits(frame)
        self.axes.set_xlim(*x)
        self.axes.set_ylim(*y)
        aside = 0.025 * float(np.ptp(x))
        for number, (place, heading) in enumerate(
            zip(scene.positions, scene.headings, strict=True)
        ):
            self._trails[number].set_data(place[:, begin : frame + 1])
            _put(self._heads[number], place[:, frame])
            self._heads[number].set_marker(arrowhead(float(heading[frame])))  # type: ignore[arg-type]
            is_inside = bool(self._inside[number, frame])
            self._heads[number].set_color(ALARM if is_inside else self.colours[number])
            self._names[number].set_position(
                (place[0, frame] + aside, place[1, frame] + aside)
            )
        if scene.leader is not None:
            _put(self._leader, scene.leader[:, frame])
        if scene.slots is not None:
            self._slots.set_data(scene.slots[:, 0, frame], scene.slots[:, 1, frame])
        alarm = bool(self._inside[:, frame].any())
        words = INSIDE if alarm else note
        self.clock.set_text(
            f"t = {scene.times[frame]:.1f} s" + (f"  {words}" if words else "")
        )
        self.clock.set_color(ALARM if alarm else "black")


def _put(line: "Line2D", place: Array) -> None:
    # A line takes sequences, of a single point, too.
    line.set_data([place[0]], [place[1]])


def _short(name: str) -> str:
    """Return the number of "UAV 3", which fits beside a triangle."""
    return escaped(name.removeprefix("UAV "))


def _save_gif(
    film: Filmed, file: Path, words: Sequence[str], progress: ProgressCallback
) -> None:
    """Write a GIF whose frames share a palette, so that it is small."""
    from PIL.Image import Dither

    frames: list[Image] = []
    palette = _palette([*film.colours, ALARM])
    for number in range(film.frames):
        progress(number, film.frames, "animating")
        image = film.draw(number, words[number])
        # Dithering would make level areas noisy, and the file large.
        frames.append(image.quantize(palette=palette, dither=Dither.NONE))
    first, *others = frames
    # Times in ms; with disposal 1 a frame stays, and the next one holds changes only.
    first.save(
        file, format="GIF", save_all=True, append_images=others, loop=0,
        duration=round(1000 / FRAMES_PER_S), disposal=1, optimize=True,
    )  # fmt: skip


def _palette(colours: Sequence[str]) -> "Image":
    """Return an image whose palette has greys, and the colours' steps to white."""
    from matplotlib.colors import to_rgb
    from PIL import Image

    # A GIF has 256 colours: 4 * _SHADES greys, and _SHADES of each of the others.
    most = 256 // _SHADES - 4
    bases = [(0.0, 0.0, 0.0), *(to_rgb(own) for own in dict.fromkeys(colours))][:most]
    shades = np.linspace(0.0, 1.0, _SHADES)
    greys = np.repeat(np.linspace(0.0, 1.0, 4 * _SHADES)[:, None], 3, axis=1)
    blends = [(1 - t) * np.array(base) + t for base in bases for t in shades]
    entries = np.round(255 * np.vstack([greys, *blends])).astype(np.uint8)
    image = Image.new("P", (1, 1))
    image.putpalette(entries.tobytes())
    return image


def _save_mp4(
    film: Filmed, file: Path, words: Sequence[str], progress: ProgressCallback
) -> None:
    from matplotlib import animation

    writer = animation.writers[WRITERS[".mp4"][0]](fps=round(FRAMES_PER_S))
    with writer.saving(film.figure, str(file), dpi=DPI):
        for number in range(film.frames):
            progress(number, film.frames, "animating")
            film.show(number, words[number])
            writer.grab_frame()
