"""The linear design: K and P by python-control, stability, level and ellipsoid.

All is matrices here; what holds for the nonlinear system is proven in `proving`.
"""

from swarmstart.terminal_set.linear.arrays import (
    bound_array,
    finite_array,
    positive_definite,
)

__all__ = [
    "bound_array",
    "finite_array",
    "positive_definite",
]
