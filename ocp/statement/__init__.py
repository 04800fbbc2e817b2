"""The problem as stated, and its rewrites to a core that all solvers share.

Shapes of controls, further decisions, phases and ensembles are each one module.
"""

from swarmstart.ocp.statement.control_shape import (
    ControlShape,
    Profile,
    piece_at,
)
from swarmstart.ocp.statement.core_problem import (
    END_TIME,
)
from swarmstart.ocp.statement.lowering import (
    Appended,
    Lowered,
    has_decisions,
    lowered,
)
from swarmstart.ocp.statement.phases import (
    CLOCK,
    COUNTER,
    Phases,
)
from swarmstart.ocp.statement.problem import (
    Quadrature,
)
from swarmstart.ocp.statement.risk import (
    Measure,
)

__all__ = [
    "CLOCK",
    "COUNTER",
    "END_TIME",
    "Appended",
    "ControlShape",
    "Lowered",
    "Measure",
    "Phases",
    "Profile",
    "Quadrature",
    "has_decisions",
    "lowered",
    "piece_at",
]
