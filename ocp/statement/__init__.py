"""The problem as stated, and its rewrites to a core that all solvers share.

Free end times, decided parameters, phases, ensembles and blocks are each one module.
"""

from swarmstart.ocp.statement.control_shape import (
    ControlShape,
)
from swarmstart.ocp.statement.core_problem import (
    END_TIME,
)
from swarmstart.ocp.statement.guess import (
    Appended,
)
from swarmstart.ocp.statement.lowering import (
    Lowered,
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
    "Quadrature",
    "lowered",
]
