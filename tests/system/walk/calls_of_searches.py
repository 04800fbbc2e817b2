"""Calls of the walk: the searches."""

from __future__ import annotations

from copy import deepcopy

import numpy as np

import swarmstart as ss
from swarmstart import heuristics
from swarmstart.tests.system.walk import made
from swarmstart.tests.system.walk.wrong_values import (
    Call,
    Calls,
    record,
    with_defaults,
)

SEARCHES = (
    "CMAES LSHADE ChaoticPSO DifferentialEvolution GeneticAlgorithm ParticleSwarm "
    "RandomSearch SelfAdaptiveDE"
).split()


def calls() -> Calls:
    """Return the calls by name, each with valid arguments by name."""
    return {**_searches(), **_running(), **_arguments(), **_records()}


def _searches() -> Calls:
    found: Calls = {}
    for name in SEARCHES:
        kind = getattr(ss, name)
        found[name] = with_defaults(kind)
    found["LSHADE.as_published"] = Call(ss.LSHADE.as_published, {"dim": 2})
    found["ParticleSwarm.constricted"] = with_defaults(ss.ParticleSwarm.constricted)
    return found


def _running() -> Calls:
    def tell(**given: object) -> None:
        search = made.search()
        search.ask()
        search.tell(**given)  # type: ignore[arg-type]

    cost = np.zeros(4)
    return {
        "Search": with_defaults(
            ss.Search, algorithm=ss.RandomSearch(), box=made.box(), rng=made.rng()
        ),
        "Search.ask": Call(
            lambda **given: made.search().ask(**given),
            {"progress": None, "suggested": None},
        ),
        "Search.tell": Call(tell, {"cost": cost, "violation": cost}),
        "minimize": with_defaults(
            ss.minimize,
            objective=lambda x: x[0],
            box=made.box(),
            budget=20,
            algorithm="random",
            seed=0,
        ),
        "run of a search": Call(
            lambda search, **given: heuristics.run(deepcopy(search), **given),
            {
                "search": made.search(),
                "objective": lambda x: x[0],
                "budget": 20,
                "on_generation": None,
                "on_advance": None,
                "on_best": None,
            },
            target=heuristics.run,
        ),
    }


def _arguments() -> Calls:
    return {
        "Box": with_defaults(ss.Box, lower=-np.ones(2), upper=np.ones(2)),
        "Box.contains": Call(made.box().contains, {"points": np.zeros((2, 3))}),
        "Budget": with_defaults(ss.Budget, evaluations=20),
        "Initial": with_defaults(ss.Initial),
        "static_penalty": Call(ss.static_penalty, {"weight": 1.0}),
        "feasibility_first": with_defaults(ss.feasibility_first),
        "epsilon_level": with_defaults(ss.epsilon_level),
        "default_order": with_defaults(ss.default_order),
        "default_algorithm": Call(ss.default_algorithm, {"evaluations": 300}),
        "is_algorithm": Call(heuristics.is_algorithm, {"given": ss.LSHADE()}),
        "algorithm_of": Call(
            heuristics.algorithm_of, {"given": "lshade", "evaluations": None}
        ),
        "box_of": Call(heuristics.box_of, {"given": None, "bounds": [(-1, 1)]}),
        "budget_of": Call(heuristics.budget_of, {"given": 20}),
        "generator_of": Call(heuristics.generator_of, {"rng": None, "seed": 0}),
        "Order": record(ss.default_order()),
        "SearchEntry": record(heuristics.SEARCHES["lshade"]),
    }


def _records() -> Calls:
    found = made.search_result()
    kernels = ss.LSHADE().kernels
    return {
        "SearchResult": record(found),
        "GenerationEvent": record(made.generation()),
        "Individual": Call(
            heuristics.Individual, {"x": np.zeros(2), "cost": 0.0, "violation": 0.0}
        ),
        "Kernels": Call(heuristics.Kernels, kernels._asdict()),
        "Pointers": Call(
            heuristics.Pointers, {"function": 1, "inputs": None, "outputs": None}
        ),
    }
