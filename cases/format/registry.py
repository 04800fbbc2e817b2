"""Registries of names in scenarios: "module:attribute" strings, imported when used.

Nothing heavy is imported here, so that `swarmstart list` and `--help` stay quick.
"""

from importlib.metadata import entry_points
from pkgutil import resolve_name

from swarmstart.cases.format.kind_words import KindWords
from swarmstart.heuristics import SEARCHES as OF_ARRAYS
from swarmstart.heuristics import SearchEntry, installed_searches

SEARCHES = {
    "default": SearchEntry("the default of the library for the budget", ""),
    **OF_ARRAYS,
    "memetic": SearchEntry(
        "L-SHADE whose best members are improved by local solves in lanes",
        "swarmstart.ocp:Memetic",
    ),
    "multistart": SearchEntry(
        "local solves in lanes from random starts, until little is left unseen",
        "swarmstart.ocp:Multistart",
    ),
    "none": SearchEntry("no search: the polish alone", ""),
}
"""Name -> entry of a search; those on arrays are registered in `heuristics`."""
SEARCHES |= {
    name: entry for name, entry in installed_searches().items() if name not in SEARCHES
}

POLISHES = {
    "ipopt": "IPOPT on multiple shooting, from the search's answer",
    "none": "no polish",
}


def _installed() -> dict[str, str]:
    """Return the kinds of other installed packages: name -> "module:WORDS"."""
    return {point.name: point.value for point in entry_points(group=KIND_GROUP)}


KIND_GROUP = "swarmstart.kinds"
"""Group of entry points in which another package announces a kind of its own."""
_KINDS = "swarmstart.cases.kinds"
KINDS = {
    "problem": f"{_KINDS}.problem.stated.names:WORDS",
    "python": f"{_KINDS}.python.names:WORDS",
    "formation_flight": f"{_KINDS}.formation_flight.names:WORDS",
    "close_formation": f"{_KINDS}.close_formation.names:WORDS",
    "reconfiguration": f"{_KINDS}.reconfiguration.names:WORDS",
    "transfer": f"{_KINDS}.transfer.names:WORDS",
}
"""Name of a kind -> "module:WORDS" of its `KindWords`; its only registration."""
KINDS |= {name: words for name, words in _installed().items() if name not in KINDS}


def words_of(kind: object) -> KindWords:
    """Return the words of a kind; those of an unknown kind, as in a record, are empty.

    Args:
        kind: A key of KINDS, or what a file has in its place.
    """
    if not isinstance(kind, str) or kind not in KINDS:
        return KindWords()
    words: KindWords = resolve_name(KINDS[kind])
    return words
