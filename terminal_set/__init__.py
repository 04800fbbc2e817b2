"""Terminal sets, in which a linear law takes over, and their proofs.

For x' = f(x, u) near a reference (x_ref, u_ref): a gain K, a matrix P and a level alpha
such that inside {e : e'Pe <= alpha} the law u = u_ref - K (x - x_ref) respects the
bounds and e'Pe decreases. `certified_terminal_set` takes all steps: linearisation, the
matrix equations of K and P, the level of the bounds, and its refutation or proof.
"""

from swarmstart.terminal_set.certificates.certificate import (
    Certificate,
    CoarseHoldError,
    HeldMargins,
    Proof,
    Refutation,
    UnprovenSetError,
    Weights,
    certificate_text,
)
from swarmstart.terminal_set.certificates.design import (
    ForeignCertificateError,
    InvalidReserveError,
    TerminalSet,
    continuous_terminal_set,
    sampled_terminal_set,
)
from swarmstart.terminal_set.interval_arithmetic.intervals import (
    IntervalEvaluation,
    UnknownIntervalOperationError,
    interval_function,
)
from swarmstart.terminal_set.interval_arithmetic.smoothness import NotSmoothError
from swarmstart.terminal_set.linear.arrays import (
    AsymmetricMatrixError,
    IndefiniteMatrixError,
    InvalidShapeError,
    NotFiniteError,
    NotPositiveError,
)
from swarmstart.terminal_set.linear.ellipsoid import (
    Ellipsoid,
    InvalidPlaneError,
    MovingReferenceError,
    Reference,
    SaturatedReferenceError,
    input_excess,
    level_from_inputs,
    level_from_states,
    smaller_side,
)
from swarmstart.terminal_set.linear.linearisation import (
    InvalidDynamicsError,
    held_spectral_radius,
    hold,
    linearise,
)
from swarmstart.terminal_set.linear.matrix_equations import (
    Gain,
    UnreliableSolutionError,
    continuous_lqr,
    continuous_lyapunov,
    sampled_lqr,
    sampled_lyapunov,
)
from swarmstart.terminal_set.linear.stability import (
    NotStabilisableError,
    UnstableLoopError,
    UnweightedModeError,
)
from swarmstart.terminal_set.proving.certification import (
    ProofOptions,
    certified_terminal_set,
    certify,
)
from swarmstart.terminal_set.proving.decrease import (
    Change,
    MovingCentreError,
    continuous_change,
    held_change,
)
from swarmstart.terminal_set.proving.drift import (
    HeldTooLongError,
    NotAnEquilibriumError,
    TooFewSubstepsError,
)
from swarmstart.terminal_set.proving.level_search import (
    Candidate,
    NoProvenSetError,
    ProvenLevel,
    largest_proven_set,
    log_volume,
    proven_level,
)
from swarmstart.terminal_set.proving.proof import prove_level, refuted_level

__all__ = [
    "AsymmetricMatrixError",
    "Candidate",
    "Certificate",
    "Change",
    "CoarseHoldError",
    "Ellipsoid",
    "ForeignCertificateError",
    "Gain",
    "HeldMargins",
    "HeldTooLongError",
    "IndefiniteMatrixError",
    "IntervalEvaluation",
    "InvalidDynamicsError",
    "InvalidPlaneError",
    "InvalidReserveError",
    "InvalidShapeError",
    "MovingCentreError",
    "MovingReferenceError",
    "NoProvenSetError",
    "NotAnEquilibriumError",
    "NotFiniteError",
    "NotPositiveError",
    "NotSmoothError",
    "NotStabilisableError",
    "Proof",
    "ProofOptions",
    "ProvenLevel",
    "Reference",
    "Refutation",
    "SaturatedReferenceError",
    "TerminalSet",
    "TooFewSubstepsError",
    "UnknownIntervalOperationError",
    "UnprovenSetError",
    "UnreliableSolutionError",
    "UnstableLoopError",
    "UnweightedModeError",
    "Weights",
    "certificate_text",
    "certified_terminal_set",
    "certify",
    "continuous_change",
    "continuous_lqr",
    "continuous_lyapunov",
    "continuous_terminal_set",
    "held_change",
    "held_spectral_radius",
    "hold",
    "input_excess",
    "interval_function",
    "largest_proven_set",
    "level_from_inputs",
    "level_from_states",
    "linearise",
    "log_volume",
    "prove_level",
    "proven_level",
    "refuted_level",
    "sampled_lqr",
    "sampled_lyapunov",
    "sampled_terminal_set",
    "smaller_side",
]
