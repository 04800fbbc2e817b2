"""Charts of a page as figures of their own, to be written as SVG and PDF files.

A page draws its charts as SVG; colours and lines are classes of the page's style sheet
(`svg`). Here the finished page is read: each chart becomes a figure of matplotlib with
the page's rules for light colours, a title above and a legend below. Only the SVG that
`svg` writes is understood: paths of M, L, H, V, h, l, v, m, a and z, texts and groups.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from swarmstart.arrays import Array
from swarmstart.cases.drawing import palette
from swarmstart.cases.drawing.drawing import Figures, escaped, put_legend

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.path import Path

_CHART = re.compile(r'<svg class="drawn(?! strip)[^>]*role="img".*?</svg>', re.DOTALL)
_SHEET = re.compile(r"<style[^>]*>(.*?)</style>", re.DOTALL)
_MEDIA = re.compile(r"@media[^{]*\{(?:[^{}]*\{[^{}]*\})*[^{}]*\}|@page[^}]*\}")
_RULE = re.compile(r"([^{}]+)\{([^{}]*)\}")
_VARIABLE = re.compile(r"var\(--([\w-]+)\)")
_TOKEN = re.compile(r"[a-zA-Z]|-?(?:\d+\.?\d*|\.\d+)")
_COLOURS = palette.LIGHT_PAGE | {f"s{k}": c for k, c in enumerate(palette.LIGHT)}
_POINTS = 0.72
"""Points of a unit of a chart: 100 units are an inch."""
_ABOVE, _ROW = 40.0, 20.0
"""Room for the title, and for a row of the legend, in units."""
_ARC = 9
"""Points of half a circle."""
_NAME = 60
"""Characters of a file's name."""


class Rule(NamedTuple):
    """A rule of a style sheet: classes of parents, class or tag of an element, look."""

    around: frozenset[str]
    own: str
    looks: Mapping[str, str]


@dataclass(frozen=True, kw_only=True, slots=True)
class Look:
    """Looks of an element: presentation attributes of SVG by name."""

    values: Mapping[str, str]

    def number(self, name: str, default: float) -> float:
        """Return a look as a number, without its unit."""
        return float(self.values.get(name, str(default)).removesuffix("px"))

    def colour(self, name: str) -> tuple[str, float] | str:
        """Return fill or stroke with its opacity; "none" for no colour."""
        own = self.values.get(name, "none")
        named = _VARIABLE.fullmatch(own)
        if own == "none" or (named is not None and named[1] not in _COLOURS):
            return "none"
        opacity = self.number("opacity", 1.0) * self.number(f"{name}-opacity", 1.0)
        return _COLOURS[named[1]] if named is not None else own, opacity

    def line_style(self, width: float) -> tuple[float, tuple[float, ...]] | str:
        """Return dashes as matplotlib's line style, in multiples of the width."""
        dashes = self.values.get("stroke-dasharray", "none")
        if dashes == "none" or not width:
            return "-"
        return 0.0, tuple(float(part) / width for part in dashes.split())


def chart_figures(page: str) -> Figures:
    """Yield the charts of a page as figures, with names for their files.

    Args:
        page: HTML from `comparison_page`, `seeds_page`, `run_page` or
            `replication_page`.
    """
    rules = _rules("".join(_SHEET.findall(page)))
    for number, found in enumerate(_CHART.findall(page), 1):
        chart = ElementTree.fromstring(found)
        words = re.sub(r"[^a-z0-9]+", "_", chart.get("aria-label", "").lower())
        yield f"{number:03}_{words[:_NAME].strip('_')}", _figure(chart, rules)


def _rules(sheet: str) -> list[Rule]:
    """Return the rules of a style sheet for the screen, in their order."""
    sheet = re.sub(r"/\*.*?\*/", "", sheet, flags=re.DOTALL)
    rules = []
    for selectors, body in _RULE.findall(_MEDIA.sub("", sheet)):
        pairs = [part.split(":", 1) for part in body.split(";") if ":" in part]
        looks = {name.strip(): value.strip() for name, value in pairs}
        for selector in selectors.split(","):
            *around, own = re.sub(r"\[[^]]*\]", "", selector).split() or [""]
            classes = frozenset(c for one in around for c in one.split(".")[1:])
            rules.append(Rule(around=classes, own=own, looks=looks))
    return rules


def _look(
    element: ElementTree.Element,
    around: frozenset[str],
    rules: Sequence[Rule],
    above: Look,
) -> Look:
    """Return the looks of an element within another one, whose looks it inherits."""
    tag = element.tag
    own = frozenset((element.get("class") or "").split())
    values = {k: v for k, v in above.values.items() if k != "opacity"}
    for rule in rules:
        name, *classes = rule.own.split(".")
        # Rules such as `path` or `.line`; those of other tags do not apply.
        if name in {"", tag} and (name or classes) and own.issuperset(classes):
            if around.issuperset(rule.around):
                values |= rule.looks
    if "stroke-width" in element.attrib:
        values["stroke-width"] = element.attrib["stroke-width"]
    return Look(values=values)


def _figure(chart: ElementTree.Element, rules: Sequence[Rule]) -> "Figure":
    """Return a chart as a figure, its title above, names of its lines below."""
    from matplotlib.figure import Figure

    _, _, width, height = map(float, chart.attrib["viewBox"].split())
    named = _named(chart)
    columns = max(1, int(width // 200))
    below = _ROW * -(-len(named) // columns) + (10.0 if named else 0.0)
    whole = _ABOVE + height + below
    figure = Figure(figsize=(width / 100, whole / 100))
    axes = figure.add_axes((0.0, below / whole, 1.0, height / whole))
    axes.set(xlim=(0.0, width), ylim=(height, 0.0))
    axes.set_axis_off()
    figure.suptitle(
        escaped(chart.get("aria-label", "")), x=0.02, ha="left", fontsize=10.0,
        y=1 - 8.0 / whole, va="top", wrap=True,
    )  # fmt: skip
    # A panel of a flight is within the player of its page.
    start = frozenset((chart.get("class") or "").split()) | {"player"}
    base = Look(values={"fill": "var(--ink)", "stroke-width": "2", "font-size": "13"})
    _draw(axes, chart, _Place(start, rules, _look(chart, start, rules, base)))
    handles = {}
    for name, element in named.items():
        look = _look(element, start, rules, base)
        (handles[escaped(name)],) = axes.plot([], [], **_line(look))
    if handles:
        put_legend(figure, handles, room=int(width / 7))
    return figure


class _Place(NamedTuple):
    """Surroundings of an element: classes around it, the rules, inherited looks."""

    around: frozenset[str]
    rules: Sequence[Rule]
    look: Look


def _named(chart: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """Return the lines that only a tooltip names, by name."""
    written = {text.text for text in chart.iter("text")}
    found: dict[str, ElementTree.Element] = {}
    for element in chart.iter("path"):
        title = element.findtext("title")
        if title and title not in written and "line" in element.get("class", ""):
            found.setdefault(title, element)
    return found


def _draw(axes: "Axes", element: ElementTree.Element, place: _Place) -> None:
    """Draw what is within an element."""
    from matplotlib.patches import PathPatch

    for child in element:
        if child.get("class") == "cursor":  # Of the player, which moves it.
            continue
        look = _look(child, place.around, place.rules, place.look)
        if child.tag == "path":
            drawn = _path(child.get("d", ""))
            if drawn is not None:
                line = _line(look)
                axes.add_patch(
                    PathPatch(
                        drawn, facecolor=look.colour("fill"), edgecolor=line["color"],
                        lw=line["lw"], ls=line["ls"], joinstyle="round",
                        capstyle=look.values.get("stroke-linecap", "butt"),
                    )
                )  # fmt: skip
        elif child.tag == "text":
            anchor = {"middle": "center", "end": "right"}
            axes.text(
                float(child.attrib["x"]), float(child.attrib["y"]),
                escaped(child.text or ""), va="baseline", color=look.colour("fill"),
                ha=anchor.get(child.get("text-anchor", ""), "left"),
                fontsize=_POINTS * look.number("font-size", 13.0),
            )  # fmt: skip
        else:
            around = place.around | set((child.get("class") or "").split())
            _draw(axes, child, _Place(around, place.rules, look))


def _line(look: Look) -> dict[str, Any]:
    width = look.number("stroke-width", 2.0)
    return {
        "color": look.colour("stroke"), "lw": _POINTS * width,
        "ls": look.line_style(width),
    }  # fmt: skip


def _path(d: str) -> "Path | None":
    """Return a path of SVG as one of matplotlib; None if it is empty."""
    from matplotlib.path import Path

    places: list[Array] = []
    codes: list[int] = []
    for command, end in _commands(d):
        for place in end:
            places.append(place)
            codes.append(int(Path.MOVETO if command in "mM" else Path.LINETO))
        if command == "z":
            places.append(places[-1])
            codes.append(int(Path.CLOSEPOLY))
    return Path(np.array(places), codes) if places else None


def _commands(d: str) -> Iterator[tuple[str, list[Array]]]:
    """Yield each command of a path with the places that it leads to."""
    at = begin = np.zeros(2)
    tokens = _TOKEN.findall(d)
    k, command = 0, ""
    while k < len(tokens):
        if tokens[k].isalpha():
            command, k = tokens[k], k + 1
            if command in "zZ":
                at = begin
                yield "z", []
                continue
        count = {"h": 1, "v": 1, "a": 7}.get(command.lower(), 2)
        numbers = [float(token) for token in tokens[k : k + count]]
        k += count
        base = at if command.islower() else np.zeros(2)
        end = _end(command.lower(), numbers, at, base)
        yield command, _half_circle(at, end) if command == "a" else [end]
        at = end
        begin = end if command in "mM" else begin


def _end(command: str, numbers: Sequence[float], at: Array, base: Array) -> Array:
    """Return the place that a command leads to; numbers count from the base."""
    if command == "h":
        return np.array([base[0] + numbers[0], at[1]])
    if command == "v":
        return np.array([at[0], base[1] + numbers[0]])
    return base + numbers[-2:]


def _half_circle(begin: Array, end: Array) -> list[Array]:
    """Return places on the half circle from one place to another, counterclockwise."""
    middle, out = (begin + end) / 2, (begin - end) / 2
    across = np.array([out[1], -out[0]])
    angles = np.linspace(0.0, np.pi, _ARC)[1:]
    return [middle + np.cos(a) * out + np.sin(a) * across for a in angles]
