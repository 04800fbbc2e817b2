"""Small panels over time as inline SVG: lines, held steps, bounds and a cursor.

A panel is data for `player.html.j2`; places are in the panel's own units, PANEL wide
and high, of which about one is a pixel.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing.report.tracks import Series, Tracks

PANEL = (300.0, 140.0)
LEFT, RIGHT, TOP, BOTTOM = 44.0, 294.0, 22.0, 118.0
MOST_POINTS = 300
ALL_POINTS = 30_000
"""Of the lines of all panels together."""
FAR = 4.0
"""Times the range of the values that a bound may lie beyond them to be in the axis."""
_DECADES = 30.0
"""Of positive values, largest to smallest, from which on their axis is logarithmic."""
_TICKS = 4
_COLOURS = 12


@dataclass(frozen=True, kw_only=True, slots=True)
class PanelDrawn:
    """A panel as its template takes it: edges, name, ticks, lines, itself in words.

    Attributes:
        label: Name and unit.
        x_ticks: (place, text).
        y_ticks: (place, text).
        alt: The panel in words.
        traces: (number of the colour, path) of each line.
        levels: (place, text) of bounds and other limits.
        crosses: Path of the marks of what failed; empty: none.
        far: Bounds too far away to be drawn, in words; empty: there are none.
        times: Times [s] of the values to be told; empty: they are not.
        values: These.
        held: Whether they are held.
    """

    label: str
    x_ticks: Sequence[tuple[float, str]]
    y_ticks: Sequence[tuple[float, str]]
    alt: str
    traces: Sequence[tuple[int, str]]
    levels: Sequence[tuple[float, str]] = ()
    crosses: str = ""
    far: str = ""
    times: Sequence[float | None] = ()
    values: Sequence[float | None] = ()
    held: bool = False
    width: float = PANEL[0]
    height: float = PANEL[1]
    left: float = LEFT
    right: float = RIGHT
    top: float = TOP
    bottom: float = BOTTOM


@dataclass(frozen=True, kw_only=True, slots=True)
class _Axis:
    """An axis from a value to a value, both at places of the panel."""

    least: float
    most: float
    begin: float
    end: float
    is_log: bool = False

    def at(self, values: Array) -> Array:
        """Return the places of values."""
        least, most, given = self.least, self.most, values
        if self.is_log:
            least, most = math.log10(least), math.log10(most)
            given = np.log10(np.maximum(values, self.least))
        share = (given - least) / (most - least)
        return self.begin + (self.end - self.begin) * share


def series_panels(tracks: Tracks) -> list[PanelDrawn]:
    """Return a panel for each state and control of a flight."""
    lines = max(1, len(tracks.series) * len(tracks.vehicles))
    most = min(MOST_POINTS, max(60, ALL_POINTS // lines))
    return [_series_panel(one, tracks, most) for one in tracks.series]


def _series_panel(one: Series, tracks: Tracks, most: int) -> PanelDrawn:
    times, values = reduced(one.times, one.values, most)
    finite = values[np.isfinite(values)]
    near, far = _bounds_near(finite, one.lower, one.upper)
    vertical = _vertical(np.append(finite, near))
    across = _across(float(tracks.times[-1]))
    alone = len(values) == 1
    label = f"{one.name} [{one.unit}]" if one.unit else one.name
    x = across.at(times)
    return PanelDrawn(
        label=label,
        traces=[
            (row % _COLOURS, path(x, vertical.at(line), held=one.is_held))
            for row, line in enumerate(values)
        ],
        x_ticks=_x_ticks(across),
        y_ticks=_y_ticks(vertical),
        levels=[(_place(vertical, bound), "bound") for bound in near],
        far=f"{one.name} {' and '.join(map(number, far))}" if far else "",
        times=rounded(times, 5) if alone else (),
        values=rounded(values[0], 4) if alone else (),
        held=one.is_held,
        alt=_told(label, finite),
    )


def solver_panel(tracks: Tracks) -> PanelDrawn | None:
    """Return the solver's time of each step beside the length of the step.

    None if one plan is carried out to its end: nothing is solved on the way.
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
    is_log = every.max() > _DECADES * every.min()
    vertical = _vertical(every, is_log=is_log, from_zero=not is_log)
    across = _across(float(tracks.times[-1]))
    x = across.at(times)
    # A logarithmic axis has no place for 0.
    drawn = np.where(values > 0, values, every.min())
    crosses = ""
    if tracks.without_plan.any():
        where = np.flatnonzero(tracks.without_plan)[:MOST_POINTS]
        begins = across.at(tracks.step_times[where])
        at = vertical.at(np.maximum(seconds[where], every.min()))
        crosses = "".join(
            f"M{_n(a - 3)} {_n(b - 3)}l6 6m-6 0l6-6"
            for a, b in zip(begins, at, strict=True)
        )
    # Differences of times are equal up to rounding only.
    is_even = np.allclose(lengths, each, rtol=1e-6)
    said = f"dt = {number(each)} s" if is_even else f"median dt = {number(each)} s"
    late = int((seconds > lengths).sum())
    return PanelDrawn(
        label="solver's time a step [s]",
        traces=[(0, path(x, vertical.at(drawn), held=True))],
        x_ticks=_x_ticks(across),
        y_ticks=_y_ticks(vertical),
        levels=[(_place(vertical, each), said)],
        crosses=crosses,
        times=rounded(times, 5),
        values=rounded(values, 3),
        held=True,
        alt=f"Solver's time of each step: median {number(float(np.median(seconds)))} s,"
        f" longest {number(float(np.nanmax(seconds)))} s; {said}; {late} of "
        f"{seconds.size} steps took longer than the step itself.",
    )


def _across(end: float) -> _Axis:
    return _Axis(least=0.0, most=end if end > 0 else 1.0, begin=LEFT, end=RIGHT)


def _vertical(values: Array, *, is_log: bool = False, from_zero: bool = False) -> _Axis:
    """Return the axis of some values, with a little room."""
    if not values.size:
        values = np.array([0.0, 1.0])
    least, most = float(values.min()), float(values.max())
    if is_log:
        least, most = least / 1.3, most * 1.3
    else:
        room = 0.06 * (most - least)
        # Of a constant, up to rounding, half its size on either side.
        if room <= 1e-12 * max(abs(least), abs(most)):
            room = 0.5 * max(abs(most), 1e-9) if most else 0.5
        least, most = least - room, most + room
        least = 0.0 if from_zero else least
    return _Axis(least=least, most=most, begin=BOTTOM, end=TOP, is_log=is_log)


def _bounds_near(
    finite: Array, lower: float, upper: float
) -> tuple[list[float], list[float]]:
    """Return the bounds that are drawn, and those too far away for it."""
    bounds = [bound for bound in (lower, upper) if np.isfinite(bound)]
    if not finite.size:
        return bounds, []
    least, most = float(finite.min()), float(finite.max())
    reach = FAR * (most - least) or np.inf  # A constant has no range to compare with.
    near = [b for b in bounds if least - reach <= b <= most + reach]
    return near, [bound for bound in bounds if bound not in near]


def _x_ticks(axis: _Axis) -> list[tuple[float, str]]:
    # The text of a tick at the very end would be cut off.
    found = [tick for tick in ticks(axis.least, axis.most) if tick < axis.most * 0.97]
    return [(_place(axis, tick), number(tick)) for tick in found]


def _y_ticks(axis: _Axis) -> list[tuple[float, str]]:
    if axis.is_log:
        powers = range(
            math.ceil(math.log10(axis.least)), math.floor(math.log10(axis.most)) + 1
        )
        chosen = list(powers)[:: max(1, -(-len(powers) // _TICKS))]
        return [(_place(axis, 10.0**power), number(10.0**power)) for power in chosen]
    return [(_place(axis, tick), number(tick)) for tick in ticks(axis.least, axis.most)]


def ticks(least: float, most: float, *, count: int = _TICKS) -> list[float]:
    """Return about `count` round numbers from least to most.

    Example:
        >>> ticks(0.0, 25.0)
        [0.0, 10.0, 20.0]
    """
    raw = (most - least) / count
    if not (math.isfinite(raw) and raw > 0):
        return [least]
    power = 10.0 ** math.floor(math.log10(raw))
    # 1e-9: a step or a tick that fits exactly must not be lost to rounding.
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= raw * (1 - 1e-9))
    first, last = math.ceil(least / step - 1e-9), math.floor(most / step + 1e-9)
    # Rounded, since 3 * 0.1 is not 0.3 in binary numbers; + 0.0 turns -0.0 into 0.0.
    return [round(k * step, 12) + 0.0 for k in range(first, last + 1)]


def number(value: float) -> str:
    """Return a number with at most four digits; a real minus sign."""
    return f"{value:.4g}".replace("-", "\N{MINUS SIGN}")


def reduced(times: Array, values: Array, most: int) -> tuple[Array, Array]:
    """Return at most about `most` of the instants, the first and the last among them.

    Args:
        times: Shape (n,), or (n + 1,) where values are held.
        values: Shape (rows, n).
        most: Instants.
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


def path(x: Array, y: Array, *, held: bool) -> str:
    """Return an SVG path; broken where a place is not finite.

    Args:
        x: Places, shape (n,), or (n + 1,) of held values.
        y: Places, shape (n,).
        held: Whether each is held to the next place.
    """
    parts: list[str] = []
    is_down = False
    for k, level in enumerate(y):
        if not (np.isfinite(level) and np.isfinite(x[k])):
            is_down = False
            continue
        if not held:
            parts.append(f"{'L' if is_down else 'M'}{_n(x[k])} {_n(level)}")
        else:
            start = f"V{_n(level)}" if is_down else f"M{_n(x[k])} {_n(level)}"
            parts.append(f"{start}H{_n(x[k + 1])}")
        is_down = True
    return "".join(parts)


def rounded(values: Array, digits: int) -> list[float | None]:
    """Return numbers with a few digits; None for one that is not finite."""
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in values]


def _place(axis: _Axis, value: float) -> float:
    return round(float(axis.at(np.array([value]))[0]), 1)


def _n(value: float) -> str:
    return f"{value:.1f}".rstrip("0").rstrip(".")


def _told(label: str, finite: Array) -> str:
    if not finite.size:
        return f"{label} over time: no finite value."
    return (
        f"{label} over time: from {number(float(finite.min()))} to "
        f"{number(float(finite.max()))}."
    )
