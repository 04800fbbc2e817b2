"""Names of states, controls and measures as words with their units."""

import re

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
