"""From a design to a certified set: bounds, refuted, proven, with the margins named.

    certified_terminal_set   designs and certifies, in one call
    certify                  certifies a design

For a held input the proof is of the Runge-Kutta map F, and the flow phi is another.
With |phi - F|_P <= c |e|_P and V(F) <= V,

    V(phi) <= (|F|_P + c |e|_P)^2 <= V(F) + (2 c + c^2) V(e),

so the proof asks for the margin Q_m + (2 c + c^2) P and then holds for the flow. c is
measured against a much finer integration and multiplied by RESERVE. Between the samples
V may grow before it falls, to at most g V; the set within which the states stay is that
much larger.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from swarmstart.errors import SwarmstartError
from swarmstart.terminal_set.arrays import FloatArray, NotPositiveError, finite_array
from swarmstart.terminal_set.certificate import Certificate, HeldMargins, Weights
from swarmstart.terminal_set.choice import proven_level
from swarmstart.terminal_set.decrease import continuous_change, held_change
from swarmstart.terminal_set.design import (
    TerminalSet,
    continuous_terminal_set,
    sampled_terminal_set,
)
from swarmstart.terminal_set.ellipsoid import Ellipsoid
from swarmstart.terminal_set.growth import Hold, prove_growth
from swarmstart.terminal_set.intervals import interval_function
from swarmstart.terminal_set.level import level_from_inputs, level_from_states
from swarmstart.terminal_set.linearisation import held_spectral_radius, linearise
from swarmstart.terminal_set.reference import Reference
from swarmstart.terminal_set.refutation import refuted_level
from swarmstart.terminal_set.stability import SAMPLED
from swarmstart.terminal_set.taylor import IntervalMaker

Array = NDArray[np.float64]

RESERVE = 10.0
"""How many times the measured error of the integrator the proof allows for."""
SAMPLES = 2000
RADII = (0.01, 0.3, 0.6, 0.8, 0.9, 1.0)
"""At which parts of the set's radius the margins are measured, for every sample."""
FINER = 50
"""Steps of the fine integration in one of the map's; the growth is measured at each."""
GROWTH_RESERVE = 1.1
LEAST_GROWTH = 1.05
SHRUNK = 1 - 1e-12
"""Of a level that is a bound's: its rounding."""
EQUILIBRIUM_TOLERANCE = 1e-9


@dataclass(eq=False)
class NotAnEquilibriumError(SwarmstartError, ValueError):
    """A reference moves, and the dynamics depend on where it moves to.

    Attributes:
        entries: Which entries of x_ref move and matter.
        rates: Their rates, of f(x_ref, u_ref).
    """

    entries: tuple[int, ...]
    rates: tuple[float, ...]

    def __str__(self) -> str:
        """Say which entries."""
        moving = ", ".join(
            f"xdot[{entry}] = {rate:.6g}"
            for entry, rate in zip(self.entries, self.rates, strict=True)
        )
        return (
            f"x_ref and u_ref are no equilibrium: {moving} there, and the dynamics "
            "depend on these states; only states that the dynamics do not depend on "
            "may move along the reference"
        )


@dataclass(eq=False)
class HeldTooLongError(SwarmstartError, ValueError):
    """A gain does not survive that its input is held for so long.

    Attributes:
        dt: How long it is to be held [s].
        spectral_radius: Of the held loop.
        longest: Up to which time the held loop is stable [s].
    """

    dt: float
    spectral_radius: float
    longest: float

    def __str__(self) -> str:
        """Say how long would do."""
        return (
            f"the gain is unstable when its input is held for {self.dt:g} s: the "
            f"spectral radius is {self.spectral_radius:.4g}; it is stable up to "
            f"{self.longest:.3g} s, and a sampled design for any dt"
        )


@dataclass(eq=False)
class UnprovenSetError(SwarmstartError, ArithmeticError):
    """No level of a design could be proven.

    Attributes:
        smallest: The smallest level that was tried.
        refuted: The refuted level; None where none was.
        seconds: The time that was allowed [s].
    """

    smallest: float
    refuted: float | None
    seconds: float

    def __str__(self) -> str:
        """Say what was tried."""
        refuted = "none" if self.refuted is None else f"{self.refuted:.6g}"
        return (
            f"no level could be proven within {self.seconds:g} s: the smallest tried "
            f"was {self.smallest:.6g}, the refuted one is {refuted}"
        )


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProofOptions:
    """What is to be proven, and how.

    Attributes:
        Q_m: Margin, shape (nx, nx): e'Pe is to fall by e'Q_m e, per second or per hold;
            None means 0, any decrease. With Q + K'RK the level bounds the cost to go,
            which takes kappa > 0 in the design.
        substeps: Runge-Kutta steps a hold, at least 1.
        intervals: Makes interval evaluations; `swarmstart.ocp.compiled_intervals` is
            faster, and needed beyond four states.
        growth: Whether the growth between samples is to be proven too; otherwise it is
            measured only, which takes less time.
        max_seconds: For the proofs of the decrease [s], and again for the growth.

    Raises:
        NotPositiveError: substeps is below 1.
    """

    Q_m: ArrayLike | None = None
    substeps: int = 1
    intervals: IntervalMaker = interval_function
    growth: bool = True
    max_seconds: float = 60.0

    def __post_init__(self) -> None:
        """Check the range."""
        if self.substeps < 1:
            raise NotPositiveError("substeps", self.substeps)


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
        weights: Q and R, per second or, held, per step; kappa.
        rng: Of the samples and of the rays that look for counterexamples.
        dt: How long the input is held [s]; None: it moves all the time.
        options: Of the proof; None: any decrease, in NumPy.

    Returns:
        K, P, the largest level of its bounds that was proven, and the certificate.

    Raises:
        NotAnEquilibriumError: The reference moves in a state that matters.
        UnprovenSetError: No level could be proven.
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


def certify(
    dynamics: ca.Function,
    reference: Reference,
    design: TerminalSet,
    *,
    rng: np.random.Generator,
    dt: float | None,
    options: ProofOptions | None = None,
) -> TerminalSet:
    """Certify a law and a P: find the largest level that can be proven.

    Args:
        dynamics: f(x, u) -> xdot, SI units.
        reference: Reference and bounds, those of the design.
        design: The law and P; its level is not used.
        rng: Of the samples and of the rays that look for counterexamples.
        dt: How long the input is held [s], also where the design is for an input that
            moves all the time; None: it does move all the time.
        options: Of the proof; None: any decrease, in NumPy.

    Returns:
        The design with the proven level, dt and the certificate.

    Raises:
        NotAnEquilibriumError: The reference moves in a state that matters.
        HeldTooLongError: The law does not survive the hold.
        UnprovenSetError: No level could be proven.
        NotPositiveError: No bound limits the level.
        SwarmstartError: As `refuted_level` and `prove_level` say.
    """
    options = options or ProofOptions()
    require_equilibrium(dynamics, reference)
    P = design.P
    margin = finite_array(
        "Q_m", np.zeros_like(P) if options.Q_m is None else options.Q_m, P.shape
    )
    top = SHRUNK * level_from_inputs(design.K, P, reference.u_max)
    of_states = SHRUNK * level_from_states(P, reference.e_max)
    motion, held, refuted = None, None, None
    if dt is None:
        top = min(top, of_states)
        change = continuous_change(dynamics, design, Q_m=margin)
    else:
        _require_stable_hold(dynamics, reference, design.K, dt)
        motion = _HeldMotion(dynamics, design, dt=dt, substeps=options.substeps)
        held, falls = motion.margins(min(top, of_states), rng)
        if not falls:
            change = held_change(motion.step, design, Q_m=margin)
            refuted = refuted_level(change, alpha_max=min(top, of_states), rng=rng)
            top = top if refuted is None else refuted.alpha
            held, _ = motion.margins(min(top, of_states), rng)
        c = held.integrator_error
        top = min(top, of_states / (np.sqrt(held.growth) + c) ** 2)
        change = held_change(motion.step, design, Q_m=margin + (2 * c + c**2) * P)
    level = proven_level(
        change,
        top,
        rng=rng,
        intervals=options.intervals,
        max_seconds=options.max_seconds,
    )
    if not level.alpha > 0:
        known = None if level.refutation is None else level.refutation.alpha
        raise UnprovenSetError(level.proof.alpha, known, options.max_seconds)
    if motion is not None and held is not None and options.growth:
        proof = prove_growth(
            motion.hold,
            level.alpha,
            held.growth,
            intervals=options.intervals,
            max_seconds=options.max_seconds,
        )
        held = replace(held, growth_is_proven=proof.proven)
    certificate = Certificate(
        dynamics=dynamics,
        reference=reference,
        K=design.K,
        P=P,
        alpha=level.alpha,
        dt=dt,
        Q_m=margin,
        held=held,
        proof=level.proof,
        # Without the integrator's margin: a counterexample all the more with it.
        refutation=level.refutation or refuted,
        design=design.design,
        weights=None,
    )
    return replace(design, alpha=level.alpha, dt=dt, certificate=certificate)


def require_equilibrium(dynamics: ca.Function, reference: Reference) -> None:
    """Refuse a reference whose motion changes the linear system around it.

    Args:
        dynamics: f(x, u) -> xdot.
        reference: The reference; it may move in states that f does not depend on.

    Raises:
        NotAnEquilibriumError: It moves in a state that matters.
    """
    xdot = np.array(dynamics(reference.x_ref, reference.u_ref)).ravel()
    matters = np.array(dynamics.jac_sparsity(0, 0).T.get_triplet()[0], dtype=int)
    moving = np.abs(xdot) > EQUILIBRIUM_TOLERANCE * (1 + np.abs(reference.x_ref))
    entries = sorted(set(np.flatnonzero(moving)) & set(matters))
    if entries:
        rates = tuple(float(xdot[entry]) for entry in entries)
        raise NotAnEquilibriumError(tuple(int(entry) for entry in entries), rates)


def _require_stable_hold(
    dynamics: ca.Function, reference: Reference, K: FloatArray, dt: float
) -> None:
    """Refuse a gain that is unstable when its input is held."""
    A, B = linearise(dynamics, reference.x_ref, reference.u_ref)
    radius = held_spectral_radius(A, B, K, dt)
    if radius < SAMPLED.limit:
        return
    stable, unstable = 0.0, dt
    for _ in range(40):
        middle = (stable + unstable) / 2
        if held_spectral_radius(A, B, K, middle) < 1:
            stable = middle
        else:
            unstable = middle
    raise HeldTooLongError(dt, radius, stable)


class _HeldMotion:
    """The motion over one hold: by the Runge-Kutta map, and much finer.

    Attributes:
        step: F(x, u) -> x after dt.
        hold: (e, t) -> the deviation after t, by as many steps.
    """

    def __init__(
        self, dynamics: ca.Function, law: TerminalSet, *, dt: float, substeps: int
    ) -> None:
        """Build the maps."""
        x = ca.SX.sym("x", dynamics.size1_in(0))
        u = ca.SX.sym("u", dynamics.size1_in(1))
        map_ = ca.simpleRK(dynamics, substeps, 4).expand()
        self.step = ca.Function("step", [x, u], [map_(x, u, dt)])
        self._piece = ca.Function("piece", [x, u], [map_(x, u, dt / FINER)])
        e, t = ca.SX.sym("e", x.numel()), ca.SX.sym("t")
        x_ref, u_ref = ca.DM(law.x_ref), ca.DM(law.u_ref)
        after = map_(x_ref + e, u_ref - ca.DM(law.K) @ e, t) - map_(x_ref, u_ref, t)
        self.hold = Hold(motion=ca.Function("motion", [e, t], [after]), P=law.P, dt=dt)
        self._law, self._substeps = law, substeps

    def margins(
        self, alpha: float, rng: np.random.Generator
    ) -> tuple[HeldMargins, bool]:
        """Measure the error of the map and the growth between samples.

        Args:
            alpha: Level of the ellipsoid.
            rng: Of the directions.

        Returns:
            The margins, and whether e'Pe fell over the hold at every sample.
        """
        law = self._law
        directions = rng.normal(size=(len(law.P), SAMPLES))
        boundary = Ellipsoid(P=law.P, alpha=alpha).boundary(directions)
        e = np.hstack([radius * boundary for radius in RADII])
        x = np.hstack([e, np.zeros((len(law.P), 1))]) + law.x_ref[:, None]
        u = np.hstack([law.feedback(e), np.zeros((len(law.u_ref), 1))])
        u += law.u_ref[:, None]
        size, growth = law.value(e), 1.0
        piece, now = self._piece.map(x.shape[1]), x
        for _ in range(FINER):
            now = np.array(piece(now, u))
            growth = max(growth, float((law.value(_relative(now)) / size).max()))
        mapped = np.array(self.step.map(x.shape[1])(x, u))
        error = law.value(_relative(now) - _relative(mapped)) / size
        falls = bool(np.all(law.value(_relative(now)) < size))
        measured = HeldMargins(
            substeps=self._substeps,
            integrator_error=RESERVE * float(np.sqrt(error.max())),
            samples=e.shape[1],
            growth=max(LEAST_GROWTH, GROWTH_RESERVE * growth),
            growth_is_proven=False,
        )
        return measured, falls


def _relative(x: Array) -> Array:
    """Return the deviations from the last column, which is the reference's."""
    return x[:, :-1] - x[:, -1:]
