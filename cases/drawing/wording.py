"""Numbers, missing numbers, names, values and durations in words, with their units.

Pages, Markdown and LaTeX use the same words. Commands print `quantity` and `duration`,
which are ASCII; `typeset_duration` is for pages. Nothing is imported that draws: the
command line needs these words without matplotlib.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

NOT_FEASIBLE = "not feasible"
NO_SUCCESS = "no success"
NOT_MEASURED = "not measured"

KEPT = 1e-6
"""An excess over a constraint up to this is rounding."""
_DIGITS = 5
_MILLI = 1e-3
_SHORT_S, _LONG_S = 1.0, 120.0
_MINUTE_S = 60.0
_UNITS = {
    "m_s2": "m/s²", "ft_s2": "ft/s²", "m_s": "m/s", "ft_s": "ft/s", "rad_s": "rad/s",
    "rad": "rad", "deg": "°", "ft": "ft", "m": "m", "n": "N", "s": "s",
    "seconds": "s",
}  # fmt: skip
_ENDING = re.compile(r"_(" + "|".join(_UNITS) + r")$")
_IN_TEXT = re.compile(r"\[([^\]]{1,20})\]\s*$")


def is_number(value: object) -> bool:
    """Return whether this is a finite number."""
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)  # To Python, True is an int.
        and math.isfinite(value)
    )


def number_of(value: Any) -> float:
    """Return a measure as a number; NaN if it is undefined."""
    return float(value) if is_number(value) else math.nan


def number(value: object, missing: str = NOT_MEASURED, *, digits: int = _DIGITS) -> str:
    """Return a number in a few significant digits, or the word for a missing one.

    Args:
        value: The number; None if it is missing.
        missing: The word for a number that is missing or not finite.
        digits: Significant digits.

    Example:
        >>> number(455.11134), number(3.0), number(123456.0), number(None, "no success")
        ('455.11', '3', '123456', 'no success')
    """
    if not is_number(value):
        return missing
    given = float(value)  # type: ignore[arg-type]
    # Whole numbers are mostly counts: two digits more are shown before rounding.
    if given == int(given) and abs(given) < 10 ** (digits + 2):
        return str(int(given))
    # Python pads exponents: 1e-07.
    return f"{given:.{digits}g}".replace("e+0", "e").replace("e-0", "e-")


def percent(share: object, missing: str = NOT_MEASURED) -> str:
    """Return a share in per cent.

    Example:
        >>> percent(0.01), percent(0.0001), percent(1)
        ('1 %', '0.01 %', '100 %')
    """
    if not is_number(share):
        return missing
    return f"{number(100 * float(share), digits=4)} %"  # type: ignore[arg-type]


def shortened(text: object, length: int = 80) -> str:
    """Return a text of at most this length, cut in its middle.

    Example:
        >>> shortened("a" * 100, 9)
        'aaaa…aaaa'
    """
    whole = str(text)
    if len(whole) <= length:
        return whole
    kept = length - 1
    return f"{whole[: kept - kept // 2]}…{whole[len(whole) - kept // 2 :]}"


def listed(words: Sequence[str]) -> str:
    """Return words as a list in a sentence.

    Example:
        >>> listed(["a", "b", "c"])
        'a, b and c'
    """
    if not words[1:]:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"


def median(values: Sequence[Any]) -> float | None:
    """Return the median of the values that are numbers; None if there are none."""
    return quantile(values, 0.5)


def quantile(values: Sequence[Any], share: float) -> float | None:
    """Return a quantile of the values that are numbers, linear between them."""
    found = sorted(value for value in values if is_number(value))
    if not found:
        return None
    place = share * (len(found) - 1)
    low = math.floor(place)
    high = min(low + 1, len(found) - 1)
    part = place - low
    # Not low + part * (high - low): a difference of two huge numbers overflows.
    return float((1 - part) * found[low] + part * found[high])


def stated_cost(cost: object, sense: object) -> float | None:
    """Return a cost as the user states it: a value that is maximised has its sign back.

    Example:
        >>> stated_cost(-3.0, -1), stated_cost(3.0, 1), stated_cost(None, 1)
        (3.0, 3.0, None)
    """
    if not is_number(cost):
        return None
    value = float(cost)  # type: ignore[arg-type]
    return (-value if sense == -1 else value) + 0.0  # No "-0".


def rate(row: Mapping[str, Any], place: int = 0) -> float | None:
    """Return the share of a row's runs that are near the best known cost.

    Args:
        row: Row of a report: results of a solver on a scenario.
        place: Index in the report's list of the distances that count as near.

    Returns:
        The share; None without runs, or if the report has no such distances.
    """
    near = row["near"]
    return near[place] / row["runs"] if row["runs"] and near else None


def interval(pair: Sequence[Any] | None) -> str:
    """Return an interval of a rate in words; "one run" if there is none.

    Example:
        >>> interval([0.72246, 1.0]), interval(None)
        ('0.72 to 1.00', 'one run')
    """
    if pair is None or not all(is_number(end) for end in pair):
        return "one run"
    return f"{pair[0]:.2f} to {pair[1]:.2f}"


def quantity(value: float, digits: int = 6) -> str:
    """Return a number with a few significant digits.

    Example:
        >>> quantity(36.712599), quantity(12.0), quantity(4.7e-06, 2)
        ('36.7126', '12', '4.7e-06')
    """
    return f"{value:.{digits}g}"


def duration(seconds: float) -> str:
    """Return a duration with its unit, in ASCII.

    Example:
        >>> duration(6e-6), duration(0.0333), duration(2.5), duration(600.0)
        ('less than 1 ms', '33.3 ms', '2.5 s', '10 min')
    """
    if not math.isfinite(seconds):
        return "an unknown time"
    if seconds < _MILLI:
        return "less than 1 ms"
    if seconds < _SHORT_S:
        return f"{quantity(1e3 * seconds, 3)} ms"
    if seconds < _LONG_S:
        return f"{quantity(seconds, 3)} s"
    return f"{quantity(seconds / _MINUTE_S, 3)} min"


def label_of(name: str, unit: str | None = None) -> tuple[str, str]:
    """Return a name in words, and its unit.

    Args:
        name: Name as in a record, with or without a unit at its end.
        unit: Unit that the scenario states; the name then stays as it is. None means
            that the unit is read from the name's end.

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


def with_unit(name: str, unit: str) -> str:
    """Return a name with its unit in brackets, or alone if the unit is empty.

    Example:
        >>> with_unit("angle", "rad"), with_unit("step", "")
        ('angle [rad]', 'step')
    """
    return f"{name} [{unit}]" if unit else name


def unit_of_measure(name: str, meaning: str) -> str:
    """Return the unit of a measure, from the end of its name or else of its meaning.

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


def typeset_duration(seconds: float) -> str:
    """Return a duration with its unit, from microseconds to hours.

    Example:
        >>> typeset_duration(0.0123), typeset_duration(2.5), typeset_duration(600.0)
        ('12.3 ms', '2.5 s', '10 min')
    """
    # Below so many seconds -> length of the unit [s], the unit.
    steps: tuple[tuple[float, float, str], ...] = (
        (1e-3, 1e-6, "µs"), (1.0, 1e-3, "ms"), (120.0, 1.0, "s"), (7200.0, 60.0, "min"),
    )  # fmt: skip
    if not math.isfinite(seconds):
        return "an unknown time"
    size, unit = next(((s, u) for most, s, u in steps if seconds < most), (3600.0, "h"))
    return f"{seconds / size:.3g} {unit}"
