"""Numbers in the sentences that commands print, in ASCII."""

import math

KEPT = 1e-6
"""An excess over a constraint up to this is rounding."""
_MILLI = 1e-3
_SHORT_S, _LONG_S = 1.0, 120.0
_MINUTE_S = 60.0


def quantity(value: float, digits: int = 6) -> str:
    """Return a number with a few significant digits.

    Example:
        >>> quantity(36.712599), quantity(12.0), quantity(4.7e-06, 2)
        ('36.7126', '12', '4.7e-06')
    """
    return f"{value:.{digits}g}"


def duration(seconds: float) -> str:
    """Return a duration with its unit.

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


def plural(count: int, thing: str) -> str:
    """Return a number of things.

    Example:
        >>> plural(1, "step"), plural(48, "step")
        ('1 step', '48 steps')
    """
    return f"{count} {thing}{'' if count == 1 else 's'}"
