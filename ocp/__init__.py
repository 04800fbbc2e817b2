"""Optimal-control problems: statement, solution, verification and closed loop."""

from swarmstart.ocp.algebraic import AlgebraicEquations
from swarmstart.ocp.closed_loop import Step, Trajectory, collected, fly, simulate
from swarmstart.ocp.compiled.backend import Backend, BackendWarning, chosen_backend
from swarmstart.ocp.compiled.batch import BatchFunction, compile_batch
from swarmstart.ocp.compiled.simd import Prepared
from swarmstart.ocp.constraints import (
    Bounds,
    Constraint,
    PathConstraint,
    Rows,
    TerminalConstraint,
)
from swarmstart.ocp.control_systems import InvalidSystemError, NonMinimalWarning
from swarmstart.ocp.controller import (
    Controller,
    Decision,
    Mode,
    OpenLoop,
    RecedingHorizon,
)
from swarmstart.ocp.dense_output import DenseOutput, interpolate
from swarmstart.ocp.distances import largest_distance, smallest_distance
from swarmstart.ocp.dual_mode import DualMode, UncertifiedSetError
from swarmstart.ocp.ensemble import ensemble
from swarmstart.ocp.errors import DivergedError, InvalidProblemError, SolveError
from swarmstart.ocp.fitness import Fitness, Known
from swarmstart.ocp.free import Free
from swarmstart.ocp.guess import shifted_controls, zero_controls
from swarmstart.ocp.integrators import INTEGRATORS, Integrator, held_step
from swarmstart.ocp.lane_settings import (
    Memetic,
    Multistart,
    SearchAlgorithm,
    population_of,
)
from swarmstart.ocp.local_team import LocalAgent, LocalTeam
from swarmstart.ocp.lower_bound.answer import BoundKind, LowerBound
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.ocp.model import Model, right_hand_side
from swarmstart.ocp.multipliers import Multipliers
from swarmstart.ocp.multistart import multistart
from swarmstart.ocp.opti import warm_start
from swarmstart.ocp.optimality_gap import OptimalityGap
from swarmstart.ocp.phased_horizon import PhasedHorizon, phased_horizon
from swarmstart.ocp.phases import Phases, phases
from swarmstart.ocp.plan import Plan, PlanningInterrupted, SearchReport, Source
from swarmstart.ocp.planner import Planner
from swarmstart.ocp.plant import Plant, SteppedPlant, Steps
from swarmstart.ocp.polish import Polished, Polisher
from swarmstart.ocp.polish_options import IpoptOptions, NlpOptions, PolishStatus
from swarmstart.ocp.problem import OptimalControlProblem
from swarmstart.ocp.radau import Radau
from swarmstart.ocp.search_settings import SearchSettings, WarmStart, When
from swarmstart.ocp.search_space import TrajectoryFamily
from swarmstart.ocp.separation import Connection, Separation, disc
from swarmstart.ocp.solution import Solution, verified
from swarmstart.ocp.solving import SolveInterrupted, solve
from swarmstart.ocp.stacked_models import stack_models
from swarmstart.ocp.start import Start
from swarmstart.ocp.status import SolutionStatus
from swarmstart.ocp.tables import Table, table
from swarmstart.ocp.team import Agent, Team
from swarmstart.ocp.terminal import terminal_set_of
from swarmstart.ocp.warm_started import (
    StartOutcome,
    WarmStartedSolver,
    WarmStartReport,
)

__all__ = [
    "INTEGRATORS",
    "Agent",
    "AlgebraicEquations",
    "Backend",
    "BackendWarning",
    "BatchFunction",
    "BoundKind",
    "Bounds",
    "Connection",
    "Constraint",
    "Controller",
    "Decision",
    "DenseOutput",
    "DivergedError",
    "DualMode",
    "Fitness",
    "Free",
    "Integrator",
    "InvalidProblemError",
    "InvalidSystemError",
    "IpoptOptions",
    "Known",
    "LocalAgent",
    "LocalTeam",
    "LowerBound",
    "Memetic",
    "Mode",
    "Model",
    "Multipliers",
    "Multistart",
    "NlpOptions",
    "NonMinimalWarning",
    "OpenLoop",
    "OptimalControlProblem",
    "OptimalityGap",
    "PathConstraint",
    "PhasedHorizon",
    "Phases",
    "Plan",
    "Planner",
    "PlanningInterrupted",
    "Plant",
    "PolishStatus",
    "Polished",
    "Polisher",
    "Prepared",
    "Radau",
    "RecedingHorizon",
    "Rows",
    "SearchAlgorithm",
    "SearchReport",
    "SearchSettings",
    "Separation",
    "Solution",
    "SolutionStatus",
    "SolveError",
    "SolveInterrupted",
    "Source",
    "Start",
    "StartOutcome",
    "Step",
    "SteppedPlant",
    "Steps",
    "Table",
    "Team",
    "TerminalConstraint",
    "Trajectory",
    "TrajectoryFamily",
    "UncertifiedSetError",
    "WarmStart",
    "WarmStartReport",
    "WarmStartedSolver",
    "When",
    "chosen_backend",
    "collected",
    "compile_batch",
    "disc",
    "ensemble",
    "fly",
    "held_step",
    "interpolate",
    "largest_distance",
    "lower_bound",
    "multistart",
    "phased_horizon",
    "phases",
    "population_of",
    "right_hand_side",
    "shifted_controls",
    "simulate",
    "smallest_distance",
    "solve",
    "stack_models",
    "table",
    "terminal_set_of",
    "verified",
    "warm_start",
    "zero_controls",
]
