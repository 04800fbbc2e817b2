"""Strips: the values of several runs on one line, with their median and a bound."""

import statistics
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from swarmstart.cases.drawing import palette
from swarmstart.cases.drawing.report import svg
from swarmstart.cases.drawing.wording import is_number, number

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.axes import Axes

WIDTH, HEIGHT, MARGINS = 280, 42, (8, 8, 14, 0)
MOST_DOTS = 200
_DECADES = 1000.0
"""Of positive values, largest to smallest, from which on the line is logarithmic."""
_ROWS = 3
_APART = 0.3
"""Part of the line; places that are nearer to each other share a text."""
_EDGE = 0.1
"""Part of the line at its ends where a text that is centred would be cut off."""
_BELOW, _ABOVE = ("<", "<="), (">", ">=")


def strip(
    values: Sequence[Any],
    *,
    bound: float | None = None,
    relation: str = "",
    width: float = 0.0,
) -> "Markup":
    """Return the values as dots on a line, as inline SVG.

    Args:
        values: Numbers; others are counted as not defined.
        bound: Drawn as a line, the side that a value is asked to be on shaded.
        relation: Of a value to the bound: "<=", ">=", "<", ">" or "==".
        width: With "==", by how much a value may be off.
    """
    from markupsafe import Markup

    known = [float(v) for v in values if is_number(v)]
    limit = float(bound) if bound is not None and is_number(bound) else None
    if not known:
        return Markup("")
    median = statistics.median(known)
    shown = known[:MOST_DOTS]
    # In rows, so that values that are nearly equal can be told apart.
    rows = [((k % _ROWS) - 1) * (len(shown) > 1) for k in range(len(shown))]
    page = palette.LIGHT_PAGE
    with svg.page_style():
        figure, axes = svg.new_chart(width=WIDTH, height=HEIGHT, margins=MARGINS)
        low, high = _scale(axes, known if limit is None else [*known, limit])
        if limit is not None:
            for begin, end in _asked(relation, limit, width, low, high):
                axes.axvspan(begin, end, color=page["good"], alpha=0.16, lw=0)
            axes.axvline(limit, color="black", lw=1.4, ls=(0, (4, 2)))
        axes.plot([median] * 2, [-2.4, 2.4], color=page["ink-soft"])
        places = list(zip(shown, rows, strict=True))
        svg.draw_dots(axes, places, lw=6, ec=page["accent"], alpha=0.75)
        _name_ends(axes, known)
        drawn = svg.as_svg(figure, salt="")  # Without marks there are no ids.
    told = svg.text_of(_told(known, median, len(values) - len(known), limit, relation))
    return Markup(
        f'<svg class="strip" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{told}">{drawn}</svg>'
    )


def _scale(axes: "Axes", marks: Sequence[float]) -> tuple[float, float]:
    """Make the panel a line that holds some values; return its ends."""
    low, high = min(marks), max(marks)
    if low > 0 and high > _DECADES * low:
        axes.set_xscale("log")
        room = (high / low) ** 0.05
        low, high = low / room, high * room
    else:
        # If all values are equal, the line is as long as their size.
        room = 0.05 * (high - low) or max(abs(high), 1e-9) * 0.5
        low, high = low - room, high + room
    axes.set(xlim=(low, high), ylim=(-3.2, 3.2), yticks=[], xticks=[])
    axes.minorticks_off()
    axes.spines["left"].set_visible(False)
    return low, high


def _name_ends(axes: "Axes", known: Sequence[float]) -> None:
    """Write lowest and highest below the line; one text if they are near."""
    low, high = min(known), max(known)
    to_part = axes.transData - axes.transAxes
    first, last = (float(to_part.transform((end, 0))[0]) for end in (low, high))
    texts, edge = [(first, number(low)), (last, number(high))], _EDGE
    if last - first < _APART:
        text = number(low) if low == high else f"{number(low)} to {number(high)}"
        texts, edge = [((first + last) / 2, text)], _APART
    for place, text in texts:
        anchor = "left" if place < edge else "right" if place > 1 - edge else "center"
        axes.text(
            place, -0.4, text, transform=axes.transAxes, ha=anchor, fontsize=10.5,
            color=palette.LIGHT_PAGE["ink-soft"],
        )  # fmt: skip


def _asked(
    relation: str, limit: float, width: float, low: float, high: float
) -> list[tuple[float, float]]:
    """Return begin and end of the side that values are asked to be on, if any."""
    if relation in _BELOW:
        return [(low, limit)]
    if relation in _ABOVE:
        return [(limit, high)]
    return [(max(limit - width, low), min(limit + width, high))] if width else []


def _told(
    known: Sequence[float],
    median: float,
    missing: int,
    limit: float | None,
    relation: str,
) -> str:
    said = f"{len(known)} value{'' if len(known) == 1 else 's'}"
    if len(known) > 1:
        said += (
            f" from {number(min(known))} to {number(max(known))}, median "
            f"{number(median)}"
        )
    else:
        said += f": {number(known[0])}"
    if missing:
        said += f", {missing} not defined"
    if limit is not None:
        said += f"; asked: {relation} {number(float(limit))}"
    return said + "."
