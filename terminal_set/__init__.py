"""Terminal sets, in which a linear law takes over, and their proofs.

For x' = f(x, u) near a reference (x_ref, u_ref): a gain K, a matrix P and a level alpha
such that inside {e : e'Pe <= alpha} the law u = u_ref - K (x - x_ref) respects the
bounds and e'Pe decreases. `certified_terminal_set` takes all steps; each step has a
module: linearisation, lqr, lyapunov, level, refutation, proof.
"""

from swarmstart.terminal_set.certificates.certificate import (
    Certificate,
    HeldMargins,
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
from swarmstart.terminal_set.certificates.evidence import (
    CoarseHoldError,
    Proof,
    Refutation,
    UnprovenSetError,
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
from swarmstart.terminal_set.linear.ellipsoid import Ellipsoid, InvalidPlaneError
from swarmstart.terminal_set.linear.level import (
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
from swarmstart.terminal_set.linear.lqr import Gain, continuous_lqr, sampled_lqr
from swarmstart.terminal_set.linear.lyapunov import (
    continuous_lyapunov,
    sampled_lyapunov,
)
from swarmstart.terminal_set.linear.reference import Reference
from swarmstart.terminal_set.linear.reliability import UnreliableSolutionError
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
from swarmstart.terminal_set.proving.choice import (
    Candidate,
    NoProvenSetError,
    largest_proven_set,
    log_volume,
)
from swarmstart.terminal_set.proving.decrease import (
    Change,
    MovingCentreError,
    continuous_change,
    held_change,
)
from swarmstart.terminal_set.proving.drift import NotAnEquilibriumError
from swarmstart.terminal_set.proving.level_search import ProvenLevel, proven_level
from swarmstart.terminal_set.proving.prerequisites import (
    HeldTooLongError,
    TooFewSubstepsError,
)
from swarmstart.terminal_set.proving.proof import prove_level
from swarmstart.terminal_set.proving.refutation import refuted_level

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
