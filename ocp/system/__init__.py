"""The system: a model and its forms, algebraic equations, constraints, python-control.

A model holds names, symbols and equations; it knows no horizon and no cost.
"""

from swarmstart.ocp.system.constraints import (
    MOVING,
    MovingLimit,
    Rows,
    row_excess,
)
from swarmstart.ocp.system.model import shown_units
from swarmstart.ocp.system.units import read_unit, warn_of_units

__all__ = [
    "MOVING",
    "MovingLimit",
    "Rows",
    "read_unit",
    "row_excess",
    "shown_units",
    "warn_of_units",
]
