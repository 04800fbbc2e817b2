"""The linear design: K and P by python-control, stability, level and ellipsoid.

Everything here concerns the linear system alone; what holds for the nonlinear one is
proven in `proving`.
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
