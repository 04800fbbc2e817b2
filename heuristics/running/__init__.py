"""Running a search: budgets, the loops that drive its kernels, results, interrupts.

`minimize` runs a whole search in one call; `Search` runs it one generation at a time
(ask and tell).
"""

from swarmstart.heuristics.running.first_use import (
    kernels_ahead,
)
from swarmstart.heuristics.running.interrupts import (
    heeded,
    put_off,
)
from swarmstart.heuristics.running.memetic import (
    Improved,
    LocalSolves,
    run_memetic,
)
from swarmstart.heuristics.running.result import (
    StopReason,
    locked,
)
from swarmstart.heuristics.running.search import (
    Individual,
    Search,
)

__all__ = [
    "Improved",
    "Individual",
    "LocalSolves",
    "Search",
    "StopReason",
    "heeded",
    "kernels_ahead",
    "locked",
    "put_off",
    "run_memetic",
]
