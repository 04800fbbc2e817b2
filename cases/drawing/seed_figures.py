"""Figures of one scenario over many seeds: bands of the states, spread of a measure."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmstart.cases.drawing.drawing import COLOURS, LAYOUT_DPI, Figures, escaped
from swarmstart.cases.drawing.tails import tail_from, tail_in_words
from swarmstart.cases.drawing.vehicles import band_name
from swarmstart.cases.drawing.wording import unit_of_measure, with_unit
from swarmstart.cases.format.document import counted
from swarmstart.cases.format.registry import words_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_STATES = 12
"""States that are drawn; more are said to be left out."""
MOST_MEASURES = 12
COLUMNS = 3
_SIDES = ("low", "median", "high")
_BESIDE, _EDGE, _BELOW, _ABOVE, _BETWEEN = 0.7, 0.15, 0.5, 0.6, 0.6
"""Room of a panel's numbers, and of the figure's edges and title [inches]."""


def seed_figures(content: Mapping[str, Any]) -> Figures:
    """Yield the figures of runs over seeds.

    Args:
        content: Content from `campaign.running.seeds.seeds_content`.
    """
    if content["bands"] is not None:
        yield "bands", _bands(content)
    spread = {
        name: [value for value in values if isinstance(value, int | float)]
        for name, values in content["measures"].items()
        if "seconds" not in name  # They differ with the load of the machine.
    }
    varied = {name: values for name, values in spread.items() if len(set(values)) > 1}
    if varied:
        yield "spread", _spread(content, varied)


def _bands(content: Mapping[str, Any]) -> "Figure":
    """Return the median of each state, and the band of 10 to 90 % of the runs."""
    states = content["bands"]["states"]
    time, rest = shown_time(content["bands"])
    chosen = list(states.items())[:MOST_STATES]
    figure, axes = _grid(len(chosen))
    for panel, (name, band) in zip(axes, chosen, strict=True):
        draw_band(panel, time, band)
        panel.set_title(escaped(band_label(name, content)), fontsize="small")
    left = len(states) - len(chosen)
    noun = "state is" if left == 1 else "states are"
    more = f"; {left} more {noun} not drawn" if left else ""
    runs = sum(not failure for failure in content["failures"])
    figure.supxlabel(f"time [s]{rest and f', {rest}'}", fontsize="small")
    figure.suptitle(
        f"median and 10 to 90 % of {counted(runs, 'run')}{more}",
        fontsize="medium",
    )
    return figure


def shown_time(bands: Mapping[str, Any]) -> tuple[list[float], str]:
    """Return the instants that are drawn, and words on those that are left out.

    Args:
        bands: "time" [s], and "states" with "low", "median" and "high" of each state.
    """
    time = list(bands["time"])
    if not time:
        return time, ""
    every = [band[side] for band in bands["states"].values() for side in _SIDES]
    begin = tail_from([(np.array(time), np.array(every, dtype=float))])
    if begin is None:
        return time, ""
    return [one for one in time if one <= begin], tail_in_words(begin, time[-1])


def draw_band(axes: "Axes", time: Sequence[float], band: Mapping[str, Any]) -> None:
    """Draw the median of a state over time, and its band.

    Args:
        axes: The panel.
        time: Instants [s].
        band: Lists "low", "median" and "high" with a value for each instant; further
            values are not drawn. None stands for a value that is not known.
    """
    low, median, high = (
        np.array(band[side][: len(time)], dtype=float) for side in _SIDES
    )
    axes.fill_between(time, low, high, color=COLOURS[0], alpha=0.3, lw=0)
    axes.plot(time, median, color=COLOURS[0], lw=1.2)


def band_label(name: str, content: Mapping[str, Any]) -> str:
    """Return name and unit of a state in words, with the unit that its band gives."""
    label, unit = band_name(name, content)
    unit = content["bands"]["states"][name].get("unit") or unit
    return with_unit(label, unit)


def _spread(content: Mapping[str, Any], varied: Mapping[str, list[float]]) -> "Figure":
    """Return a row of points for each measure that differs from run to run."""
    chosen = list(varied.items())[:MOST_MEASURES]
    known = dict(words_of(content.get("kind")).measures)
    figure, axes = _grid(len(chosen), height=1.3)
    for panel, (name, values) in zip(axes, chosen, strict=True):
        # At heights in the order of the seeds, so that equal values are all seen.
        shifts = np.linspace(-0.25, 0.25, len(values))
        panel.plot(values, shifts, "o", ms=4, mfc="none", color=COLOURS[0])
        panel.axvline(float(np.median(values)), color=COLOURS[1], lw=1.5)
        panel.set(ylim=(-0.6, 0.6), yticks=[])
        # A user's own measure has a name of any ending, and no stated unit.
        unit = unit_of_measure(name, known[name]) if name in known else ""
        panel.set_title(escaped(with_unit(name, unit)), fontsize="small")
    left = len(varied) - len(chosen)
    noun = "measure is" if left == 1 else "measures are"
    more = f"; {left} more {noun} not drawn" if left else ""
    runs = len(content["seeds"])
    text = f"measures of {counted(runs, 'run')}, their medians as lines{more}"
    figure.suptitle(text, fontsize="medium")
    return figure


def _grid(panels: int, height: float = 1.8) -> tuple["Figure", list[Any]]:
    """Return a figure with some small panels at fixed places, each with a title.

    A layout would measure all ticks of all panels twice, which takes longer than to
    draw them.
    """
    from matplotlib.figure import Figure

    columns = min(COLUMNS, panels)
    rows = -(-panels // columns)
    whole = 0.9 + height * rows
    wide, high = 9.0 / columns - _BESIDE, height - _BETWEEN
    figure = Figure(figsize=(9.0, whole), dpi=LAYOUT_DPI)
    grid = figure.add_gridspec(
        rows, columns, left=_BESIDE / 9.0, right=1 - _EDGE / 9.0,
        wspace=_BESIDE / wide, bottom=_BELOW / whole, top=1 - _ABOVE / whole,
        hspace=_BETWEEN / high,
    )  # fmt: skip
    for k in range(panels):
        axes = figure.add_subplot(grid[k // columns, k % columns])
        axes.tick_params(labelsize="small")
        for axis in (axes.xaxis, axes.yaxis):
            axis.get_offset_text().set_fontsize("small")
    return figure, figure.axes
