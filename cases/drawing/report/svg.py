"""Charts as inline SVG, by plain functions: axes, lines, bands, marks.

Sizes are in units of the view box, about a pixel on a wide page. Colours come from
classes (`palette.style_sheet`), so that a figure follows the page into dark and print.
Every function returns markup; text is cleaned and escaped in `text_of`.
"""

import html
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from swarmstart.cases.drawing.page import cleaned
from swarmstart.cases.drawing.palette import MARKS
from swarmstart.cases.drawing.wording import is_number, number, shortened

SERIES = len(MARKS)
_HUGE = 1e300  # Beyond it differences overflow.
_FEW_DECADES = 1.4
_MANY_DECADES = 7


def text_of(text: object) -> str:
    """Return text for markup: cleaned, escaped."""
    return html.escape(cleaned(str(text)), quote=True)


@dataclass(frozen=True, kw_only=True, slots=True)
class Axis:
    """A scale from values to a side of a chart.

    Attributes:
        low: Value at `start`.
        high: Value at `end`, greater than `low`.
        start: Begin of the axis, in units of the view box.
        end: Its end; less than `start` for an axis that points up.
        is_log: Logarithmic; `low` is then positive.
        label: Its quantity with the unit.
    """

    low: float
    high: float
    start: float
    end: float
    is_log: bool = False
    label: str = ""

    def at(self, value: float) -> float:
        """Return the place of a value; one beyond an end is placed at that end."""
        if self.is_log:
            low, high = math.log(self.low), math.log(self.high)
            given = math.log(max(value, self.low))  # 0 or less has no logarithm.
        else:
            low, high, given = self.low, self.high, value
        share = min(max((given - low) / (high - low), 0.0), 1.0)
        return self.start + share * (self.end - self.start)

    def ticks(self) -> list[tuple[float, str]]:
        """Return values of the ticks with their text."""
        values = _log_ticks(self) if self.is_log else _linear_ticks(self)
        return [(value, number(value, digits=6)) for value in values]


def axis_over(
    values: Iterable[Any],
    start: float,
    end: float,
    *,
    label: str,
    is_log: bool = False,
    margin: float = 0.04,
) -> Axis:
    """Return the axis that holds these values; missing ones are left out."""
    found = [float(value) for value in values if is_number(value)]
    found = [min(max(value, -_HUGE), _HUGE) for value in found]
    if is_log:
        found = [value for value in found if value > 0] or [1.0]
        low, high = math.log10(min(found)), math.log10(max(found))
        low, high = _apart(low, high, margin, least=0.3)
        # Powers beyond are 0, or overflow.
        low, high = 10.0 ** max(low, -300), 10.0 ** min(high, 300)
    else:
        found = found or [0.0, 1.0]
        low, high = min(found), max(found)
        low, high = _apart(low, high, margin, least=max(abs(high) * 1e-9, 1e-12))
    return Axis(low=low, high=high, start=start, end=end, is_log=is_log, label=label)


def frame(x: Axis, y: Axis, *, has_y_ticks: bool = True, tick_gap: float = 46) -> str:
    """Return grid, ticks, ticks' texts and labels of a chart's two axes."""
    grid, texts = [], []
    bottom, top = y.start, y.end
    for value, words in _spaced(x, tick_gap):
        place = _n(x.at(value))
        grid.append(f"M{place} {_n(bottom)}V{_n(top)}")
        texts.append(_text(x.at(value), bottom + 17, words, anchor="middle"))
    for value, words in _spaced(y, 20) if has_y_ticks else []:
        grid.append(f"M{_n(x.start)} {_n(y.at(value))}H{_n(x.end)}")
        texts.append(_text(x.start - 6, y.at(value) + 4, words, anchor="end"))
    middle = (x.start + x.end) / 2
    if x.label:
        texts.append(_text(middle, bottom + 35, x.label, anchor="middle", name="l"))
    if y.label:
        texts.append(_text(4, top - 9, y.label, name="l"))
    outline = f"M{_n(x.start)} {_n(top)}V{_n(bottom)}H{_n(x.end)}"
    return (
        f'<path class="g" d="{"".join(grid)}"/><path class="a" d="{outline}"/>'
        + "".join(texts)
    )


def line(
    points: Sequence[tuple[float, float]], series: int, title: str, *, is_step: bool
) -> str:
    """Return a series' line through points of the view box."""
    if not points:
        return ""
    inner = f"<title>{text_of(shortened(title))}</title>" if title else ""
    return (
        f'<path class="line s{series % SERIES}" d="{_path(points, is_step)}">'
        f"{inner}</path>"
    )


def band(
    low: Sequence[tuple[float, float]],
    high: Sequence[tuple[float, float]],
    series: int,
    *,
    is_step: bool,
) -> str:
    """Return the area between two lines."""
    if not low or not high:
        return ""
    there = _corners(low) if is_step else list(low)
    back = (_corners(high) if is_step else list(high))[::-1]
    whole = _turning([*there, *back])
    return f'<path class="band s{series % SERIES}" d="{whole}z"/>'


def mark(x: float, y: float, series: int, title: str = "") -> str:
    """Return a series' mark at a place."""
    inner = f"<title>{text_of(shortened(title))}</title>" if title else ""
    k = series % SERIES
    return f'<use href="#m{k}" class="s{k}" x="{_n(x)}" y="{_n(y)}">{inner}</use>'


def dots(points: Sequence[tuple[float, float]], series: int, title: str = "") -> str:
    """Return dots, as one path: a page may have ten thousand."""
    if not points:
        return ""
    inner = f"<title>{text_of(shortened(title))}</title>" if title else ""
    # A line of no length: its round ends are the dot. Heights need no decimals.
    places = "".join(f"M{_n(x)} {y:.0f}h0" for x, y in points)
    return f'<path class="dots s{series % SERIES}" d="{places}">{inner}</path>'


def stroke(points: Sequence[tuple[float, float]], name: str) -> str:
    """Return a line of a class of its own, such as that of a target."""
    return f'<path class="{name}" d="{_path(points, is_step=False)}"/>'


def words_at(
    x: float, y: float, words: str, *, anchor: str = "", name: str = ""
) -> str:
    """Return text at a place."""
    return _text(x, y, words, anchor=anchor, name=name)


def marks_defined() -> str:
    """Return the marks of all series; a page with figures has them once."""
    paths = "".join(f'<path id="m{k}" d="{path}"/>' for k, path in enumerate(MARKS))
    keys = "".join(
        f'<g id="k{k}"><path class="line s{k}" d="M0 6H34"/>'
        f'<use href="#m{k}" class="s{k}" x="17" y="6"/></g>'
        for k in range(SERIES)
    )
    return (
        '<svg width="0" height="0" class="defined" aria-hidden="true" '
        f'focusable="false"><defs>{paths}{keys}</defs></svg>'
    )


def key(series: int) -> str:
    """Return a legend's sample of a series: line with dashes, and mark."""
    return (
        f'<svg class="key" aria-hidden="true"><use href="#k{series % SERIES}"/></svg>'
    )


def thinned(length: int, most: int) -> list[int]:
    """Return at most this many places of a list, evenly, its ends among them."""
    if length <= most:
        return list(range(length))
    return sorted({round(k * (length - 1) / (most - 1)) for k in range(most)})


def _path(points: Sequence[tuple[float, float]], is_step: bool) -> str:
    begin, *rest = points
    parts = [f"M{_n(begin[0])} {_n(begin[1])}"]
    if is_step:
        parts += [f"H{_n(x)}V{_n(y)}" for x, y in rest]
    elif rest:
        parts.append("L" + " ".join(f"{_n(x)} {_n(y)}" for x, y in rest))
    return "".join(parts)


def _turning(points: Sequence[tuple[float, float]]) -> str:
    """Return a path whose level and upright parts have one coordinate each."""
    before = tuple(map(_n, points[0]))
    parts = ["M" + " ".join(before)]
    for point in points[1:]:
        x, y = map(_n, point)
        if (x, y) == before:
            continue
        if y == before[1]:
            parts.append(f"H{x}")
        else:
            parts.append(f"V{y}" if x == before[0] else f"L{x} {y}")
        before = (x, y)
    return "".join(parts)


def _corners(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points of a step curve: first along x, then along y."""
    whole = [points[0]]
    for (_, before), (x, y) in itertools.pairwise(points):
        whole += [(x, before), (x, y)]
    return whole


def _text(x: float, y: float, words: str, *, anchor: str = "", name: str = "") -> str:
    named = f' class="{name}"' if name else ""
    anchored = f' text-anchor="{anchor}"' if anchor else ""
    return f'<text{named}{anchored} x="{_n(x)}" y="{_n(y)}">{text_of(words)}</text>'


def _n(value: float) -> str:
    """Return a coordinate with one decimal; less is not visible."""
    return f"{value:.1f}".removesuffix(".0")


def _apart(
    low: float, high: float, margin: float, *, least: float
) -> tuple[float, float]:
    """Return the ends of an axis with a margin; they are never equal."""
    if high - low < least:
        low, high = low - least / 2, high + least / 2
    width = margin * (high - low)
    return low - width, high + width


def _log_ticks(axis: Axis) -> list[float]:
    low, high = math.log10(axis.low), math.log10(axis.high)
    decades = range(math.floor(low), math.ceil(high) + 1)
    if high - low < _FEW_DECADES:
        values = [step * 10.0**k for k in decades for step in (1, 2, 5)]
        inside = [value for value in values if axis.low <= value <= axis.high]
        return inside if len(inside) > 1 else _linear_ticks(axis)
    every = math.ceil((high - low) / _MANY_DECADES)
    return [10.0**k for k in decades if k % every == 0 and low <= k <= high]


def _linear_ticks(axis: Axis) -> list[float]:
    """Return ticks at 1, 2 or 5 times a power of ten."""
    raw = (axis.high - axis.low) / 5
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= raw * 0.999)
    first = math.ceil(axis.low / step - 1e-9)
    last = math.floor(axis.high / step + 1e-9)
    # A step is a fifth of the axis, or more: only rounding would make over a dozen.
    return [float(f"{k * step:.12g}") for k in range(first, min(last, first + 12) + 1)]


def _spaced(axis: Axis, gap: float) -> list[tuple[float, str]]:
    """Return the ticks whose texts do not touch."""
    kept: list[tuple[float, str]] = []
    for value, words in axis.ticks():
        if not kept or abs(axis.at(value) - axis.at(kept[-1][0])) >= gap:
            kept.append((value, words))
    return kept
