"""Charts within a page, as SVG: axes, lines, bands, bars, dots, marks, legends.

Sizes are in units of the view box, about a pixel on a wide page, with one decimal:
smaller differences are not visible. Looks are classes of the page's style sheet
(`shell.css`, `palette`), so that a chart has the colours of the light, dark or printed
page, and obeys the page's policy, which refuses `style` attributes. Matplotlib chooses
the ticks; its own axes would take 60 ms of CPU each, and a page may have three hundred.
"""

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arrays import Array
from swarmstart.cases.drawing import palette
from swarmstart.cases.drawing.page import cleaned
from swarmstart.cases.drawing.wording import number, shortened

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.ticker import Locator

WIDTH, HEIGHT = 600, 330
"""Of a chart."""
ACROSS, UP = (64, 586), (280, 30)
"""Ends of the axes of its panel: left and right, below and above."""
_NAME = 40
# Beyond them differences, and powers of ticks beside an axis, overflow.
_HUGE, _MOST_POWER = 1e300, 150.0
_ROUNDING = 1e-9
_CONSTANT = 1e-12  # Part of their size by which equal values may differ: rounding.
_LINEAR, _FEW = 4.0, 100.0  # Ratios of the ends of logarithmic axes with other ticks.
_DIGITS = 6


@dataclass(frozen=True, kw_only=True, slots=True)
class Chart:
    """A chart as it stands in a page.

    Attributes:
        width: Width of the view box.
        height: Height of the view box.
        drawing: Markup within its `svg` element.
        follows: Attribute that tells the script how to find the chart's values; may be
            empty.
    """

    width: float
    height: float
    drawing: str
    follows: str = ""


@dataclass(frozen=True, kw_only=True, slots=True)
class Axis:
    """A scale from values to places in a chart, in units of its view box.

    Attributes:
        low: Value at `start`.
        high: Value at `end`, greater than `low`.
        start: Place of the beginning of the axis.
        end: Place of the end of the axis; less than `start` if it points up.
        is_log: Whether the axis is logarithmic; `low` is then positive.
    """

    low: float
    high: float
    start: float
    end: float
    is_log: bool = False

    def at(self, values: ArrayLike) -> Array:
        """Return places; NaN for a value without one (None, or 0 among logarithms)."""
        given = np.asarray(values, dtype=float)
        low, high = self.low, self.high
        if self.is_log:
            low, high = math.log(low), math.log(high)
            given = np.log(np.where(given > 0, given, np.nan))
        return np.asarray(
            self.start + (given - low) / (high - low) * (self.end - self.start)
        )

    def ticks(self, most: int) -> list[tuple[float, str]]:
        """Return places and texts of the ticks: about `most` of them, or fewer."""
        # Not at the head: Markdown, LaTeX and CSV have no ticks.
        from matplotlib.ticker import LogLocator, MaxNLocator

        if self.is_log and self.high > _LINEAR * self.low:
            subs = (1, 2, 5) if self.high < _FEW * self.low else (1,)
            locator: Locator = LogLocator(subs=subs, numticks=most)
        else:
            locator = MaxNLocator(most, steps=(1, 2, 5, 10))
        found = np.asarray(locator.tick_values(self.low, self.high))
        share = (self.at(found) - self.start) / (self.end - self.start)
        # Rounding must not lose a tick at an end.
        kept = found[(share >= -_ROUNDING) & (share <= 1 + _ROUNDING)].tolist()
        digits = _DIGITS
        if not self.is_log and len(kept) > 1:
            # Neighbours far from zero differ late.
            size = max(map(abs, kept)) / (kept[1] - kept[0])
            digits = max(digits, 1 + math.ceil(math.log10(size)))
        texts = [number(v, digits=digits).replace("-", "\N{MINUS SIGN}") for v in kept]
        return list(zip(self.at(kept).tolist(), texts, strict=True))


def axis_of(
    values: Iterable[Any],
    ends: tuple[float, float],
    *,
    margin: float = 0.05,
    is_log: bool = False,
) -> Axis:
    """Return an axis with room for values and a margin; only finite values count.

    Args:
        values: Numbers, NaN or None.
        ends: Places of the beginning and the end of the axis.
        margin: Part of the range that is added on either side.
        is_log: Whether the axis is logarithmic; values that are not positive are left
            out.
    """
    found = np.asarray(list(values), dtype=float)
    found = np.clip(found[np.isfinite(found)], -_HUGE, _HUGE)
    if is_log:
        found = np.clip(np.log10(found[found > 0]), -_MOST_POWER, _MOST_POWER)
    low, high = (found.min(), found.max()) if found.size else (0.0, 1.0)
    room = margin * (high - low)
    if high - low <= _CONSTANT * max(abs(low), abs(high)):
        room = 0.5 if is_log else 0.05 * abs(high) or 0.05
    low, high = float(low - room), float(high + room)
    if is_log:
        low, high = 10.0**low, 10.0**high
    return Axis(low=low, high=high, start=ends[0], end=ends[1], is_log=is_log)


def text_of(text: object) -> str:
    """Return text for markup: cleaned, escaped."""
    return html.escape(cleaned(str(text)), quote=True)


def text(x: float, y: float, words: str, *, anchor: str = "", name: str = "") -> str:
    """Return words at a place.

    Args:
        x: Horizontal place of the anchor.
        y: Vertical place of the base line.
        words: Text, also one of a user: it is escaped.
        anchor: "middle" or "end"; empty means the beginning.
        name: Class of the element; may be empty.
    """
    named = f' class="{name}"' if name else ""
    anchored = f' text-anchor="{anchor}"' if anchor else ""
    place = f'x="{_decimal(x)}" y="{_decimal(y)}"'
    return f"<text{named}{anchored} {place}>{text_of(words)}</text>"


def frame(
    x: Axis,
    y: Axis,
    *,
    title: str = "",
    label: str = "",
    most: tuple[int, int] = (8, 6),
    unit: str = "",
) -> str:
    """Return grid and ticks of a panel, its title above and its label below.

    Args:
        x: Horizontal axis.
        y: Vertical axis.
        title: Quantity on the vertical axis.
        label: Quantity on the horizontal axis.
        most: Largest number of ticks of the horizontal and the vertical axis; 0 means
            no ticks.
        unit: Unit that is shown in place of the last ticks of the horizontal axis.
    """
    grid, texts = [], []
    for place, words in x.ticks(most[0]):
        grid.append(f"M{_decimal(place)} {_decimal(y.start)}V{_decimal(y.end)}")
        if not unit or place < x.end - 18:
            texts.append(text(place, y.start + 16, words, anchor="middle", name="tick"))
    for place, words in y.ticks(most[1]) if most[1] else []:
        grid.append(f"M{_decimal(x.start)} {_decimal(place)}H{_decimal(x.end)}")
        texts.append(text(x.start - 5, place + 4, words, anchor="end", name="tick"))
    if unit:
        texts.append(text(x.end, y.start + 16, unit, anchor="end", name="tick"))
    if label:
        texts.append(text((x.start + x.end) / 2, y.start + 34, label, anchor="middle"))
    if title:
        texts.append(text(x.start, y.end - 8, title))
    left, right, below, above = map(_decimal, (x.start, x.end, y.start, y.end))
    return (
        f'<path class="grid" d="{"".join(grid)}"/>{"".join(texts)}'
        f'<path class="axes" d="M{left} {above}V{below}H{right}"/>'
    )


def look(series: int) -> str:
    """Return the classes of colour and dashes of a series; they repeat after twelve."""
    count = len(palette.DASHES)
    # One further in each round: series 13 has the colour of the first, not its dashes.
    return f"s{series % count} d{(series + series // count) % count}"


def line(
    x: Array, y: Array, name: str, *, title: str = "", width: float | None = None
) -> str:
    """Return a line.

    Args:
        x: Horizontal places, shape (n,).
        y: Vertical places, shape (n,); the line is broken where a place is not finite.
        name: Classes of the line.
        title: Tooltip of the line.
        width: Width of the line; None means that of the style sheet.
    """
    wide = "" if width is None else f' stroke-width="{_decimal(width)}"'
    return drawn(path(x, y), f"line {name}", title=title, more=wide)


def drawn(d: str, name: str, *, title: str = "", more: str = "") -> str:
    """Return a path element with its tooltip; `d` and `more` are markup."""
    if not title:
        return f'<path class="{name}" d="{d}"{more}/>'
    tip = f"<title>{text_of(shortened(title))}</title>"
    return f'<path class="{name}" d="{d}"{more}>{tip}</path>'


def path(x: Array, y: Array) -> str:
    """Return the path through places; broken where a place is not finite."""
    parts: list[str] = []
    before = ("", "")
    for place in zip(x.tolist(), y.tolist(), strict=True):
        if not all(map(math.isfinite, place)):
            before = ("", "")
            continue
        a, b = map(_decimal, place)
        if not before[0]:
            parts.append(f"M{a} {b}")
        elif b == before[1]:
            parts.append(f"H{a}" if a != before[0] else "")
        else:
            parts.append(f"V{b}" if a == before[0] else f"L{a} {b}")
        before = (a, b)
    return "".join(parts)


def outline(x: Array, low: Array, high: Array) -> str:
    """Return the path around the area between two lines, shape (n,) each."""
    kept = np.isfinite(low) & np.isfinite(high) & np.isfinite(x)
    there, back = x[kept], x[kept][::-1]
    around = path(np.append(there, back), np.append(low[kept], high[kept][::-1]))
    return f"{around}z" if around else ""


def box(x: Sequence[float], y: Sequence[float]) -> str:
    """Return the path around a box, from its two ends in x and its two ends in y."""
    left, right, one, other = map(_decimal, (*x, *y))
    return f"M{left} {one}H{right}V{other}H{left}z"


def dots(x: Array, y: Array) -> str:
    """Return the path of dots; what is not finite is left out."""
    kept = np.isfinite(x) & np.isfinite(y)
    # A line of no length: its round ends are the dot.
    places = zip(x[kept].tolist(), y[kept].tolist(), strict=True)
    return "".join(f"M{_decimal(a)} {_decimal(b)}h0" for a, b in places)


def marks(x: Array, y: Array, series: int, *, title: str = "") -> str:
    """Return the marks of a series at places, shape (n,) each."""
    mark = palette.MARKS[series % len(palette.MARKS)]
    places = zip(x.tolist(), y.tolist(), strict=True)
    d = "".join(f"M{_decimal(a)} {_decimal(b)}{mark}" for a, b in places)
    return drawn(d, f"marks s{series % len(palette.MARKS)}", title=title)


def corners(x: ArrayLike, y: ArrayLike) -> tuple[Array, Array]:
    """Return the corners of a line of steps: each value is held to the next place.

    Args:
        x: Horizontal places, shape (n,), or (n + 1,) if the last value is held, too.
        y: Values, shape (n,).
    """
    both = np.repeat(np.asarray(x), 2)[1 : 2 * np.size(y) + 1]
    return both, np.repeat(np.asarray(y), 2)[: both.size]


def legend(numbers: Mapping[str, int]) -> "Markup":
    """Return the legend: a list of series, each with its line and mark, that wraps.

    Args:
        numbers: Name of a series -> its number.
    """
    from markupsafe import Markup

    ends, middle = np.array([0.0, 34.0]), np.array([6.0])
    items = [
        '<li><svg class="drawn key" viewBox="0 0 34 12" aria-hidden="true">'
        + line(ends, np.repeat(middle, 2), look(series))
        + marks(np.array([17.0]), middle, series)
        + f"</svg>{text_of(shortened(name, _NAME))}</li>"
        for name, series in numbers.items()
    ]
    return Markup('<ul class="legend" aria-label="Legend">{}</ul>').format(
        Markup("".join(items))
    )


def thinned(length: int, most: int) -> list[int]:
    """Return at most `most` indices of a list, evenly spaced, with both ends.

    Args:
        length: Number of entries in the list.
        most: Largest number of indices.
    """
    if length <= most:
        return list(range(length))
    return sorted({round(k * (length - 1) / (most - 1)) for k in range(most)})


def _decimal(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")
