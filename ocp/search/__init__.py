"""Search for starts: the space of decisions, population searches, lanes, many starts.

`account.py` has the report on the starts: which start led to which answer, and the
effort.
"""

from swarmstart.ocp.search.account import (
    StartsAccount,
)
from swarmstart.ocp.search.many_starts import (
    LANES,
)
from swarmstart.ocp.search.search_space import (
    SearchSpace,
    space_of,
)
from swarmstart.ocp.search.settings import (
    SearchGiven,
    search_settings,
)

__all__ = [
    "LANES",
    "SearchGiven",
    "SearchSpace",
    "StartsAccount",
    "search_settings",
    "space_of",
]
