"""swarmstart: warm starts for nonlinear optimal control by population search.

Public names are imported when first used, so that the command line stays quick.
"""

# ruff: noqa: I001  (it would write one statement for each name)
from typing import TYPE_CHECKING

from swarmstart.doors import door

if TYPE_CHECKING:  # For type checkers; a test holds it against the table below.
    from swarmstart.cases.campaign.studies.comparing import (
        NoFittingSolverError as NoFittingSolverError,
    )
    from swarmstart.cases.campaign.studies.library import (
        Row as Row,
        compare as compare,
        run as run,
    )
    from swarmstart.cases.campaign.running.finished_run import (
        Interrupted as Interrupted,
        Run as Run,
    )
    from swarmstart.cases.campaign.studies.sweeping import (
        NoInstancesError as NoInstancesError,
        SweepInterrupted as SweepInterrupted,
        sweep as sweep,
    )
    from swarmstart.cases.campaign.trials.solvers import (
        InvalidBudgetTextError as InvalidBudgetTextError,
        UnknownSolverError as UnknownSolverError,
    )
    from swarmstart.cases.commands.terminal import (
        Progress as Progress,
    )
    from swarmstart.cases.format.document import (
        UnreadableFileError as UnreadableFileError,
        YamlError as YamlError,
    )
    from swarmstart.cases.format.flaws import (
        InvalidScenarioError as InvalidScenarioError,
    )
    from swarmstart.cases.format.kind import (
        CodeNotAllowedError as CodeNotAllowedError,
        SeveralPlansError as SeveralPlansError,
    )
    from swarmstart.cases.format.scenario import (
        UnknownScenarioError as UnknownScenarioError,
    )
    from swarmstart.cases.kinds.python.scenario import (
        UserCodeError as UserCodeError,
    )
    from swarmstart.cases.record.files import (
        FolderInUseError as FolderInUseError,
        RecordError as RecordError,
    )
    from swarmstart.cases.record.record import (
        OccupiedFolderError as OccupiedFolderError,
    )
    from swarmstart.cases.record.results import (
        Record as Record,
        load as load,
    )
    from swarmstart.errors import (
        InvalidArgumentError as InvalidArgumentError,
        MissingPackageError as MissingPackageError,
        SwarmstartError as SwarmstartError,
    )
    from swarmstart.export import (
        CExport as CExport,
        ExportError as ExportError,
        NoCCompilerError as NoCCompilerError,
        export_c as export_c,
        export_fmu as export_fmu,
    )
    from swarmstart.heuristics import (
        CMAES as CMAES,
        LSHADE as LSHADE,
        AskTellError as AskTellError,
        Box as Box,
        Budget as Budget,
        ChaoticPSO as ChaoticPSO,
        DifferentialEvolution as DifferentialEvolution,
        GeneticAlgorithm as GeneticAlgorithm,
        Initial as Initial,
        InvalidBoxError as InvalidBoxError,
        InvalidBudgetError as InvalidBudgetError,
        InvalidEvaluationError as InvalidEvaluationError,
        InvalidOrderError as InvalidOrderError,
        InvalidPointsError as InvalidPointsError,
        InvalidSettingsError as InvalidSettingsError,
        InvalidSnapshotError as InvalidSnapshotError,
        ParticleSwarm as ParticleSwarm,
        RandomSearch as RandomSearch,
        Search as Search,
        SearchInterrupted as SearchInterrupted,
        SearchResult as SearchResult,
        SelfAdaptiveDE as SelfAdaptiveDE,
        StopReason as StopReason,
        default_algorithm as default_algorithm,
        default_order as default_order,
        epsilon_level as epsilon_level,
        feasibility_first as feasibility_first,
        minimize as minimize,
        static_penalty as static_penalty,
    )
    from swarmstart.ocp import (
        Agent as Agent,
        AlgebraicEquations as AlgebraicEquations,
        BackendWarning as BackendWarning,
        BoundKind as BoundKind,
        Bounds as Bounds,
        Connection as Connection,
        CountedFrom as CountedFrom,
        Decision as Decision,
        DivergedError as DivergedError,
        CommittedTeam as CommittedTeam,
        DualMode as DualMode,
        Fitness as Fitness,
        Free as Free,
        HeldSignals as HeldSignals,
        InvalidProblemError as InvalidProblemError,
        InvalidSystemError as InvalidSystemError,
        IpoptOptions as IpoptOptions,
        Known as Known,
        Links as Links,
        LocalAgent as LocalAgent,
        LocalTeam as LocalTeam,
        LowerBound as LowerBound,
        Memetic as Memetic,
        Mode as Mode,
        Model as Model,
        Multistart as Multistart,
        NlpOptions as NlpOptions,
        NoRestError as NoRestError,
        NoSensitivityError as NoSensitivityError,
        NonMinimalWarning as NonMinimalWarning,
        Obstacle as Obstacle,
        OpenLoop as OpenLoop,
        OptimalControlProblem as OptimalControlProblem,
        OptimalityGap as OptimalityGap,
        PathConstraint as PathConstraint,
        PhasedHorizon as PhasedHorizon,
        Phases as Phases,
        Plan as Plan,
        Planner as Planner,
        PlanningInterrupted as PlanningInterrupted,
        Plant as Plant,
        PolishStatus as PolishStatus,
        Radau as Radau,
        RecedingHorizon as RecedingHorizon,
        SearchReport as SearchReport,
        SearchSettings as SearchSettings,
        Separation as Separation,
        Solution as Solution,
        SolutionStatus as SolutionStatus,
        Solutions as Solutions,
        SolveError as SolveError,
        SolveInterrupted as SolveInterrupted,
        SolveManyInterrupted as SolveManyInterrupted,
        Source as Source,
        Start as Start,
        StartOutcome as StartOutcome,
        Step as Step,
        SteppedPlant as SteppedPlant,
        Swarm as Swarm,
        SwarmController as SwarmController,
        SwarmFlight as SwarmFlight,
        Table as Table,
        Team as Team,
        TerminalConstraint as TerminalConstraint,
        Trajectory as Trajectory,
        TrajectoryFamily as TrajectoryFamily,
        TransportDelay as TransportDelay,
        UncertifiedSetError as UncertifiedSetError,
        UnitWarning as UnitWarning,
        WarmStartReport as WarmStartReport,
        WarmStartedSolver as WarmStartedSolver,
        compile_batch as compile_batch,
        disc as disc,
        ensemble as ensemble,
        fly as fly,
        interpolate as interpolate,
        multistart as multistart,
        phased_horizon as phased_horizon,
        phases as phases,
        simulate as simulate,
        simulate_swarm as simulate_swarm,
        solve as solve,
        solve_many as solve_many,
        stack_models as stack_models,
        swarm_model as swarm_model,
        table as table,
        terminal_set_of as terminal_set_of,
        warm_start as warm_start,
    )
    from swarmstart.ocp.lower_bound.bounding import (
        lower_bound as lower_bound,
    )
    from swarmstart.simulators import (
        AircraftPlant as AircraftPlant,
        Autopilot as Autopilot,
        CommandPlant as CommandPlant,
        FmuPlant as FmuPlant,
        OnnxPlant as OnnxPlant,
        RollOutsInterrupted as RollOutsInterrupted,
        SelectedPlant as SelectedPlant,
        SimulatedPlan as SimulatedPlan,
        SimulatorError as SimulatorError,
        SurrogateRound as SurrogateRound,
        solve_simulated as solve_simulated,
    )
    from swarmstart.terminal_set import (
        AsymmetricMatrixError as AsymmetricMatrixError,
        Certificate as Certificate,
        CoarseHoldError as CoarseHoldError,
        ForeignCertificateError as ForeignCertificateError,
        HeldTooLongError as HeldTooLongError,
        IndefiniteMatrixError as IndefiniteMatrixError,
        InvalidDynamicsError as InvalidDynamicsError,
        InvalidPlaneError as InvalidPlaneError,
        InvalidReserveError as InvalidReserveError,
        InvalidShapeError as InvalidShapeError,
        MovingCentreError as MovingCentreError,
        MovingReferenceError as MovingReferenceError,
        NoProvenSetError as NoProvenSetError,
        NotAnEquilibriumError as NotAnEquilibriumError,
        NotFiniteError as NotFiniteError,
        NotPositiveError as NotPositiveError,
        NotSmoothError as NotSmoothError,
        NotStabilisableError as NotStabilisableError,
        ProofOptions as ProofOptions,
        Reference as Reference,
        SaturatedReferenceError as SaturatedReferenceError,
        TerminalSet as TerminalSet,
        TooFewSubstepsError as TooFewSubstepsError,
        UnknownIntervalOperationError as UnknownIntervalOperationError,
        UnprovenSetError as UnprovenSetError,
        UnreliableSolutionError as UnreliableSolutionError,
        UnstableLoopError as UnstableLoopError,
        UnweightedModeError as UnweightedModeError,
        Weights as Weights,
        certificate_text as certificate_text,
        certify as certify,
        sampled_terminal_set as sampled_terminal_set,
    )

__version__ = "0.2.0"

_NAMES = {
    "swarmstart.cases.campaign.studies.comparing": "NoFittingSolverError",
    "swarmstart.cases.campaign.studies.library": "Row compare run",
    "swarmstart.cases.campaign.studies.sweeping": (
        "NoInstancesError SweepInterrupted sweep"
    ),
    "swarmstart.cases.campaign.running.finished_run": "Interrupted Run",
    "swarmstart.cases.campaign.trials.solvers": (
        "InvalidBudgetTextError UnknownSolverError"
    ),
    "swarmstart.cases.commands.terminal": "Progress",
    "swarmstart.cases.format.document": "UnreadableFileError YamlError",
    "swarmstart.cases.format.flaws": "InvalidScenarioError",
    "swarmstart.cases.format.kind": "CodeNotAllowedError SeveralPlansError",
    "swarmstart.cases.format.scenario": "UnknownScenarioError",
    "swarmstart.cases.kinds.python.scenario": "UserCodeError",
    "swarmstart.cases.record.files": "FolderInUseError RecordError",
    "swarmstart.cases.record.record": "OccupiedFolderError",
    "swarmstart.cases.record.results": "Record load",
    "swarmstart.errors": "InvalidArgumentError MissingPackageError SwarmstartError",
    "swarmstart.export": "CExport ExportError NoCCompilerError export_c export_fmu",
    "swarmstart.heuristics": """
        CMAES LSHADE AskTellError Box Budget ChaoticPSO DifferentialEvolution
        GeneticAlgorithm Initial InvalidBoxError InvalidBudgetError
        InvalidEvaluationError InvalidOrderError InvalidPointsError
        InvalidSettingsError InvalidSnapshotError ParticleSwarm RandomSearch
        Search SearchInterrupted SearchResult SelfAdaptiveDE StopReason
        default_algorithm default_order epsilon_level feasibility_first minimize
        static_penalty
    """,
    "swarmstart.ocp": """
        Agent AlgebraicEquations BackendWarning BoundKind Bounds CommittedTeam
        Connection CountedFrom Decision DivergedError DualMode Fitness Free
        HeldSignals InvalidProblemError InvalidSystemError IpoptOptions Known Links
        LocalAgent LocalTeam LowerBound Memetic Mode Model Multistart NlpOptions
        NoRestError NoSensitivityError NonMinimalWarning Obstacle OpenLoop
        OptimalControlProblem OptimalityGap PathConstraint PhasedHorizon Phases Plan
        Planner PlanningInterrupted Plant PolishStatus Radau RecedingHorizon
        SearchReport SearchSettings Separation Solution SolutionStatus Solutions
        SolveError SolveInterrupted SolveManyInterrupted Source Start StartOutcome
        Step SteppedPlant Swarm SwarmController SwarmFlight Table Team
        TerminalConstraint Trajectory TrajectoryFamily TransportDelay
        UncertifiedSetError UnitWarning WarmStartReport WarmStartedSolver
        compile_batch disc ensemble fly interpolate multistart phased_horizon phases
        simulate simulate_swarm solve solve_many stack_models swarm_model table
        terminal_set_of warm_start
    """,
    "swarmstart.ocp.lower_bound.bounding": "lower_bound",
    "swarmstart.simulators": """
        AircraftPlant Autopilot CommandPlant FmuPlant OnnxPlant RollOutsInterrupted
        SelectedPlant SimulatedPlan SimulatorError SurrogateRound solve_simulated
    """,
    "swarmstart.terminal_set": """
        AsymmetricMatrixError Certificate CoarseHoldError
        ForeignCertificateError HeldTooLongError IndefiniteMatrixError
        InvalidDynamicsError InvalidPlaneError InvalidReserveError
        InvalidShapeError MovingCentreError MovingReferenceError NoProvenSetError
        NotAnEquilibriumError NotFiniteError NotPositiveError NotSmoothError
        NotStabilisableError ProofOptions Reference SaturatedReferenceError
        TerminalSet TooFewSubstepsError UnknownIntervalOperationError
        UnprovenSetError UnreliableSolutionError UnstableLoopError
        UnweightedModeError Weights certificate_text certify sampled_terminal_set
    """,
}
_HOMES, __getattr__, __dir__ = door(__name__, _NAMES, within="")
__all__ = list(_HOMES)
