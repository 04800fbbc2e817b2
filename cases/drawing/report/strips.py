"""Strips: the values of several runs on one line, with their median and a bound."""

import statistics
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmstart.cases.drawing.report import svg
from swarmstart.cases.drawing.wording import is_number, number

if TYPE_CHECKING:
    from markupsafe import Markup

WIDTH, HEIGHT, ENDS = 280, 42, (8, 272)
"""Size of a strip; ends of its line."""
MIDDLE, LINE = 14, 28
"""Heights of its dots, and of its line."""
MOST_DOTS = 200
_DECADES = 1000.0
"""Of positive values, largest to smallest, from which on the line is logarithmic."""
_ROWS = 3
_APART = 80
"""Places that are nearer to each other share a text."""
_EDGE = 26
"""Room at the ends of the line where a text that is centred would be cut off."""
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
        values: Values of the runs; those that are no numbers are counted as not
            defined.
        bound: Bound that is drawn as a line, with the side shaded on which values
            should be.
        relation: Required relation of a value to the bound: "<=", ">=", "<", ">" or
            "==".
        width: With "==", the largest allowed difference from the bound.
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
    axis = _axis(known if limit is None else [*known, limit])
    drawn = [f'<path class="axes" d="M{ENDS[0]} {LINE}H{ENDS[1]}"/>']
    if limit is not None:
        for side in _asked(relation, limit, width, axis.low, axis.high):
            drawn.append(svg.drawn(svg.box(axis.at(side).tolist(), (0, LINE)), "asked"))
        drawn.append(svg.drawn(f"M{float(axis.at(limit)):.1f} 0V{LINE}", "bound"))
    drawn.append(svg.drawn(f"M{float(axis.at(median)):.1f} 3.5V24.5", "median"))
    heights = MIDDLE + 4.4 * np.array(rows)
    drawn.append(svg.drawn(svg.dots(axis.at(shown), heights), "dots"))
    drawn += _ends(known, axis)
    told = svg.text_of(_told(known, median, len(values) - len(known), limit, relation))
    return Markup(
        f'<svg class="drawn strip" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{told}">{"".join(drawn)}</svg>'
    )


def _axis(marks: Sequence[float]) -> svg.Axis:
    """Return the line that holds some values."""
    low, high = min(marks), max(marks)
    if low == high:
        # If all values are equal, the line is as long as their size.
        room = max(abs(high), 1e-9) * 0.5
        low, high = low - room, high + room
    is_log = low > 0 and max(marks) > _DECADES * min(marks)
    return svg.axis_of([low, high], ENDS, is_log=is_log)


def _ends(known: Sequence[float], axis: svg.Axis) -> list[str]:
    """Return lowest and highest as texts below the line; one text if they are near."""
    low, high = min(known), max(known)
    first, last = axis.at([low, high]).tolist()
    texts, edge = [(first, number(low)), (last, number(high))], _EDGE
    if last - first < _APART:
        text = number(low) if low == high else f"{number(low)} to {number(high)}"
        texts, edge = [((first + last) / 2, text)], _APART
    found = []
    for place, words in texts:
        anchor = "end" if place > ENDS[1] - edge else "middle"
        anchor = "" if place < ENDS[0] + edge else anchor
        found.append(svg.text(place, HEIGHT - 2, words, anchor=anchor, name="tick"))
    return found


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
