"""The problem as an NLP: transcription, multipliers, and the polish by an NLP solver.

A polish begins at a `Start` and ends with a status, never with an error.
"""

from swarmstart.ocp.nlp.multipliers import (
    Duals,
    Multipliers,
    duals_of,
    multipliers_of,
)
from swarmstart.ocp.nlp.polish import (
    Polisher,
    is_better,
)
from swarmstart.ocp.nlp.polish_options import (
    DEAF,
    PolishOptions,
    check_solver,
    has_solver,
)
from swarmstart.ocp.nlp.start import (
    Start,
)
from swarmstart.ocp.nlp.watching import (
    Answer,
    Ratios,
    Relay,
    Unwatched,
    Value,
    Watch,
    Work,
)

__all__ = [
    "DEAF",
    "Answer",
    "Duals",
    "Multipliers",
    "PolishOptions",
    "Polisher",
    "Ratios",
    "Relay",
    "Start",
    "Unwatched",
    "Value",
    "Watch",
    "Work",
    "check_solver",
    "duals_of",
    "has_solver",
    "is_better",
    "multipliers_of",
]
