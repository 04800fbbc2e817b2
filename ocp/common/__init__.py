"""Common ground of `ocp`: errors, limits, expressions, presentation."""

from swarmstart.ocp.common.expressions import (
    symbol_names,
)
from swarmstart.ocp.common.limits import (
    require_seconds,
)
from swarmstart.ocp.common.presentation import (
    ProgressCallback,
    tell_nothing,
)

__all__ = [
    "ProgressCallback",
    "require_seconds",
    "symbol_names",
    "tell_nothing",
]
