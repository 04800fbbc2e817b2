"""Strips: the values of several runs on one line, with their median and a bound."""

import math
import statistics
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from swarmstart.cases.drawing.page import rendered
from swarmstart.cases.drawing.report.panels_over_time import number
from swarmstart.cases.drawing.wording import is_number

if TYPE_CHECKING:
    from markupsafe import Markup

WIDTH, LEFT, RIGHT, MIDDLE = 280.0, 8.0, 272.0, 15.0
MOST_DOTS = 200
_DECADES = 1000.0
"""Of positive values, largest to smallest, from which on the line is logarithmic."""
_ROWS = 3
_APART = 80.0
"""Places that are nearer to each other share a text."""
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
    limit = bound if is_number(bound) else None
    marks = [*known] + ([] if limit is None else [float(limit)])
    if not known:
        return Markup("")
    shown = known[:MOST_DOTS]
    low, high = min(marks), max(marks)
    is_log = low > 0 and high > _DECADES * low
    if is_log:
        low, high = math.log10(low), math.log10(high)
    # If all values are equal, the line is as long as their size.
    room = 0.05 * (high - low) or max(abs(high), 1e-9) * 0.5
    low, high = low - room, high + room

    def at(value: float) -> float:
        given = math.log10(value) if is_log else value
        return round(LEFT + (RIGHT - LEFT) * (given - low) / (high - low), 1)

    median = statistics.median(known)
    missing = len(values) - len(known)
    return Markup(
        rendered(
            "strip.html.j2",
            {
                # In rows, so that values that are nearly equal can be told apart.
                "dots": [
                    (at(v), MIDDLE + 4 * ((k % _ROWS) - 1) * (len(shown) > 1))
                    for k, v in enumerate(shown)
                ],
                "median": at(median),
                "bound": None if limit is None else at(float(limit)),
                "asked": _asked(relation, limit, width, at),
                "ends": _ends(known, at),
                "limit": "" if limit is None else number(float(limit)),
                "alt": _told(known, median, missing, limit, relation),
                "size": (WIDTH, LEFT, RIGHT),
            },
        )
    )


def _ends(known: Sequence[float], at: Any) -> list[tuple[float, str, str]]:
    """Return place, anchor, text of lowest and highest; one text if they are near."""
    low, high = min(known), max(known)
    if at(high) - at(low) < _APART:
        text = number(low) if low == high else f"{number(low)} to {number(high)}"
        middle = (at(low) + at(high)) / 2
        # A text that is centred near an edge would be cut off.
        anchor = "start" if middle < WIDTH / 3 else "end"
        anchor = "middle" if WIDTH / 3 <= middle <= 2 * WIDTH / 3 else anchor
        return [(middle, anchor, text)]
    return [
        (at(low), "start" if at(low) < 2 * LEFT else "middle", number(low)),
        (at(high), "end" if at(high) > WIDTH - 2 * LEFT else "middle", number(high)),
    ]


def _asked(
    relation: str, limit: float | None, width: float, at: Any
) -> tuple[float, float] | None:
    """Return begin and end of the side that values are asked to be on."""
    if limit is None:
        return None
    place = at(limit)
    if relation in _BELOW:
        return LEFT, place
    if relation in _ABOVE:
        return place, RIGHT
    if width:
        ends = np.clip([at(limit - width), at(limit + width)], LEFT, RIGHT)
        return float(ends[0]), float(ends[1])
    return None


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
