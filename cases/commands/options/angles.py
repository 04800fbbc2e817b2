"""Warnings about angles of a scenario that look like degrees."""

import math
from collections.abc import Iterator, Mapping
from typing import Any

from swarmstart.cases.commands.terminal.output import say
from swarmstart.cases.drawing.naming.quantities import quantity
from swarmstart.cases.drawing.naming.wording import is_number
from swarmstart.cases.format.document import printable

ENDING = "_rad"
"""End of the names of keys whose values are angles [rad]."""


def warn_of_angles(settings: Mapping[str, Any]) -> None:
    """Print a warning on standard error for each angle that looks like degrees.

    Args:
        settings: The resolved scenario as plain data.
    """
    for warning in angle_warnings(settings):
        say(f"warning: {warning}")


def angle_warnings(settings: Mapping[str, Any]) -> list[str]:
    """Return a warning for each angle of more than a full turn in round numbers.

    Headings can lie beyond a full turn, as 11*pi/5 does for a UAV that turns left; but
    such values are no multiples of a half, as degrees mostly are.

    Example:
        >>> angle_warnings({"heading_rad": 90.0})[0]
        'heading_rad = 90 is more than a full turn; is it in degrees? radians(90)'
    """
    return [
        f"{printable(name)} = {quantity(value)} is more than a full turn; is it in "
        f"degrees? radians({quantity(value)})"
        for name, value in _angles(settings, "", is_angle=False)
        if abs(value) > 2 * math.pi and (2 * value).is_integer()
    ]


def _angles(part: Any, name: str, *, is_angle: bool) -> Iterator[tuple[str, float]]:
    """Yield the dotted name and the value of each number below an angle's key."""
    if isinstance(part, Mapping):
        for key, inner in part.items():
            dotted = f"{name}.{key}" if name else str(key)
            yield from _angles(inner, dotted, is_angle=str(key).endswith(ENDING))
    elif isinstance(part, list):
        for place, inner in enumerate(part):
            yield from _angles(inner, f"{name}.{place}", is_angle=is_angle)
    elif is_angle and is_number(part):
        yield name, float(part)
