"""Terminal sets, in which a linear law takes over, and their proofs.

The set of x' = f(x, u) around a reference (x_ref, u_ref) is {e : e'Pe <= alpha}, with
the deviation e = x - x_ref, a matrix P and a level alpha. Inside it, under the law u =
u_ref - K e with a gain K, all bounds hold, and e'Pe decreases. `certified_terminal_set`
takes all steps: linearisation, the matrix equations of K and P, the largest level that
the bounds allow, and the largest level up to it that can be proven.
"""

# ruff: noqa: I001  (it would write one statement for each name)
from typing import TYPE_CHECKING

from swarmstart.doors import door

if TYPE_CHECKING:  # Loaded when first used: a set that is kept needs no proof.
    from swarmstart.terminal_set.certificates.certificate import (
        Certificate as Certificate,
        CoarseHoldError as CoarseHoldError,
        HeldMargins as HeldMargins,
        Proof as Proof,
        Refutation as Refutation,
        UnprovenSetError as UnprovenSetError,
        Weights as Weights,
        certificate_text as certificate_text,
    )
    from swarmstart.terminal_set.certificates.design import (
        ForeignCertificateError as ForeignCertificateError,
        InvalidReserveError as InvalidReserveError,
        TerminalSet as TerminalSet,
        continuous_terminal_set as continuous_terminal_set,
        sampled_terminal_set as sampled_terminal_set,
    )
    from swarmstart.terminal_set.interval_arithmetic.intervals import (
        IntervalEvaluation as IntervalEvaluation,
        UnknownIntervalOperationError as UnknownIntervalOperationError,
        interval_function as interval_function,
    )
    from swarmstart.terminal_set.interval_arithmetic.smoothness import (
        NotSmoothError as NotSmoothError,
    )
    from swarmstart.terminal_set.linear.arrays import (
        AsymmetricMatrixError as AsymmetricMatrixError,
        IndefiniteMatrixError as IndefiniteMatrixError,
        InvalidShapeError as InvalidShapeError,
        NotFiniteError as NotFiniteError,
        NotPositiveError as NotPositiveError,
    )
    from swarmstart.terminal_set.linear.ellipsoid import (
        Ellipsoid as Ellipsoid,
        InvalidPlaneError as InvalidPlaneError,
        MovingReferenceError as MovingReferenceError,
        Reference as Reference,
        SaturatedReferenceError as SaturatedReferenceError,
        input_excess as input_excess,
        level_from_inputs as level_from_inputs,
        level_from_states as level_from_states,
        smaller_side as smaller_side,
    )
    from swarmstart.terminal_set.linear.linearisation import (
        InvalidDynamicsError as InvalidDynamicsError,
        held_spectral_radius as held_spectral_radius,
        hold as hold,
        linearise as linearise,
    )
    from swarmstart.terminal_set.linear.matrix_equations import (
        Gain as Gain,
        UnreliableSolutionError as UnreliableSolutionError,
        continuous_lqr as continuous_lqr,
        continuous_lyapunov as continuous_lyapunov,
        sampled_lqr as sampled_lqr,
        sampled_lyapunov as sampled_lyapunov,
    )
    from swarmstart.terminal_set.linear.stability import (
        NotStabilisableError as NotStabilisableError,
        UnstableLoopError as UnstableLoopError,
        UnweightedModeError as UnweightedModeError,
    )
    from swarmstart.terminal_set.proving.certification import (
        ProofOptions as ProofOptions,
        certified_terminal_set as certified_terminal_set,
        certify as certify,
    )
    from swarmstart.terminal_set.proving.decrease import (
        Change as Change,
        MovingCentreError as MovingCentreError,
        continuous_change as continuous_change,
        held_change as held_change,
    )
    from swarmstart.terminal_set.proving.drift import (
        HeldTooLongError as HeldTooLongError,
        NotAnEquilibriumError as NotAnEquilibriumError,
        TooFewSubstepsError as TooFewSubstepsError,
    )
    from swarmstart.terminal_set.proving.level_search import (
        Candidate as Candidate,
        NoProvenSetError as NoProvenSetError,
        ProvenLevel as ProvenLevel,
        largest_proven_set as largest_proven_set,
        log_volume as log_volume,
        proven_level as proven_level,
    )
    from swarmstart.terminal_set.proving.proof import (
        prove_level as prove_level,
        refuted_level as refuted_level,
    )

_NAMES = {
    "certificates.certificate": """
        Certificate CoarseHoldError HeldMargins Proof Refutation
        UnprovenSetError Weights certificate_text
    """,
    "certificates.design": """
        ForeignCertificateError InvalidReserveError TerminalSet
        continuous_terminal_set sampled_terminal_set
    """,
    "interval_arithmetic.intervals": """
        IntervalEvaluation UnknownIntervalOperationError interval_function
    """,
    "interval_arithmetic.smoothness": "NotSmoothError",
    "linear.arrays": """
        AsymmetricMatrixError IndefiniteMatrixError InvalidShapeError
        NotFiniteError NotPositiveError
    """,
    "linear.ellipsoid": """
        Ellipsoid InvalidPlaneError MovingReferenceError Reference
        SaturatedReferenceError input_excess level_from_inputs level_from_states
        smaller_side
    """,
    "linear.linearisation": "InvalidDynamicsError held_spectral_radius hold linearise",
    "linear.matrix_equations": """
        Gain UnreliableSolutionError continuous_lqr continuous_lyapunov
        sampled_lqr sampled_lyapunov
    """,
    "linear.stability": "NotStabilisableError UnstableLoopError UnweightedModeError",
    "proving.certification": "ProofOptions certified_terminal_set certify",
    "proving.decrease": "Change MovingCentreError continuous_change held_change",
    "proving.drift": "HeldTooLongError NotAnEquilibriumError TooFewSubstepsError",
    "proving.level_search": """
        Candidate NoProvenSetError ProvenLevel largest_proven_set log_volume
        proven_level
    """,
    "proving.proof": "prove_level refuted_level",
}
_HOMES, __getattr__, __dir__ = door(__name__, _NAMES)
__all__ = list(_HOMES)
