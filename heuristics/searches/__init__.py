"""The searches, each a file with its settings, its state and its two kernels.

`arguments.py` lists them, and reads the arguments in which a user names one.
"""

from swarmstart.heuristics.searches.de import (
    F_MAX,
)

__all__ = [
    "F_MAX",
]
