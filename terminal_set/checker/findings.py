"""Findings of the checker: one for each statement of a certificate."""

from __future__ import annotations

import enum
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
    """

    verdict: Verdict
    text: str
