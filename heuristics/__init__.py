"""Population search on arrays: minimises any function over a box.

A population is a float64 array of shape (dim, size): a column is an individual.
"""

from swarmstart.heuristics.laws.algorithm import (
    Algorithm,
    InvalidSettingsError,
    Kernels,
    State,
)
from swarmstart.heuristics.laws.box import Box, InvalidBoxError, InvalidPointsError
from swarmstart.heuristics.laws.initial import Initial
from swarmstart.heuristics.laws.order import (
    InvalidOrderError,
    Order,
    epsilon_level,
    feasibility_first,
    static_penalty,
)
from swarmstart.heuristics.laws.sampling import Sampling
from swarmstart.heuristics.running.budget import Budget, InvalidBudgetError, budget_of
from swarmstart.heuristics.running.compiled_loop import CompiledObjective, Pointers
from swarmstart.heuristics.running.minimize import Objective, minimize, run
from swarmstart.heuristics.running.result import (
    GenerationEvent,
    SearchInterrupted,
    SearchResult,
    StopReason,
)
from swarmstart.heuristics.running.search import (
    AskTellError,
    Individual,
    InvalidEvaluationError,
    InvalidSnapshotError,
    Search,
    Snapshot,
)
from swarmstart.heuristics.searches.arguments import (
    ALGORITHMS,
    algorithm_of,
    box_of,
    generator_of,
)
from swarmstart.heuristics.searches.chaotic_pso import ChaoticPSO
from swarmstart.heuristics.searches.cma import CMAES
from swarmstart.heuristics.searches.de import DifferentialEvolution
from swarmstart.heuristics.searches.default import default_algorithm, default_order
from swarmstart.heuristics.searches.genetic import GeneticAlgorithm
from swarmstart.heuristics.searches.jde import SelfAdaptiveDE
from swarmstart.heuristics.searches.lshade import LSHADE
from swarmstart.heuristics.searches.pso import ParticleSwarm
from swarmstart.heuristics.searches.random_search import RandomSearch

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
