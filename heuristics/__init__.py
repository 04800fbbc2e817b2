"""Population search on arrays: minimises any function over a box.

A population is a float64 array of shape (dim, size): a column is an individual.
"""

from swarmstart.heuristics.algorithm import (
    Algorithm,
    InvalidSettingsError,
    Kernels,
    State,
)
from swarmstart.heuristics.arguments import (
    ALGORITHMS,
    algorithm_of,
    box_of,
    generator_of,
)
from swarmstart.heuristics.box import Box, InvalidBoxError, InvalidPointsError
from swarmstart.heuristics.budget import Budget, InvalidBudgetError, budget_of
from swarmstart.heuristics.chaotic_pso import ChaoticPSO
from swarmstart.heuristics.cma import CMAES
from swarmstart.heuristics.compiled_loop import CompiledObjective, Pointers
from swarmstart.heuristics.de import DifferentialEvolution
from swarmstart.heuristics.default import default_algorithm, default_order
from swarmstart.heuristics.genetic import GeneticAlgorithm
from swarmstart.heuristics.initial import Initial
from swarmstart.heuristics.jde import SelfAdaptiveDE
from swarmstart.heuristics.lshade import LSHADE
from swarmstart.heuristics.minimize import Objective, minimize, run
from swarmstart.heuristics.order import (
    InvalidOrderError,
    Order,
    epsilon_level,
    feasibility_first,
    static_penalty,
)
from swarmstart.heuristics.pso import ParticleSwarm
from swarmstart.heuristics.random_search import RandomSearch
from swarmstart.heuristics.result import (
    GenerationEvent,
    SearchInterrupted,
    SearchResult,
    StopReason,
)
from swarmstart.heuristics.sampling import Sampling
from swarmstart.heuristics.search import (
    AskTellError,
    Individual,
    InvalidEvaluationError,
    InvalidSnapshotError,
    Search,
    Snapshot,
)

__all__ = [
    "ALGORITHMS",
    "CMAES",
    "LSHADE",
    "Algorithm",
    "AskTellError",
    "Box",
    "Budget",
    "ChaoticPSO",
    "CompiledObjective",
    "DifferentialEvolution",
    "GenerationEvent",
    "GeneticAlgorithm",
    "Individual",
    "Initial",
    "InvalidBoxError",
    "InvalidBudgetError",
    "InvalidEvaluationError",
    "InvalidOrderError",
    "InvalidPointsError",
    "InvalidSettingsError",
    "InvalidSnapshotError",
    "Kernels",
    "Objective",
    "Order",
    "ParticleSwarm",
    "Pointers",
    "RandomSearch",
    "Sampling",
    "Search",
    "SearchInterrupted",
    "SearchResult",
    "SelfAdaptiveDE",
    "Snapshot",
    "State",
    "StopReason",
    "algorithm_of",
    "box_of",
    "budget_of",
    "default_algorithm",
    "default_order",
    "epsilon_level",
    "feasibility_first",
    "generator_of",
    "minimize",
    "run",
    "static_penalty",
]
