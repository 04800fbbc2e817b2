"""Answers: plans and planners, `solve` with its improvements, repair and verification.

A plan is what a solver found; a `Solution` is a plan that was checked on a finer path.
"""

from swarmstart.ocp.answer.explained import (
    paragraph_of,
    status_line,
)
from swarmstart.ocp.answer.improving import (
    improved,
    repaired,
)
from swarmstart.ocp.answer.plan import (
    Plan,
    Source,
    start_of,
)
from swarmstart.ocp.answer.solving import (
    BoundInterrupted,
    bounded,
)

__all__ = [
    "BoundInterrupted",
    "Plan",
    "Source",
    "bounded",
    "improved",
    "paragraph_of",
    "repaired",
    "start_of",
    "status_line",
]
