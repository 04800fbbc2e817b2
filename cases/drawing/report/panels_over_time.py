"""Small panels over time: lines, held steps, bounds of a flight; bands of many runs.

The player's script adds a cursor to the panels of a flight, with the value there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.drawing import MOST_NAMED, quartiles_of
from swarmstart.cases.drawing.panels import Panel, bounds_of
from swarmstart.cases.drawing.report import svg
from swarmstart.cases.drawing.report.tracks import Series, Tracks
from swarmstart.cases.drawing.wording import number, shortened
from swarmstart.cases.format.document import counted

if TYPE_CHECKING:
    from markupsafe import Markup

SIZE, ACROSS, UP = (300, 140), (48, 294), (118, 22)
"""Width and height of a panel; ends of its axes: left and right, below and above."""
_LABEL = 40
"""Letters of a label."""
_WIDEST = 4
"""Lines of which each is wider than the next one."""
MOST_POINTS = 300
ALL_POINTS = 30_000
"""Number of points of the lines in all panels together."""
_DECADES = 30.0
"""Of positive values, largest to smallest, from which on their axis is logarithmic."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PanelDrawn:
    """A panel in the form that the player takes.

    Attributes:
        alt: Description of the panel in words.
        drawing: Markup within the panel's `svg` element.
        has_bounds: Whether bounds are drawn.
        far: Words on bounds that are too far away to be drawn; empty if there are none.
        times: Times of `values` [s]; empty if no values are shown at the cursor.
        values: Values that are shown at the cursor.
        held: Whether the values are held from each time to the next.
    """

    alt: str
    drawing: "Markup"
    has_bounds: bool = False
    far: str = ""
    times: Sequence[float | None] = ()
    values: Sequence[float | None] = ()
    held: bool = False


def series_panels(tracks: Tracks) -> list[PanelDrawn]:
    """Return a panel for each state and control of a flight."""
    lines = max(1, len(tracks.series) * len(tracks.vehicles))
    most = min(MOST_POINTS, max(60, ALL_POINTS // lines))
    return [_series_panel(one, tracks, most) for one in tracks.series]


def _series_panel(one: Series, tracks: Tracks, most: int) -> PanelDrawn:
    times, values = reduced(one.times, one.values, most)
    values = np.where(np.isfinite(values), values, np.nan)
    label = f"{one.name} [{one.unit}]" if one.unit else one.name
    lower, upper = np.array([one.lower]), np.array([one.upper])
    near, far = bounds_of(
        Panel(label=label, times=times, values=values, lower=lower, upper=upper)
    )
    levels = [bound for bound, _ in near]
    x = across(float(tracks.times[-1]))
    y = svg.axis_of([*values.ravel(), *levels], UP, margin=0.06)
    drawn = [frame(x, y, label), *(_level(y, level) for level in levels)]
    if len(values) > MOST_NAMED:
        times, quarters = quartiles_of(times, values)
        low, below, middle, above, high = (y.at(row) for row in quarters)
        for ends in ((low, high), (below, above)):
            drawn.append(svg.drawn(svg.outline(x.at(times), *ends), "area s0"))
        drawn.append(svg.line(x.at(times), middle, "s0"))
    for place, row in enumerate(values) if len(values) <= MOST_NAMED else ():
        # Held values often coincide: earlier lines, drawn wider, show beneath.
        ahead = max(0, min(len(values), _WIDEST) - 1 - place) if one.is_held else 0
        places = (x.at(times), y.at(row))
        if one.is_held:
            places = svg.corners(*places)
        drawn.append(svg.line(*places, svg.look(place), width=1.3 + 0.6 * ahead))
    alone = len(values) == 1
    return PanelDrawn(
        drawing=_markup(drawn),
        has_bounds=bool(near),
        far=f"{one.name} {' and '.join(map(_told, far))}" if far else "",
        times=rounded(times, 5) if alone else (),
        values=rounded(values[0], 4) if alone else (),
        held=one.is_held,
        alt=_range_told(label, values[np.isfinite(values)]),
    )


def solver_panel(tracks: Tracks) -> PanelDrawn | None:
    """Return the solver's time of each step beside the length of the step.

    None if one plan is carried out to its end, since nothing is solved during the run.
    """
    seconds = tracks.step_seconds
    if tracks.is_one_plan or not seconds.size or not np.isfinite(seconds).any():
        return None
    lengths = np.diff(tracks.step_times)
    # Peaks, not samples: the slowest step must be seen.
    times, values = _peaks(tracks.step_times, np.maximum(seconds, 0.0), MOST_POINTS)
    positive = values[np.isfinite(values) & (values > 0)]
    each = float(np.median(lengths))
    every = np.append(positive, each)
    # A logarithmic axis has no place for 0.
    drawn = np.maximum(values, every.min())
    # Differences of times are equal up to rounding only.
    is_even = np.allclose(lengths, each, rtol=1e-6)
    said = f"dt = {_told(each)} s" if is_even else f"median dt = {_told(each)} s"
    late = int((seconds > lengths).sum())
    is_log = every.max() > _DECADES * every.min()
    x = across(float(tracks.times[-1]))
    y = svg.axis_of(np.append(drawn, every), UP, margin=0.06, is_log=is_log)
    y = y if is_log else replace(y, low=0.0)
    where = np.flatnonzero(tracks.without_plan)[:MOST_POINTS]
    failed = np.maximum(seconds[where], every.min())
    crosses = zip(x.at(tracks.step_times[where]), y.at(failed), strict=True)
    is_high = float(y.at(each)) < UP[1] + 14
    words_at = float(y.at(each)) + (13 if is_high else -4)
    drawing = [
        frame(x, y, "solver's time a step [s]"),
        svg.line(*svg.corners(x.at(times), y.at(drawn)), "s0", width=1.7),
        _level(y, each),
        svg.drawn(
            "".join(f"M{a - 3:.1f} {b - 3:.1f}l6 6m-6 0l6-6" for a, b in crosses),
            "failed",
        ),
        svg.text(ACROSS[1] - 2, words_at, said, anchor="end", name="tick"),
    ]
    return PanelDrawn(
        drawing=_markup(drawing),
        times=rounded(times, 5),
        values=rounded(values, 3),
        held=True,
        alt=f"Solver's time of each step: median {_told(float(np.median(seconds)))} s,"
        f" longest {_told(float(np.nanmax(seconds)))} s; {said}; {late} of "
        f"{counted(seconds.size, 'step')} took longer than the step itself.",
    )


def band_panel(label: str, times: Sequence[float], band: Mapping[str, Any]) -> "Markup":
    """Return the markup within the `svg` element of a band of many runs.

    Args:
        label: The quantity and its unit.
        times: Instants [s].
        band: Lists "low", "median" and "high" with a value for each instant; further
            values are not drawn. None stands for a value that is not known.
    """
    x = across(times[-1], begin=times[0])
    sides = [
        np.array(band[side][: len(times)], dtype=float)
        for side in ("low", "median", "high")
    ]
    y = svg.axis_of(np.concatenate(sides), UP, margin=0.06)
    at, (low, median, high) = x.at(times), (y.at(side) for side in sides)
    area = svg.drawn(svg.outline(at, low, high), "area s0")
    return _markup([frame(x, y, label), area, svg.line(at, median, "s0", width=1.2)])


def across(end: float, *, begin: float = 0.0) -> svg.Axis:
    """Return the axis of a span of time [s]."""
    last = end if end > begin else begin + 1.0
    return svg.Axis(low=begin, high=last, start=ACROSS[0], end=ACROSS[1])


def frame(x: svg.Axis, y: svg.Axis, label: str) -> str:
    """Return an empty panel over a span of time [s]."""
    return svg.frame(x, y, title=shortened(label, _LABEL), most=(4, 4), unit="s")


def _level(y: svg.Axis, value: float) -> str:
    at = f"{float(y.at(value)):.1f}"
    return svg.drawn(f"M{ACROSS[0]} {at}H{ACROSS[1]}", "level")


def _markup(drawn: Sequence[str]) -> "Markup":
    from markupsafe import Markup

    return Markup("".join(drawn))


def _told(value: float) -> str:
    return number(value, digits=4)


def reduced(times: Array, values: Array, most: int) -> tuple[Array, Array]:
    """Return about `most` of the instants, or fewer, with their values.

    The first and the last instant are among them.

    Args:
        times: Instants, shape (n,), or (n + 1,) if values are held.
        values: Values at the instants, shape (rows, n).
        most: Number of instants.
    """
    count = values.shape[1]
    if count <= most:
        return times, values
    places = np.unique(np.linspace(0, count - 1, most).round().astype(int))
    if times.size == count:
        return times[places], values[:, places]
    return np.append(times[places], times[-1]), values[:, places]


def _peaks(times: Array, values: Array, most: int) -> tuple[Array, Array]:
    """Return held values over fewer, longer intervals: the largest of each."""
    count = values.size
    if count <= most:
        return times, values
    begins = np.unique(np.linspace(0, count, most + 1).astype(int)[:-1])
    return np.append(times[begins], times[-1]), np.maximum.reduceat(values, begins)


def rounded(values: Array, digits: int) -> list[float | None]:
    """Return numbers with a few digits; None for one that is not finite."""
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in values]


def _range_told(label: str, finite: Array) -> str:
    if not finite.size:
        return f"{label} over time: no finite value."
    return (
        f"{label} over time: from {_told(float(finite.min()))} to "
        f"{_told(float(finite.max()))}."
    )
