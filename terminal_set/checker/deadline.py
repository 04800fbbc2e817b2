"""A time by which all work must end, checked within long evaluations."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass


class TimeIsUpError(Exception):
    """The deadline has passed."""


@dataclass(frozen=True, slots=True)
class Deadline:
    """A time by which work must end.

    Attributes:
        at: The time, of `time.monotonic` [s].
    """

    at: float

    @classmethod
    def after(cls, seconds: float) -> Deadline:
        """Return the deadline some seconds from now."""
        return cls(time.monotonic() + seconds)

    @property
    def has_passed(self) -> bool:
        """Return whether the time has passed."""
        return time.monotonic() > self.at

    def check(self) -> None:
        """Check the clock.

        Raises:
            TimeIsUpError: If the time has passed.
        """
        if self.has_passed:
            raise TimeIsUpError


NEVER = Deadline(math.inf)
