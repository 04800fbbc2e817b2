"""Numbers and missing numbers in words, alike in pages, Markdown and LaTeX."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

NOT_FEASIBLE = "not feasible"
NEVER = "never"
NOT_COMPARED = "not compared"
NOT_MEASURED = "not measured"

_DIGITS = 5


def is_number(value: object) -> bool:
    """Return whether this is a finite number."""
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and math.isfinite(value)
    )


def number_of(value: Any) -> float:
    """Return a measure as a number; NaN if it is undefined."""
    return float(value) if is_number(value) else math.nan


def number(value: object, missing: str = NOT_MEASURED, *, digits: int = _DIGITS) -> str:
    """Return a number in a few significant digits, or the word for a missing one.

    Args:
        value: The number; None if it is missing.
        missing: The word for a missing or not finite one.
        digits: Significant digits.

    Example:
        >>> number(455.11134), number(3.0), number(123456.0), number(None, "never")
        ('455.11', '3', '123456', 'never')
    """
    if not is_number(value):
        return missing
    given = float(value)  # type: ignore[arg-type]
    if given == int(given) and abs(given) < 10 ** (digits + 2):
        return str(int(given))
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


def counted(count: int, thing: str) -> str:
    """Return a number of things.

    Example:
        >>> counted(1, "seed"), counted(3, "seed")
        ('1 seed', '3 seeds')
    """
    return f"{count} {thing}{'' if count == 1 else 's'}"


def median(values: Sequence[Any]) -> float | None:
    """Return the median of those that are numbers; None if there are none."""
    return quantile(values, 0.5)


def quantile(values: Sequence[Any], share: float) -> float | None:
    """Return a quantile of those that are numbers, linear between them."""
    found = sorted(value for value in values if is_number(value))
    if not found:
        return None
    place = share * (len(found) - 1)
    low = math.floor(place)
    high = min(low + 1, len(found) - 1)
    part = place - low
    # Not low + part * (high - low): a difference of two huge numbers overflows.
    return float((1 - part) * found[low] + part * found[high])


def shown(cost: object, sense: object) -> float | None:
    """Return a cost as the user states it: a value that is maximised has its sign back.

    Example:
        >>> shown(-3.0, -1), shown(3.0, 1), shown(None, 1)
        (3.0, 3.0, None)
    """
    if not is_number(cost):
        return None
    value = float(cost)  # type: ignore[arg-type]
    return (-value if sense == -1 else value) + 0.0  # No "-0".


def rate(row: Mapping[str, Any], place: int = 0) -> float | None:
    """Return the share of a row's runs that are near the best known cost."""
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
