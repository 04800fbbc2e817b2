"""Population search on arrays: minimises any function over a box.

A population is a float64 array of shape (dim, size): a column is an individual.
"""

# ruff: noqa: I001  (it would write one statement for each name)
from typing import TYPE_CHECKING

from swarmstart.doors import door

if TYPE_CHECKING:  # Loaded when first used: searches need Numba, their names do not.
    from swarmstart.heuristics.laws.algorithm import (
        Algorithm as Algorithm,
        InvalidSettingsError as InvalidSettingsError,
        Kernels as Kernels,
        State as State,
        is_algorithm as is_algorithm,
    )
    from swarmstart.heuristics.laws.box import (
        Box as Box,
        InvalidBoxError as InvalidBoxError,
        InvalidPointsError as InvalidPointsError,
    )
    from swarmstart.heuristics.laws.initial import (
        Initial as Initial,
        Sampling as Sampling,
    )
    from swarmstart.heuristics.laws.order import (
        InvalidOrderError as InvalidOrderError,
        Order as Order,
        epsilon_level as epsilon_level,
        feasibility_first as feasibility_first,
        static_penalty as static_penalty,
    )
    from swarmstart.heuristics.running.budget import (
        Budget as Budget,
        InvalidBudgetError as InvalidBudgetError,
        budget_of as budget_of,
    )
    from swarmstart.heuristics.running.compiled_loop import (
        CompiledObjective as CompiledObjective,
        Pointers as Pointers,
    )
    from swarmstart.heuristics.running.minimize import (
        Objective as Objective,
        minimize as minimize,
        run as run,
    )
    from swarmstart.heuristics.running.result import (
        GenerationEvent as GenerationEvent,
        SearchInterrupted as SearchInterrupted,
        SearchResult as SearchResult,
        StopReason as StopReason,
    )
    from swarmstart.heuristics.running.search import (
        AskTellError as AskTellError,
        Individual as Individual,
        InvalidEvaluationError as InvalidEvaluationError,
        InvalidSnapshotError as InvalidSnapshotError,
        Search as Search,
        Snapshot as Snapshot,
    )
    from swarmstart.heuristics.searches.arguments import (
        ALGORITHMS as ALGORITHMS,
        algorithm_of as algorithm_of,
        box_of as box_of,
        default_algorithm as default_algorithm,
        default_order as default_order,
        generator_of as generator_of,
    )
    from swarmstart.heuristics.searches.chaotic_pso import (
        ChaoticPSO as ChaoticPSO,
    )
    from swarmstart.heuristics.searches.cma import (
        CMAES as CMAES,
    )
    from swarmstart.heuristics.searches.de import (
        F_MAX as F_MAX,
        DifferentialEvolution as DifferentialEvolution,
    )
    from swarmstart.heuristics.searches.genetic import (
        GeneticAlgorithm as GeneticAlgorithm,
    )
    from swarmstart.heuristics.searches.jde import (
        SelfAdaptiveDE as SelfAdaptiveDE,
    )
    from swarmstart.heuristics.searches.lshade import (
        LSHADE as LSHADE,
    )
    from swarmstart.heuristics.searches.names import (
        SEARCHES as SEARCHES,
        SEARCH_GROUP as SEARCH_GROUP,
        SearchEntry as SearchEntry,
        installed_searches as installed_searches,
    )
    from swarmstart.heuristics.searches.pso import (
        ParticleSwarm as ParticleSwarm,
    )
    from swarmstart.heuristics.searches.random_search import (
        RandomSearch as RandomSearch,
    )

_NAMES = {
    "laws.algorithm": "Algorithm InvalidSettingsError Kernels State is_algorithm",
    "laws.box": "Box InvalidBoxError InvalidPointsError",
    "laws.initial": "Initial Sampling",
    "laws.order": """
        InvalidOrderError Order epsilon_level feasibility_first static_penalty
    """,
    "running.budget": "Budget InvalidBudgetError budget_of",
    "running.compiled_loop": "CompiledObjective Pointers",
    "running.minimize": "Objective minimize run",
    "running.result": "GenerationEvent SearchInterrupted SearchResult StopReason",
    "running.search": """
        AskTellError Individual InvalidEvaluationError InvalidSnapshotError
        Search Snapshot
    """,
    "searches.arguments": """
        ALGORITHMS algorithm_of box_of default_algorithm default_order generator_of
    """,
    "searches.chaotic_pso": "ChaoticPSO",
    "searches.cma": "CMAES",
    "searches.de": "DifferentialEvolution F_MAX",
    "searches.genetic": "GeneticAlgorithm",
    "searches.jde": "SelfAdaptiveDE",
    "searches.lshade": "LSHADE",
    "searches.names": "SEARCHES SEARCH_GROUP SearchEntry installed_searches",
    "searches.pso": "ParticleSwarm",
    "searches.random_search": "RandomSearch",
}
_HOMES, __getattr__, __dir__ = door(__name__, _NAMES)
__all__ = list(_HOMES)
