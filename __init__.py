"""swarmstart: warm starts for nonlinear optimal control by population search.

Public names are imported when first used, so that the command line stays quick.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from swarmstart.errors import SwarmstartError
    from swarmstart.heuristics import (
        CMAES,
        LSHADE,
        Box,
        Budget,
        ChaoticPSO,
        DifferentialEvolution,
        GeneticAlgorithm,
        ParticleSwarm,
        RandomSearch,
        SearchInterrupted,
        SelfAdaptiveDE,
        default_order,
        epsilon_level,
        feasibility_first,
        minimize,
        static_penalty,
    )
    from swarmstart.ocp import (
        Agent,
        Bounds,
        Connection,
        DualMode,
        IpoptOptions,
        Model,
        NlpOptions,
        OptimalControlProblem,
        PathConstraint,
        Planner,
        Plant,
        RecedingHorizon,
        SearchSettings,
        Separation,
        Solution,
        SolutionStatus,
        SolveInterrupted,
        Team,
        TerminalConstraint,
        Trajectory,
        compile_batch,
        disc,
        multistart,
        simulate,
        solve,
        terminal_set_of,
    )
    from swarmstart.terminal_set import (
        ProofOptions,
        Reference,
        TerminalSet,
        Weights,
        certify,
        sampled_terminal_set,
    )

__version__ = "0.1.0"

__all__ = [
    "CMAES",
    "LSHADE",
    "Agent",
    "Bounds",
    "Box",
    "Budget",
    "ChaoticPSO",
    "Connection",
    "DifferentialEvolution",
    "DualMode",
    "GeneticAlgorithm",
    "IpoptOptions",
    "Model",
    "NlpOptions",
    "OptimalControlProblem",
    "ParticleSwarm",
    "PathConstraint",
    "Planner",
    "Plant",
    "ProofOptions",
    "RandomSearch",
    "RecedingHorizon",
    "Reference",
    "SearchInterrupted",
    "SearchSettings",
    "SelfAdaptiveDE",
    "Separation",
    "Solution",
    "SolutionStatus",
    "SolveInterrupted",
    "SwarmstartError",
    "Team",
    "TerminalConstraint",
    "TerminalSet",
    "Trajectory",
    "Weights",
    "certify",
    "compile_batch",
    "default_order",
    "disc",
    "epsilon_level",
    "feasibility_first",
    "minimize",
    "multistart",
    "sampled_terminal_set",
    "simulate",
    "solve",
    "static_penalty",
    "terminal_set_of",
]

_HOMES = (
    "swarmstart.errors",
    "swarmstart.ocp",
    "swarmstart.heuristics",
    "swarmstart.terminal_set",
)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name in __all__:
        for home in map(importlib.import_module, _HOMES):
            if hasattr(home, name):
                return getattr(home, name)
    raise AttributeError(f"module 'swarmstart' has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the public names."""
    return sorted([*globals(), *__all__])
