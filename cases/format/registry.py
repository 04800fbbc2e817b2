"""Registries of names in scenarios: "module:attribute" strings, imported when used.

Nothing heavy is imported here, so that `swarmstart list` and `--help` stay quick.
"""

from typing import NamedTuple


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


class KindEntry(NamedTuple):
    """A kind of scenario as the registry knows it.

    Attributes:
        kind: "module:attribute" of its Kind.
        measures: "module:attribute" of its measures: name -> meaning.
    """

    kind: str
    measures: str


KINDS = {
    "problem": KindEntry(
        "swarmstart.cases.kinds.problem.kind:KIND",
        "swarmstart.cases.kinds.problem.stated.names:MEASURES",
    ),
    "python": KindEntry(
        "swarmstart.cases.kinds.python.kind:KIND",
        "swarmstart.cases.kinds.problem.stated.names:MEASURES",
    ),
    "formation_flight": KindEntry(
        "swarmstart.cases.kinds.formation_flight.kind:KIND",
        "swarmstart.cases.kinds.formation_flight.names:MEASURES",
    ),
    "close_formation": KindEntry(
        "swarmstart.cases.kinds.close_formation.kind:KIND",
        "swarmstart.cases.kinds.close_formation.names:MEASURES",
    ),
    "reconfiguration": KindEntry(
        "swarmstart.cases.kinds.reconfiguration.kind:KIND",
        "swarmstart.cases.kinds.reconfiguration.names:MEASURES",
    ),
    "transfer": KindEntry(
        "swarmstart.cases.kinds.transfer.kind:KIND",
        "swarmstart.cases.kinds.transfer.names:MEASURES",
    ),
}
