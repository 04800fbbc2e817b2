"""Optimal-control problems: statement, solution, verification and closed loop."""

from swarmstart.ocp.answer.multistart import multistart
from swarmstart.ocp.answer.optimality_gap import OptimalityGap
from swarmstart.ocp.answer.plan import Plan, PlanningInterrupted, SearchReport, Source
from swarmstart.ocp.answer.planner import Planner
from swarmstart.ocp.answer.sensitivity import NoSensitivityError, Sensitivity
from swarmstart.ocp.answer.solution import Solution, verified
from swarmstart.ocp.answer.solving import SolveInterrupted, solve
from swarmstart.ocp.common.errors import DivergedError, InvalidProblemError, SolveError
from swarmstart.ocp.compiled.backend import Backend, BackendWarning, chosen_backend
from swarmstart.ocp.compiled.batch import BatchFunction, compile_batch
from swarmstart.ocp.compiled.simd import Prepared
from swarmstart.ocp.foreign_nlp.opti import warm_start
from swarmstart.ocp.foreign_nlp.warm_started import (
    StartOutcome,
    WarmStartedSolver,
    WarmStartReport,
)
from swarmstart.ocp.integration.integrators import INTEGRATORS, Integrator, held_step
from swarmstart.ocp.integration.radau import Radau
from swarmstart.ocp.interpolation.tables import Table, table
from swarmstart.ocp.loop.closed_loop import Step, Trajectory, collected, fly, simulate
from swarmstart.ocp.loop.controller import (
    Controller,
    Decision,
    Mode,
    OpenLoop,
    RecedingHorizon,
)
from swarmstart.ocp.loop.dense_output import (
    DenseOutput,
    interpolate,
    largest_distance,
    smallest_distance,
)
from swarmstart.ocp.loop.dual_mode import DualMode, UncertifiedSetError, terminal_set_of
from swarmstart.ocp.loop.local_team import LocalAgent, LocalTeam
from swarmstart.ocp.loop.phased_horizon import PhasedHorizon, phased_horizon
from swarmstart.ocp.loop.plant import Plant, SteppedPlant, Steps
from swarmstart.ocp.loop.team import Agent, Team
from swarmstart.ocp.lower_bound.bounding import lower_bound
from swarmstart.ocp.lower_bound.stated.answer import BoundKind, LowerBound
from swarmstart.ocp.nlp.multipliers import Multipliers
from swarmstart.ocp.nlp.polish import Polished, Polisher
from swarmstart.ocp.nlp.polish_options import IpoptOptions, NlpOptions, PolishStatus
from swarmstart.ocp.nlp.start import Start
from swarmstart.ocp.rollout.fitness import Fitness, Known
from swarmstart.ocp.rollout.status import SolutionStatus
from swarmstart.ocp.search.search_space import TrajectoryFamily
from swarmstart.ocp.search.settings import (
    Memetic,
    Multistart,
    SearchAlgorithm,
    SearchSettings,
    WarmStart,
    When,
    population_of,
)
from swarmstart.ocp.statement.decisions import Free
from swarmstart.ocp.statement.ensemble import ensemble
from swarmstart.ocp.statement.guesses import shifted_controls, zero_controls
from swarmstart.ocp.statement.phases import Phases, phases
from swarmstart.ocp.statement.problem import OptimalControlProblem
from swarmstart.ocp.statement.rewrites.counted_from import CountedFrom
from swarmstart.ocp.statement.rewrites.delay import TransportDelay
from swarmstart.ocp.system.algebraic import AlgebraicEquations
from swarmstart.ocp.system.constraints import (
    Bounds,
    Constraint,
    PathConstraint,
    Rows,
    TerminalConstraint,
)
from swarmstart.ocp.system.control_systems import InvalidSystemError, NonMinimalWarning
from swarmstart.ocp.system.model import Model, right_hand_side
from swarmstart.ocp.system.separation import Connection, Separation, disc
from swarmstart.ocp.system.stacked_models import stack_models

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
    "CountedFrom",
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
    "NoSensitivityError",
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
    "Sensitivity",
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
    "TransportDelay",
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
