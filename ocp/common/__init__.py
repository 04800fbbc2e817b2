"""Common ground of `ocp`: errors, limits, expressions, units, progress."""

from swarmstart.ocp.common.expressions import (
    symbol_names,
)
from swarmstart.ocp.common.limits import (
    require_seconds,
)
from swarmstart.ocp.common.profile import (
    Profile,
    piece_at,
)
from swarmstart.ocp.common.progress import (
    ProgressCallback,
    tell_nothing,
)

__all__ = [
    "Profile",
    "ProgressCallback",
    "piece_at",
    "require_seconds",
    "symbol_names",
    "tell_nothing",
]
