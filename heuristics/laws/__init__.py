"""Laws that all searches share: the box, the order of points, and sampling.

A search consists of settings, a state and two kernels (`algorithm.py`). The kernels are
written with the functions of this folder.
"""

from swarmstart.heuristics.laws.algorithm import (
    first_size_of,
    require,
)
from swarmstart.heuristics.laws.box import (
    Box,
)
from swarmstart.heuristics.laws.initial import (
    smooth_in,
)
from swarmstart.heuristics.laws.order import (
    STATIC_PENALTY,
)

__all__ = [
    "STATIC_PENALTY",
    "Box",
    "first_size_of",
    "require",
    "smooth_in",
]
