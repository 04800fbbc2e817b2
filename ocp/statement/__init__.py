"""The problem as stated, and its rewrites to a core that all solvers share.

Shapes of controls, further decisions, phases and ensembles are each one module; each
feature that a core does not have is a file of rewrites/.
"""

from swarmstart.ocp.statement.control_shape import (
    ControlShape,
    Profile,
    piece_at,
)
from swarmstart.ocp.statement.feature import (
    Feature,
)
from swarmstart.ocp.statement.guesses import (
    Appended,
)
from swarmstart.ocp.statement.phases import (
    CLOCK,
    COUNTER,
    Phases,
)
from swarmstart.ocp.statement.problem import (
    Quadrature,
)
from swarmstart.ocp.statement.rewrites.chain import (
    FEATURES,
    Lowered,
    has_decisions,
    lowered,
)
from swarmstart.ocp.statement.rewrites.end_time import (
    END_TIME,
)
from swarmstart.ocp.statement.rewrites.held import (
    held_signals,
)
from swarmstart.ocp.statement.risk import (
    Measure,
)

__all__ = [
    "CLOCK",
    "COUNTER",
    "END_TIME",
    "FEATURES",
    "Appended",
    "ControlShape",
    "Feature",
    "Lowered",
    "Measure",
    "Phases",
    "Profile",
    "Quadrature",
    "has_decisions",
    "held_signals",
    "lowered",
    "piece_at",
]
