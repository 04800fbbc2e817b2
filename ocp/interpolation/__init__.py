"""Tables and splines in expressions, and smooth forms of switches."""

from swarmstart.ocp.interpolation.tables import (
    Beyond,
    Method,
    Table,
    table,
)

__all__ = [
    "Beyond",
    "Method",
    "Table",
    "table",
]
