"""Lengths of time on the command line and in plans: 120s, 2m, 1h, 120."""

import math
import re

from swarmstart.errors import SwarmstartError

UNITS = {"s": 1, "m": 60, "h": 3600}
"""Names of units -> seconds."""
_DURATION = re.compile(r"(?P<number>[0-9.]+(?:e[0-9]+)?) *(?P<unit>[smh]?)")
_LONGEST_S = 1e9


class InvalidDurationError(SwarmstartError, ValueError):
    """A text is not a length of time."""


def seconds_of(text: str) -> float:
    """Return a length of time [s].

    Args:
        text: "120s", "2m", "1h"; a number alone is seconds.

    Raises:
        InvalidDurationError: If it is anything else, 0, or above 10^9 seconds.

    Example:
        >>> seconds_of("2m"), seconds_of("0.5")
        (120.0, 0.5)
    """
    match = _DURATION.fullmatch(text.strip())
    try:
        seconds = float(match["number"]) * UNITS[match["unit"] or "s"] if match else 0.0
    except ValueError:  # Two points.
        seconds = 0.0
    if not 0.0 < seconds <= _LONGEST_S or not math.isfinite(seconds):
        raise InvalidDurationError(
            f"expected a length of time such as 120s, 2m or 1h, found {text!r}"
        )
    return seconds
