"""Certification of a design: the level that bounds allow, refuted and proven levels.

    certified_terminal_set   designs and certifies, in one call
    certify                  certifies a design

V(e) = e'Pe, with e the deviation from the reference, and |e|_P is the root of V(e). For
a held input the proof is about the Runge-Kutta map F, which differs from the flow phi;
both lead from e to the deviation after a hold. With |phi - F|_P <= c |e|_P, proven too
(`flow_error.py`), and V(F) <= V(e),

    V(phi) <= (|F|_P + c |e|_P)^2 <= V(F) + (2 c + c^2) V(e),

so the proof requires the margin Q_m + (2 c + c^2) P and then also holds for the flow.
Between samples V may grow before it decreases: to at most g V(e) on the map's curve,
and to at most (sqrt(g) + c)^2 V(e) on the flow. The level that holds the states at all
times is larger than alpha by this factor.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from swarmstart.arguments import (
    FLAG,
    RNG,
    a_count,
    a_number,
    checked,
    of_kind,
    optional,
    reals,
)
from swarmstart.arrays import Array
from swarmstart.machine_code import WorkClock, now, working
from swarmstart.terminal_set.certificates.certificate import (
    Certificate,
    HeldMargins,
    UnprovenSetError,
    Weights,
    sealed,
)
from swarmstart.terminal_set.certificates.design import (
    ForeignCertificateError,
    TerminalSet,
    continuous_terminal_set,
    sampled_terminal_set,
)
from swarmstart.terminal_set.interval_arithmetic.smoothness import require_smooth
from swarmstart.terminal_set.linear.arrays import (
    NotPositiveError,
    positive_semidefinite,
)
from swarmstart.terminal_set.linear.ellipsoid import (
    Reference,
    level_from_inputs,
    level_from_states,
)
from swarmstart.terminal_set.linear.linearisation import linearise
from swarmstart.terminal_set.proving.decrease import (
    Change,
    continuous_change,
    held_change,
)
from swarmstart.terminal_set.proving.drift import (
    Drift,
    ReferenceMotion,
    bearable_drift,
    require_enough_substeps,
    require_stable_hold,
)
from swarmstart.terminal_set.proving.hold_margins import (
    HeldMotion,
    HoldBounds,
    ProvableHold,
    provable_hold,
    with_proven_growth,
)
from swarmstart.terminal_set.proving.kept_sets import keep, key_of_set, load_set
from swarmstart.terminal_set.proving.level_search import proven_level

ROUNDING = 1e-12
"""Relative rounding of a bound's level, apart from that by the condition of P."""


@checked(
    substeps=a_count(),
    growth=FLAG,
    work=a_number(),
    max_seconds=optional(a_number(finite=False)),
    Q_m=optional(reals()),
)
@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProofOptions:
    """Options of a proof: its margin, effort and parts.

    Attributes:
        Q_m: Margin, shape (nx, nx): e'Pe must decrease by e'Q_m e, per second or per
            hold; None means 0, any decrease. With Q + K'RK, e'Pe bounds the cost to go,
            which needs kappa > 0 in the design.
        substeps: Number of Runge-Kutta steps in a hold, at least 1.
        growth: Whether the growth between samples is proven too; if False it is only
            measured, which takes less time.
        work: Budget of work, in units of about a second, for each of three parts: the
            proofs of the decrease, of the integrator's error, and of the growth. The
            same budget proves the same on every machine.
        max_seconds: Wall time for all proofs together [s], on top of the budget; a
            proof that this limit ended says so (`Proof.was_late`). None: no limit.

    Raises:
        NotPositiveError: If substeps is below 1, or work or max_seconds not above 0.
        TypeError: If substeps is not an integer.

    Example:
        Prove that e'Pe falls by 0.1 e'e at least in every hold:

        >>> import numpy as np
        >>> import swarmstart as ss
        >>> options = ss.ProofOptions(Q_m=0.1 * np.eye(2), work=10)
        >>> options.substeps
        1
    """

    Q_m: ArrayLike | None = None
    substeps: int = 1
    growth: bool = True
    work: float = 60.0
    max_seconds: float | None = None

    def __post_init__(self) -> None:
        """Check the ranges."""
        # Takes an integer of NumPy, but no 1.0.
        object.__setattr__(self, "substeps", operator.index(self.substeps))
        if self.substeps < 1:
            raise NotPositiveError("substeps", self.substeps)
        if not self.work > 0:
            raise NotPositiveError("work", self.work)
        if self.max_seconds is not None and not self.max_seconds > 0:
            raise NotPositiveError("max_seconds", self.max_seconds)


@checked(weights=of_kind(Weights, "Weights"))
def certified_terminal_set(
    dynamics: ca.Function,
    reference: Reference,
    weights: Weights,
    *,
    rng: np.random.Generator,
    dt: float | None = None,
    options: ProofOptions | None = None,
) -> TerminalSet:
    """Design a terminal set and certify it.

    Args:
        dynamics: f(x, u) -> xdot, SI units, of SX or of MX that can be expanded.
        reference: Reference and bounds.
        weights: Q and R, per second, or per step for a held input; kappa.
        rng: Source of randomness of samples and of rays that look for counterexamples.
        dt: Time for which the input is held [s]; None for a continuous input.
        options: Options of the proof; None means `ProofOptions()`, for which any
            decrease is enough.

    Returns:
        K, P, the largest level within the bounds that was proven, and the certificate.

    Raises:
        NotAnEquilibriumError: If the reference moves too much in a state that has
            bounds or that the dynamics depend on.
        UnprovenSetError: If no level could be proven.
        SwarmstartError: As the designs, `refuted_level` and `prove_level` say.
    """
    Q, R, kappa = weights.Q, weights.R, weights.kappa
    if dt is None:
        design = continuous_terminal_set(dynamics, reference, Q=Q, R=R, kappa=kappa)
    else:
        design = sampled_terminal_set(dynamics, reference, dt=dt, Q=Q, R=R, kappa=kappa)
    found = certify(dynamics, reference, design, rng=rng, dt=dt, options=options)
    certificate = found.certificate
    if certificate is not None:
        certificate = replace(certificate, weights=weights)
    return replace(found, certificate=certificate)


@checked(
    dynamics=of_kind(ca.Function, "a casadi.Function"),
    reference=of_kind(Reference, "a Reference"),
    design=of_kind(TerminalSet, "a TerminalSet"),
    rng=RNG,
    dt=optional(a_number()),
    options=optional(of_kind(ProofOptions, "ProofOptions")),
)
def certify(
    dynamics: ca.Function,
    reference: Reference,
    design: TerminalSet,
    *,
    rng: np.random.Generator,
    dt: float | None,
    options: ProofOptions | None = None,
) -> TerminalSet:
    """Certify a law and a matrix P: find the largest level that can be proven.

    Args:
        dynamics: f(x, u) -> xdot, SI units.
        reference: Reference and bounds, those of the design.
        design: The law and P; its level is not used.
        rng: Source of randomness of samples and of rays that look for counterexamples.
        dt: Time for which the input is held [s], even if the design is continuous; None
            for a continuous input.
        options: Options of the proof; None means `ProofOptions()`, for which any
            decrease is enough.

    Returns:
        The design with the proven level, dt and the certificate.

    Raises:
        NotAnEquilibriumError: If the reference moves too much in a state that has
            bounds or that the dynamics depend on.
        HeldTooLongError: If the law is unstable with an input held for dt.
        TooFewSubstepsError: If the Runge-Kutta map of a hold is too far from the flow.
        NotSmoothError: If the dynamics jump at the reference, or their derivatives are
            unbounded there; a kink, as that of fabs, is allowed.
        UnknownIntervalOperationError: If they have an operation without interval form.
        UnprovenSetError: If no level could be proven.
        NotPositiveError: If no bound limits the level.
        SwarmstartError: As `refuted_level` and `prove_level` say.

    Example:
        A pendulum that hangs, its torque held for 0.1 s:

        >>> import casadi as ca
        >>> import numpy as np
        >>> import swarmstart as ss
        >>> x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
        >>> f = ca.Function("f", [x, u], [ca.vertcat(x[1], u - ca.sin(x[0]))])
        >>> rest = ss.Reference(x_ref=[0, 0], u_ref=[0], u_lower=[-1], u_upper=[1])
        >>> design = ss.sampled_terminal_set(
        ...     f, rest, dt=0.1, Q=np.eye(2), R=np.eye(1)
        ... )
        >>> certified = ss.certify(
        ...     f, rest, design, dt=0.1, rng=np.random.default_rng(0)
        ... )
        >>> certified.certificate is not None
        True
        >>> bool(0.9 * design.alpha < certified.alpha <= design.alpha)
        True
    """
    options = options or ProofOptions()
    nx = len(design.P)
    Q_m = np.zeros((nx, nx)) if options.Q_m is None else np.asarray(options.Q_m)
    # Without the limit of seconds: what it ended is not kept.
    stated = dt, Q_m.tolist(), options.substeps, options.growth, options.work
    key = key_of_set(dynamics, reference, design, stated, rng)
    kept = load_set(
        key, dynamics, reference, design,
        dt=dt, Q_m=Q_m, substeps=options.substeps, rng=rng,
    )  # fmt: skip
    if kept is not None:
        return kept
    with working(seconds=options.max_seconds) as clock:
        found = _certified(
            dynamics, reference, design, rng=rng, dt=dt, options=options, clock=clock
        )
    keep(key, found, rng)
    return found


def _certified(  # noqa: PLR0913 - what certify was given, and its clock
    dynamics: ca.Function,
    reference: Reference,
    design: TerminalSet,
    *,
    rng: np.random.Generator,
    dt: float | None,
    options: ProofOptions,
    clock: WorkClock,
) -> TerminalSet:
    """Certify a law and a P, within the work and the time of the options."""
    _require_smooth(dynamics, reference)
    A, B = linearise(dynamics, reference.x_ref, reference.u_ref)
    reference_motion = ReferenceMotion(dynamics, reference)
    for name in ("x_ref", "u_ref"):
        if not np.array_equal(getattr(design, name), getattr(reference, name)):
            raise ForeignCertificateError(name)
    nx = len(design.P)
    Q_m = positive_semidefinite(
        "Q_m", np.zeros((nx, nx)) if options.Q_m is None else options.Q_m, nx
    )
    bounds = _levels_of_bounds(design, reference)
    if dt is None:
        asked = _asked_of_moving_input(dynamics, design, reference_motion, Q_m, bounds)
    else:
        require_stable_hold(A, B, design.K, dt)
        require_enough_substeps(A, B, design, dt=dt, substeps=options.substeps)
        motion = HeldMotion(dynamics, design, dt=dt, substeps=options.substeps)
        until = now() + options.work
        asked = _asked_of_held_input(
            motion, reference_motion, Q_m, bounds, rng=rng, until=until
        )
    change, top, drift, hold = asked
    level = proven_level(change, top, rng=rng, work=options.work)
    refutation = level.refutation
    if refutation is None and hold is not None:
        # Found without the integrator's margin, so also a counterexample with it.
        refutation = hold.refutation
    if not level.alpha > 0:
        known = None if refutation is None else refutation.alpha
        raise UnprovenSetError(level.proof.alpha, known, options.work)
    certificate = Certificate(
        dynamics=dynamics,
        reference=reference,
        K=design.K,
        P=design.P,
        alpha=level.alpha,
        core=drift.core_of(level.alpha),
        drift=drift.relative,
        dt=dt,
        Q_m=Q_m,
        held=None if hold is None else _margins(hold, level.alpha, options),
        proof=replace(level.proof, was_late=clock.was_late),
        refutation=refutation,
        design=design.design,
        weights=None,
    )
    return replace(design, alpha=level.alpha, dt=dt, certificate=sealed(certificate))


class _Asked(NamedTuple):
    """A decrease to be proven, and the level up to which to prove it."""

    change: Change
    top: float
    drift: Drift
    hold: ProvableHold | None


def _levels_of_bounds(design: TerminalSet, reference: Reference) -> tuple[float, float]:
    """Return the levels of the input and state bounds, reduced by their rounding.

    Raises:
        NotPositiveError: If neither is finite, or one is not positive.
    """
    # F P^-1 F' is computed with an error of about eps times the condition of P.
    condition = float(np.linalg.cond(design.P))
    rounding = ROUNDING + 4 * len(design.P) * float(np.finfo(float).eps) * condition
    inputs = (1 - rounding) * level_from_inputs(design.K, design.P, reference.u_max)
    states = (1 - rounding) * level_from_states(design.P, reference.e_max)
    if not 0 < min(inputs, states) < np.inf:
        raise NotPositiveError("the level that the bounds allow", min(inputs, states))
    return inputs, states


def _asked_of_moving_input(
    dynamics: ca.Function,
    design: TerminalSet,
    motion: ReferenceMotion,
    Q_m: Array,
    bounds: tuple[float, float],
) -> _Asked:
    """Return the decrease to be proven for a continuous input."""
    top = min(bounds)
    change = continuous_change(dynamics, design, Q_m=Q_m)
    drift = bearable_drift(motion, motion.bound, change, top)
    # 2 a V(e) in place of the drift, as in `drift.py`.
    change = replace(change, Q_m=Q_m + 2 * drift.relative * design.P)
    return _Asked(change, top, drift, None)


def _asked_of_held_input(
    motion: HeldMotion,
    reference_motion: ReferenceMotion,
    Q_m: Array,
    bounds: tuple[float, float],
    *,
    rng: np.random.Generator,
    until: float,
) -> _Asked:
    """Return the decrease to be proven for a held input, with its margins."""
    inputs, states = bounds
    moved = reference_motion.over_hold(motion.dt, len(motion.holds))
    change = held_change(motion.step, motion.law, Q_m=Q_m)
    drift = bearable_drift(reference_motion, moved, change, min(bounds))
    limits = HoldBounds(inputs=inputs, states=states, drift=drift.relative)
    hold = provable_hold(motion, change, limits, rng=rng, until=until)
    return _Asked(hold.change, hold.top, drift, hold)


def _require_smooth(dynamics: ca.Function, reference: Reference) -> None:
    """Validate that f has second derivatives at the reference; see `smoothness.py`."""
    at = np.concatenate([reference.x_ref, reference.u_ref])
    x, u = ca.SX.sym("x", reference.x_ref.size), ca.SX.sym("u", reference.u_ref.size)
    f = ca.Function(dynamics.name(), [ca.vertcat(x, u)], [dynamics(x, u)])
    require_smooth(f, at)


def _margins(hold: ProvableHold, alpha: float, options: ProofOptions) -> HeldMargins:
    """Return the margins; the growth is proven if that is requested and succeeds."""
    if not options.growth:
        return hold.margins
    return with_proven_growth(hold, alpha, work=options.work)
