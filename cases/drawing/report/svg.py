"""Figures of matplotlib as SVG within a page.

Colours of the palette become the page's CSS variables, so that a figure follows the
page into dark and print; text stays text, in the page's font. A page's policy refuses
`style` attributes, so styles become attributes of their own. Coordinates are in units
of the view box, about a pixel on a wide page, with one decimal: less is not visible.
"""

import html
import io
import re
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from swarmstart.cases.drawing import palette
from swarmstart.cases.drawing.drawing import colour, columns_of_names, line_style
from swarmstart.cases.drawing.page import cleaned
from swarmstart.cases.drawing.wording import number, shortened

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

UNIT = 72
"""Units of the view box in an inch; matplotlib's points."""
WIDTH, HEIGHT, MARGINS = 600, 330, (64, 14, 50, 30)
"""Size of a chart; its margins left, right, below and above the panel."""
TARGET: dict[str, Any] = {"color": "black", "ls": (0, (1.5, 3.5)), "lw": 1.2}
"""Look of the line of a target, or of what is known."""
_LEGEND_ROW, _LEGEND_LETTERS, _NAME = 19, 90, 40
_FEW_DECADES = 2
_INK, _SOFT, _RULE, _LINE = (
    palette.LIGHT_PAGE[name] for name in ("ink", "ink-soft", "rule", "line")
)
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none", "text.parse_math": False, "text.color": _INK,
    "figure.dpi": UNIT, "font.size": 13,
    "figure.facecolor": "none", "axes.facecolor": "none", "axes.edgecolor": _LINE,
    "axes.labelcolor": _INK, "axes.titlelocation": "left", "axes.titlesize": 13,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True,
    "axes.axisbelow": True, "grid.color": _RULE, "grid.linewidth": 1.0,
    "xtick.color": _LINE, "ytick.color": _LINE, "xtick.labelcolor": _SOFT,
    "ytick.labelcolor": _SOFT, "xtick.major.size": 0.0, "ytick.major.size": 0.0,
    "lines.linewidth": 2.0, "lines.markersize": 8.0,
    "lines.markeredgewidth": 0.0,
    "lines.scale_dashes": False, "legend.frameon": False, "legend.fontsize": 12,
}  # fmt: skip
_VARIABLES = {
    "#000000": "ink",
    **{value: name for name, value in palette.LIGHT_PAGE.items()},
    **{value: f"s{k}" for k, value in enumerate(palette.LIGHT)},
}
_NAMED = re.compile(r'<g id="title:([^"]*)">')
_TAG = re.compile(r"<[^>]+>")
_IDENTITY = re.compile(r'(?<=^<g) id="[^"]*"')
_PROPERTIES = re.compile(r' style="([^"]*)"')
_PLACES = re.compile(r'(?<= )(d|x|y)="([^"]*)"')
_DECIMALS = re.compile(r"-?\d+\.\d+")
_COMMANDS = re.compile(r"([A-Zz])\s*(?:(\S+) (\S+)((?: [^\sA-Za-z]+)*))?")
# What says nothing: level text, the look that the page gives, paths without ink, and
# groups without attributes and titles.
_IDLE = re.compile(
    r' transform="rotate\(-0 [^"]*\)"| stroke-dashoffset="0"| font-size="13px"'
    r'|(?<=^<text)(?P<rest>[^>]*) fill="var\(--ink\)"'
)
_INKLESS = re.compile(r'<path d="[^"]*" fill="none"/>|<g/>')
_PLAIN = re.compile(r"<g>((?:<(?!/?g\b|title)[^>]*>[^<]*)*)</g>")


def text_of(text: object) -> str:
    """Return text for markup: cleaned, escaped."""
    return html.escape(cleaned(str(text)), quote=True)


def page_style() -> "AbstractContextManager[None]":
    """Return the context in which the charts of a page are drawn and put into it."""
    import matplotlib as mpl

    return mpl.rc_context(_STYLE)


def new_chart(
    *,
    width: float = WIDTH,
    height: float = HEIGHT,
    margins: tuple[float, float, float, float] = MARGINS,
) -> "tuple[Figure, Axes]":
    """Return a figure with one panel at a fixed place, which needs no layout.

    Args:
        width: Of the figure.
        height: Of the figure.
        margins: Left, right, below and above the panel.
    """
    from matplotlib.figure import Figure

    left, right, below, above = margins
    figure = Figure(figsize=(width / UNIT, height / UNIT))
    size = ((width - left - right) / width, (height - below - above) / height)
    return figure, figure.add_axes((left / width, below / height, *size))


def series_style(number: int, *, has_mark: bool = True) -> dict[str, Any]:
    """Return colour, dashes and mark of a series, as `Axes.plot` takes them."""
    mark = palette.MARKS[number % len(palette.MARKS)] if has_mark else None
    return {"color": colour(number), "ls": line_style(number), "marker": mark}


def titled(text: str) -> str:
    """Return the `gid` of an artist with which a page gives it a tooltip."""
    return f"title:{text_of(shortened(text))}"


def label_of_series(text: str) -> str:
    """Return a user's text as it stands in a chart."""
    label = cleaned(shortened(text, _NAME))
    # Legends leave out what begins with an underscore.
    return f" {label}" if label.startswith("_") else label


def name_series(figure: "Figure") -> None:
    """Put a legend below the one panel of a chart, which grows by its rows."""
    (axes,) = figure.axes
    handles, names = axes.get_legend_handles_labels()
    columns = columns_of_names(names, _LEGEND_LETTERS)
    room = _LEGEND_ROW * -(-len(names) // columns)
    width, height = (UNIT * inches for inches in figure.get_size_inches())
    place, whole = axes.get_position(), height + room
    figure.set_size_inches(width / UNIT, whole / UNIT)
    axes.set_position(
        (place.x0, (place.y0 * height + room) / whole, place.width,
         place.height * height / whole)
    )  # fmt: skip
    figure.legend(
        handles, names, loc="lower left", ncols=columns, borderaxespad=0.0,
        borderpad=0.1, handlelength=2.6, labelspacing=0.3, columnspacing=1.4,
    )  # fmt: skip


def draw_dots(axes: "Axes", places: Sequence[tuple[float, float]], **look: Any) -> None:
    """Draw dots as one path, which is a third as long as a mark for each.

    Args:
        axes: The panel.
        places: In its data.
        look: Of the line; `lw` is the size of the dots.
    """
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    # Lines of no length: their round ends are the dots.
    codes = [Path.MOVETO, Path.LINETO] * len(places)
    path = Path([place for place in places for _ in range(2)], codes)
    axes.add_patch(PathPatch(path, fill=False, capstyle="round", **look))


def make_logarithmic(axis: "Axis", *, ticks: int = 8) -> None:
    """Make an axis logarithmic, with plain numbers at few places.

    Args:
        axis: Horizontal or vertical axis whose panel holds its lines already.
        ticks: The most of them.
    """
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    axis.axes.set(**{f"{axis.axis_name}scale": "log"})  # type: ignore[attr-defined]
    low, high = axis.get_view_interval()
    is_narrow = high < low * 10**_FEW_DECADES
    axis.set_major_locator(
        LogLocator(subs=(1, 2, 5) if is_narrow else (1,), numticks=ticks)
    )
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda at, _: number(at, digits=6)))


def as_svg(figure: "Figure", *, salt: str) -> str:
    """Return what is within the `svg` element of a figure; the same for the same.

    Args:
        figure: Drawn, and put into the page, in `page_style()`.
        salt: A word that no other figure of the page has, for its ids.
    """
    import matplotlib as mpl

    buffer = io.StringIO()
    nothing: dict[str, Any] = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with mpl.rc_context({"svg.hashsalt": salt}), warnings.catch_warnings():
        # Text is drawn by the browser, whose fonts have more glyphs.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        for artist in figure.findobj():
            artist.set_clip_on(False)  # Axes hold all; marks at an edge stay whole.
        figure.savefig(buffer, format="svg", metadata=nothing)
    text = buffer.getvalue()
    text = text[text.index('<g id="figure_1">') : text.rindex("</svg>")]
    # Escaped twice: by `titled`, and by matplotlib.
    text = _NAMED.sub(lambda m: f"<g><title>{html.unescape(m[1])}</title>", text)
    text = re.sub(r"\n\s*", "", _TAG.sub(_for_a_page, text))
    text, before = _INKLESS.sub("", text), ""
    while text != before:  # Groups within groups, from the inner to the outer ones.
        text, before = _PLAIN.sub(r"\1", text), text
    return text


def size_of(figure: "Figure") -> tuple[int, int]:
    """Return width and height of a figure in units of the view box."""
    width, height = figure.get_size_inches()
    return round(UNIT * width), round(UNIT * height)


def thinned(length: int, most: int) -> list[int]:
    """Return at most this many places of a list, evenly, its ends among them."""
    if length <= most:
        return list(range(length))
    return sorted({round(k * (length - 1) / (most - 1)) for k in range(most)})


def _for_a_page(match: re.Match[str]) -> str:
    """Return a tag without styles of its own, ids of groups, and needless decimals."""
    tag = _PROPERTIES.sub(_attributes, _IDENTITY.sub("", match[0]))
    tag = _IDLE.sub(r"\g<rest>", tag.replace("xlink:href", "href"))
    return _PLACES.sub(_rounded, tag)


def _attributes(match: re.Match[str]) -> str:
    """Return CSS properties as attributes, colours as variables of the page."""
    found = []
    for part in filter(None, map(str.strip, match[1].split(";"))):
        name, _, value = part.partition(": ")
        if name == "font":  # Before matplotlib 3.10: size and family in one.
            name, value = "font-size", value[: value.index("px") + 2].split()[-1]
        if name != "font-family":  # The page's own.
            variable = _VARIABLES.get(value)
            found.append(f' {name}="{f"var(--{variable})" if variable else value}"')
    return "".join(found)


def _rounded(match: re.Match[str]) -> str:
    few = _DECIMALS.sub(lambda found: _one_decimal(float(found[0])), match[2])
    if match[1] != "d":
        return f'{match[1]}="{few}"'
    parts, before = [], ("", "")
    for command, x, y, rest in _COMMANDS.findall(few):
        short = f"{command}{x} {y}{rest}" if y else command
        if command == "L" and x == before[0]:
            short = f"V{y}"
        elif command == "L" and y == before[1]:
            short = f"H{x}"
        parts.append(short)
        before = (x, y) if command in "ML" else ("", "")
    return f'd="{"".join(parts)}"'


def _one_decimal(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")
