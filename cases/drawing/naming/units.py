"""Names, values and durations as words with their units."""

import math
import re
from typing import Any

from swarmstart.cases.drawing.naming.wording import is_number

_UNITS = {
    "m_s2": "m/s²", "ft_s2": "ft/s²", "m_s": "m/s", "ft_s": "ft/s", "rad_s": "rad/s",
    "rad": "rad", "deg": "°", "ft": "ft", "m": "m", "n": "N", "s": "s",
    "seconds": "s",
}  # fmt: skip
_ENDING = re.compile(r"_(" + "|".join(sorted(_UNITS, key=len, reverse=True)) + r")$")
_IN_TEXT = re.compile(r"\[([^\]]{1,20})\]\s*$")


def label_of(name: str, unit: str | None = None) -> tuple[str, str]:
    """Return a name in words, and its unit.

    Args:
        name: As in a record, with or without a unit at its end.
        unit: The unit where the scenario says it, whose names stay as they are;
            None: the one at the name's end.

    Example:
        >>> label_of("turn_rate_rad_s")
        ('turn rate', 'rad/s')
        >>> label_of("angle", "rad")
        ('angle', 'rad')
    """
    if unit is not None:
        return name, unit
    found = _ENDING.search(name)
    if found is None:
        return name.replace("_", " "), ""
    return name[: found.start()].replace("_", " "), _UNITS[found.group(1)]


def unit_of_measure(name: str, meaning: str) -> str:
    """Return the unit of a measure: that at its name's end, or at its meaning's.

    Example:
        >>> unit_of_measure("step_seconds_median", "median wall time of a step [s]")
        's'
    """
    found = _ENDING.search(name)
    if found is not None:
        return _UNITS[found.group(1)]
    said = _IN_TEXT.search(meaning)
    return said.group(1) if said else ""


def shown(value: Any, *, digits: int = 6) -> str:
    """Return a value as text: "-" if it is not defined.

    Example:
        >>> shown(None), shown(12.0), shown([1.5, None])
        ('-', '12', '1.5, -')
    """
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, list | tuple):
        few = [shown(one, digits=4) for one in value[:12]]
        return ", ".join(few) + (
            f", ... ({len(value)})" if len(value) > len(few) else ""
        )
    if is_number(value):
        return f"{value:.{digits}g}" if isinstance(value, float) else str(value)
    return str(value)


def duration(seconds: float) -> str:
    """Return a duration with its unit.

    Example:
        >>> duration(0.0123), duration(2.5), duration(600.0)
        ('12.3 ms', '2.5 s', '10 min')
    """
    steps: tuple[tuple[float, float, str], ...] = (
        (1e-3, 1e-6, "µs"), (1.0, 1e-3, "ms"), (120.0, 1.0, "s"), (7200.0, 60.0, "min"),
    )  # fmt: skip
    if not math.isfinite(seconds):
        return "an unknown time"
    size, unit = next(((s, u) for most, s, u in steps if seconds < most), (3600.0, "h"))
    return f"{seconds / size:.3g} {unit}"
