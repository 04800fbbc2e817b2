"""Basis of all figures: colours and line styles, series, legends, empty figures, files.

Each series has a colour and a line style of its own, so that twelve series can be told
apart with any colour vision and in grey print. Several series in one panel have a line
each, or are drawn as bands if there are too many.
"""

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Protocol, TypeVar

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing import palette
from swarmstart.cases.format.document import printable
from swarmstart.cases.record.files import write_atomically
from swarmstart.cases.record.record import PNG
from swarmstart.ocp import Trajectory
from swarmstart.ocp.common import ProgressCallback, tell_nothing

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase

S_contra = TypeVar("S_contra", contravariant=True)
F_contra = TypeVar("F_contra", contravariant=True)
S = TypeVar("S")
F = TypeVar("F")
Figures = Iterable[tuple[str, "Figure"]]
"""Names of figures, without a suffix, and the figures."""
LineStyle = str | tuple[float, tuple[float, ...]]

COLOURS = palette.LIGHT
MOST_NAMED = 12
"""Series up to which each has its own line and name; more are drawn as bands."""
LAYOUT_DPI, PNG_DPI = 110, 200
"""Dots per inch at which a figure is laid out, and of PNG files."""
# Without a date, so that the same figure is the same file.
_METADATA: dict[str, dict[str, Any]] = {
    "png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None},
}  # fmt: skip

_WIDTH, _STEP, _WIDEST = 1.3, 0.6, 4
"""Width of lines [points]; of the first few held ones, which may coincide, more."""
WHOLE, HALF = 170, 95
"""Characters that a legend below a wide figure has room for, and below half of one."""
_DECADE = 10.0
_RAISED = str.maketrans(
    "-0123456789",
    "\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ZERO}\N{SUPERSCRIPT ONE}\N{SUPERSCRIPT TWO}"
    "\N{SUPERSCRIPT THREE}\N{SUPERSCRIPT FOUR}\N{SUPERSCRIPT FIVE}"
    "\N{SUPERSCRIPT SIX}\N{SUPERSCRIPT SEVEN}\N{SUPERSCRIPT EIGHT}"
    "\N{SUPERSCRIPT NINE}",
)
_HANDLE = 9
"""Characters that the line beside a name takes."""
_DENSE, _OFTEN, _MOVE, _THIN = 400, 0.1, 0.02, 0.5
"""Lines with more instants that turn at more than this part of them are thinner. A
move counts if it is more than this part of the range. The last one is the factor."""
_OUTER, _INNER = 0.18, 0.38
"""Opacity of the band of all series, and of that of their middle half."""


class Draw(Protocol[S_contra, F_contra]):
    """A function that draws a run into files and returns these, in order."""

    def __call__(
        self,
        scenario: S_contra,
        flight: F_contra,
        trajectory: Trajectory,
        folder: Path,
        *,
        formats: Sequence[str] = PNG,
        progress: ProgressCallback = tell_nothing,
    ) -> list[Path]:
        """Draw the run into files in the folder; return the files, in order."""


def new_figure(size: tuple[float, float] = (7.0, 4.0)) -> "Figure":
    """Return an empty figure, `size` in inches, which pyplot does not manage."""
    # Not at the head: results that are only computed must not wait for matplotlib.
    from matplotlib.figure import Figure

    return Figure(figsize=size, dpi=LAYOUT_DPI, layout="constrained")


def into_folder(figures: Callable[[S, F, Trajectory], Figures]) -> Draw[S, F]:
    """Return a function that writes figures into a folder and returns the files.

    Args:
        figures: Function from scenario, flight and trajectory to figures by name, in
            order.
    """

    @functools.wraps(figures)
    def draw(
        scenario: S,
        flight: F,
        trajectory: Trajectory,
        folder: Path,
        *,
        formats: Sequence[str] = PNG,
        progress: ProgressCallback = tell_nothing,
    ) -> list[Path]:
        drawn = figures(scenario, flight, trajectory)
        return write_figures(drawn, folder, formats=formats, progress=progress)

    return draw


def write_figures(
    figures: Figures,
    folder: Path,
    *,
    formats: Sequence[str] = PNG,
    progress: ProgressCallback = tell_nothing,
) -> list[Path]:
    """Write figures as files by name; return the files, in order.

    Args:
        figures: Figures by name; the names have no suffix.
        folder: Folder of the files; made if it is missing.
        formats: Formats of each figure, of "png", "svg" and "pdf"; each is a file.
        progress: Callback with (files written, all files, "drawing").

    Raises:
        RecordError: If a file cannot be written.
    """
    # All figures are drawn before the first is written: progress tells their number.
    planned = [
        (figure, form, folder / f"{name}.{form}")
        for name, figure in figures
        for form in formats
    ]
    for number, (figure, form, file) in enumerate(planned):
        progress(number, len(planned), "drawing")
        write_atomically(file, functools.partial(_save, figure, form))
    return [file for _, _, file in planned]


def _save(figure: "Figure", form: str, file: BinaryIO) -> None:
    """Write a figure in a format.

    `Figure.savefig` draws twice, the first time for the layout alone, although drawing
    lays out by itself.
    """
    from matplotlib.backend_bases import get_registered_canvas_class

    canvas = get_registered_canvas_class(form)(figure)
    figure.set_dpi(PNG_DPI)
    getattr(canvas, f"print_{form}")(file, metadata=_METADATA[form])


def colour(number: int) -> str:
    """Return the colour of a series; after twelve the colours are used again."""
    return COLOURS[number % len(COLOURS)]


def line_style(number: int) -> LineStyle:
    """Return the line style of a series; series with the same colour differ in it.

    Example:
        >>> line_style(0), line_style(2)
        ('-', (0.0, (2.0, 2.0)))
    """
    count = len(palette.DASHES)
    # One further in each round: series 13 has the colour of the first, not its dashes.
    dashes = palette.DASHES[(number + number // count) % count]
    return (0.0, tuple(map(float, dashes.split()))) if dashes else "-"


def arrowhead(heading: float) -> Array:
    """Return a triangle that points along a heading [rad], shape (4, 2)."""
    along = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([-along[1], along[0]])
    tip, left = along, -0.7 * along + 0.55 * across
    right = -0.7 * along - 0.55 * across
    return np.array([tip, left, right, tip])


def draw_series(
    axes: "Axes",
    times: Array,
    values: Array,
    *,
    names: Sequence[str] = (),
    numbers: Sequence[int] | None = None,
) -> None:
    """Draw a line for each series, or bands if there are more than MOST_NAMED.

    Args:
        axes: The panel.
        times: Instants, shape (n,), or (n + 1,) if values are held from each to the
            next.
        values: Values of each series, shape (series, n).
        names: Names of the series; empty means that they are not named.
        numbers: Number of the colour and line style of each series; None means from 0
            on.
    """
    if len(values) > MOST_NAMED:
        draw_bands(axes, times, values)
        return
    held = times.size == values.shape[1] + 1
    thin = _THIN if _leaps(values) else 1.0
    for place, row in enumerate(values):
        number = place if numbers is None else numbers[place]
        label = escaped(names[place]) if names else None
        if held:
            # Held values often coincide: earlier lines, drawn wider, show beneath.
            ahead = min(len(values), _WIDEST) - 1 - place
            axes.stairs(
                row, times, baseline=None, color=colour(number), label=label,
                lw=thin * (_WIDTH + max(0.0, _STEP * ahead)), ls=line_style(number),
            )  # fmt: skip
        else:
            axes.plot(
                times, row, color=colour(number), ls=line_style(number),
                lw=thin * _WIDTH, label=label,
            )  # fmt: skip


def _leaps(values: Array) -> bool:
    """Return whether lines go to and fro so often that they would cover the panel."""
    if values.shape[1] <= _DENSE:
        return False
    values = np.where(np.isfinite(values), values, 0.0)
    moves = np.diff(values)
    # Rounding makes a level line turn all the time, too.
    small = _MOVE * np.ptp(values, axis=1, keepdims=True)
    rising = np.where(np.abs(moves) > small, np.sign(moves), 0.0)
    turns = rising[:, 1:] * rising[:, :-1] < 0
    return bool(turns.mean(axis=1).max(initial=0.0) > _OFTEN)


def draw_bands(axes: "Axes", times: Array, values: Array) -> None:
    """Draw the median of many series, their middle half, and their extremes.

    Args:
        axes: The panel.
        times: Instants, shape (n,), or (n + 1,) if values are held from each to the
            next.
        values: Values of each series, shape (series, n).
    """
    times, (low, below, middle, above, high) = quartiles_of(times, values)
    own = COLOURS[0]
    axes.fill_between(
        times, low, high, color=own, alpha=_OUTER, lw=0, label="smallest to largest"
    )
    axes.fill_between(
        times, below, above, color=own, alpha=_INNER, lw=0, label="middle half"
    )
    axes.plot(times, middle, color=own, lw=_WIDTH, label=f"median of {len(values)}")


def quartiles_of(times: Array, values: Array) -> tuple[Array, Array]:
    """Return instants and, at each, minimum, quartiles and maximum of the values.

    Args:
        times: Instants, shape (n,), or (n + 1,) if values are held from each to the
            next; held values have two instants each.
        values: Values of each series, shape (series, n).

    Returns:
        Instants, shape (m,), and values, shape (5, m).
    """
    known = np.where(np.isfinite(values), values, np.nan)
    if times.size == known.shape[1] + 1:
        # The corners of the steps: each value at both ends of its interval.
        times = np.repeat(times, 2)[1:-1]
        known = np.repeat(known, 2, axis=1)
    # nanquantile warns of instants at which no series has a value.
    known = np.where(np.isnan(known).all(axis=0), 0.0, known)
    return times, np.nanquantile(known, [0.0, 0.25, 0.5, 0.75, 1.0], axis=0)


def name_lines(figure: "FigureBase", *, room: int = WHOLE) -> None:
    """Put one legend below a figure, with the names in all of its panels.

    Args:
        figure: A figure, or a part of one.
        room: Number of characters that fit into a line.
    """
    put_legend(figure, named_lines(figure), room=room)


def named_lines(figure: "FigureBase") -> "dict[str, Artist]":
    """Return the first line or mark of each label in a figure's panels, by label."""
    named: dict[str, Artist] = {}
    panels: list[Axes] = figure.axes  # type: ignore[assignment]
    for axes in panels:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(name, handle)
    return named


def put_legend(
    figure: "FigureBase", named: "Mapping[str, Artist]", *, room: int
) -> None:
    """Put a legend below a figure, or a part of one; nothing if there are no names.

    Args:
        figure: A figure, or a part of one.
        named: Line or mark of each name.
        room: Number of characters that fit into a line.
    """
    if named:
        figure.legend(
            list(named.values()), list(named), loc="outside lower center",
            ncols=columns_of_names(named, room), fontsize="small", frameon=False,
            handlelength=2.6,
        )  # fmt: skip


def columns_of_names(names: "Iterable[str]", room: int) -> int:
    """Return how many names fit beside one another, in rows as even as can be.

    Args:
        names: Names in a legend.
        room: Number of characters that fit into a line, with the samples of lines.
    """
    sizes = [len(name) + _HANDLE for name in names]
    rows = 1
    while -(-len(sizes) // rows) * max(sizes) > room and rows < len(sizes):
        rows += 1
    return -(-len(sizes) // rows)


def make_logarithmic(axes: "Axes", values: Array, *, ratio: float = 100.0) -> None:
    """Make the vertical axis logarithmic if positive values span decades.

    Args:
        axes: The panel.
        values: Values that are drawn in the panel.
        ratio: The axis becomes logarithmic if the largest value is more than this
            multiple of the smallest.
    """
    finite = values[np.isfinite(values)]
    # Not if a value is 0 or negative: it would vanish from the panel.
    if finite.size and 0 < finite.min() * ratio < finite.max():
        from matplotlib.ticker import NullFormatter

        name_powers(axes)
        # Within a decade the minor ticks are the only ones with numbers.
        if finite.max() > _DECADE * finite.min():
            axes.yaxis.set_minor_formatter(NullFormatter())


def name_powers(axes: "Axes", *, has_minor_ticks: bool = True) -> None:
    """Make the vertical axis logarithmic, with powers of ten as plain text.

    Args:
        axes: The panel.
        has_minor_ticks: Whether there are ticks between the powers; with many decades
            they take longer to draw than the lines.
    """
    from matplotlib.ticker import FuncFormatter, NullLocator

    axes.set_yscale("log")
    # Matplotlib's own would be formulas: a parser, to be loaded and built, for each.
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: _power(value)))
    if not has_minor_ticks:
        axes.yaxis.set_minor_locator(NullLocator())


def _power(value: float) -> str:
    """Return a power of ten as text; another number in a few digits."""
    exponent = math.log10(value) if value > 0 else math.nan
    whole = round(exponent) if math.isfinite(exponent) else 0
    if not math.isclose(exponent, whole, abs_tol=1e-9):
        return f"{value:.4g}"
    return f"10{str(whole).translate(_RAISED)}"


def escaped(text: str) -> str:
    """Return a user's text with dollars and control characters escaped for matplotlib.

    Matplotlib's warning of a character without a glyph would send an ESC to a terminal.
    """
    lines = [printable(line) for line in text.split("\n")]
    return "\n".join(lines).replace("$", r"\$")
