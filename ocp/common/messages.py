"""Addresses of the paragraphs that explain messages, all on one page of the docs.

Each status that is not plainly good, each reason and each warning ends with the address
of a paragraph, which gives the cause and says what to do.
"""

from enum import Enum

PAGE = "docs/messages.md"


class Paragraph(Enum):
    """A paragraph that explains a message, on one page of the docs (docs/messages.md).

    The value of a member is the paragraph's anchor; `str` gives its address.
    """

    FEASIBLE = "feasible"
    NOT_POLISHED = "not-polished"
    POLISH_LIMIT = "polish-limit"
    POLISH_INFEASIBLE = "polish-infeasible"
    POLISH_BROKE_OFF = "polish-broke-off"
    POLISH_WORSE = "polish-worse"
    NOT_STATIONARY = "not-stationary"
    SADDLE = "saddle"
    FLAT = "flat"
    KINK = "kink"
    WHOLE_NUMBERS = "whole-numbers"
    BETWEEN_CHECKS = "between-checks"
    FINER_GRID = "finer-grid"
    EDGE = "edge"
    NOT_FINITE = "not-finite"
    INFEASIBLE = "infeasible"
    INVALID_DATA = "invalid-data"
    STOPPED = "stopped"
    NO_STEP = "no-step"
    SOME_STEPS = "some-steps"
    WITHIN = "within"
    NOT_CERTIFIED = "not-certified"
    OTHER_SYSTEM = "other-system"
    OFF_PLAN = "off-plan"
    BROKEN_RUN = "broken-run"
    CASADI = "casadi"
    MORE_STATES = "more-states"
    UNITS = "units"
    RAMP = "ramp"
    DEGREES = "degrees"
    RENAMED = "renamed"

    def __str__(self) -> str:
        """Return the address."""
        return f"{PAGE}#{self.value}"
