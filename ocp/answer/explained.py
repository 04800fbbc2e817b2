"""Paragraphs that explain statuses of answers and their reasons."""

from collections.abc import Mapping
from types import MappingProxyType

from swarmstart.ocp.common.messages import Paragraph
from swarmstart.ocp.nlp.optimality import Curvature
from swarmstart.ocp.nlp.polish_options import PolishStatus
from swarmstart.ocp.rollout.status import SolutionStatus

NOT_POLISHED = "it was searched, not polished"
NOT_STATIONARY = "the polish ended at a point that is not stationary"
AT_KINK = "the path touches a kink or jump of"
WHOLE_NUMBERS = "whole numbers cost"
ON_EDGE = "the answer stands on the edge of"

_STATUSES: Mapping[SolutionStatus, Paragraph | None] = MappingProxyType(
    {
        SolutionStatus.CONVERGED: None,
        SolutionStatus.FEASIBLE: Paragraph.FEASIBLE,
        SolutionStatus.BROKEN: Paragraph.BETWEEN_CHECKS,
        SolutionStatus.MISMATCH: Paragraph.FINER_GRID,
        SolutionStatus.NOT_FINITE: Paragraph.NOT_FINITE,
        SolutionStatus.INFEASIBLE: Paragraph.INFEASIBLE,
        SolutionStatus.INVALID: Paragraph.INVALID_DATA,
        SolutionStatus.NOT_REACHED: Paragraph.STOPPED,
    }
)
REASONS: Mapping[SolutionStatus, Mapping[str, Paragraph]] = MappingProxyType(
    {
        SolutionStatus.FEASIBLE: {
            NOT_POLISHED: Paragraph.NOT_POLISHED,
            PolishStatus.ITERATION_LIMIT.value: Paragraph.POLISH_LIMIT,
            PolishStatus.INFEASIBLE.value: Paragraph.POLISH_INFEASIBLE,
            PolishStatus.NUMERICAL_FAILURE.value: Paragraph.POLISH_BROKE_OFF,
            PolishStatus.WORSE.value: Paragraph.POLISH_WORSE,
            NOT_STATIONARY: Paragraph.NOT_STATIONARY,
            Curvature.NEGATIVE.value: Paragraph.SADDLE,
            Curvature.FLAT.value: Paragraph.FLAT,
            AT_KINK: Paragraph.KINK,
            WHOLE_NUMBERS: Paragraph.WHOLE_NUMBERS,
        },
        SolutionStatus.MISMATCH: {ON_EDGE: Paragraph.EDGE},
    }
)
"""Status -> words of a reason that has a paragraph of its own -> that paragraph."""


def paragraph_of(status: SolutionStatus, reason: str = "") -> Paragraph | None:
    """Return the paragraph that explains a reason, or else a status.

    None for a local optimum, which needs no explanation.
    """
    # A reason can begin with remarks, as on the start, and end with others.
    for words, paragraph in REASONS.get(status, {}).items():
        if words in reason:
            return paragraph
    return _STATUSES[status]


def status_line(status: SolutionStatus) -> str:
    """Return the name, words and paragraph of a status, for a table of counts."""
    paragraph = paragraph_of(status)
    more = "" if paragraph is None else f" (more: {paragraph})"
    return f"{status.name}: {status.value}{more}"
