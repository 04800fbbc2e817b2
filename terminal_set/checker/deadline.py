"""A time by which all work ends, looked at from within long evaluations."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass


class TimeIsUpError(Exception):
    """The deadline has passed."""


@dataclass(frozen=True, slots=True)
class Deadline:
    """A time by which work is to end.

    Attributes:
        at: That time, of `time.monotonic` [s].
    """

    at: float

    @classmethod
    def after(cls, seconds: float) -> Deadline:
        """Return the deadline so many seconds from now."""
        return cls(time.monotonic() + seconds)

    @property
    def has_passed(self) -> bool:
        """Return whether it is later."""
        return time.monotonic() > self.at

    def check(self) -> None:
        """Look at the clock.

        Raises:
            TimeIsUpError: If it is later.
        """
        if self.has_passed:
            raise TimeIsUpError


NEVER = Deadline(math.inf)
