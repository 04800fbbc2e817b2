"""Helpers of all of `ocp`: errors, limits, expressions, pickling, presentation."""

from swarmstart.ocp.common.expressions import (
    symbol_names,
)
from swarmstart.ocp.common.limits import (
    require_seconds,
    shaped,
)
from swarmstart.ocp.common.messages import (
    Paragraph,
)
from swarmstart.ocp.common.presentation import (
    PROGRESS,
    ProgressCallback,
    ProgressGiven,
    hidden,
    is_notebook,
    shown,
    tell_nothing,
)

__all__ = [
    "PROGRESS",
    "Paragraph",
    "ProgressCallback",
    "ProgressGiven",
    "hidden",
    "is_notebook",
    "require_seconds",
    "shaped",
    "shown",
    "symbol_names",
    "tell_nothing",
]
