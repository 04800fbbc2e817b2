"""Search for the largest level that can be proven, for one design or a family.

The steps of the search are

    bounds     the requested level is tried first; if it is proven, the search ends
    refuted    the nearest counterexample, of the proof or of a search for it, is an
               upper limit of all levels that can be proven
    downwards  fractions of that limit, until one is proven: the model may be undefined,
               or have thin features that samples miss
    upwards    levels between the highest proven and the lowest unproven one

The last step ends when the two are within TIGHT of each other or time is up. A level
counts as unproven after MORE_BOXES times the boxes of the last proof.

The weights of an LQR are seldom given, but matter: for the formation model, with inputs
held for 1 s and Q = R = I, the set extends 24 cm to each side in position; with another
R it extends by metres. So the weights are scaled by several numbers s, a level is
proven for each design, and the largest set is taken (`largest_proven_set`). Levels of
different P cannot be compared, but sizes can. The usual size is the volume.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swarmstart.arguments import RNG, a_number, checked, function, of_kind, several
from swarmstart.arrays import Array
from swarmstart.errors import InvalidArgumentError, SwarmstartError
from swarmstart.machine_code import now, working
from swarmstart.terminal_set.certificates.certificate import Proof, Refutation
from swarmstart.terminal_set.certificates.design import TerminalSet
from swarmstart.terminal_set.linear.ellipsoid import Ellipsoid
from swarmstart.terminal_set.proving.decrease import Change
from swarmstart.terminal_set.proving.proof import (
    CHANGE,
    WORK,
    prove_level,
    refuted_level,
)

FIRST_SHARE = 0.92
"""Fraction of the refuted level that is tried first: with six states more takes too
long."""
NEARER_SHARE = 0.99
"""Fraction of a level refuted by a state that is tried next."""
LOWER_SHARES = (0.54, 0.25)
"""Fractions of an unproven level that are tried next; the last one repeatedly."""
SMALLEST_SHARE = 1e-12
"""Smallest level, relative to the first, down to which levels are quartered. A smaller
one takes hardly less time to prove; if the model is undefined somewhere in a larger
one, that shows at once."""
TIGHT = 1.011
"""Ratio of the lowest unproven level and the proven one at which the search ends."""
MORE_BOXES = 10
FEW_BOXES = 50_000
"""Number of boxes that every proof may take."""
MOST_BOXES = 100_000_000
"""Largest number of boxes of a first proof, which ends by time in practice."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class ProvenLevel:
    """The largest level that could be proven.

    Attributes:
        proof: Proof of the largest proven level, or the last attempt if none was
            proven.
        refutation: The nearest counterexample below the requested level; None if none
            was found.
    """

    proof: Proof
    refutation: Refutation | None

    @property
    def alpha(self) -> float:
        """The proven level; 0 if no level was proven."""
        return self.proof.alpha if self.proof.proven else 0.0


@checked(change=CHANGE, alpha_max=a_number(finite=False, nan=True), rng=RNG, work=WORK)
def proven_level(
    change: Change,
    alpha_max: float,
    *,
    rng: np.random.Generator,
    work: float = 60.0,
) -> ProvenLevel:
    """Prove the largest possible level up to a given one.

    Args:
        change: Change from `continuous_change` or `held_change`.
        alpha_max: The requested level, > 0: that of the bounds.
        rng: Source of randomness of the rays that look for a counterexample.
        work: Budget for all proofs together [s]; in a `working` block
            (`machine_code/clocks.py`), in units of work, each of about a second.

    Returns:
        The requested level if it could be proven, else the largest level that could be.
        If no level could be proven, `alpha` of the result is 0.

    Raises:
        SwarmstartError: As `refuted_level` and `prove_level` say.
    """
    search = _LevelSearch(change, alpha_max, now() + work)
    # For a level that cannot be proven, a counterexample is usually found at once.
    if not search.proves(alpha_max, 0.25):
        search.refute(refuted_level(change, alpha_max=alpha_max, rng=rng))
        search.descend()
        search.tighten()
    return search.level


class _LevelSearch:
    """The highest proven level, the lowest unproven one, the nearest counterexample.

    Attributes:
        level: The result so far.
    """

    def __init__(self, change: Change, alpha_max: float, until: float) -> None:
        """Begin without any proven or refuted level."""
        self._change, self._alpha_max, self._until = change, alpha_max, until
        self._unproven, self._is_broken = alpha_max, False  # By a state.
        self._proof: Proof | None = None
        self._refutation: Refutation | None = None

    @property
    def level(self) -> ProvenLevel:
        """The result so far."""
        if self._proof is None:
            raise TypeError("expected a level that was tried")
        return ProvenLevel(proof=self._proof, refutation=self._refutation)

    def proves(self, alpha: float, share: float, boxes: int = MOST_BOXES) -> bool:
        """Try to prove a level, in a fraction of the remaining work."""
        left = (self._until - now()) * share
        proof = prove_level(self._change, alpha, max_boxes=boxes, work=left)
        # A failure does not replace a proof.
        if proof.proven or self._proof is None or not self._proof.proven:
            self._proof = proof
        if not proof.proven:
            self._unproven, self._is_broken = alpha, False
            if proof.counterexample is not None:
                self._break(proof.counterexample)
        return proof.proven

    def refute(self, refutation: Refutation | None) -> None:
        """Take a counterexample into account."""
        if refutation is None:
            return
        if refutation.alpha <= self._unproven:
            self._unproven, self._is_broken = refutation.alpha, True
        if self._refutation is None or refutation.alpha < self._refutation.alpha:
            self._refutation = refutation

    def descend(self) -> None:
        """Try lower and lower levels until one is proven."""
        if self.proves(FIRST_SHARE * self._unproven, 0.7):
            return
        shares = iter(LOWER_SHARES)
        share = next(shares)
        while not self._is_late and self._unproven > SMALLEST_SHARE * self._alpha_max:
            if self.proves(share * self._unproven, 0.5):
                return
            share = next(shares, share)

    def tighten(self) -> None:
        """Try levels between the highest proven and the lowest unproven one."""
        while not self._is_late:
            proof = self.level.proof
            if not proof.proven or self._unproven <= TIGHT * proof.alpha:
                return
            # The middle in ratio; a state refutes its own level and no smaller one.
            alpha = float(np.sqrt(proof.alpha * self._unproven))
            if self._is_broken:
                alpha = max(alpha, NEARER_SHARE * self._unproven)
            self.proves(alpha, 1.0, max(MORE_BOXES * proof.boxes, FEW_BOXES))

    @property
    def _is_late(self) -> bool:
        return not now() < self._until

    def _break(self, e: Array) -> None:
        """Take a state into account at which c is not below 0, or not a number."""
        alpha, change = float(e @ self._change.P @ e), float(self._change.function(e))
        # It may lie slightly outside the ellipsoid that was tried.
        self._unproven, self._is_broken = min(alpha, self._unproven), True
        if change >= 0 and alpha <= self._alpha_max:
            self.refute(Refutation(alpha=alpha, e=e, change=change))


@dataclass(eq=False)
class NoProvenSetError(SwarmstartError, ValueError):
    """No design of a family has a level that was proven.

    Attributes:
        scales: The scales that were tried.
    """

    scales: tuple[float, ...]

    def __str__(self) -> str:
        """Say what was tried."""
        tried = ", ".join(f"{scale:g}" for scale in self.scales) or "none"
        return f"no level could be proven for any of the scales tried: {tried}"


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Candidate:
    """One design of a family.

    Attributes:
        scale: The number from which `design` made it, such as a factor of the weights.
        terminal_set: The design, with the proven level; with the level of its bounds if
            none was proven.
        level: Outcome of the search for the largest level that can be proven.
        size: Size of the proven set; minus infinity if none was proven.
    """

    scale: float
    terminal_set: TerminalSet
    level: ProvenLevel
    size: float


@checked(ellipsoid=of_kind(Ellipsoid, "an Ellipsoid"))
def log_volume(ellipsoid: Ellipsoid) -> float:
    """Compute the logarithm of an ellipsoid's volume, relative to the unit ball's.

    Args:
        ellipsoid: The set e'Pe <= alpha; the result is log sqrt(alpha^nx / det P).
    """
    _, log_determinant = np.linalg.slogdet(ellipsoid.P)
    return float(len(ellipsoid.P) * np.log(ellipsoid.alpha) - log_determinant) / 2


@checked(
    design=function(),
    change=function(),
    scales=several(a_number(), "a sequence of numbers"),
    rng=RNG,
    size=function(),
    work=WORK,
)
def largest_proven_set(
    design: Callable[[float], TerminalSet],
    change: Callable[[TerminalSet], Change],
    scales: Sequence[float],
    *,
    rng: np.random.Generator,
    size: Callable[[Ellipsoid], float] = log_volume,
    work: float = 60.0,
) -> tuple[Candidate, ...]:
    """Rank the designs of a family by the size of their proven sets.

    Args:
        design: Function: scale -> terminal set, with the level that its bounds allow.
        change: Function: terminal set -> its change c, from `continuous_change` or
            `held_change`.
        scales: The scales to try.
        rng: Source of randomness of the rays that look for counterexamples.
        size: Function: proven ellipsoid -> its size.
        work: Budget of work for the proofs of one design, in units of about a second.

    Returns:
        All candidates, the largest first; those without a proof last, in their order.

    Raises:
        NoProvenSetError: If no level was proven for any scale.
        SwarmstartError: As `design`, `refuted_level` and `prove_level` say.
    """
    found = []
    for scale in scales:
        designed = design(scale)
        if not isinstance(designed, TerminalSet):
            raise InvalidArgumentError(
                "design", designed, "a function to a TerminalSet"
            )
        with working():
            level = proven_level(change(designed), designed.alpha, rng=rng, work=work)
        measured = -np.inf
        if level.alpha > 0:
            designed = replace(designed, alpha=level.alpha)
            measured = size(designed.ellipsoid)
            if not a_number(finite=False).accepts(measured):
                raise InvalidArgumentError("size", measured, "a function to a number")
        found.append(
            Candidate(scale=scale, terminal_set=designed, level=level, size=measured)
        )
    if not any(candidate.level.alpha > 0 for candidate in found):
        raise NoProvenSetError(tuple(scales))
    # Stable: those of size minus infinity keep their order.
    return tuple(sorted(found, key=lambda candidate: -candidate.size))
