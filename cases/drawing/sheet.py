"""One sheet of a run: four parts, two by two, with letters and headings."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import (
    HALF,
    MOST_NAMED,
    WHOLE,
    draw_series,
    name_powers,
    named_lines,
    new_figure,
    put_legend,
)
from swarmstart.cases.drawing.panels import (
    Labels,
    Panel,
    columns_of,
    draw_panel,
    grid_in,
    wrapped,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase, SubFigure


SHEET = (12.0, 8.8)
"""Size of a sheet of two rows [inches]."""
MOST_IN_PART = 8
"""Panels of a part of a sheet."""
SETTLED = "#f0c419"
"""Colour of the band of settled values."""
_FLOOR = 1e-7
"""Errors are drawn down to this part of the band, or of the largest one."""
_BELOW = 0.1
"""Part of the first quartile of many errors down to which they are drawn."""
_LABEL = 42
"""Characters of a vertical label along the height of a part."""
_TITLE = 110
"""Characters of a line of the title."""


class Part(NamedTuple):
    """A part of a sheet: its heading, and the function that draws it."""

    heading: str
    draw: "Callable[[FigureBase], None]"


def sheet(title: str, parts: Sequence[Part]) -> "Figure":
    """Return a figure of at most four parts, two by two.

    Args:
        title: Title of the sheet in one or several lines, a user's text.
        parts: Parts from the upper left to the lower right.
    """
    rows, columns = -(-len(parts) // 2), min(len(parts), 2)
    figure = new_figure((SHEET[0] * columns / 2, SHEET[1] * (0.55 if rows == 1 else 1)))
    if title:
        lines = [wrapped(line, width=_TITLE) for line in title.splitlines()]
        figure.suptitle("\n".join(lines), fontweight="bold")
    cells = figure.add_gridspec(rows, columns, wspace=0.02)
    spots = [cells[k // columns, k % columns] for k in range(len(parts))]
    if len(parts) > columns and len(parts) % columns:
        # The last one gets the whole row.
        spots[-1] = cells[-1, :]
    places = [figure.add_subfigure(spot) for spot in spots]
    for letter, place, part in zip("abcd", places, parts, strict=False):
        place.suptitle(
            f"({letter}) {part.heading}", x=0.02, ha="left", fontsize="medium"
        )
        part.draw(place)
    _name_all(figure, places)
    return figure


def _name_all(figure: "Figure", places: "Iterable[SubFigure]") -> None:
    """Name lines that several parts share once below the sheet, others in their part.

    A part that has a legend already keeps it.
    """
    named = [named_lines(place) for place in places]
    times = Counter(name for part in named for name in part)
    shared: dict[str, Artist] = {}
    for place, part in zip(places, named, strict=True):
        own = {name: line for name, line in part.items() if times[name] == 1}
        shared |= {name: line for name, line in part.items() if name not in own}
        if not place.legends:
            put_legend(place, own, room=HALF)
    put_legend(figure, shared, room=WHOLE)


def panels_part(heading: str, panels: Sequence[Panel], labels: Labels) -> Part:
    """Return a part of small panels over time, with their bounds.

    Args:
        heading: Heading of the part; words on bounds are added if there are any.
        panels: Panels, at least one; those beyond MOST_IN_PART are left out, and a note
            says so.
        labels: Words on the axes.
    """
    shown = panels[:MOST_IN_PART]
    if any(np.isfinite([*panel.lower, *panel.upper]).any() for panel in shown):
        heading = f"{heading} and their bounds"
    if len(shown) < len(panels):
        heading = f"{heading}: the first {len(shown)} of {len(panels)}"
    if shown[0].rest:
        heading = f"{heading}, {shown[0].rest}"

    def draw(part: "FigureBase") -> None:
        columns = min(columns_of(len(shown)), 2)
        rows = -(-len(shown) // columns)  # Rounded up.
        (block,) = grid_in(part, [len(shown)], columns=columns)
        for axes, panel in zip(block, shown, strict=True):
            draw_panel(axes, panel, labels, width=_LABEL // max(rows, 2))

    return Part(heading, draw)


def draw_errors(  # noqa: PLR0913 - two axes, two limits, two words
    axes: "Axes",
    times: Array,
    errors: Array,
    *,
    band: float | None = None,
    settled: float | None = None,
    unit: str,
    names: Sequence[str] = (),
    numbers: Sequence[int] | None = None,
) -> None:
    """Draw errors on a logarithmic axis, with the settled band and the time to it.

    Args:
        axes: The panel.
        times: Instants, shape (T,) [s].
        errors: Errors, at least 0, shape (series, T).
        band: Largest error that counts as settled; None if there is no such band.
        settled: Time from which all errors stay in the band [s]; None if they never do.
        unit: Unit of the errors.
        names: Names of the series.
        numbers: Number of the colour of each series; None means from 0 on.
    """
    finite = errors[np.isfinite(errors) & (errors > 0)]
    largest = float(finite.max(initial=0.0))
    # 1e-300: errors may all be 0, and a logarithmic axis needs a positive end.
    floor = _FLOOR * max(band or 0.0, largest, 1e-300)
    if len(errors) > MOST_NAMED:  # Of many, one that is at its place says little.
        quarter = np.quantile(np.nan_to_num(errors), 0.25, axis=0)
        floor = max(floor, _BELOW * float(quarter.min()))
    # Lines of smaller errors leave the panel through its lower edge.
    drawn = np.maximum(errors, floor / 10)
    draw_series(axes, times, drawn, names=names, numbers=numbers)
    name_powers(axes, has_minor_ticks=False)
    axes.margins(x=0)
    axes.grid(alpha=0.3)
    least = float(drawn[np.isfinite(drawn)].min(initial=np.inf))
    # At least a decade of the band is seen.
    bottom = max(floor, 0.5 * min(least, np.inf if band is None else band / 10))
    if np.isfinite(bottom):
        axes.set_ylim(bottom=bottom)
    if band is None:
        return
    draw_band(axes, bottom, band, name=f"settled: at most {band:g} {unit}")
    draw_settling(axes, settled)


def draw_band(axes: "Axes", low: float, high: float, *, name: str) -> None:
    """Shade the band within which a run counts as settled."""
    axes.axhspan(low, high, color=SETTLED, alpha=0.25, lw=0, zorder=0, label=name)


def draw_settling(axes: "Axes", time: float | None) -> None:
    """Mark the time from which a run is settled; write a note if it never is.

    Args:
        axes: The panel.
        time: Time from which the run is settled [s]; None if it never is.
    """
    text = "never settled" if time is None else f"settled from {time:g} s on"
    if time is not None:
        axes.axvline(time, color="0.15", ls="-.", lw=1.2, label=text)
    axes.set_title(text, fontsize="small", loc="right")


def settled_at(times: Array, errors: Array, band: float) -> float | None:
    """Return the first time from which all errors stay within a band.

    Args:
        times: Instants, shape (T,) [s].
        errors: Errors, at least 0, shape (series, T).
        band: Largest error that counts as settled.

    Returns:
        Time [s]; None if that never happens.

    Example:
        >>> settled_at(np.arange(4.0), np.array([[3.0, 0.5, 2.0, 0.1]]), 1.0)
        3.0
    """
    # Not `>`: NaN is outside, too.
    outside = np.flatnonzero(~(errors.max(axis=0) <= band))
    if outside.size == 0:
        return float(times[0])
    place = int(outside[-1]) + 1
    return float(times[place]) if place < times.size else None
