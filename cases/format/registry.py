"""Registries of names in scenarios: "module:attribute" strings, imported when used.

Nothing heavy is imported here, so that `swarmstart list` and `--help` stay quick.
"""

from importlib.metadata import entry_points
from pkgutil import resolve_name
from typing import NamedTuple

from swarmstart.cases.format.kind_words import KindWords


class SearchEntry(NamedTuple):
    """A search as scenarios and the command line know it.

    Attributes:
        title: Description in a few words.
        settings: "module:class" of its settings; empty if it has none.
        warm_start: Part of the first population that is the last plan, by default.
        sampling: Method of drawing the rest, by default; None means that of the
            library.
    """

    title: str
    settings: str
    warm_start: str
    sampling: str | None = None


SEARCHES = {
    "default": SearchEntry("the default of the library for the budget", "", "one"),
    "cpso": SearchEntry(
        "chaotic particle swarm (5.17)-(5.19)",
        "swarmstart.heuristics:ChaoticPSO",
        "all",
        "uniform",
    ),
    "pso": SearchEntry(
        "standard particle swarm", "swarmstart.heuristics:ParticleSwarm", "all"
    ),
    "de": SearchEntry(
        "differential evolution",
        "swarmstart.heuristics:DifferentialEvolution",
        "one",
    ),
    "jde": SearchEntry(
        "differential evolution that adapts its own parameters",
        "swarmstart.heuristics:SelfAdaptiveDE",
        "one",
    ),
    "lshade": SearchEntry(
        "L-SHADE: adaptive differential evolution of a shrinking population",
        "swarmstart.heuristics:LSHADE",
        "one",
    ),
    "ga": SearchEntry(
        "real-coded genetic algorithm, started at random as the chapter's",
        "swarmstart.heuristics:GeneticAlgorithm",
        "none",
        "uniform",
    ),
    "cma": SearchEntry(
        "covariance matrix adaptation, restarted with twice the population (IPOP)",
        "swarmstart.heuristics:CMAES",
        "one",
    ),
    "memetic": SearchEntry(
        "L-SHADE whose best members are improved by local solves in lanes",
        "swarmstart.ocp:Memetic",
        "one",
    ),
    "multistart": SearchEntry(
        "local solves in lanes from random starts, until little is left unseen",
        "swarmstart.ocp:Multistart",
        "one",
    ),
    "random": SearchEntry("random search", "swarmstart.heuristics:RandomSearch", "one"),
    "none": SearchEntry("no search: the polish alone", "", "one"),
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
