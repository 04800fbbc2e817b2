"""Findings of the checker, one for each statement, and the deadline of its work."""

from __future__ import annotations

import enum
import math
import time
from dataclasses import dataclass


class Verdict(enum.Enum):
    """The verdict on a statement; the value is the word printed."""

    PROVED = "re-proved"
    SAMPLED = "sampled only"
    SKIPPED = "not claimed"
    REFUSED = "refused"
    UNDECIDED = "undecided"


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the report.

    Attributes:
        verdict: The verdict on the statement.
        text: The statement, with the numbers.
        subject: Subject of a statement that was only sampled, as the last line of the
            report names it; empty for any other statement.
    """

    verdict: Verdict
    text: str
    subject: str = ""


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
        # Not the time of day, which may be set.
        return cls(time.monotonic() + seconds)

    @property
    def has_passed(self) -> bool:
        """Return whether the time has passed."""
        return time.monotonic() > self.at

    def check(self) -> None:
        """Raise an error if the time has passed.

        Raises:
            TimeIsUpError: If the time has passed.
        """
        if self.has_passed:
            raise TimeIsUpError


NEVER = Deadline(math.inf)
