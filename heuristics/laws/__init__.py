"""Laws that all searches share: the box, the order of points, sampling, and descent.

A search is settings, a state and two kernels (`algorithm.py`); these are written in
terms of what is here.
"""

from swarmstart.heuristics.laws.algorithm import (
    first_size_of,
    require,
)
from swarmstart.heuristics.laws.box import (
    Box,
)
from swarmstart.heuristics.laws.descent import (
    DescentOptions,
    descend,
)
from swarmstart.heuristics.laws.order import (
    STATIC_PENALTY,
)

__all__ = [
    "STATIC_PENALTY",
    "Box",
    "DescentOptions",
    "descend",
    "first_size_of",
    "require",
]
