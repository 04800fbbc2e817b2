"""Searches of other libraries behind our objective, box and order; for comparisons.

Each is imported in the function that needs it.
"""

from swarmstart.benchmarks.adapters.peer import (
    MissingPeerError,
    PeerResult,
    UnsupportedOrderError,
)
from swarmstart.benchmarks.adapters.pygmo_search import PygmoAlgorithm, pygmo_search
from swarmstart.benchmarks.adapters.scipy_de import scipy_de

__all__ = [
    "MissingPeerError",
    "PeerResult",
    "PygmoAlgorithm",
    "UnsupportedOrderError",
    "pygmo_search",
    "scipy_de",
]
