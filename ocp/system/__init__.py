"""The system: a model and its forms, algebraic equations, constraints, python-control.

A model holds names, symbols and equations; it knows no horizon and no cost.
"""

from swarmstart.ocp.system.constraints import (
    MovingLimit,
    Rows,
    row_excess,
)

__all__ = [
    "MovingLimit",
    "Rows",
    "row_excess",
]
