"""Names of the searches on arrays. The searches are registered only here.

Nothing is imported here, so that `swarmstart list` and `--help` stay quick.
"""

from typing import NamedTuple


class SearchEntry(NamedTuple):
    """A search as scenarios and the command line know it.

    Attributes:
        title: Description in a few words.
        settings: "module:class" of its settings; empty if it has none.
        warm_start: Default of the part of the first population that is made from the
            last plan: "one", "all" or "none".
        sampling: Default of the method of drawing the rest; None means the default of
            `Initial`.
    """

    title: str
    settings: str
    warm_start: str = "one"
    sampling: str | None = None


SEARCH_GROUP = "swarmstart.searches"
"""Group of entry points in which another package announces a search of its own."""
_HERE = "swarmstart.heuristics.searches"
SEARCHES = {
    "cpso": SearchEntry(
        "chaotic particle swarm (5.17)-(5.19)",
        f"{_HERE}.chaotic_pso:ChaoticPSO",
        "all",
        "uniform",
    ),
    "pso": SearchEntry("standard particle swarm", f"{_HERE}.pso:ParticleSwarm", "all"),
    "de": SearchEntry("differential evolution", f"{_HERE}.de:DifferentialEvolution"),
    "jde": SearchEntry(
        "differential evolution that adapts its own parameters",
        f"{_HERE}.jde:SelfAdaptiveDE",
    ),
    "lshade": SearchEntry(
        "L-SHADE: adaptive differential evolution of a shrinking population",
        f"{_HERE}.lshade:LSHADE",
    ),
    "ga": SearchEntry(
        "real-coded genetic algorithm, started at random as the chapter's",
        f"{_HERE}.genetic:GeneticAlgorithm",
        "none",
        "uniform",
    ),
    "cma": SearchEntry(
        "covariance matrix adaptation, restarted with twice the population (IPOP)",
        f"{_HERE}.cma:CMAES",
    ),
    "random": SearchEntry("random search", f"{_HERE}.random_search:RandomSearch"),
}
"""Name -> entry of a search of the library; scenarios have the same names."""


def installed_searches() -> dict[str, SearchEntry]:
    """Return the searches of other installed packages, without importing these."""
    from importlib.metadata import entry_points  # Loads sockets and e-mail.

    return {
        point.name: SearchEntry(f"a search of {point.module}", point.value)
        for point in entry_points(group=SEARCH_GROUP)
        if point.name not in SEARCHES
    }
