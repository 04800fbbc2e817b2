"""Searches of other libraries behind our objective, box and order; for comparisons.

The one place in `heuristics` that imports them, each in the function that needs it.
"""

from swarmstart.heuristics.adapters.peer import (
    MissingPeerError,
    PeerResult,
    UnsupportedOrderError,
)
from swarmstart.heuristics.adapters.pygmo_search import PygmoAlgorithm, pygmo_search
from swarmstart.heuristics.adapters.scipy_de import scipy_de

__all__ = [
    "MissingPeerError",
    "PeerResult",
    "PygmoAlgorithm",
    "UnsupportedOrderError",
    "pygmo_search",
    "scipy_de",
]
