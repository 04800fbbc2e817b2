"""Optimal-control problems: statement, solution, verification and closed loop."""

# ruff: noqa: I001  (it would write one statement for each name)
from typing import TYPE_CHECKING

from swarmstart.doors import door

if TYPE_CHECKING:  # Loaded when first used: few commands need all of these.
    from swarmstart.ocp.answer.multistart import (
        multistart as multistart,
    )
    from swarmstart.ocp.answer.optimality_gap import (
        OptimalityGap as OptimalityGap,
    )
    from swarmstart.ocp.answer.plan import (
        Plan as Plan,
        PlanningInterrupted as PlanningInterrupted,
        SearchReport as SearchReport,
        Source as Source,
    )
    from swarmstart.ocp.answer.planner import (
        Planner as Planner,
    )
    from swarmstart.ocp.answer.sensitivity import (
        NoSensitivityError as NoSensitivityError,
        Sensitivities as Sensitivities,
        Sensitivity as Sensitivity,
    )
    from swarmstart.ocp.answer.solution import (
        Solution as Solution,
        verified as verified,
    )
    from swarmstart.ocp.answer.solving import (
        SolveInterrupted as SolveInterrupted,
        solve as solve,
    )
    from swarmstart.ocp.common.errors import (
        DivergedError as DivergedError,
        InvalidProblemError as InvalidProblemError,
        SolveError as SolveError,
    )
    from swarmstart.ocp.compiled.backend import (
        Backend as Backend,
        BackendWarning as BackendWarning,
        chosen_backend as chosen_backend,
    )
    from swarmstart.ocp.compiled.batch import (
        BatchFunction as BatchFunction,
        compile_batch as compile_batch,
    )
    from swarmstart.ocp.compiled.simd import (
        Prepared as Prepared,
    )
    from swarmstart.ocp.foreign_nlp.opti import (
        warm_start as warm_start,
    )
    from swarmstart.ocp.foreign_nlp.warm_started import (
        StartOutcome as StartOutcome,
        WarmStartedSolver as WarmStartedSolver,
        WarmStartReport as WarmStartReport,
    )
    from swarmstart.ocp.instances.solutions import (
        Solutions as Solutions,
        SolveManyInterrupted as SolveManyInterrupted,
    )
    from swarmstart.ocp.instances.solve_many import (
        solve_many as solve_many,
    )
    from swarmstart.ocp.integration.integrators import (
        INTEGRATORS as INTEGRATORS,
        Integrator as Integrator,
        held_step as held_step,
    )
    from swarmstart.ocp.integration.radau import (
        Radau as Radau,
    )
    from swarmstart.ocp.interpolation.tables import (
        Table as Table,
        table as table,
    )
    from swarmstart.ocp.loop.closed_loop import (
        Step as Step,
        Trajectory as Trajectory,
        collected as collected,
        fly as fly,
        simulate as simulate,
    )
    from swarmstart.ocp.loop.controller import (
        Controller as Controller,
        Decision as Decision,
        Mode as Mode,
        OpenLoop as OpenLoop,
        RecedingHorizon as RecedingHorizon,
    )
    from swarmstart.ocp.loop.dense_output import (
        DenseOutput as DenseOutput,
        interpolate as interpolate,
        largest_distance as largest_distance,
        smallest_distance as smallest_distance,
    )
    from swarmstart.ocp.loop.dual_mode import (
        DualMode as DualMode,
        UncertifiedSetError as UncertifiedSetError,
        terminal_set_of as terminal_set_of,
    )
    from swarmstart.ocp.loop.local_team import (
        LocalAgent as LocalAgent,
        LocalTeam as LocalTeam,
    )
    from swarmstart.ocp.loop.phased_horizon import (
        PhasedHorizon as PhasedHorizon,
        phased_horizon as phased_horizon,
    )
    from swarmstart.ocp.loop.plant import (
        Plant as Plant,
        Simulator as Simulator,
        SteppedPlant as SteppedPlant,
        Steps as Steps,
    )
    from swarmstart.ocp.loop.team import (
        Agent as Agent,
        Team as Team,
    )
    from swarmstart.ocp.lower_bound.stated.answer import (
        BoundKind as BoundKind,
        LowerBound as LowerBound,
    )
    from swarmstart.ocp.nlp.multipliers import (
        Multipliers as Multipliers,
    )
    from swarmstart.ocp.nlp.polish import (
        Polished as Polished,
        Polisher as Polisher,
    )
    from swarmstart.ocp.nlp.polish_options import (
        IpoptOptions as IpoptOptions,
        NlpOptions as NlpOptions,
        PolishStatus as PolishStatus,
    )
    from swarmstart.ocp.nlp.start import (
        Start as Start,
    )
    from swarmstart.ocp.rollout.fitness import (
        Fitness as Fitness,
        Known as Known,
    )
    from swarmstart.ocp.rollout.status import (
        SolutionStatus as SolutionStatus,
    )
    from swarmstart.ocp.search.search_space import (
        TrajectoryFamily as TrajectoryFamily,
    )
    from swarmstart.ocp.search.settings import (
        Memetic as Memetic,
        Multistart as Multistart,
        SearchAlgorithm as SearchAlgorithm,
        SearchSettings as SearchSettings,
        WarmStart as WarmStart,
        When as When,
        population_of as population_of,
    )
    from swarmstart.ocp.statement.decisions import (
        Free as Free,
    )
    from swarmstart.ocp.statement.ensemble import (
        ensemble as ensemble,
    )
    from swarmstart.ocp.statement.guesses import (
        shifted_controls as shifted_controls,
        zero_controls as zero_controls,
    )
    from swarmstart.ocp.statement.phases import (
        Phases as Phases,
        phases as phases,
    )
    from swarmstart.ocp.statement.problem import (
        OptimalControlProblem as OptimalControlProblem,
    )
    from swarmstart.ocp.statement.rewrites.counted_from import (
        CountedFrom as CountedFrom,
    )
    from swarmstart.ocp.statement.rewrites.delay import (
        TransportDelay as TransportDelay,
    )
    from swarmstart.ocp.statement.rewrites.held import (
        HeldSignals as HeldSignals,
    )
    from swarmstart.ocp.swarm.committed_team import (
        CommittedTeam as CommittedTeam,
    )
    from swarmstart.ocp.swarm.controller import (
        SwarmController as SwarmController,
        swarm_model as swarm_model,
    )
    from swarmstart.ocp.swarm.flight import (
        SwarmFlight as SwarmFlight,
    )
    from swarmstart.ocp.swarm.simulation import (
        simulate_swarm as simulate_swarm,
    )
    from swarmstart.ocp.swarm.swarm import (
        Links as Links,
        Obstacle as Obstacle,
        Swarm as Swarm,
    )
    from swarmstart.ocp.swarm.tube import (
        NoRestError as NoRestError,
    )
    from swarmstart.ocp.system.algebraic import (
        AlgebraicEquations as AlgebraicEquations,
    )
    from swarmstart.ocp.system.constraints import (
        Bounds as Bounds,
        Constraint as Constraint,
        PathConstraint as PathConstraint,
        Rows as Rows,
        TerminalConstraint as TerminalConstraint,
    )
    from swarmstart.ocp.system.control_systems import (
        InvalidSystemError as InvalidSystemError,
        NonMinimalWarning as NonMinimalWarning,
    )
    from swarmstart.ocp.system.model import (
        Model as Model,
        right_hand_side as right_hand_side,
    )
    from swarmstart.ocp.system.separation import (
        Connection as Connection,
        Separation as Separation,
        disc as disc,
    )
    from swarmstart.ocp.system.stacked_models import (
        stack_models as stack_models,
    )
    from swarmstart.ocp.system.units import UnitWarning as UnitWarning

_NAMES = {
    "answer.multistart": "multistart",
    "answer.optimality_gap": "OptimalityGap",
    "answer.plan": "Plan PlanningInterrupted SearchReport Source",
    "answer.planner": "Planner",
    "answer.sensitivity": "NoSensitivityError Sensitivities Sensitivity",
    "answer.solution": "Solution verified",
    "answer.solving": "SolveInterrupted solve",
    "common.errors": "DivergedError InvalidProblemError SolveError",
    "compiled.backend": "Backend BackendWarning chosen_backend",
    "compiled.batch": "BatchFunction compile_batch",
    "compiled.simd": "Prepared",
    "foreign_nlp.opti": "warm_start",
    "foreign_nlp.warm_started": "StartOutcome WarmStartedSolver WarmStartReport",
    "instances.solutions": "Solutions SolveManyInterrupted",
    "instances.solve_many": "solve_many",
    "integration.integrators": "INTEGRATORS Integrator held_step",
    "integration.radau": "Radau",
    "interpolation.tables": "Table table",
    # By itself, as the word is for aircraft.
    "loop.closed_loop": " ".join(["Step Trajectory collected simulate", "fly"]),
    "loop.controller": "Controller Decision Mode OpenLoop RecedingHorizon",
    "loop.dense_output": "DenseOutput interpolate largest_distance smallest_distance",
    "loop.dual_mode": "DualMode UncertifiedSetError terminal_set_of",
    "loop.local_team": "LocalAgent LocalTeam",
    "loop.phased_horizon": "PhasedHorizon phased_horizon",
    "loop.plant": "Plant Simulator SteppedPlant Steps",
    "loop.team": "Agent Team",
    "lower_bound.stated.answer": "BoundKind LowerBound",
    "nlp.multipliers": "Multipliers",
    "nlp.polish": "Polished Polisher",
    "nlp.polish_options": "IpoptOptions NlpOptions PolishStatus",
    "nlp.start": "Start",
    "rollout.fitness": "Fitness Known",
    "rollout.status": "SolutionStatus",
    "search.search_space": "TrajectoryFamily",
    "search.settings": """
        Memetic Multistart SearchAlgorithm SearchSettings WarmStart When
        population_of
    """,
    "statement.decisions": "Free",
    "statement.ensemble": "ensemble",
    "statement.guesses": "shifted_controls zero_controls",
    "statement.phases": "Phases phases",
    "statement.problem": "OptimalControlProblem",
    "statement.rewrites.counted_from": "CountedFrom",
    "statement.rewrites.delay": "TransportDelay",
    "statement.rewrites.held": "HeldSignals",
    "swarm.committed_team": "CommittedTeam",
    "swarm.controller": "SwarmController swarm_model",
    "swarm.flight": "SwarmFlight",
    "swarm.simulation": "simulate_swarm",
    "swarm.swarm": "Links Obstacle Swarm",
    "swarm.tube": "NoRestError",
    "system.algebraic": "AlgebraicEquations",
    "system.constraints": "Bounds Constraint PathConstraint Rows TerminalConstraint",
    "system.control_systems": "InvalidSystemError NonMinimalWarning",
    "system.model": "Model right_hand_side",
    "system.separation": "Connection Separation disc",
    "system.stacked_models": "stack_models",
    "system.units": "UnitWarning",
}
_HOMES, __getattr__, __dir__ = door(__name__, _NAMES)
__all__ = list(_HOMES)
