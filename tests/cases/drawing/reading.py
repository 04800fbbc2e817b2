"""Reading figures: what a panel shows, by content."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg

from swarmstart.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D


def contrast(first: str, second: str) -> float:
    """Return the contrast ratio of two colours "#rrggbb", from 1 to 21.

    Source: WCAG 2.2, "contrast ratio".
    """
    darker, lighter = sorted((_luminance(first), _luminance(second)))
    return (lighter + 0.05) / (darker + 0.05)


def _luminance(colour: str) -> float:
    """Return the relative luminance. Source: WCAG 2.2, "relative luminance"."""
    knee = 0.04045
    parts = [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    red, green, blue = (
        part / 12.92 if part <= knee else ((part + 0.055) / 1.055) ** 2.4
        for part in parts
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def panel(figure: Figure, label: str) -> Axes:
    """Return the one panel whose vertical axis is called so."""
    found = [axes for axes in figure.axes if words(axes) == label]
    assert len(found) == 1, [words(axes) for axes in figure.axes]
    return found[0]


def words(axes: Axes) -> str:
    """Return the label of the vertical axis in one line."""
    return axes.get_ylabel().replace("\n", " ")


def named(axes: Axes, name: str) -> list[Line2D]:
    """Return the lines of that name."""
    return [line for line in axes.lines if line.get_label() == name]


def bounds(axes: Axes) -> list[float]:
    """Return where bounds are drawn, ascending."""
    return sorted(level(line) for line in named(axes, "bound"))


def level(line: Line2D) -> float:
    """Return where a horizontal line is."""
    return float(np.asarray(line.get_ydata())[0])


def curves(axes: Axes) -> list[Array]:
    """Return the values of the lines of more than two points, plans left out."""
    return [
        np.asarray(line.get_ydata(), dtype=float)
        for line in axes.lines
        if np.size(line.get_ydata()) > 2 and line.get_label() != "plans"
    ]


def held(axes: Axes) -> list[tuple[Array, Array]]:
    """Return values and edges of the steps that are drawn."""
    data = [patch.get_data() for patch in axes.patches if hasattr(patch, "get_data")]
    return [(np.asarray(one[0]), np.asarray(one[1])) for one in data]


def legend(figure: Figure) -> list[str]:
    """Return the names in all legends of a figure and its parts."""
    every = [*figure.legends, *(x for part in figure.subfigs for x in part.legends)]
    every += [own for axes in figure.axes if (own := axes.get_legend()) is not None]
    return [text.get_text() for one in every for text in one.get_texts()]


def covered(figure: Figure) -> list[str]:
    """Return the names in legends that lie over a panel once the figure is drawn."""
    FigureCanvasAgg(figure).draw()  # type: ignore[no-untyped-call]
    every = [*figure.legends, *(x for part in figure.subfigs for x in part.legends)]
    every += [own for axes in figure.axes if (own := axes.get_legend()) is not None]
    panels = [axes.get_window_extent() for axes in figure.axes]
    return [
        text.get_text()
        for one in every
        for text in one.get_texts()
        if any(text.get_window_extent().overlaps(panel) for panel in panels)
    ]
